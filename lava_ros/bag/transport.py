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

"""Time of a replay that keys hold, quicken and move: between a real clock and ``replay.pace``."""

from collections.abc import Callable
import threading
import time

PAUSE, BACK, AHEAD, FASTER, SLOWER, QUIT = 'space', 'left', 'right', 'up', 'down', 'q'

#: Replay time that one key goes back or ahead by [s].
JUMP = 5.0

#: Times the rate that a replay is slowed or quickened to at most.
SPEEDS = (1.0 / 16.0, 16.0)

#: Longest time without a look at the keys [s].
POLL = 0.05


class Transport:
    """A clock for ``pace`` that stands still, runs faster and jumps as somebody presses keys.

    Attributes:
        is_paused: Whether it stands still.
        speed: How many times as fast as the rate says it runs.
        is_ended: Whether it has been told to quit.
    """

    def __init__(
        self,
        read_key: Callable[[float], str],
        *,
        now: Callable[[], float] = time.monotonic,
        on_change: Callable[['Transport'], None] = lambda _: None,
    ) -> None:
        """Run at the rate.

        Args:
            read_key: Waits up to a time [s] for a key; its name, empty when there was none.
            now: Clock that only goes forward [s].
            on_change: Called when a key has changed something.
        """
        self._read_key = read_key
        self._now = now
        self._on_change = on_change
        self._time = 0.0
        self._since = now()
        self._jump = 0.0
        self._is_showing = False
        self.is_paused = False
        self.speed = 1.0
        self.is_ended = False

    def now(self) -> float:
        """Replay time [s], at the rate that the replay was started with."""
        moment = self._now()
        if not self.is_paused:
            self._time += (moment - self._since) * self.speed
        self._since = moment
        return self._time

    def wait(self, seconds: float, stop: threading.Event) -> bool:
        """Let replay time pass or less, and do what keys say meanwhile; held, until let go.

        Args:
            seconds: Replay time [s].
            stop: Ends the wait when set.

        Returns:
            Whether the replay is to stop, or to go on elsewhere (``take_jump``).
        """
        self._obey(self._read_key(0.0 if self.is_paused else min(seconds / self.speed, POLL)))
        # What is due right where a jump leads to is shown, also while time stands still.
        self._is_showing = self._is_showing and seconds <= 0.0
        while self.is_paused and not self._is_showing and not self._is_interrupted(stop):
            self._obey(self._read_key(POLL))
        return self._is_interrupted(stop)

    def take_jump(self) -> float:
        """How far to go from here [s of replay time], 0 for not at all; asked for once."""
        jump, self._jump = self._jump, 0.0
        self._is_showing = jump != 0.0
        return jump

    def _is_interrupted(self, stop: threading.Event) -> bool:
        return self.is_ended or self._jump != 0.0 or stop.is_set()

    def _obey(self, key: str) -> None:
        self.now()  # what has passed has passed at the speed of then
        if key == PAUSE:
            self.is_paused = not self.is_paused
        elif key in (FASTER, SLOWER):
            low, high = SPEEDS
            self.speed = min(max(self.speed * (2.0 if key == FASTER else 0.5), low), high)
        elif key in (BACK, AHEAD):
            self._jump += JUMP if key == AHEAD else -JUMP
        elif key == QUIT:
            self.is_ended = True
        else:
            return
        self._on_change(self)
