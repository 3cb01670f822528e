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

"""Snapshots that are copied while the next steps run: of one moment, and the caller's alone."""

import gc

import numpy as np
import pytest
import warp as wp

from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation import simulation as simulation_module
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.streams import Reader
from lava_ros.simulation.diagnostics import FlowDiagnostics, moment_of
from solver import incline, only, simulated

VENTS = (Vent((60.0, 155.0), 20.0), Vent((160.0, 155.0), 5.0))


def flow(device):
    """Lava that comes down a valley with a hole in it, the same to the bit each time."""
    y, x = np.mgrid[0:30, 0:40]
    ground = 500.0 - x + 0.05 * (y - 15.0) ** 2
    ground[3:6, 20:30] = np.nan
    scene = Scene(Terrain(ground, 10.0), VENTS, lava=Lava())
    forced = {'cooling': True, 'solidification': True}
    return Simulation(scene, effects=forced, accuracy=Accuracy(deterministic=True), device=device)


def as_bytes(snapshot):
    """All that a snapshot says."""
    grids = (snapshot.thickness, snapshot.temperature, snapshot.frozen)
    numbers = (snapshot.time, snapshot.budget, snapshot.particle_count, snapshot.steps)
    return [grid.tobytes() for grid in grids], numbers


def test_a_begun_snapshot_is_of_its_moment(device):
    """It is what a snapshot would have been; what comes before its result does not show."""
    one, other = flow(device), flow(device)
    for time in (60.0, 120.0):
        one.advance(time)
        other.advance(time)
        pending, snapshot = one.begin_snapshot(), other.snapshot()
        one.advance(time + 30.0)
        one.set_vents(VENTS[:1])
        other.advance(time + 30.0)
        other.set_vents(VENTS[:1])
        assert snapshot.time == pytest.approx(time, abs=30.0)
        assert as_bytes(pending.result()) == as_bytes(snapshot)
        assert pending.result() is pending.result()
    assert np.isnan(snapshot.thickness[3:6, 20:30]).all()
    assert as_bytes(one.snapshot()) == as_bytes(other.snapshot())


def test_snapshots_that_are_kept_stay_as_they_are(device):
    """However many there are: memory is used again only when nobody has an array of it."""
    simulation = flow(device)
    kept, copies = [], []
    for number in range(6):
        simulation.advance(20.0 * (number + 1))
        snapshot = simulation.begin_snapshot().result()
        # a view keeps the memory, too
        kept.append((snapshot.thickness[2:], snapshot.temperature))
        copies.append([grid.copy() for grid in kept[-1]])
    del snapshot
    simulation.advance(140.0)
    # never asked for: nothing is lost with it
    simulation.begin_snapshot()
    for grids, copied in zip(kept, copies, strict=True):
        for grid, former in zip(grids, copied, strict=True):
            assert np.array_equal(grid, former, equal_nan=True)
    assert len({grids[0].ctypes.data for grids in kept}) == len(kept)


def test_memory_is_used_again(device):
    """In the long run a GPU's copies come to the same places, and few of them are page-locked."""
    array = wp.array(np.arange(8.0), dtype=wp.float64, device=device)
    reader, places = Reader(array.device), []
    for number in range(20 if array.device.is_cuda else 2):
        reader.before_writing()
        array.fill_(float(number))
        (values,) = reader.begin([array], beside=True)()
        assert (values == number).all()
        places.append(values.ctypes.data)
        del values
        gc.collect()
    if array.device.is_cuda:
        assert len(set(places)) == 1
        held = [reader.begin([array], beside=True)() for _ in range(6)]
        assert sum(reader._made.values()) == 4
        assert len({values.ctypes.data for (values,) in held}) == 6


def test_launches_under_way_change_nothing(monkeypatch):
    """One that is launched before the last one is looked at: the same times, steps and lava.

    There is more lava than there was room for at the start, and it comes far. Cells are laid
    around it at other stages, but before it is there.
    """
    ends = []
    monkeypatch.setattr(simulation_module, '_FIRST_CAPACITY', 256)
    for number in (1, 2):
        monkeypatch.setitem(simulation_module._UNDER_WAY, False, number)
        ground = incline(0.5, 30, 200, 10.0, top=900.0)
        simulation = simulated(
            ground,
            Lava(),
            Vent((60.0, 155.0), 100.0),
            effects=only('inertia'),
            spacing=5.0,
            thickness=0.4,
            deterministic=True,
        )
        room = simulation._state.capacity
        for time in (15.0, 15.001, 40.0):
            assert simulation.advance(time) >= time
        assert simulation._state.capacity > room
        assert simulation.most_particles == simulation.particle_count
        ends.append((simulation.steps, simulation.time, simulation.snapshot()))
    one, other = ends
    assert one[:2] == other[:2]
    np.testing.assert_array_equal(one[2].thickness, other[2].thickness)


def test_volumes_are_summed_where_they_are(device):
    """The sum is that of the particles that there are, of all numbers from none on."""
    simulation = flow(device)
    for time in (0.0, 60.0, 600.0):
        simulation.advance(time)
        held = simulation.sample().volume.sum()
        state, vents = simulation._state, simulation._vents
        moment = moment_of(FlowDiagnostics().take(state, vents).numpy(), state)
        assert moment.volume == pytest.approx(held, rel=1e-12)
        assert moment.particle_count == len(state.read_particles())
        assert moment.steps.count == simulation.steps
        assert moment.released.tolist() == vents.save()['released'].tolist()
        assert simulation.budget() == simulation.snapshot().budget
    assert moment.particle_count > 0
