# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Status and speed of the worker, and its queue of commands."""

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

#: A step or command is reported as a hold-up at or above this wall time [s]: ten slices.
MAX_TASK_DURATION = 1.0


class WorkerState(Enum):
    """State of the worker."""

    WAITING = 'waiting for terrain'
    STARTING = 'starting'
    RUNNING = 'running'
    PAUSED = 'paused'
    FINISHED = 'finished'
    FAILED = 'failed'
    STOPPED = 'stopped'


@dataclass(frozen=True)
class WorkerStatus:
    """Status of the worker.

    Attributes:
        state: State of the worker.
        error: Reason of the failure, empty unless the state is FAILED.
        speed: Simulated time per wall time over the last seconds.
        mean_speed: Simulated time per wall time since the start, without pauses.
        is_behind: Whether simulated time falls behind the clock.
        device: Name of the simulation's device, empty before there is one.
        lag: Lag of simulated time behind the time of the clock before its newest step [s of the
            clock].
        lost: Time of the clock since the start that simulated time has not followed [s].
        jump: Newest jump of the clock [s], negative for a jump back. Jumps are not followed.
        jumps: Number of jumps of the clock since the start.
        doing: Current task of the thread: ``a step`` or the kind of a command; empty in between.
        turn: Wall time of the current task so far or, if longer, of the last step [s].
        waiting: Kinds of the waiting commands.
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
    def blocked_by(self) -> str:
        """Description of a task that delays commands, with its duration; empty if it is short."""
        if self.turn < MAX_TASK_DURATION:
            return ''
        waiting = f'; waiting for it: {", ".join(self.waiting)}' if self.waiting else ''
        return f'{self.doing or "a step"} takes {self.turn:.1f} s or more{waiting}'


#: Wall time over which the speed is averaged [s].
SPEED_WINDOW = 5.0


class SpeedMeter:
    """Averages simulated time per wall time, over the last seconds and over the whole run."""

    def __init__(self) -> None:
        """Initialize without notes."""
        self._history: deque[tuple[float, float]] = deque()
        self._wall_time = 0.0
        self._simulated_time = 0.0

    @property
    def value(self) -> float:
        """Simulated time per wall time over ``SPEED_WINDOW``, 0 before the second note."""
        if len(self._history) < 2:
            return 0.0
        (start, first), (end, last) = self._history[0], self._history[-1]
        return (last - first) / (end - start) if end > start else 0.0

    @property
    def mean(self) -> float:
        """Simulated time per wall time over all notes, without pauses."""
        return self._simulated_time / self._wall_time if self._wall_time > 0.0 else 0.0

    def note(self, reached: float) -> None:
        """Record that a simulated time [s] has just been reached."""
        now = time.monotonic()
        if self._history:
            self._wall_time += now - self._history[-1][0]
            self._simulated_time += reached - self._history[-1][1]
        self._history.append((now, reached))
        while now - self._history[0][0] > SPEED_WINDOW:
            self._history.popleft()

    def clear(self) -> None:
        """End an interval; the next note starts a new one."""
        self._history.clear()


#: Maximum number of waiting commands; a kind of which only the newest waits counts once.
MAX_WAITING = 1000


class Command(NamedTuple):
    """An action for the thread, and the future of its result.

    The command replaces a waiting one of the same ``kind``, such as ``vents``, unless it is empty.
    """

    action: Callable[[], Any]
    future: 'Future[Any]'
    kind: str


class CommandQueue:
    """A bounded queue of commands from any thread for one thread.

    A command replaces a waiting one of the same kind, whose future is cancelled. So a flood of
    messages that each replace all of their kind costs one command per round.
    """

    def __init__(self, limit: int = MAX_WAITING) -> None:
        """Initialize an empty queue."""
        self._limit = limit
        # keys: the kind, or a unique object for a command without a kind
        self._waiting: dict[object, Command] = {}
        self._closed: LavaError | None = None
        self._changed = threading.Condition()

    def __len__(self) -> int:
        """Return the number of waiting commands."""
        return len(self._waiting)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the waiting commands, each once, oldest first."""
        with self._changed:
            return tuple(dict.fromkeys(item.kind or 'command' for item in self._waiting.values()))

    def put(self, command: Command) -> None:
        """Add a command, replacing one of its kind; refuse it if the queue is full or closed."""
        with self._changed:
            former = self._waiting.pop(command.kind, None)
            refusal = self._closed
            if not command.kind and len(self._waiting) >= self._limit:
                waiting = f'{self._limit} waiting'
                refusal = LavaError('commands', waiting, 'fewer at a time; try again later')
            if refusal is None:
                self._waiting[command.kind or object()] = command
                self._changed.notify()
        # Outside the lock, because callbacks of futures may put another command.
        if former is not None:
            former.future.cancel()
        if refusal is not None:
            finish(command.future, refusal)

    def get(self, timeout: float | None = None) -> Command:
        """Remove and return the oldest command, waiting up to ``timeout`` [s], None: for ever.

        Raises:
            queue.Empty: If no command arrives in time, or the queue is closed.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed, timeout)
            if not self._waiting:
                raise queue.Empty
            return self._waiting.pop(next(iter(self._waiting)))

    def close(self, reason: LavaError) -> None:
        """Refuse waiting and later commands for a reason."""
        with self._changed:
            self._closed = reason
            commands = list(self._waiting.values())
            self._waiting.clear()
            self._changed.notify()
        for command in commands:
            finish(command.future, reason)


def finish(future: 'Future[Any]', error: Exception | None = None, *, result: Any = None) -> None:
    """Set the result or the error of a future, unless it has been cancelled."""
    if future.set_running_or_notify_cancel():
        if error is None:
            future.set_result(result)
        else:
            future.set_exception(error)
