# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What is no number any more must show: as a flaw of the snapshot, never as dry ground."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.scene import Lava, Terrain, Vent
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.snapshot import Snapshot, StepReport
from solver import simulated

COLUMNS = {'x': 0, 'y': 1, 'volume': 2, 'temperature': 3}


def slope():
    """A plane with a valley along its middle."""
    y, x = np.mgrid[0:30, 0:40]
    return Terrain(500.0 - x + 0.05 * (y - 15.0) ** 2, 10.0)


@pytest.fixture
def flow(device):
    """Lava that has come a little way."""
    simulation = simulated(slope(), Lava(), Vent((60.0, 155.0), 20.0), device=device)
    simulation.advance(120.0)
    assert simulation.snapshot().flaw() == ''
    return simulation


@pytest.mark.parametrize('value', [np.nan, np.inf])
@pytest.mark.parametrize('name', COLUMNS)
def test_a_broken_particle_shows(flow, name, value):
    """One particle that is no number any more spoils the snapshot, at once and later on."""
    rows = flow._state.particle.numpy()
    rows[3, COLUMNS[name]] = value
    flow._state.particle.assign(rows)
    assert flow.snapshot().flaw()
    flow.advance(150.0, wall_limit=5.0)
    assert flow.snapshot().flaw()


def test_a_particle_flung_far_away_has_left(flow):
    """Far away is a place: what is there has left, its volume is accounted for, nothing is odd."""
    rows = flow._state.particle.numpy()
    rows[3, 0] += 1e30
    flow._state.particle.assign(rows)
    flow.advance(150.0, wall_limit=5.0)
    assert flow.snapshot().flaw() == ''
    assert flow.budget().error < 1e-5


def test_lava_around_a_broken_particle_is_not_dry(flow):
    """Cells whose sum is no number are no number on the map, not 0."""
    before = flow.snapshot().thickness
    rows = flow._state.particle.numpy()
    rows[3, 2] = np.nan
    flow._state.particle.assign(rows)
    after = flow.snapshot().thickness
    assert np.isnan(after[before > 0.1]).any()
    assert not ((before > 0.1) & (after == 0.0)).any()


def snapshot():
    """A snapshot without lava, with one cell without data."""
    elevation = np.zeros((4, 5))
    elevation[0, 0] = np.nan
    thickness = np.zeros((4, 5), np.float32)
    thickness[0, 0] = np.nan
    return Snapshot(
        time=1.0,
        terrain=Terrain(elevation, 10.0),
        thickness=thickness,
        temperature=np.full((4, 5), np.nan, np.float32),
        budget=VolumeBudget(0.0, 0.0, 0.0, 0.0),
        particle_count=0,
        steps=StepReport(1, 1, 1, 1.0, 'longest'),
    )


def spoilt(**cells):
    """The same with values put into cell (1, 2) of its arrays."""
    good = snapshot()
    arrays = {name: getattr(good, name).copy() for name in cells}
    for name, value in cells.items():
        arrays[name][1, 2] = value
    return replace(good, **arrays)


def test_a_sound_snapshot_has_no_flaw():
    """Unknown ground and dry cells without temperature are as they should be."""
    assert snapshot().flaw() == ''
    assert spoilt(thickness=0.5, temperature=1300.0).flaw() == ''


@pytest.mark.parametrize(
    ('broken', 'words'),
    [
        (lambda: replace(snapshot(), time=np.nan), 'time nan s'),
        (lambda: replace(snapshot(), budget=VolumeBudget(1.0, np.nan, 0.0, 0.0)), 'held=nan'),
        (lambda: replace(snapshot(), budget=VolumeBudget(1.0, 1.0, 0.0, np.inf)), 'left=inf'),
        (lambda: spoilt(thickness=np.nan), 'thickness is not a number of metres in 1 cell'),
        (lambda: spoilt(thickness=np.inf), 'thickness'),
        (lambda: spoilt(thickness=-0.1), 'thickness'),
        (lambda: spoilt(thickness=0.5), 'temperature is not a number of kelvin in 1 cell'),
        (lambda: spoilt(thickness=0.5, temperature=-3.0), 'temperature'),
        (lambda: spoilt(thickness=0.5, temperature=np.inf), 'temperature'),
    ],
)
def test_flaws_are_named(broken, words):
    """Each says what is wrong and in how many cells."""
    assert words in broken().flaw()
