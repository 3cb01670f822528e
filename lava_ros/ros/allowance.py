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

"""How often others in the graph may ask for what costs a simulation time, or a disk space."""

from collections.abc import Callable
import time
from typing import NamedTuple

from lava_ros.errors import LavaError


class Limit(NamedTuple):
    """How often something may come: ``calls`` at once, and one more each ``period`` [s]."""

    calls: int
    period: float


#: What is limited, by the name of its service or parameters. A start and a choice of effects hold
#: the simulation up, for they may compile; bags take space.
LIMITS = {
    'reset': Limit(5, 2.0),
    'effects': Limit(5, 2.0),
    'record': Limit(5, 10.0),
    'save': Limit(5, 10.0),
}


class Allowance:
    """Counts what is asked for, and refuses what comes too often."""

    def __init__(
        self,
        refused: Callable[[str, LavaError], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start with all that is allowed at once.

        Args:
            refused: Takes the name and the error of what is refused.
            clock: Returns wall time [s].
        """
        self._refused = refused
        self._clock = clock
        self._left = {name: (float(limit.calls), clock()) for name, limit in LIMITS.items()}

    def take(self, name: str) -> None:
        """Count something of a name of ``LIMITS``; LavaError where that is too often."""
        calls, period = LIMITS[name]
        left, counted = self._left[name]
        now = self._clock()
        left = min(float(calls), left + (now - counted) / period)
        is_allowed = left >= 1.0
        self._left[name] = left - is_allowed, now
        if not is_allowed:
            right = f'at most {calls} at once and one more each {period:g} s; try again later'
            self.refuse(name, LavaError(name, 'too often', right))

    def refuse(self, name: str, error: LavaError) -> None:
        """Report the error of what is refused, and raise it."""
        self._refused(name, error)
        raise error
