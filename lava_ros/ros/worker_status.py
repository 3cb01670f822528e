# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What the worker is doing, how fast, and the commands that wait for it."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from enum import Enum
import queue
import threading
import time
from typing import Any, NamedTuple

from lava_ros.errors import LavaError

#: Wall time of a step or a command from which on others are said to wait for it [s]: ten slices.
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
        lag: Lag of simulated time behind the time of the clock before its newest step [s of the
            clock].
        lost: Time of the clock since the start that simulated time has not followed [s].
        jump: Newest jump of the clock [s], negative for a jump back. Jumps are not followed.
        jumps: Number of jumps of the clock since the start.
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
    lost: float = 0.0
    jump: float = 0.0
    jumps: int = 0
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


#: Most commands that wait; kinds of which the newest alone waits count as one each.
MAX_WAITING = 1000


class Command(NamedTuple):
    """Something to be done in the thread, and what becomes of it.

    ``kind`` is what it replaces all of, such as ``vents``; empty when it replaces nothing.
    """

    action: Callable[[], Any]
    future: 'Future[Any]'
    kind: str


class CommandQueue:
    """Commands from any thread for one thread, bounded in number.

    A command of a kind replaces the waiting one of that kind, whose future is cancelled: a flood
    of messages that each stand for everything of their kind costs the thread one command a turn.
    """

    def __init__(self, limit: int = MAX_WAITING) -> None:
        """Start empty."""
        self._limit = limit
        # by kind, and those without one each by itself
        self._waiting: dict[object, Command] = {}
        self._closed: LavaError | None = None
        self._changed = threading.Condition()

    def __len__(self) -> int:
        """Commands that wait."""
        return len(self._waiting)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the commands that wait, oldest first, each once."""
        with self._changed:
            return tuple(dict.fromkeys(item.kind or 'command' for item in self._waiting.values()))

    def put(self, command: Command) -> None:
        """Add a command in place of one of its kind, or refuse it: too many, or closed."""
        with self._changed:
            former = self._waiting.pop(command.kind, None)
            refusal = self._closed
            if not command.kind and len(self._waiting) >= self._limit:
                waiting = f'{self._limit} waiting'
                refusal = LavaError('commands', waiting, 'fewer at a time; try again later')
            if refusal is None:
                self._waiting[command.kind or object()] = command
                self._changed.notify()
        # Futures call back, and what they call may put another command.
        if former is not None:
            former.future.cancel()
        if refusal is not None:
            finish(command.future, refusal)

    def get(self, timeout: float | None = None) -> Command:
        """Take the oldest command, after waiting for one for a time [s], None for ever.

        Raises:
            queue.Empty: There was none in time, or the queue is closed.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed, timeout)
            if not self._waiting:
                raise queue.Empty
            return self._waiting.pop(next(iter(self._waiting)))

    def close(self, reason: LavaError) -> None:
        """Refuse what waits, and whatever comes from now on, for a reason."""
        with self._changed:
            self._closed = reason
            commands = list(self._waiting.values())
            self._waiting.clear()
            self._changed.notify()
        for command in commands:
            finish(command.future, reason)


def finish(future: 'Future[Any]', error: Exception | None = None, *, result: Any = None) -> None:
    """Give a future its result or its error, unless it has been cancelled."""
    if future.set_running_or_notify_cancel():
        if error is None:
            future.set_result(result)
        else:
            future.set_exception(error)
