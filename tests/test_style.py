# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rules of ROS's linters, checked without them: headers, XML, whitespace."""

import csv
from pathlib import Path
import re
import subprocess
from xml.etree import ElementTree

import pytest
import yaml

ROOT = Path(__file__).parents[1]

#: Folders of code and configuration of this package.
FOLDERS = ('docs', 'examples', 'foxglove', 'launch', 'lava_ros', 'msg_configs', 'params', 'rviz')
FOLDERS += ('schemas', 'tests')

#: Suffixes of text files; Python is ruff's.
TEXTS = ('.csv', '.ini', '.json', '.md', '.rst', '.rviz', '.toml', '.txt', '.xml', '.yaml')

#: The first lines of every module.
HEADER = '''\
# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0
'''


def _files(*suffixes: str) -> list[Path]:
    found = [path for path in ROOT.glob('*') if path.suffix in suffixes and path.is_file()]
    for folder in FOLDERS:
        found += [path for path in (ROOT / folder).rglob('*') if path.suffix in suffixes]
    return sorted(path for path in found if '_build' not in path.parts)


def test_every_module_has_the_license_header() -> None:
    modules = _files('.py')
    assert len(modules) > 200
    for path in modules:
        text = path.read_text(encoding='utf-8').removeprefix('#!/usr/bin/env python3\n')
        assert text.startswith(HEADER), path


def test_text_files_have_unix_lines_without_trailing_blanks() -> None:
    for path in _files(*TEXTS):
        data = path.read_bytes()
        assert data == b'' or data == data.rstrip() + b'\n', f'{path}: end'
        assert not re.search(rb'[ \t\r\f\v]\n', data), f'{path}: trailing blanks'


@pytest.mark.parametrize('path', _files('.xml'), ids=lambda path: path.name)
def test_xml_is_well_formed(path: Path) -> None:
    ElementTree.parse(path)


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
