# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Hostile bags and rasters give a result or one error, soon and in bounded memory."""

from collections.abc import Callable, Iterator
from pathlib import Path
import random
import re
from typing import Any
import warnings

from hypothesis import given, Phase, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from command_line import lava
from fuzz.files import hostile_bag, hostile_raster
from fuzz.limits import bounded
from lava_ros.bag.replay import schedule
from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.scene.emplaced import KINDS, read_flows
from recording import record

#: Rasters of each kind, and bags, which are slow: 20 and 2 in a test run, 1,000 and 500 nightly.
FILES = max(1, settings.default.max_examples // 2)
BAGS = FILES // 2 if FILES > 20 else 2

SEEDS = st.integers(0, 2**63)

# a smaller seed does not make a smaller file
files = settings(max_examples=FILES, phases=[Phase.generate])


def call(*words: object) -> tuple[int, str]:
    """Call `lava` within limits; return its exit status and all output."""
    with bounded(), warnings.catch_warnings():
        # numpy warns of a number that was not checked
        warnings.simplefilter('error', RuntimeWarning)
        status, *output = lava(*words)
    output = ''.join(output)
    assert status in (0, 1, 2), output
    assert 'no memory is left' not in output
    assert output.replace('\n', '').replace('\t', '').isprintable()
    assert status == 0 or re.search('expected|damaged|cut off', output), output
    return status, output


@pytest.fixture(scope='module')
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a small bag."""
    return record(tmp_path_factory.mktemp('sound') / 'bag', (200.0, 400.0))


@pytest.fixture(scope='module', autouse=True)
def unpublished() -> Iterator[None]:
    """Let a replay read the bag without publishing it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('lava_ros.ros.player.play', lambda bag, **_: sum(1 for _ in schedule(bag)))
        yield


def test_hostile_bags(in_part: Any, sound: Path, folder: Callable[[], Path], trial: Any) -> None:
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
                status, output = call('info', path / 'new')
                assert (status, 'damaged (' in output) == (0, False), output

    in_part(is_read_or_refused, settings(files, max_examples=BAGS), number=SEEDS)


@files
@given(seed=SEEDS)
def test_hostile_rasters(seed: int, folder: Callable[[], Path], trial: Any) -> None:
    path = hostile_raster(random.Random(seed), folder())
    with trial('files') as row:
        row['refused'] += bool(call('effects', '--terrain', path)[0])


@files
@given(seed=SEEDS)
def test_hostile_emplaced_flows(seed: int, folder: Callable[[], Path], trial: Any) -> None:
    chance = random.Random(seed)
    path = hostile_raster(chance, folder())
    ground = Terrain(np.full((20, 20), 99.0), 10.0, epsg=32633, offset=(500_000.0, 4_179_800.0))
    item = {'file': path.name, 'as': chance.choice(KINDS)}
    with trial('files') as row, bounded():
        try:
            raised, flows = read_flows('flows', [item], path.parent, ground)
        except LavaError as error:
            row['refused'] += 1
            assert error.field
        else:
            assert np.isfinite(raised.elevation).all() and raised.elevation.min() >= 99.0
            for flow in flows:
                places, volumes = flow.columns(chance.choice((3.0, 10.0, 25.0)))
                assert np.isfinite(volumes).all() and ground.covered(places).all()

