# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulated time that a simulation has to reach, and its lag behind the clock."""

from collections.abc import Callable
import math
from typing import Any

from lava_ros.live.catch_up import CatchUp, Published
from lava_ros.live.clock import FollowedClock
from lava_ros.live.session import SimulationSession
from lava_ros.live.worker_status import SpeedMeter

#: Maximum delay of the state behind the clock, in addition to a time step, at which its maps are
#: still repeated [s of the clock].
MAX_DELAY = 5.0

#: Maximum time of the clock for which maps wait for the lava of vents [s], at the end of a step.
MAX_WAIT = 60.0


class Pace:
    """The simulated time that a session has to reach. It belongs to the session's thread.

    It advances by ``time_scale`` times the steps of the clock, up to ``MAX_LAG`` each. A
    simulation that cannot keep up lags by at most ``MAX_LAG`` and a time step; time beyond that is
    lost. The lag of a resumed simulation (``resume_from``) is not lost.

    Attributes:
        clock: The clock that simulated time follows.
        end_time: Simulated end time [s], None without one.
        is_paused: True if simulated time is held, except for a requested step.
        speed: The speed of the simulation.
        target: Simulated time to reach [s].
        step_target: End of a requested step of a paused simulation [s], None without one.
    """

    def __init__(
        self, read: Callable[[], float], session: SimulationSession, time_scale: float, *,
        end_time: float | None = None, is_paused: bool = False,
    ) -> None:
        """Initialize at time 0; ``read`` returns the time of the clock [s]."""
        self._read, self._session = read, session
        self._time_scale, self.end_time, self.is_paused = time_scale, end_time, is_paused
        self.target = 0.0
        self._next = CatchUp()
        self._renew()

    def _renew(self) -> None:
        self.step_target: float | None = None
        self._catch_up, self._next = self._next, CatchUp()
        self.speed, self.clock = SpeedMeter(), FollowedClock(self._read)

    def resume_from(self, published: Published | None) -> None:
        """Let the next start catch up with the newest maps of a killed process, if any."""
        self._next = CatchUp(published)

    def restart(self) -> None:
        """Begin again with a simulation that has just started."""
        self._renew()
        self.follow()

    def follow(self) -> None:
        """Follow the clock from its current time and that of the simulation."""
        self.clock.start()
        self.target = self._session.time
        self.speed.clear()
        self.speed.note(self.target)

    @property
    def time_scale(self) -> float:
        """Simulated time per time of the clock; when it changes, the lag in clock time remains."""
        return self._time_scale

    @time_scale.setter
    def time_scale(self, scale: float) -> None:
        lag = (self.target - self.followed) / self._time_scale
        self._time_scale, self.target = scale, self.followed + lag * scale

    def pause(self, is_paused: bool) -> None:
        """Hold simulated time, or let it continue; a requested step ends."""
        now = self._session.time
        if is_paused and not self.is_paused:
            self.give_up(now)
        if self.step_target is not None:
            self.step_target, self.target = None, now
        self.is_paused = is_paused

    @property
    def is_finished(self) -> bool:
        """True if the simulation has reached its end time."""
        return self.end_time is not None and self._session.time >= self.end_time

    @property
    def is_moving(self) -> bool:
        """True if simulated time follows the clock or a requested step."""
        is_held = self.is_paused and self.step_target is None
        return not (self._session.simulation is None or self.is_finished or is_held)

    def move(self) -> None:
        """Read the clock, and move the target with it or a requested step, up to the end time."""
        is_held = self.step_target is not None or not self.is_moving
        elapsed = self.clock.elapse(is_held=is_held)
        if not self.is_moving:
            return
        if self.step_target is not None:
            self.target = self.step_target
        else:
            self.target += elapsed * self._time_scale
            self.target = max(self.target, self._catch_up.begin(self.clock, self._time_scale))
            self._catch_up.note(self.age / self._time_scale, is_late=self.age > self.max_age)
            max_lag = self._catch_up.max_lag * self._time_scale
            self.give_up(self._session.time + self._session.view.step + max_lag)
        if self.end_time is not None:
            self.target = min(self.target, self.end_time)

    def give_up(self, until: float) -> None:
        """Limit the target to a simulated time [s], and count the rest as lost time."""
        self.clock.lost += max(0.0, self.target - until) / self._time_scale
        self.target = min(self.target, until)

    @property
    def age(self) -> float:
        """Simulated time from the state to the target [s]."""
        return max(0.0, self.target - self._session.time)

    @property
    def max_age(self) -> float:
        """Age of the state above which it is stale [s]."""
        step = min(self._session.view.step, self.max_wait)
        return step + (MAX_DELAY + self.clock.step) * self._time_scale

    @property
    def max_wait(self) -> float:
        """Age of the state above which a time step is ended early [s]."""
        scene = self._session.view.scene
        return MAX_WAIT * self._time_scale if scene is not None and scene.vents else math.inf

    @property
    def followed(self) -> float:
        """Simulated time up to which nothing remains to be computed [s]."""
        view = self._session.view
        return view.time + min(max(0.0, self.target - view.time), view.step)

    @property
    def lag(self) -> float:
        """Lag behind the clock before its newest step, possibly below 0 [s of the clock]."""
        return (self.target - self.followed) / self._time_scale - self.clock.step

    def report(self, *, is_running: bool) -> dict[str, Any]:
        """Return the fields of ``WorkerStatus`` about simulated time and the clock."""
        speed, clock = self.speed, self.clock
        return {
            'speed': speed.value,
            'mean_speed': speed.mean,
            'lag': max(0.0, self.lag),
            'lost': clock.lost,
            'jump': clock.jump,
            'jumps': clock.jumps,
            'time': self._session.time,
            'age': self.age if is_running else 0.0,
            'max_age': self.max_age,
            'is_catching_up': is_running and self._catch_up.is_behind,
        }
