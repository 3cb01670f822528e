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

"""When lava came to each cell, noted at every step."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.checkpoint import from_bytes
from solver import incline

TERRAIN = incline(0.2, 30, 40, 5.0)
SCENE = Scene(TERRAIN, (Vent((40.0, 75.0), 20.0),), lava=Lava())
END = 60.0


def made(**options):
    """A simulation on the CPU that notes arrivals."""
    return Simulation(SCENE, device='cpu', **{'notes_arrival': True, **options})


def test_times_are_those_of_maps_that_are_close():
    """One map at the end knows what a map every second does, and the flow is the same."""
    simulation = made()
    seen = np.full(TERRAIN.shape, np.nan)
    for time in np.arange(1.0, END + 1.0):
        simulation.advance(time)
        thickness = simulation.snapshot().thickness
        seen[np.isnan(seen) & (thickness >= COVERED)] = time
    one, plain = made(), made(notes_arrival=False)
    one.advance(END)
    plain.advance(END)
    shown = one.snapshot()
    assert plain.snapshot().arrived is None
    np.testing.assert_array_equal(shown.thickness, plain.snapshot().thickness)
    wet = shown.thickness >= COVERED
    assert wet.sum() > 50
    # lava 0.1 m thick in a part of a cell is not that thick on average
    missing = wet & np.isnan(shown.arrived)
    assert missing.sum() <= 0.02 * wet.sum()
    assert abs(np.nanmedian(seen - shown.arrived)) <= 2.0
    assert np.nanmin(shown.arrived) < 10.0 and np.nanmax(shown.arrived) <= END
    assert len(np.unique(shown.arrived[np.isfinite(shown.arrived)])) > 20


def test_times_go_on_after_a_checkpoint_and_on_another_ground():
    """What is resumed has them, and what flows on when the ground changes; not on other cells."""
    simulation = made()
    simulation.advance(20.0)
    before = simulation.snapshot().arrived
    copy = Simulation.resume(from_bytes(simulation.checkpoint().to_bytes()), device='cpu')
    np.testing.assert_array_equal(copy.snapshot().arrived, before)
    raised = replace(TERRAIN, elevation=TERRAIN.elevation + 3.0)
    copy.set_terrain(raised)
    copy.advance(25.0)
    after = copy.snapshot().arrived
    known = np.isfinite(before)
    np.testing.assert_array_equal(after[known], before[known])
    copy.set_terrain(replace(TERRAIN, origin=(-5.0, 0.0)))
    assert not np.isfinite(copy.snapshot().arrived).any()


def test_times_of_another_map_are_refused():
    """A checkpoint has them for its own cells."""
    simulation = made()
    checkpoint = simulation.checkpoint()
    arrays = {**checkpoint.arrays, 'arrived.times': np.zeros((2, 2), np.float32)}
    with pytest.raises(LavaError, match='checkpoint.arrived'):
        Simulation.resume(replace(checkpoint, arrays=arrays), device='cpu')
