# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulated time follows the clock of a worker: its steps, jumps and lags."""

import threading
import time
from types import SimpleNamespace

import pytest

from lava_ros.live import worker_status as speed
from lava_ros.live.clock import FollowedClock, MAX_LAG
from lava_ros.live.worker_status import SpeedMeter, WorkerState
from worker_bench import TERRAIN


@pytest.mark.parametrize('step', [0.01, 5.0, MAX_LAG])
@pytest.mark.parametrize(
    'bench', [{'time_scale': scale} for scale in (0.01, 1.0, 1e5)], indirect=True
)
def test_time_follows_steps_of_the_clock(bench, step):
    bench.run(bench.worker.set_terrain(TERRAIN))
    scale = bench.worker.pace.time_scale
    for count in range(1, 6):
        set_clock(bench, bench.now + step)
        bench.wait(lambda: bench.simulation.time == pytest.approx(count * step * scale))  # noqa: B023
    status = bench.worker.status
    assert (status.lost, status.jumps, status.is_behind) == (0.0, 0, False)
    # a new scale applies to later steps
    before = bench.simulation.time
    bench.run(bench.worker.set('time_scale', 2.0))
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(before + 1.0, abs=1e-6))


def set_clock(bench, now):
    """Set the clock, and wait until the worker has read it."""
    bench.now = now
    bench.wait_for_clock()


@pytest.mark.parametrize('step', [0.01, 5.0, 30.0])
def test_snapshot_shows_the_time_of_the_clock(bench, step):
    bench.run(bench.worker.set_terrain(TERRAIN))
    for count in range(1, 4):
        # a blocked worker processes the clock and the request together
        bench.simulation.is_compiled.clear()
        held = bench.worker.set_effects({}, horizon=float(count))
        bench.wait(lambda: bench.worker.status.current_task == 'effects')
        bench.now += step
        bench.worker.request_snapshot()
        bench.simulation.is_compiled.set()
        bench.run(held)
        bench.wait(lambda: bench.shown[-1].time == pytest.approx(count * step))  # noqa: B023


@pytest.mark.parametrize('jump', [2.0 * MAX_LAG, 1e6, -2.0, -1e6])
@pytest.mark.parametrize('bench', [{'time_scale': 1.0}, {'time_scale': 1e5}], indirect=True)
def test_jumps_of_the_clock_are_counted_but_not_followed(bench, jump):
    bench.now = 1e7
    bench.run(bench.worker.set_terrain(TERRAIN))
    scale = bench.worker.pace.time_scale
    bench.go_on(0.5, scale)
    set_clock(bench, bench.now + jump)
    bench.wait(lambda: bench.worker.status.jumps == 1)
    status = bench.worker.status
    assert bench.simulation.time == pytest.approx(0.5 * scale)
    assert (status.jump, status.lost) == pytest.approx((jump, max(0.0, jump)))
    assert not status.is_behind
    bench.go_on(0.5, scale)
    assert bench.worker.status.jumps == 1
    # a new start resets the counts
    bench.run(bench.worker.reset())
    bench.wait(lambda: (bench.worker.status.jumps, bench.worker.status.lost) == (0, 0.0))


@pytest.mark.parametrize('is_read_while_paused', [True, False])
@pytest.mark.parametrize(('jump', 'jumps'), [(-2.0, 1), (-1e6, 1), (-0.5, 0), (1e6, 0)])
def test_only_jumps_back_of_the_clock_are_counted_while_paused(
    bench, jump, jumps, is_read_while_paused
):
    bench.now = 1e7
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.run(bench.worker.pause(True))
    bench.now += jump
    if is_read_while_paused:
        bench.wait(lambda: bench.worker.status.jumps == jumps)
        assert bench.worker.status.jump == (jump if jumps else 0.0)
    # the jump is counted once, and the time of the pause is not lost
    bench.run(bench.worker.pause(False))
    bench.go_on(0.5)
    status = bench.worker.status
    assert (status.jumps, status.lost) == (jumps, 0.0)
    assert bench.simulation.time == pytest.approx(0.5)


def test_a_long_computation_is_no_jump(monkeypatch):
    # a steady clock that is read after the computation alone
    now = [100.0]
    monkeypatch.setattr('lava_ros.live.clock.time.monotonic', lambda: now[0])
    clock = FollowedClock(lambda: 1e9 + now[0])
    clock.start()
    for elapsed in (MAX_LAG, 10.0 * MAX_LAG):
        now[0] += elapsed
        assert clock.elapse() == pytest.approx(elapsed)
    assert (clock.jumps, clock.lost) == (0, 0.0)


def test_first_time_and_jitter_of_the_clock_are_not_jumps(bench):
    bench.now = 0.0
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait_for_clock()
    set_clock(bench, 1.7e9)
    bench.go_on(0.5)
    for step in (-0.25, 0.125, 0.25):
        bench.now += step
        time.sleep(0.25)
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.625))
    assert (bench.worker.status.jumps, bench.worker.status.lost) == (0, 0.0)


@pytest.mark.parametrize('bench', [{'speed': 5.0, 'time_scale': 100.0}], indirect=True)
def test_time_beyond_the_maximum_lag_is_lost(bench):
    bench.run(bench.worker.set_terrain(TERRAIN))
    for _ in range(10):
        bench.now += 0.05
        time.sleep(0.05)
    bench.wait(lambda: bench.worker.status.is_behind)
    # 5 on an idle machine
    assert 0.0 < bench.worker.status.speed < 6.5
    assert bench.worker.status.lost == 0.0
    for _ in range(3):
        set_clock(bench, bench.now + 0.9 * MAX_LAG)
    # the clock continues, but the target does not advance
    assert bench.worker.pace.target <= bench.simulation.time + MAX_LAG * 100.0 + 1e-6
    bench.wait(lambda: bench.worker.status.lost > MAX_LAG)
    assert bench.worker.status.jumps == 0
    # the lag is in time of the clock, at each scale
    bench.run(bench.worker.set('time_scale', 1e-3))
    bench.wait(lambda: not bench.worker.status.is_behind)


def test_status_follows_a_command_before_its_future_completes(bench):
    is_held, states = threading.Event(), []
    bench.worker.commands.submit(is_held.wait)
    future = bench.worker.set_terrain(TERRAIN)
    future.add_done_callback(lambda _: states.append(bench.worker.status.state))
    is_held.set()
    bench.wait(lambda: states)
    # a step of the clock from now on is followed
    assert states == [WorkerState.RUNNING]


def test_mean_speed_excludes_pauses(monkeypatch):
    clock = SimpleNamespace(now=0.0, monotonic=lambda: clock.now)
    monkeypatch.setattr(speed, 'time', clock)
    meter = SpeedMeter()
    assert (meter.value, meter.mean) == (0.0, 0.0)
    for run in (((0.0, 0.0), (10.0, 30.0)), ((500.0, 30.0), (507.0, 37.0), (510.0, 40.0))):
        meter.clear()
        for clock.now, reached in run:
            meter.note(reached)
    assert meter.mean == pytest.approx(2.0)
    # notes older than the window do not count
    assert meter.value == pytest.approx(1.0)
    assert clock.now - 507.0 < speed.SPEED_WINDOW
