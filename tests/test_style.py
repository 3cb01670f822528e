# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rules of ROS's linters, checked without them: whitespace, tables, package.xml."""

import csv
from pathlib import Path
import re
import subprocess
from xml.etree import ElementTree

import yaml

ROOT = Path(__file__).parents[1]

#: Folders of code and configuration of this package.
FOLDERS = ('docs', 'examples', 'foxglove', 'launch', 'lava_ros', 'msg_configs', 'params', 'rviz')
FOLDERS += ('schemas', 'tests')

#: Suffixes of text files; Python is ruff's.
TEXTS = ('.csv', '.ini', '.json', '.md', '.rst', '.rviz', '.toml', '.txt', '.xml', '.yaml')


def test_text_files_have_unix_lines_without_trailing_blanks() -> None:
    folders = [path for name in FOLDERS for path in (ROOT / name).rglob('*')]
    for path in (*ROOT.glob('*'), *folders):
        if path.suffix not in TEXTS or '_build' in path.parts:
            continue
        data = path.read_bytes()
        assert data == b'' or data == data.rstrip() + b'\n', f'{path}: end'
        assert not re.search(rb'[ \t\r\f\v]\n', data), f'{path}: trailing blanks'


def test_rows_of_committed_tables_are_complete() -> None:
    paths = list((ROOT / 'docs/benchmarks').glob('*.csv'))
    assert paths
    for path in paths:
        with path.open(newline='', encoding='utf-8') as file:
            names, *rows = csv.reader(file)
        assert len(names) > 1 and rows, path
        assert {len(row) for row in rows} == {len(names)}, path


def test_elements_of_package_xml_are_in_order() -> None:
    order = ['name', 'version', 'description', 'maintainer', 'license', 'url', 'author']
    order += ['build_depend', 'buildtool_depend', 'exec_depend', 'doc_depend', 'test_depend']
    order += ['export']
    tags = [item.tag for item in ElementTree.parse(ROOT / 'package.xml').getroot()]
    assert set(tags) <= set(order)
    assert tags == sorted(tags, key=order.index)


def test_hooks_pin_their_tools() -> None:
    hooks = yaml.safe_load((ROOT / '.pre-commit-config.yaml').read_text(encoding='utf-8'))
    (repository,) = hooks['repos']
    assert repository['repo'] == 'local'
    names = {hook['id'] for hook in repository['hooks']}
    assert {'ruff', 'mypy', 'check-xml', 'trailing-whitespace', 'end-of-file'} <= names
    for hook in repository['hooks']:
        if hook['language'] == 'python':
            assert all('==' in item for item in hook['additional_dependencies']), hook['id']


def test_make_lint_runs_the_tools_of_the_hooks() -> None:
    recipe = subprocess.check_output(['make', '--dry-run', 'lint'], cwd=ROOT, text=True)
    text = (ROOT / '.pre-commit-config.yaml').read_text(encoding='utf-8')
    words = {word.strip("'") for word in recipe.split()}
    (ruff,) = (word for word in words if word.startswith('ruff=='))
    assert f'[{ruff}]' in text
    assert 'entry: make types\n' in text
    assert any(word.startswith('mypy==') for word in words)
