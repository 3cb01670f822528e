# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rate limits of requests from the graph that delay the simulation or use disk space."""

from collections.abc import Callable
import time
from typing import NamedTuple

from lava_ros.errors import LavaError


class Limit(NamedTuple):
    """A rate limit: ``calls`` requests at once, and one more each ``period`` [s]."""

    calls: int
    period: float


#: Limits by the name of the service or of the group of parameters. A reset and a choice of effects
#: may compile and so delay the simulation; bags use disk space.
LIMITS = {
    'reset': Limit(5, 2.0),
    'effects': Limit(5, 2.0),
    'record': Limit(5, 10.0),
    'save': Limit(5, 10.0),
}


class Allowance:
    """Counts requests and refuses those beyond ``LIMITS``."""

    def __init__(
        self,
        refused: Callable[[str, LavaError], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Allow the full number of calls of each limit.

        Args:
            refused: Called with the name and the error of each refused request.
            clock: Returns wall time [s].
        """
        self._refused = refused
        self._clock = clock
        self._left = {name: (float(limit.calls), clock()) for name, limit in LIMITS.items()}

    def take(self, name: str) -> None:
        """Count a request.

        Args:
            name: Key of ``LIMITS``.

        Raises:
            LavaError: If such requests come too often.
        """
        calls, period = LIMITS[name]
        left, counted = self._left[name]
        now = self._clock()
        left = min(float(calls), left + (now - counted) / period)
        is_allowed = left >= 1.0
        self._left[name] = left - is_allowed, now
        if not is_allowed:
            expected = f'at most {calls} at once and one more each {period:g} s; try again later'
            self.refuse(name, LavaError(name, 'too often', expected))

    def refuse(self, name: str, error: LavaError) -> None:
        """Report the error of a refused request, and raise it."""
        self._refused(name, error)
        raise error
