# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Files that lie about themselves: a result, or one error, soon, in memory that does not grow."""

from collections.abc import Callable, Iterator
from pathlib import Path
import random
import shutil
from typing import Any
import warnings

from hypothesis import given, Phase, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from command_line import lava
from fuzz.files import (
    hostile_bag,
    hostile_case,
    hostile_raster,
    hostile_rates,
    hostile_scene,
    hostile_vents,
)
from fuzz.limits import bounded
from lava_ros.bag.replay import schedule
from lava_ros.errors import LavaError
from lava_ros.hindcast.case import load_case
from lava_ros.scene import Terrain
from lava_ros.scene.effusion_rates import Options, read_effusion_rates
from lava_ros.scene.vent_files import read_vents
from recording import record

#: Files of each kind, and bags, which take seconds each: 25 and 6 in every test run, 500 in
#: `make nightly`.
FILES = max(1, settings.default.max_examples // 4)
BAGS = FILES if FILES > 25 else 6

#: Most that reading a file may take beside what is there [bytes].
MEMORY = 3 << 30

SEEDS = st.integers(0, 2**63)

# a smaller seed makes no smaller file
files = settings(max_examples=FILES, phases=[Phase.generate])


def call(*words: object) -> tuple[int, str]:
    """Call the command line within bounds: its exit status and all that it prints."""
    with bounded(MEMORY), warnings.catch_warnings():
        # what numpy warns of is a number that was not looked at
        warnings.simplefilter('error', RuntimeWarning)
        status, *said = lava(*words)
    said = ''.join(said)
    assert status in (0, 1, 2), said
    assert 'no memory is left' not in said
    assert said.replace('\n', '').replace('\t', '').isprintable()
    # 2: refused by an error that says what would be right
    assert status == 0 or 'expected' in said or 'damaged' in said or 'cut off' in said, said
    return status, said


@pytest.fixture(scope='module')
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small bag."""
    return record(tmp_path_factory.mktemp('sound') / 'bag', (200.0, 400.0))


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], Path]:
    """Makes an empty folder, in the place of the one before."""
    path = tmp_path_factory.mktemp('files') / 'folder'

    def fresh() -> Path:
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir()
        return path

    return fresh


@pytest.fixture(scope='module', autouse=True)
def unpublished() -> Iterator[None]:
    """A replay goes through the bag and publishes nothing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('lava_ros.ros.player.play', lambda bag, **_: sum(1 for _ in schedule(bag)))
        yield


def test_bags(in_share: Any, sound: Path, folder: Callable[[], Path], trial: Any) -> None:
    """Commands that read one; what is recovered is a bag without damage."""

    def is_read_or_refused(number: int) -> None:
        chance = random.Random(number)
        path = folder()
        hostile_bag(chance, sound, path / 'bag')
        commands = [
            ('info', path / 'bag'),
            ('info', path / 'bag', '--json', path / 'out.json'),
            ('replay', path / 'bag'),
            ('plot', path / 'bag', '-o', path / 'out.png'),
            ('report', path / 'bag', '-o', path / 'out.html'),
            ('export', path / 'bag', '-o', path / 'out', '--every'),
            ('recover', path / 'bag', path / 'new'),
        ]
        with trial('files') as row:
            statuses = [call(*words)[0] for words in chance.sample(commands, 2)]
            row['refused'] += any(statuses)
            if (path / 'new').exists():
                status, said = call('info', path / 'new')
                assert (status, 'damaged (' in said) == (0, False), said

    in_share(is_read_or_refused, settings(files, max_examples=BAGS), number=SEEDS)


@files
@given(seed=SEEDS)
def test_cases(seed: int, folder: Callable[[], Path], trial: Any) -> None:
    """A hindcast's folder with a value of any kind in a file."""
    path = folder() / 'case'
    hostile_case(random.Random(seed), path)
    with trial('files') as row, bounded(MEMORY):
        try:
            case = load_case(path)
        except LavaError as error:
            row['refused'] += 1
            assert error.field
        else:
            assert case.volume > 0.0 and case.duration > 0.0


@files
@given(seed=SEEDS)
def test_rasters(seed: int, folder: Callable[[], Path], trial: Any) -> None:
    """Ground whose header does not fit what follows."""
    path = hostile_raster(random.Random(seed), folder())
    with trial('files') as row:
        row['refused'] += bool(call('effects', '--terrain', path)[0])


GROUND = Terrain(np.zeros((6, 7)), 10.0)


@files
@given(seed=SEEDS)
def test_vents(seed: int, folder: Callable[[], Path], trial: Any) -> None:
    """A vector file with other bytes: its vents have finite numbers, or one error has a name."""
    path = hostile_vents(random.Random(seed), folder())
    with trial('files') as row, bounded(MEMORY):
        try:
            vents = read_vents('--vents', path, GROUND)
        except LavaError as error:
            row['refused'] += 1
            assert error.field
        else:
            places = [place for vent in vents for place in vent.places]
            assert np.isfinite(places).all() and places


@files
@given(seed=SEEDS)
def test_tables_of_rates(seed: int, folder: Callable[[], Path], trial: Any) -> None:
    """A table with any text in a cell: intervals in order, or one error with a name."""
    chance = random.Random(seed)
    path = hostile_rates(chance, folder())
    options = Options(gaps=chance.choice((None, 'zero', 'interpolate')))
    with trial('files') as row, bounded(MEMORY):
        try:
            rates = read_effusion_rates('--effusion-rate', path, options)
        except LavaError as error:
            row['refused'] += 1
            assert error.field
        else:
            numbers = [(item.start, item.end, item.discharge) for item in rates]
            assert np.isfinite(numbers).all()
            assert all(start < end and rate >= 0.0 for start, end, rate in numbers)


@files
@given(seed=SEEDS)
def test_scenes(seed: int, folder: Callable[[], Path], trial: Any) -> None:
    """A scene with a value of any kind at any place."""
    path = hostile_scene(random.Random(seed), folder())
    with trial('files') as row:
        row['refused'] += bool(call('effects', path)[0])
