# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Any command line of `lava` starts its work, or is refused in one line."""

import argparse
from collections.abc import Iterator
from functools import cache
import logging
from pathlib import Path
import tempfile
from typing import Any

from hypothesis import note, settings
from hypothesis import strategies as st
import numpy as np
import pytest
import yaml

from command_line import lava, parser_of
from eruption import write_case
from fuzz.limits import bounded
from lava_ros.cli import scenes
from lava_ros.scene import emplaced, reshaping, terrain_files
from lava_ros.scene import scene as scene_module

#: Maximum growth of memory in a command [bytes].
MEMORY = 2 << 30

SAMPLE = Path(__file__).parents[2] / 'bags/sample'

#: Commands that compute or draw, with their required arguments.
COMMANDS = {
    'check accuracy': [],
    'barrier': ['ground.npz', '-o', 'ground.tif', '--line', '0,100', '400,150', '--height', '5'],
    'check solver': [],
    'check speed': ['steps'],
    'calibrate': ['valley'],
    'ros demo': [],
    'effects': ['scene.yaml'],
    'export': [str(SAMPLE), '-o', 'maps'],
    'materials': [],
    'places': [str(SAMPLE), 'places.csv'],
    'plan': ['scene.yaml', '--within', '1min'],
    'run': ['scene.yaml', '-o', 'out'],
    'map': [str(SAMPLE), '-o', 'frame.png'],
}

#: Other required arguments of a command: an ensemble, and a mapped eruption.
MORE = {'run': [['scene.yaml', '-o', 'out', '--members', '4'], ['valley'], [
    'valley', '-o', 'out', '--members', '4']]}

#: Functions that start the work, after arguments and files are checked.
WORK = (
    'lava_ros.products.animation.new_figure', 'lava_ros.clients.monitor.Monitor.__init__',
    'lava_ros.forecast.pool.Pool.__init__', 'lava_ros.simulation.simulation.Simulation.__init__',
)

WHOLE = (
    '0', '-0', '-1', '1', '2', '8', '64', '101', '1_000', '2000000',
    '99999999999999999999', '-99999999999999999999', '9' * 400, '9' * 5000, '\u0663', '',
)
NUMBERS = (
    *WHOLE, '3.5', '1e-3', '1e3', '1e9', '1e18', '1e300', '1e-300', '5e-324', '1e309', 'inf',
    '-inf', 'nan',
)
TIMES = ('1h', '0h', '-1h', '1e309s', '1e300d', '1e-320s', 'infh', 'nand', '9' * 400 + 'd', '1hh')
PLACES = (
    '0,0', '1e300,0', 'nan,nan', '1,2,3', ',', 'inf,5', '200,100', '200,100.0000001', '0,1e-200',
)
NAMES = (
    'draft', 'cells', 'auto', 'cpu', 'cuda:0', 'inertia', 'etna_basalt', 'steps', 'viscosity',
    'viscosity=1:2', 'viscosity=nan:inf', 'discharge=-1:1e300', 'new.json', 'none/new.json',
    'ground.npz', 'valley', 'scene.yaml', '.', 'x' * 300, '\udcff',
)
WORDS = {
    int: st.sampled_from(WHOLE) | st.integers(-10, 200).map(str),
    float: st.sampled_from(NUMBERS) | st.floats().map(repr),
    None: st.sampled_from(NUMBERS + TIMES + PLACES + NAMES) | st.text(
        st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=5
    ),
}


class BegunError(BaseException):
    """The command accepted its arguments, and would start its work now."""


@cache
def options(command: str) -> list[argparse.Action]:
    """Return the options of a command."""
    actions = parser_of(command)._actions
    return [item for item in actions if item.option_strings and item.dest != 'help']


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    """Draw a command with up to three of its options, and values that may suit them."""
    command = draw(st.sampled_from(sorted(COMMANDS)))
    words = [command, *draw(st.sampled_from([COMMANDS[command], *MORE.get(command, [])]))]
    known = options(command)
    for action in draw(st.lists(st.sampled_from(known), max_size=3)) if known else ():
        flag = action.option_strings[-1]
        if action.nargs == 0 or (action.nargs == '?' and draw(st.booleans())):
            words.append(flag)
            continue
        count = {'+': draw(st.integers(1, 3)), '?': 1, None: 1}.get(action.nargs, action.nargs)
        values = [draw(WORDS.get(action.type, WORDS[None])) for _ in range(count)]
        # after = a value may begin with a hyphen
        words += [f'{flag}={values[0]}'] if count == 1 else [flag, *values]
    return words


def outcome(words: list[str]) -> tuple[int | None, str]:
    """Return the exit status and stderr of a command; None if its work began."""
    with bounded(MEMORY):
        try:
            status, _, errors = lava(*words)
        except BegunError:
            return None, ''
    return status, errors


@pytest.fixture
def place(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Enter a folder with a scene, a terrain and a case, where no work is done."""

    def begin(*args: Any, **options: Any) -> None:
        raise BegunError

    for name in WORK:
        monkeypatch.setattr(name, begin)
    # do not log the files that were read
    for module in (emplaced, terrain_files, scene_module, scenes, reshaping):
        monkeypatch.setattr(logging.getLogger(module.__name__), 'disabled', True)
    with tempfile.TemporaryDirectory() as folder:
        monkeypatch.chdir(folder)
        north = np.arange(30)[:, None] * 20.0
        ground = np.broadcast_to(500.0 - 0.1 * north, (30, 24))
        np.savez('ground.npz', elevation=ground, resolution=20.0)
        Path('places.csv').write_text('name,x,y\nhut,240,200\n')
        write_case(Path('valley'))
        Path('scene.yaml').write_text(yaml.safe_dump({
            'terrain': {'file': 'ground.npz'},
            'vents': [{'position': [240.0, 100.0], 'discharge': 10.0, 'radius': 30.0}],
            'lava': {'viscosity': 5e3},
            'uncertainty': {'position': {'deviation': 20.0}},
        }))
        yield


def test_command_lines_are_accepted_or_refused(in_part: Any, place: None, trial: Any) -> None:
    def is_accepted_or_refused(words: list[str]) -> None:
        note(' '.join(['lava', *words]))
        with trial('command lines') as row:
            status, errors = outcome(words)
            if status:
                row['refused'] += 1
                assert status in (1, 2), errors
                assert errors.startswith(('lava: ', f'lava {words[0]}: ')), errors
                noted = 'will be replaced', 'of mean rates'
                lines = [line for line in errors.splitlines() if not any(n in line for n in noted)]
                assert len(lines) == 1 and len(errors) < 1600, errors

    # a command takes a tenth of a second
    tried = settings(max_examples=15) if settings().derandomize else settings()
    in_part(is_accepted_or_refused, tried, words=command_lines())


@pytest.mark.parametrize('words', [
    ['calibrate', 'valley', '--seed=-1'],
    ['run', 'valley', '--runs=0'],
    ['run', 'valley', '--runs=1000000000'],
    ['plan', 'scene.yaml', '--within', '1min', '--members', '9' * 5000],
    ['plan', 'scene.yaml', '--within', '1e305d'],
    ['check speed', 'steps', '--repetitions=1000000000'],
    ['check accuracy', '--repetitions=1000000000'],
    ['check solver', '--json', 'x' * 300],
    ['ros demo', '--output', 'x' * 300],
    ['export', str(SAMPLE), '-o', '\udcff'],
    ['barrier', 'ground.npz', '-o', 'new.tif', '--height=5', '--line', '0,0', '0,1e-200'],
    ['export', str(SAMPLE), '-o', 'maps', '--at=nan'],
    ['export', str(SAMPLE), '-o', 'maps', '--epsg=0'],
])
def test_refuses_command_lines_that_fuzzing_found(words: list[str], place: None) -> None:
    status, errors = outcome(words)
    assert status == 2 and len(errors.splitlines()) == 1, errors
