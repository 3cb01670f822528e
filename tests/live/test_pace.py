# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulated time that follows a clock. Each test sets the progress of the session."""

import math
from types import SimpleNamespace

import pytest

from lava_ros.live.catch_up import Published
from lava_ros.live.clock import MAX_LAG
from lava_ros.live.pace import MAX_DELAY, MAX_WAIT, Pace


class Session:
    """The parts of a session that a pace reads; a test sets the simulated time and step [s]."""

    def __init__(self, time=0.0, step=0.0, vents=('vent',)):
        self.simulation = object()
        self.compute(time, step, vents)

    def compute(self, time, step=0.0, vents=('vent',)):
        """Let the simulation be at a time, after a step."""
        self.time = time
        self.view = SimpleNamespace(time=time, step=step, scene=SimpleNamespace(vents=vents))


class Clock:
    """A clock that a test moves, by less than a jump."""

    now = 1000.0

    def __call__(self):
        """Return the time [s]."""
        return self.now


def following(scale=1.0, **options):
    """Return a pace, its session and its clock, at simulated time 0."""
    clock, session = Clock(), Session()
    pace = Pace(clock, session, scale, **options)
    pace.follow()
    return pace, session, clock


@pytest.mark.parametrize('scale', [1.0, 2.0, 60.0])
def test_target_is_the_time_of_the_clock_times_the_scale(scale):
    pace, session, clock = following(scale)
    for _ in range(3):
        clock.now += 5.0
        pace.move()
        session.compute(pace.target)
    assert pace.target == 15.0 * scale
    assert (pace.age, pace.clock.lost) == (0.0, 0.0)


@pytest.mark.parametrize('scale', [0.5, 1.0, 60.0])
def test_lag_beyond_its_maximum_is_lost_in_time_of_the_clock(scale):
    pace, session, clock = following(scale)
    session.compute(0.0, step=3.0)
    for _ in range(4):
        clock.now += 0.5 * MAX_LAG
        pace.move()
    # a time step more may be due
    assert pace.target == MAX_LAG * scale + 3.0
    assert pace.clock.lost == pytest.approx(MAX_LAG - 3.0 / scale)
    report = pace.report(is_running=True)
    assert report['age'] == pace.target
    # neither the rest of the step of 3 s nor the newest step of the clock counts as lag
    assert report['lag'] == pytest.approx(0.5 * MAX_LAG)


def test_lag_is_never_below_zero_and_stays_when_the_scale_changes():
    pace, session, clock = following(10.0)
    clock.now += 4.0
    pace.move()
    assert pace.report(is_running=True)['lag'] == 0.0
    session.compute(40.0)
    assert pace.lag == -4.0
    assert pace.report(is_running=True)['lag'] == 0.0
    session.compute(20.0)
    pace.time_scale = 2.0
    # two seconds of the clock are still due
    assert pace.target == 24.0
    # a target within the step that the session has computed does not count as lag
    session.compute(20.0, step=10.0)
    pace.time_scale = 4.0
    assert (pace.followed, pace.target) == (24.0, 24.0)


def test_pause_gives_up_what_is_due_once_and_ends_a_requested_step():
    pace, session, clock = following(2.0)
    clock.now += 10.0
    pace.move()
    session.compute(8.0)
    pace.pause(True)
    assert (pace.target, pace.clock.lost, pace.is_moving) == (8.0, 6.0, False)
    pace.step_target = 50.0
    assert pace.is_moving
    pace.move()
    assert pace.target == 50.0
    session.compute(30.0)
    pace.pause(True)
    # a step that was requested is not time of the clock
    assert (pace.target, pace.step_target, pace.clock.lost) == (30.0, None, 6.0)
    pace.pause(False)
    assert pace.is_moving


def test_target_ends_at_the_end_time():
    pace, session, clock = following(10.0, end_time=25.0)
    clock.now += 5.0
    pace.move()
    assert pace.target == 25.0
    assert pace.is_moving and not pace.is_finished
    session.compute(25.0)
    assert pace.is_finished and not pace.is_moving


@pytest.mark.parametrize(
    ('step', 'vents', 'wait'), [(8.0, ('vent',), 8.0), (1e4, ('vent',), 120.0), (1e4, (), 1e4)]
)
def test_state_is_stale_after_a_step_and_a_delay_of_the_clock(step, vents, wait):
    pace, session, clock = following(2.0)
    clock.now += 3.0
    pace.move()
    session.compute(pace.target, step, vents)
    assert pace.max_wait == (MAX_WAIT * 2.0 if vents else math.inf)
    assert pace.max_age == wait + (MAX_DELAY + 3.0) * 2.0


def test_lag_of_a_resumed_simulation_is_not_lost_and_shrinks_until_it_has_caught_up():
    pace, session, clock = following(10.0)
    # 100 s of the clock ago the maps of 500 s were published
    pace.resume_from(Published(500.0, clock.now - 100.0))
    session.compute(300.0)
    pace.restart()
    pace.move()
    assert (pace.target, pace.clock.lost) == (1500.0, 0.0)
    assert pace.report(is_running=True)['is_catching_up']
    assert not pace.report(is_running=False)['is_catching_up']
    assert pace.report(is_running=False)['age'] == 0.0
    # a lag that grows again by less than it has shrunk is not lost
    session.compute(1000.0)
    pace.move()
    assert pace.report(is_running=True)['is_catching_up']
    clock.now += 40.0
    pace.move()
    assert (pace.target, pace.clock.lost) == (1900.0, 0.0)
    # once it is at most as old as a running simulation may be, the maximum is as usual
    session.compute(1900.0)
    pace.move()
    assert not pace.report(is_running=True)['is_catching_up']
    for _ in range(2):
        clock.now += 40.0
        pace.move()
    assert pace.target == 1900.0 + 10.0 * MAX_LAG
    assert pace.clock.lost == 20.0


def test_lag_of_a_resumed_simulation_that_grows_by_more_than_the_maximum_is_lost():
    pace, session, clock = following(10.0)
    pace.resume_from(Published(500.0, clock.now - 100.0))
    session.compute(300.0)
    pace.restart()
    pace.move()
    for _ in range(2):
        clock.now += 40.0
        pace.move()
    # 120 s of the clock at the start, and MAX_LAG
    assert (pace.target, pace.clock.lost) == (300.0 + 10.0 * (120.0 + MAX_LAG), 20.0)


def test_oldest_state_that_is_not_stale_ends_the_catching_up():
    pace, session, clock = following(1.0)
    pace.resume_from(Published(MAX_DELAY, clock.now))
    session.compute(0.0)
    pace.restart()
    pace.move()
    assert pace.age == pace.max_age
    assert not pace.report(is_running=True)['is_catching_up']


def test_give_up_loses_nothing_that_is_not_due():
    pace, _, clock = following(2.0)
    clock.now += 10.0
    pace.move()
    pace.give_up(50.0)
    assert (pace.target, pace.clock.lost) == (20.0, 0.0)
