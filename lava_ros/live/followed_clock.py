# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The clock that simulated time follows: its steps, its jumps, and lost time."""

from collections.abc import Callable
import time

#: Maximum step of a clock that is followed, and maximum lag of simulated time [s of the clock]. A
#: coarse /clock makes steps of seconds; a replay that skips hours makes a jump.
MAX_LAG = 60.0

#: Backward step below which a clock has not jumped [s]: simulated time waits for it.
JITTER = 1.0


class FollowedClock:
    """Measures how far a clock has advanced from one reading to the next.

    A clock that goes back, or ahead by more than ``MAX_LAG`` at once, has jumped. A jump is
    counted and not followed. A clock that shows 0 has no time yet, as in ROS, and its first time
    is not a jump.

    Attributes:
        step: The newest advance of the clock [s].
        jump: The newest jump [s], negative where the clock went back, 0 before the first.
        jumps: Number of jumps.
        lost: Time of the clock that simulated time has not followed [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        """Initialize from a function that returns the time [s]; ``start`` begins to follow it."""
        self._clock = clock
        self._now = self._looked = 0.0
        self.step = self.jump = self.lost = 0.0
        self.jumps = 0

    def start(self) -> None:
        """Follow the clock, beginning at its current time."""
        self._now, self._looked = self._clock(), time.monotonic()
        self.step = 0.0

    def elapse(self) -> float:
        """Return the advance of the clock since the last reading [s], 0 at a jump."""
        before, looked = self._now, self._looked
        now, self._looked = self._clock(), time.monotonic()
        elapsed = now - before
        if -JITTER < elapsed <= 0.0 and now:
            return 0.0
        self._now = now
        if not before:
            return 0.0
        # After a long computation a steady clock is far ahead, which is not a jump.
        if 0.0 < elapsed <= MAX_LAG + self._looked - looked:
            self.step = elapsed
            return elapsed
        self.jump = elapsed
        self.jumps += 1
        self.lost += max(0.0, elapsed)
        return 0.0
