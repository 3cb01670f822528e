# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Every block of code in the documents runs as it is written: the README in every run.

The notebook and the blocks of other documents run nightly; every run parses their commands.

A block runs in a folder of its own, with the files that a reader would have (`furnished`). An HTML
comment before the block marks what cannot run here:

    <!-- not run: REASON -->                     the whole block, for one of REASONS
    <!-- not run: REASON: beginning; other -->   the lines of a shell block that begin like that
    <!-- run: together -->                       its lines are programs that run at the same time
    <!-- run: in one shell -->                   its lines install a clone (nightly)

A document that changes the package changes a copy, in which its other blocks then run:

    <!-- file: PATH -->                          the block is that file
    <!-- insert: PATH after: BEGINNING -->       insert the block after the line, or `before:` it
    <!-- replace: PATH: TEXT -->                 the block replaces the text
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
import json
import os
from pathlib import Path
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest
import rasterio
import yaml

from command_line import lava
from eruption import write_case
from install.installed_node import copy_checkout
import lava_ros
from lava_ros.cli.parser import parse_command_line
from lava_ros.ros.parameters import LIFECYCLE, PARAMETERS, SOURCES
from lava_ros.scene import scene_from_yaml
from ros_domain import outside

ROOT = Path(__file__).parents[1]

#: Why a block may stay unrun.
REASONS = {
    'installs': 'changes what is installed', 'tests': 'runs the tests, or is as slow',
    'a full ROS installation': 'ros2, rviz2 and similar programs are not on PyPI',
    'several machines': 'tests/forecast/test_cluster.py runs it',
    'a robot': 'needs one', 'a display': 'opens a window', 'a GPU': 'needs one',
    'no program': 'is text: a layout, a table, output',
}

NOTEBOOK = json.loads((ROOT / 'examples/lava_ros.ipynb').read_text(encoding='utf-8'))
CODE = [cell for cell in NOTEBOOK['cells'] if cell['cell_type'] == 'code']

#: Characters that only a shell understands.
SHELL = re.compile(r'[|&;<>$*`]')

DOCUMENTS = sorted(
    path
    for pattern in (
        '*.md', 'bags/*.md', 'docs/*.md', 'docs/how_to/*.md', 'docs/tutorials/*.md',
        'examples/*.md',
    )
    for path in ROOT.glob(pattern)
)


@dataclass(frozen=True)
class Block:
    """A block of code in a document."""

    document: str
    line: int
    language: str
    text: str
    remarks: tuple[str, ...]

    def __str__(self) -> str:
        return f'{self.document}:{self.line}'


def blocks() -> Iterator[Block]:
    for path in DOCUMENTS:
        lines = path.read_text(encoding='utf-8').splitlines()
        remarks: tuple[str, ...] = ()
        start, language = None, ''
        for number, line in enumerate(lines, 1):
            fence = re.match(r'\s*```\s*(\{?[\w-]*\}?)', line)
            if start is not None:
                if fence:
                    text = '\n'.join(lines[start : number - 1])
                    yield Block(str(path.relative_to(ROOT)), start, language, text, remarks)
                    start, remarks = None, ()
            elif fence:
                start, language = number, fence.group(1)
            elif comment := re.fullmatch(r'\s*<!--\s*(.*?)\s*-->\s*', line):
                remarks = (*remarks, comment.group(1))
            elif line.strip():
                remarks = ()


BLOCKS = list(blocks())


@pytest.fixture(scope='module')
def furnished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder with the files that a reader of the documents has."""
    folder = tmp_path_factory.mktemp('furnished')
    examples = ROOT / 'examples/observatory_files.py'
    subprocess.run([sys.executable, examples], cwd=folder, check=True)
    # a block that begins with a file name is that file
    for block in BLOCKS:
        if match := re.match(r'# (\w+\.yaml)\n', block.text):
            (folder / match.group(1)).write_text(block.text)
    write_case(folder / 'valley', hours=0.5)
    for name in ('bags/demo', 'runs/etna', 'runs/lidar'):
        shutil.copytree(ROOT / 'bags/sample', folder / name)
    for name in ('docs', 'examples', 'msg_configs'):
        shutil.copytree(ROOT / name, folder / name)
    return folder


@pytest.fixture
def shop(furnished: Path, tmp_path: Path) -> Path:
    """Return a copy of that folder for a block."""
    return shutil.copytree(furnished, tmp_path, dirs_exist_ok=True)


def _environment(folder: Path) -> dict[str, str]:
    programs = folder / '.bin'
    programs.mkdir()
    for name, words in (
        ('lava', '-m lava_ros.cli.main'), ('lava_node', '-m lava_ros.ros.node'),
        ('python', ''), ('python3', ''),
    ):
        program = programs / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
        program.chmod(0o755)
    return os.environ | {
        'PATH': f'{programs}{os.pathsep}{os.environ["PATH"]}',
        'PYTHONPATH': os.pathsep.join(filter(None, [str(ROOT), os.environ.get('PYTHONPATH')])),
        'MPLBACKEND': 'Agg',
    }


def _left_out(block: Block) -> tuple[str, ...]:
    """Return the beginnings of the lines that are not run, an empty one for all lines."""
    left_out: list[str] = []
    for remark in block.remarks:
        if match := re.fullmatch(r'not run: ([^:]+?)(?:: (.*))?', remark):
            reason, beginnings = match.groups()
            assert reason in REASONS, f'{block}: {reason} is none of {list(REASONS)}'
            left_out += [words.strip() for words in (beginnings or '').split(';')]
    return tuple(left_out)


def _commands(block: Block) -> list[str]:
    left_out = _left_out(block)
    lines = [line.strip() for line in block.text.replace('\\\n', ' ').splitlines()]
    return [line for line in lines if line and not line.startswith(('#', *left_out))]


def _is_run(block: Block) -> bool:
    return '' not in _left_out(block)


def _is_quick(block: Block) -> bool:
    return block.document == 'README.md' or block.language == 'yaml'


def _running(language: str, *, installs: bool = False) -> Any:
    """Return a parameter for each block of a language that runs in the unchanged package."""
    running = [
        pytest.param(item, marks=() if _is_quick(item) else pytest.mark.nightly)
        for item in STANDING
        if item.language == language and _is_run(item)
        and ('run: in one shell' in item.remarks) == installs
    ]
    return pytest.mark.parametrize('block', running, ids=str)


def _change(root: Path, block: Block, remark: str) -> None:
    kind, _, rest = remark.partition(': ')
    if kind == 'file':
        (root / rest).write_text(block.text + '\n')
        return
    match = re.fullmatch(r'(\S+?):? (?:(after|before): )?(.*)', rest)
    assert match, f'{block}: {remark}'
    name, side, anchor = match.groups()
    text = (root / name).read_text()
    if kind == 'replace':
        assert text.count(anchor) == 1, f'{block}: {anchor} is not in {name}, or more than once'
        (root / name).write_text(text.replace(anchor, block.text))
        return
    lines = text.split('\n')
    places = [index for index, line in enumerate(lines) if line.strip().startswith(anchor)]
    assert len(places) == 1, f'{block}: {len(places)} lines of {name} begin with {anchor}'
    at = places[0] + (side == 'after')
    (root / name).write_text('\n'.join([*lines[:at], *block.text.split('\n'), *lines[at:]]))


def _changes(block: Block) -> list[str]:
    return [remark for remark in block.remarks if re.match('file:|insert:|replace:', remark)]


CHANGING = sorted({block.document for block in BLOCKS if _changes(block)})
STANDING = [block for block in BLOCKS if block.document not in CHANGING]


def test_blocks_are_found_and_exceptions_have_reasons() -> None:
    known = {'sh', 'python', 'yaml'}
    assert known <= {block.language for block in BLOCKS if _is_run(block)}
    for block in BLOCKS:
        is_known = block.language in known or block.language.startswith('{')
        assert is_known or not _is_run(block), f'{block} is {block.language or "of no language"}'


def test_commands_in_blocks_have_known_options_and_parameters() -> None:
    """This includes commands that do not run here, except those of other programs."""
    known = {item.name for item in (*PARAMETERS, *SOURCES, *LIFECYCLE)}
    for block in (item for item in BLOCKS if item.language == 'sh'):
        for line in block.text.replace('\\\n', ' ').splitlines():
            call, _, ros = line.partition(' --ros-args')
            if call.startswith('lava ') and not SHELL.search(call):
                try:
                    parse_command_line(shlex.split(call, comments=True)[1:])
                except SystemExit as end:
                    assert end.code == 0, f'{block}: {line}'
            if re.match('lava(_node| ros node)', line):
                assert set(re.findall(r'-p "?([\w.]+):=', ros)) <= known, f'{block}: {line}'


@_running('sh')
def test_shell_blocks_succeed(block: Block, shop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    environment = _environment(shop)
    if 'run: together' in block.remarks:
        # the port of the document may be in use
        commands = [re.sub(r'^(lava watch.*?)( --port \d+)?$', r'\1 --port 0', command)
                    for command in _commands(block)]
        _run_together(commands, shop, environment)
        return
    monkeypatch.chdir(shop)
    for name, text in environment.items():
        monkeypatch.setenv(name, text)
    for command in _commands(block):
        first, *words = shlex.split(command, comments=True)
        if first == 'lava' and not SHELL.search(command):
            # faster than a process
            status, *output = lava(*words)
        else:
            done = subprocess.run(
                ['bash', '-c', command], capture_output=True, text=True, timeout=200.0, check=False
            )
            status, output = done.returncode, [done.stdout, done.stderr]
        assert status == 0, '\n'.join([f'{block}: {command}', *output])


@_running('sh', installs=True)
def test_installation_succeeds(block: Block, tmp_path: Path) -> None:
    """Run the lines in one shell, which does not know the checkout or its environment."""
    script = '\n'.join(_commands(block))
    (place,) = re.findall('(?m)^git clone URL (.*)$', block.text)
    copy_checkout(tmp_path / place)
    programs = tmp_path / '.bin'
    programs.mkdir()
    (programs / 'python3').symlink_to(Path(sys.executable).resolve())
    environment = {
        'HOME': str(tmp_path), 'PATH': f'{programs}{os.pathsep}{os.defpath}', 'LANG': 'C.UTF-8',
    }
    # pip needs the network of the machine
    done = outside(lambda: subprocess.run(
        ['bash', '-ec', script], cwd=tmp_path, env=environment, capture_output=True, text=True,
        timeout=1000.0, check=False,
    ))
    assert done.returncode == 0, f'{block}\n{done.stdout}\n{done.stderr}'
    assert f'lava_ros {lava_ros.__version__}' in done.stdout


def _run_together(commands: list[str], folder: Path, environment: dict[str, str]) -> None:
    logs = [folder / f'{number}.log' for number in range(len(commands))]
    running = []
    try:
        for command, log in zip(commands, logs, strict=True):
            with log.open('w') as file:
                words = ['bash', '-c', f'exec {command}']
                running.append(subprocess.Popen(
                    words, cwd=folder, env=environment, stdout=file, stderr=subprocess.STDOUT
                ))
        _wait_until_up(running, logs)
        _interrupt(running)
        for process, command, log in zip(running, commands, logs, strict=True):
            is_well = process.returncode in (0, 130, -signal.SIGINT)
            text = log.read_text()
            # a node that refuses its inputs runs on
            assert is_well and '[ERROR]' not in text, f'{command}\n{text}'
    finally:
        for process in running:
            process.kill()


def _wait_until_up(running: list[subprocess.Popen[bytes]], logs: list[Path]) -> None:
    """Wait until each process has ended, or has sockets and prints nothing more."""
    end = time.monotonic() + 60.0
    output, silent_since = -1, 0.0
    while output < 0 or time.monotonic() < silent_since + 1.0:
        if time.monotonic() > end:
            assert output >= 0, [process.args for process in running]
            return
        time.sleep(0.1)
        now = sum(log.stat().st_size for log in logs)
        are_up = all(process.poll() is not None or _has_sockets(process) for process in running)
        if are_up and now != output:
            output, silent_since = now, time.monotonic()


def _has_sockets(process: subprocess.Popen[bytes]) -> bool:
    with suppress(OSError):
        links = Path(f'/proc/{process.pid}/fd').iterdir()
        return any(os.readlink(link).startswith('socket:') for link in links)
    return False


def _interrupt(running: list[subprocess.Popen[bytes]]) -> None:
    """Send SIGINT until all have ended: Python may miss one while it imports."""
    end = time.monotonic() + 60.0
    while any(process.poll() is None for process in running):
        assert time.monotonic() < end, [process.args for process in running]
        for process in running:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                with suppress(subprocess.TimeoutExpired):
                    process.wait(10.0)


@_running('python')
def test_python_blocks_run_and_print_no_nan(block: Block, shop: Path) -> None:
    printed = _python(block, shop, _environment(shop))
    assert not re.search(r'\bnan\b', printed), f'{block}\n{printed}'


def _python(block: Block, folder: Path, environment: dict[str, str]) -> str:
    done = subprocess.run(
        [sys.executable, '-c', block.text], cwd=folder, env=environment, capture_output=True,
        text=True, timeout=200.0, check=False,
    )
    assert done.returncode == 0, f'{block}\n{done.stdout}\n{done.stderr}'
    return done.stdout


@_running('yaml')
def test_yaml_blocks_are_scenes_or_parameters(block: Block, shop: Path) -> None:
    content = yaml.safe_load(block.text)
    if 'terrain' in content:
        (shop / 'block.yaml').write_text(block.text)
        scene_from_yaml(shop / 'block.yaml')
    else:
        parameters = content.get('/**', content.get('lava', {})).get('ros__parameters')
        assert parameters, f'{block}: neither a scene nor parameters'


@pytest.mark.nightly
@pytest.mark.parametrize('document', CHANGING)
def test_changes_of_the_package_fit_and_run(document: str, tmp_path: Path) -> None:
    shutil.copytree(ROOT / 'lava_ros', tmp_path / 'lava_ros')
    for block in (item for item in BLOCKS if item.document == document):
        for remark in _changes(block):
            _change(tmp_path, block, remark)
        if not _changes(block):
            assert block.language == 'python', block
            _python(block, tmp_path, os.environ | {'PYTHONPATH': str(tmp_path)})


def test_modules_of_the_reference_exist() -> None:
    page = (ROOT / 'docs/api.rst').read_text(encoding='utf-8')
    names = re.findall(r'^.. automodule:: (\S+)$', page, re.MULTILINE)
    assert len(names) > 20
    assert [name for name in names if find_spec(name) is None] == []


def test_notebook_has_no_outputs() -> None:
    assert (NOTEBOOK['nbformat'], NOTEBOOK['nbformat_minor']) == (4, 5)
    assert len({cell['id'] for cell in NOTEBOOK['cells']}) == len(NOTEBOOK['cells']) == 10
    assert len(CODE) == 9
    assert all(cell['outputs'] == [] and cell['execution_count'] is None for cell in CODE)


@pytest.mark.nightly
def test_cells_of_the_notebook_run_in_order(tmp_path: Path) -> None:
    cells = [''.join(cell['source']) for cell in CODE]
    cells += ["for number in plt.get_fignums(): plt.figure(number).savefig(f'{number}.png')"]
    cells += ["np.save('probability.npy', maps.probability)", 'print(budget.flowing)']
    text = '\n'.join(cells)
    block = Block('examples/lava_ros.ipynb', 1, 'python', text, ())
    flowing = float(_python(block, tmp_path, _environment(tmp_path)).split()[-1])
    assert len(list(tmp_path.glob('*.png'))) == 4
    # 40 m3/s for an hour, 15 for another, less the lava that waits in the vent
    assert 0.97 * 198_000.0 < flowing < 198_000.0
    with rasterio.open(tmp_path / 'maps/thickness.tif') as file:
        assert file.read(1, masked=True).sum() * 30.0**2 == pytest.approx(flowing, rel=1e-4)
    with rasterio.open(tmp_path / 'maps/inundation_probability.tif') as file:
        probability = file.read(1, masked=True)
    assert np.isclose(probability.max(), 100.0)
    # not multiples of 12.5: the error of the particle spacing widens the arrival of each member
    expected = np.load(tmp_path / 'probability.npy')[::-1]
    np.testing.assert_array_equal(probability.filled(np.nan), expected)


@pytest.mark.parametrize('page', sorted(Path(ROOT / 'docs').glob('*.md')), ids=Path.stem.fget)
def test_formulas_become_mathml(page):
    convert = pytest.importorskip('latex2mathml.converter').convert
    text = re.sub(r'```.*?```|`[^`\n]*`', '', page.read_text(encoding='utf-8'), flags=re.DOTALL)
    formulas = re.findall(r'\$\$(.+?)\$\$|(?<![\\$\w])\$([^$\n]+?)\$(?![\w$])', text, re.DOTALL)
    for formula in map(''.join, formulas):
        assert '\\' not in re.sub('<annotation.*?</annotation>', '', convert(formula)), formula
