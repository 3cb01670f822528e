# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulated time that a simulation has to reach, and its lag behind the clock."""

from collections.abc import Callable
import math

from lava_ros.live.catch_up import CatchUp, Published
from lava_ros.live.clock import FollowedClock
from lava_ros.live.session import SimulationSession
from lava_ros.live.worker_status import SpeedMeter

#: Maximum delay of the state behind the clock, in addition to a time step, at which its maps are
#: still repeated [s of the clock].
MAX_DELAY = 5.0

#: Lag at or below which simulated time has reached the clock [s].
ROUNDING = 1e-3

#: Maximum time of the clock for which maps wait for the lava of vents [s], at the end of a step.
MAX_WAIT = 60.0


class Pace:
    """The simulated time that a session has to reach. It belongs to the session's thread.

    Attributes:
        clock: The clock that simulated time follows.
        scale: Simulated time per time of the clock.
        speed: The speed of the simulation.
        target: Simulated time to reach [s].
        step_target: End of a requested step of a paused simulation [s], None without one.
    """

    def __init__(
        self, read: Callable[[], float], session: SimulationSession, scale: float
    ) -> None:
        """Initialize at time 0.

        Args:
            read: Returns the time of the clock [s].
            session: The simulation and its time.
            scale: Simulated time per time of the clock.
        """
        self._read, self._session = read, session
        self.scale = scale
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

    def rescale(self, scale: float) -> None:
        """Change the simulated time per time of the clock; the lag in seconds of it remains."""
        lag = (self.target - self.followed) / self.scale
        self.scale, self.target = scale, self.followed + lag * scale

    def end_step(self) -> None:
        """End a requested step at the time that the simulation has reached."""
        if self.step_target is not None:
            self.step_target, self.target = None, self._session.time

    def move(self, end_time: float | None) -> None:
        """Move the target with the clock or a requested step, up to an end time [s]."""
        if self.step_target is not None:
            self.target = self.step_target
        else:
            self.target += self.clock.elapse() * self.scale
            self.target = max(self.target, self._catch_up.begin(self.clock, self.scale))
            self._catch_up.note(self.age / self.scale, is_late=self.age > self.max_age)
            max_lag = self._catch_up.max_lag * self.scale
            self.give_up(self._session.time + self._session.view.step + max_lag)
        if end_time is not None:
            self.target = min(self.target, end_time)

    def give_up(self, until: float) -> None:
        """Limit the target to a simulated time [s], and count the rest as lost time."""
        self.clock.lost += max(0.0, self.target - until) / self.scale
        self.target = min(self.target, until)

    @property
    def is_catching_up(self) -> bool:
        """True until a resumed simulation has reached the time of the clock."""
        return self._catch_up.is_behind

    @property
    def age(self) -> float:
        """Simulated time from the state to the target [s]."""
        return max(0.0, self.target - self._session.time)

    @property
    def max_age(self) -> float:
        """Age of the state above which it is stale [s]."""
        step = min(self._session.view.step, self.max_wait)
        return step + (MAX_DELAY + self.clock.step) * self.scale

    @property
    def max_wait(self) -> float:
        """Age of the state above which a time step is ended early [s]."""
        scene = self._session.view.scene
        return MAX_WAIT * self.scale if scene is not None and scene.vents else math.inf

    @property
    def followed(self) -> float:
        """Simulated time up to which nothing remains to be computed [s]."""
        view = self._session.view
        return view.time + min(max(0.0, self.target - view.time), view.step)

    @property
    def lag(self) -> float:
        """Lag behind the clock before its newest step, possibly below 0 [s of the clock]."""
        return (self.target - self.followed) / self.scale - self.clock.step
