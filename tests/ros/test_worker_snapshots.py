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

"""The worker thread: snapshots are finished while the simulation goes on."""

import time

import pytest

from lava_ros.ros.worker_status import WorkerState
from lava_ros.scene import Lava, Scene
from worker_bench import TERRAIN, VENT


@pytest.fixture
def copying(bench):
    """A simulation half a second old, of which a snapshot is on its way and does not come."""
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,), lava=Lava())))
    go_on(bench, 0.5)
    bench.simulation.is_copied.clear()
    bench.worker.request_snapshot()
    bench.wait(lambda: bench.simulation.begun == 1)
    yield bench
    for simulation in bench.made:
        simulation.is_copied.set()


def go_on(bench, seconds):
    """Let simulated time go on."""
    until = bench.simulation.time + seconds
    bench.now += seconds
    bench.wait(lambda: bench.simulation.time == pytest.approx(until))


def test_the_simulation_goes_on_meanwhile(copying):
    """Time passes while it is on its way, and what is shown then is of the moment it was begun."""
    shown = len(copying.shown)
    go_on(copying, 0.5)
    assert copying.worker.latest.time == 0.0
    copying.simulation.is_copied.set()
    copying.wait(lambda: len(copying.shown) > shown)
    assert copying.shown[-1].time == pytest.approx(0.5)
    assert copying.worker.latest is copying.shown[-1]


def test_what_is_asked_for_meanwhile_comes_next(copying):
    """However often: one more is begun when the first is there, and none is lost."""
    for _ in range(3):
        go_on(copying, 0.5)
        copying.worker.request_snapshot()
    assert copying.simulation.begun == 1
    copying.simulation.is_copied.set()
    copying.wait(lambda: copying.worker.latest.time == pytest.approx(2.0))
    assert copying.simulation.begun == 2


def test_a_flaw_that_shows_late_fails_the_simulation(bench):
    """As one that shows at once; what was shown before stays."""
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,), lava=Lava())))
    last = bench.worker.latest
    bench.simulation.flawed = True
    go_on(bench, 0.5)
    bench.simulation.is_copied.clear()
    bench.worker.request_snapshot()
    bench.wait(lambda: bench.simulation.begun == 1)
    go_on(bench, 0.5)
    assert bench.worker.status.state is WorkerState.RUNNING
    bench.simulation.is_copied.set()
    bench.wait_for_state(WorkerState.FAILED)
    assert 'thickness is not a number of metres in 20 cells' in bench.worker.status.error
    assert bench.worker.latest is last


def test_a_flaw_of_the_former_simulation_is_none_of_the_next(bench):
    """A reset meanwhile: the new simulation runs, and shows itself."""
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,), lava=Lava())))
    bench.simulation.flawed = True
    go_on(bench, 0.5)
    former = bench.simulation
    former.is_copied.clear()
    bench.worker.request_snapshot()
    bench.wait(lambda: former.begun == 1)
    reset = bench.worker.reset()
    bench.wait(lambda: len(bench.made) == 2)
    former.is_copied.set()
    bench.run(reset)
    time.sleep(0.1)
    bench.wait_for_state(WorkerState.RUNNING)
    assert bench.worker.latest.time == 0.0


def test_what_is_at_rest_has_been_waited_for(copying):
    """A pause shows the state that stands still, not the one that was on its way."""
    go_on(copying, 0.5)
    copying.worker.pause(True)
    time.sleep(0.1)
    assert copying.worker.latest.time == 0.0
    copying.simulation.is_copied.set()
    copying.wait_for_state(WorkerState.PAUSED)
    assert copying.worker.latest.time == pytest.approx(1.0)
    copying.wait(lambda: copying.shown[-1].time == pytest.approx(1.0))


def test_the_end_waits_for_it(copying):
    """Stopping leaves no thread behind."""
    copying.simulation.is_copied.set()
    assert copying.worker.stop(60.0)
    assert copying.worker.latest.time == pytest.approx(0.5)
