# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Catching up of a resumed simulation with the time of the clock."""

import math
from typing import NamedTuple

from lava_ros.live.clock import FollowedClock, JITTER, MAX_LAG

#: Maximum clock time between the last maps of a killed process and its restart with which the
#: simulation catches up [s]. A longer time means that the clock was wrong then or is wrong now.
MAX_DOWNTIME = 86_400.0


class Published(NamedTuple):
    """Simulated time of maps [s], and the time of the clock at which they were published [s].

    ``clock`` is None if simulated time was held.
    """

    time: float
    clock: float | None = None


class CatchUp:
    """The lag of a simulation at its start. Unlike a later lag beyond ``MAX_LAG``, it is not lost.

    ``max_lag`` is the maximum lag behind the clock [s of the clock]. It shrinks with the lag.
    """

    def __init__(self, published: Published | None = None) -> None:
        """Initialize with the newest maps of the killed process, None for a start at time 0."""
        self._published = published
        self.max_lag = MAX_LAG

    @property
    def is_behind(self) -> bool:
        """True until the simulation has caught up."""
        return self.max_lag > MAX_LAG

    def begin(self, clock: FollowedClock, time_scale: float) -> float:
        """Return the simulated time that the killed process would have reached by now [s].

        It is 0 except at the first valid time of the clock. A ``clock`` that has gone back since
        the maps, or too far ahead, has jumped.
        """
        if self._published is None or not (now := clock.read()):
            return 0.0
        (time, published), self._published = self._published, None
        down = now - published if published is not None else 0.0
        if not -JITTER < down <= MAX_DOWNTIME:
            clock.note_jump(down)
            down = 0.0
        self.max_lag = math.inf
        return time + max(0.0, down) * time_scale

    def note(self, lag: float, *, is_late: bool) -> None:
        """Shrink the maximum lag to the current lag [s of the clock]; end unless ``is_late``."""
        self.max_lag = min(self.max_lag, MAX_LAG + lag * is_late)
