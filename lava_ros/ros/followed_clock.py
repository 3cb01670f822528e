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

"""The clock that simulated time follows: its steps, and what of it is not followed."""

from collections.abc import Callable
import time

#: Longest step of a clock that is followed [s of the clock], and the most that simulated time may
#: be behind: a coarse /clock makes steps of seconds, and a replay that skips hours makes a jump.
MAX_LAG = 60.0

#: A clock that goes back by less than this has not jumped: it is waited for [s].
JITTER = 1.0


class FollowedClock:
    """Measures how far a clock has advanced from one look to the next.

    A clock that goes back, or ahead by more than ``MAX_LAG`` at once, has jumped. A jump is
    counted and not followed. A clock that shows 0 has no time yet, as in ROS, and its first time
    is no jump.

    Attributes:
        step: The newest advance of the clock [s].
        jump: The newest jump [s], negative where the clock went back, 0 before the first.
        jumps: Number of jumps.
        lost: Time of the clock that simulated time has not followed [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        """Take the clock, whose time is in seconds; ``start`` begins to follow it."""
        self._clock = clock
        self._now = self._looked = 0.0
        self.step = self.jump = self.lost = 0.0
        self.jumps = 0

    def start(self) -> None:
        """Follow the clock from its present time on."""
        self._now, self._looked = self._clock(), time.monotonic()
        self.step = 0.0

    def elapse(self) -> float:
        """Return the time to follow since the last look [s], 0 at a jump."""
        before, looked = self._now, self._looked
        now, self._looked = self._clock(), time.monotonic()
        elapsed = now - before
        if -JITTER < elapsed <= 0.0 and now:
            return 0.0
        self._now = now
        if not before:
            return 0.0
        # A thread that was busy for long finds a steady clock far ahead.
        if 0.0 < elapsed <= MAX_LAG + self._looked - looked:
            self.step = elapsed
            return elapsed
        self.jump = elapsed
        self.jumps += 1
        self.lost += max(0.0, elapsed)
        return 0.0
