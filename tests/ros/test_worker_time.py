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

"""The worker thread: simulated time follows the clock, pauses, steps, ends, starts again."""

import time

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.ros import worker_status as speed
from lava_ros.ros.worker import MAX_LAG
from lava_ros.ros.worker_status import LONGEST_TURN, SpeedMeter, WorkerState
from lava_ros.scene import Lava, Scene
from worker_bench import Bench, TERRAIN, VENT


def test_terrain_starts_the_simulation(bench):
    """The first terrain starts the simulation, which is shown at once."""
    assert bench.worker.status.state is WorkerState.WAITING
    assert bench.worker.latest is None
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait_for_state(WorkerState.RUNNING)
    assert bench.worker.latest.time == 0.0
    assert bench.worker.status.device == 'paper'


@pytest.mark.parametrize('bench', [{'time_scale': 60.0}], indirect=True)
def test_time_follows_the_clock(bench):
    """Simulated time is the clock's times the scale, from the start on."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(30.0))
    bench.run(bench.worker.set_time_scale(2.0))
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(31.0))


def test_a_clock_that_jumps(bench):
    """A jump back moves nothing, a jump ahead no more than the lag."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.now -= 50.0
    time.sleep(0.25)
    assert bench.simulation.time == 0.0
    bench.now += 1e9
    bench.wait(lambda: bench.simulation.time > 0.0)
    time.sleep(0.25)
    assert bench.simulation.time == pytest.approx(MAX_LAG)


@pytest.mark.parametrize('time_scale', [1.0, 1e2, 1e3, 1e4, 1e5])
def test_time_scales(time_scale):
    """At every scale time follows a clock that stutters, jumps and goes back, within the lag."""
    bench = Bench(time_scale=time_scale)
    try:
        bench.run(bench.worker.set_terrain(TERRAIN))
        expected, clock = 0.0, bench.now
        for step in (0.25, 0.0, 0.5, -30.0, 0.125, 1e6, -2e6, 0.5):
            clock += step
            bench.now = clock
            expected += min(max(step, 0.0), MAX_LAG) * time_scale
            bench.wait(lambda: bench.simulation.time == pytest.approx(expected))  # noqa: B023
            # The clock has to be seen where it is now before it moves on.
            bench.wait(lambda: bench.worker._last_clock == clock)  # noqa: B023
        steps = np.diff([0.0, *bench.simulation.advanced_to])
        assert (steps >= 0.0).all()
        assert steps.max() <= MAX_LAG * time_scale * (1.0 + 1e-9)
    finally:
        assert bench.worker.stop(60.0)


@pytest.mark.parametrize('bench', [{'speed': 5.0, 'time_scale': 100.0}], indirect=True)
def test_a_slow_simulation_does_not_chase_the_clock(bench):
    """Lost time is given up beyond the lag, and the achieved speed is reported."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    for _ in range(20):
        bench.now += 0.05
        time.sleep(0.05)
    bench.wait(lambda: bench.worker.status.is_behind)
    # Exactly 5 on an idle machine, less on a busy one.
    assert 0.0 < bench.worker.status.speed < 6.5
    # 100 s were asked for, and are the lag; asking goes on, the target does not move further.
    bench.now += 1000.0
    bench.wait(lambda: len(bench.simulation.advanced_to) > 12)
    assert bench.worker._target <= bench.simulation.time + MAX_LAG * 100.0 + 1e-6


def test_pause_and_step(bench):
    """A pause holds time and shows the last state; a step advances by its length."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))
    bench.run(bench.worker.pause(True))
    bench.wait_for_state(WorkerState.PAUSED)
    bench.wait(lambda: bench.worker.latest.time == pytest.approx(0.5))
    bench.now += 0.5
    time.sleep(0.25)
    assert bench.simulation.time == pytest.approx(0.5)
    bench.run(bench.worker.step(10.0))
    bench.wait(lambda: bench.worker.latest.time == pytest.approx(10.5))
    assert bench.worker.status.state is WorkerState.PAUSED
    bench.run(bench.worker.pause(False))
    bench.now += 0.25
    bench.wait(lambda: bench.simulation.time == pytest.approx(10.75))


def test_step_needs_a_pause(bench):
    """A running simulation cannot be stepped, nor one that is not there."""
    with pytest.raises(LavaError, match='step'):
        bench.run(bench.worker.step(1.0))
    bench.run(bench.worker.set_terrain(TERRAIN))
    with pytest.raises(LavaError, match='a paused simulation'):
        bench.run(bench.worker.step(1.0))


@pytest.mark.parametrize('bench', [{'end_time': 2.0, 'time_scale': 10.0}], indirect=True)
def test_end_time(bench):
    """The simulation stops at the end time exactly, shows it, and goes on when it is moved."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.now += 0.9
    bench.wait_for_state(WorkerState.FINISHED)
    bench.wait(lambda: bench.worker.latest.time == 2.0)
    bench.run(bench.worker.set_end_time(5.0))
    bench.wait_for_state(WorkerState.RUNNING)
    bench.now += 0.9
    bench.wait(lambda: bench.worker.latest.time == 5.0)
    bench.run(bench.worker.reset())
    bench.wait_for_state(WorkerState.RUNNING)
    assert bench.simulation.time < 5.0


def test_reset(bench):
    """A reset makes a new simulation of the scene at time 0; a pause stays."""
    with pytest.raises(LavaError, match='reset'):
        bench.run(bench.worker.reset())
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,), lava=Lava())))
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))
    bench.run(bench.worker.pause(True))
    bench.run(bench.worker.set_constants({'lava': Lava(viscosity=7.0)}))
    bench.run(bench.worker.reset())
    assert len(bench.made) == 2
    assert bench.simulation.scene.vents == (VENT,)
    assert bench.simulation.scene.lava.viscosity == 7.0
    assert bench.worker.latest.time == 0.0
    bench.wait_for_state(WorkerState.PAUSED)


def test_what_the_thread_is_at_is_told(bench):
    """While a command lasts, which one, since when and who waits; of steps the last one counts."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait(lambda: bench.worker.status.hold_up == '')
    bench.simulation.is_compiled.clear()
    compiling = bench.worker.set_effects({}, horizon=3600.0)
    bench.wait(lambda: bench.worker.status.doing == 'effects')
    reset = bench.worker.reset()
    before = bench.worker.status
    bench.wait(lambda: bench.worker.status.turn > before.turn)
    assert before.waiting == ('reset',)
    bench.simulation.is_compiled.set()
    bench.run(compiling)
    bench.run(reset)
    bench.simulation.slowness = LONGEST_TURN
    bench.now += 0.5
    bench.wait(lambda: bench.worker.status.turn >= LONGEST_TURN)
    assert bench.worker.status.hold_up.startswith('a step takes ')
    bench.simulation.slowness = 0.0
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(1.0))
    bench.wait(lambda: bench.worker.status.hold_up == '')


def test_the_mean_leaves_pauses_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs of 10 s at 3x and 1x with a long pause between them are 2x."""
    now = 0.0
    monkeypatch.setattr(speed.time, 'monotonic', lambda: now)
    meter = SpeedMeter()
    assert (meter.value, meter.mean) == (0.0, 0.0)
    meter.note(0.0)
    now = 10.0
    meter.note(30.0)
    meter.clear()
    now = 500.0
    meter.note(30.0)
    now = 507.0
    meter.note(37.0)
    now = 510.0
    meter.note(40.0)
    assert meter.mean == pytest.approx(2.0)
    # What is older than the window no longer counts.
    assert meter.value == pytest.approx(1.0)
    assert now - 507.0 < speed.SPEED_WINDOW
