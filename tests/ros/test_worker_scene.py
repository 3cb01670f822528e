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

"""The worker thread: terrain and vents come in any order, and what is refused changes nothing."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.ros.session import Origin
from lava_ros.ros.worker_status import WorkerState
from lava_ros.scene import Lava, Scene, Terrain
from worker_bench import OUTSIDE, TERRAIN, VENT


def test_vents_wait_for_terrain(bench):
    """The newest vents that come before the terrain are used with it."""
    first = bench.worker.set_vents([OUTSIDE])
    second = bench.worker.set_vents([VENT])
    bench.wait(first.cancelled)
    assert not second.done()
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.run(second)
    assert bench.simulation.scene.vents == (VENT,)


def test_waiting_vents_off_the_terrain_are_refused(bench):
    """When they turn out to be off the map, the terrain starts without them."""
    vents = bench.worker.set_vents([OUTSIDE])
    bench.run(bench.worker.set_terrain(TERRAIN))
    with pytest.raises(LavaError, match=r'vents\[0\].position'):
        bench.run(vents)
    assert bench.simulation.scene.vents == ()


def test_first_vents_start_again(bench):
    """Vents for a simulation without lava start it again: its resolution depends on them."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))
    bench.run(bench.worker.set_vents([VENT]))
    assert len(bench.made) == 2
    assert bench.simulation.scene.vents == (VENT,)
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))
    bench.run(bench.worker.set_vents([]))
    bench.run(bench.worker.add_vent(VENT))
    assert len(bench.made) == 2
    assert bench.worker.scene.vents == bench.simulation.scene.vents == (VENT,)


def test_what_vents_have_emitted_is_kept(bench):
    """Also of a vent that has closed, and of one that a simulation was resumed with."""
    earlier = replace(VENT, discharge=((0.0, 7.0), (2.0, 9.0)))
    scene = Scene(TERRAIN, (VENT,), lava=Lava())
    bench.run(bench.worker.pause(True))
    bench.run(bench.worker.go_on_with(lambda: bench.make(scene), scene, None, (earlier,)))
    bench.run(bench.worker.set_vents([replace(VENT, discharge=4.0)]))
    assert bench.worker.scene.vents[0].discharge == 4.0
    bench.simulation.time = 3.0
    bench.run(bench.worker.set_vents([]))
    (vent,) = bench.worker.eruption.schedule
    assert vent.discharge == ((0.0, 4.0), (3.0, 0.0))
    bench.run(bench.worker.reset())
    assert bench.worker.eruption.schedule == ()


def test_bad_input_changes_nothing(bench):
    """Refused vents and terrain leave the simulation as it was, and running."""
    with pytest.raises(LavaError, match='a terrain before'):
        bench.run(bench.worker.add_vent(VENT))
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,), lava=Lava())))
    for command in (
        bench.worker.set_vents([OUTSIDE]),
        bench.worker.add_vent(OUTSIDE),
        bench.worker.set_terrain(Terrain(np.zeros((4, 5)), 1.0, origin=(900.0, 0.0))),
    ):
        with pytest.raises(LavaError, match='position'):
            bench.run(command)
    assert bench.worker.scene.vents == bench.simulation.scene.vents == (VENT,)
    assert bench.simulation.scene.terrain is TERRAIN
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))


def test_a_refused_start_keeps_the_old_simulation(bench):
    """A scene the simulation itself refuses leaves the old one running."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.refusal = LavaError('device', 'cuda:9', 'one of cpu')
    with pytest.raises(LavaError, match='cuda:9'):
        bench.run(bench.worker.reset())
    bench.wait_for_state(WorkerState.RUNNING)
    bench.now += 0.5
    bench.wait(lambda: bench.made[0].time == pytest.approx(0.5))


def test_new_terrain_is_shown_at_once(bench):
    """A new terrain changes the snapshot, also in a pause."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.run(bench.worker.pause(True))
    other = Terrain(np.ones((7, 6)), 10.0)
    bench.run(bench.worker.set_terrain(other))
    assert bench.worker.latest.terrain is other
    bench.run(bench.worker.set_terrain(Terrain(np.ones((7, 6)), 10.0)))
    assert bench.simulation.scene.terrain is other


def test_what_goes_on_from_a_checkpoint_says_so_until_it_starts_anew(bench):
    """The origin is that of the simulation in use: a reset is an eruption of its own."""
    assert bench.worker.eruption.origin is None
    origin = Origin('bags/first', 120.0, 7)
    scene = Scene(TERRAIN, (VENT,), lava=Lava())
    bench.run(bench.worker.go_on_with(lambda: bench.make(scene), scene, origin))
    assert bench.worker.eruption.origin == origin
    bench.run(bench.worker.set_vents([]))
    assert bench.worker.eruption.origin == origin
    bench.run(bench.worker.reset())
    assert bench.worker.eruption.origin is None
