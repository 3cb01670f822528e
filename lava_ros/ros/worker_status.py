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

"""What the worker is doing, how fast, and the share of the time that forecasts may have."""

from collections import deque
from dataclasses import dataclass
from enum import Enum
import time

#: Wall time of a step or a command from which on it is said that others wait for it [s]: ten
#: slices.
LONGEST_TURN = 1.0


class WorkerState(Enum):
    """What the worker is doing."""

    WAITING = 'waiting for terrain'
    STARTING = 'starting'
    RUNNING = 'running'
    PAUSED = 'paused'
    FINISHED = 'finished'
    FAILED = 'failed'
    STOPPED = 'stopped'


@dataclass(frozen=True)
class WorkerStatus:
    """How the worker is doing.

    Attributes:
        state: What it is doing.
        error: What made it fail, empty unless the state is FAILED.
        speed: Simulated time per wall time, over the last seconds.
        mean_speed: The same since the simulation started, pauses left out.
        is_behind: Whether simulated time falls behind the clock.
        device: Name of the simulation's device, empty before there is one.
        lag: Time of the clock that simulated time is behind [s]; more than ``MAX_LAG`` is lost.
        doing: What the thread is at: ``a step``, or the kind of a command; empty between two.
        turn: Wall time it has been at that, or at the last step where that took longer [s].
        waiting: Kinds of the commands that wait for it.
    """

    state: WorkerState
    error: str
    speed: float
    mean_speed: float
    is_behind: bool
    device: str
    lag: float = 0.0
    doing: str = ''
    turn: float = 0.0
    waiting: tuple[str, ...] = ()

    @property
    def hold_up(self) -> str:
        """What others have to wait for, and for how long already; empty when it is not long."""
        if self.turn < LONGEST_TURN:
            return ''
        waiting = f'; waiting for it: {", ".join(self.waiting)}' if self.waiting else ''
        return f'{self.doing or "a step"} takes {self.turn:.1f} s or more{waiting}'


#: Least share of a device that forecasts have, by its kind. On a GPU two that are busy get half of
#: it each, so the live simulation loses half of this; on a CPU forecasts are nice, and take away
#: what cores share: caches, memory.
LEAST_SHARES = {'cpu': 0.25, 'cuda': 0.1}

#: Share by which forecasts get more in a second in which the live simulation keeps up.
SHARE_RATE = 0.1

#: Wall time over which the speed is averaged [s].
SPEED_WINDOW = 5.0


class SpeedMeter:
    """Averages simulated time per wall time, over the last seconds and over all it ran."""

    def __init__(self) -> None:
        """Start with nothing."""
        self._history: deque[tuple[float, float]] = deque()
        self._wall_time = 0.0
        self._simulated_time = 0.0

    @property
    def value(self) -> float:
        """Simulated seconds per second, 0 before there are two notes."""
        if len(self._history) < 2:
            return 0.0
        (start, first), (end, last) = self._history[0], self._history[-1]
        return (last - first) / (end - start) if end > start else 0.0

    @property
    def mean(self) -> float:
        """Simulated seconds per second between all notes, the pauses left out."""
        return self._simulated_time / self._wall_time if self._wall_time > 0.0 else 0.0

    def note(self, reached: float) -> None:
        """Note a simulated time [s] that has just been reached."""
        now = time.monotonic()
        if self._history:
            self._wall_time += now - self._history[-1][0]
            self._simulated_time += reached - self._history[-1][1]
        self._history.append((now, reached))
        while now - self._history[0][0] > SPEED_WINDOW:
            self._history.popleft()

    def clear(self) -> None:
        """End a run: the next note begins another."""
        self._history.clear()


class Pace:
    """The share of the time for what may wait: least while the simulation falls behind its clock.

    It grows by ``SHARE_RATE`` a second again when the simulation keeps up.
    """

    def __init__(self) -> None:
        """Start with all of the time."""
        self._share = 1.0
        self._noted: float | None = None

    def note(self, is_behind: bool, now: float) -> None:
        """Note whether the simulation is behind its clock, at a wall time [s]."""
        if is_behind:
            self._share = 0.0
        elif self._noted is not None:
            self._share = min(1.0, self._share + SHARE_RATE * (now - self._noted))
        self._noted = now

    def share(self, most: float, device: str) -> float:
        """The share now, on a device, given the largest one."""
        least = LEAST_SHARES[device.partition(':')[0]]
        return min(max(round(self._share, 1), least), most)
