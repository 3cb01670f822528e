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

"""The worker thread: commands are quick, bounded, taken in one thread and cancelled at the end."""

import threading
import time

import pytest

from lava_ros.errors import LavaError
from lava_ros.ros.worker_status import WorkerState
from lava_ros.scene import Scene, Vent
from worker_bench import Bench, OUTSIDE, TERRAIN, VENT


@pytest.mark.parametrize('bench', [{'speed': 1.0, 'time_scale': 1000.0}], indirect=True)
def test_commands_are_quick_under_load(bench):
    """A busy simulation takes a command between two slices."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.now += 1.0
    bench.wait(lambda: bench.worker.status.is_behind)
    start = time.monotonic()
    bench.run(bench.worker.set_vents([VENT]))
    # Catching up with the clock would take a thousand seconds.
    assert time.monotonic() - start < 4.0


def test_a_flood_of_vents_is_coalesced(bench):
    """Of what waits the newest counts; simulated time goes on; nothing piles up."""
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,))))
    given = []
    set_vents = bench.simulation.set_vents

    def slow_set_vents(vents):
        time.sleep(0.01)
        given.append(vents[0].discharge)
        set_vents(vents)

    bench.simulation.set_vents = slow_set_vents
    futures = []
    for index in range(500):
        futures.append(bench.worker.set_vents([Vent((25.0, 15.0), 1.0 + index)]))
        bench.now += 0.001
        time.sleep(0.001)
        assert len(bench.worker._commands) < 10
    bench.run(futures[-1])
    assert bench.simulation.scene.vents[0].discharge == 500.0
    assert given == sorted(given)
    assert all(future.done() for future in futures)
    assert sum(not future.cancelled() for future in futures) == len(given) < 250
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))
    assert len(bench.simulation.advanced_to) > 3


def test_too_many_commands_are_refused(bench):
    """What cannot be coalesced is bounded: more is refused, and taken again when there is room."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.run(bench.worker.pause(True))
    bench.simulation.is_compiled.clear()
    slow = bench.worker.set_effects({}, horizon=3600.0)
    futures = [bench.worker.add_vent(OUTSIDE) for _ in range(1100)]
    refused = [future for future in futures if future.done()]
    assert 99 <= len(refused) <= 101
    with pytest.raises(LavaError, match='1000 waiting'):
        refused[0].result(0.0)
    bench.simulation.is_compiled.set()
    bench.run(slow)
    with pytest.raises(LavaError, match='a place on the terrain'):
        bench.run(futures[0])
    bench.run(bench.worker.pause(False))


def test_snapshots_come_on_request(bench):
    """A request renews the snapshot once there is something new, and says so once."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait(lambda: len(bench.shown) == 1)
    bench.worker.request_snapshot()
    time.sleep(0.25)
    assert len(bench.shown) == 1
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))
    assert len(bench.shown) == 1
    bench.worker.request_snapshot()
    bench.wait(lambda: len(bench.shown) == 2)
    assert bench.shown[-1].time == pytest.approx(0.5)


def test_everything_happens_in_one_thread(bench):
    """The simulation is made, advanced and read by the worker's thread alone."""
    threads = set()
    original = bench.make

    def make(scene):
        threads.add(threading.current_thread().name)
        return original(scene)

    bench.worker._make_simulation = make
    bench.run(bench.worker.set_terrain(TERRAIN))
    assert threads == {'lava simulation'}


def test_stop_cancels_what_waits():
    """Commands that were not run are cancelled, and the end is bounded in time."""
    bench = Bench()
    waiting = bench.worker.set_vents([VENT])
    bench.run(bench.worker.pause(False))
    assert bench.worker.stop(5.0)
    assert waiting.cancelled()
    assert bench.worker.status.state is WorkerState.STOPPED


def test_stop_reports_a_thread_that_is_stuck():
    """A thread that does not end in time is reported, not waited for."""
    bench = Bench()
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.simulation.slowness = 1.0
    bench.now += 0.5
    time.sleep(0.2)
    assert not bench.worker.stop(0.1)
    assert bench.worker.stop(5.0)
