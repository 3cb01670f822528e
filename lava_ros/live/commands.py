# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Commands for the simulation thread: their queue, and methods that are commands."""

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial, wraps
import queue
import threading
from typing import Any, NamedTuple, TypeVar

from lava_ros.errors import LavaError, RefusalError

ResultT = TypeVar('ResultT')

#: Maximum number of waiting commands; a kind of which only the newest waits counts once.
MAX_WAITING = 1000


class Command(NamedTuple):
    """An action for the thread, and the future of its result.

    The command replaces a waiting one of the same ``kind``, such as ``vents``, unless it is empty.
    Commands with an ``item`` and the same action run together if they follow each other: the
    action receives them in a list, and may finish the futures of some of them itself.
    """

    action: Callable[..., Any]
    future: 'Future[Any]'
    kind: str
    item: Any = None


class CommandQueue:
    """A bounded queue of commands from any thread for one thread.

    A command replaces a waiting one of the same kind, whose future is cancelled. A flood of
    messages that each replace the previous one therefore costs one command per round.
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

    def submit(
        self, action: Callable[..., ResultT], kind: str = '', *, item: Any = None
    ) -> 'Future[ResultT]':
        """Add an action as a command, and return the future of its result."""
        future: Future[ResultT] = Future()
        self.put(Command(action, future, kind, item))
        return future

    def put(self, command: Command) -> None:
        """Add a command, replacing one of its kind; refuse it if the queue is full or closed."""
        with self._changed:
            former = self._waiting.pop(command.kind, None)
            refusal = self._closed
            if not command.kind and len(self._waiting) >= self._limit:
                problem = f'{self._limit} commands are waiting'
                refusal = RefusalError('commands', problem, 'Try again later')
            if refusal is None:
                self._waiting[command.kind or object()] = command
                self._changed.notify()
        # Outside the lock, because callbacks of futures may put another command.
        if former is not None:
            former.future.cancel()
        if refusal is not None:
            finish(command.future, refusal)

    def get(self, timeout: float) -> list[Command]:
        """Remove and return the oldest command, and those after it that run together with it.

        Waits up to ``timeout`` [s] for a command.

        Raises:
            queue.Empty: If no command arrives in time, or the queue is closed.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed, timeout)
            if not self._waiting:
                raise queue.Empty
            first = self._waiting.pop(next(iter(self._waiting)))
            commands = [first]
            while first.item is not None and self._waiting:
                place, command = next(iter(self._waiting.items()))
                if command.item is None or command.action != first.action:
                    break
                commands.append(self._waiting.pop(place))
            return commands

    def close(self, reason: LavaError) -> None:
        """Refuse all waiting and later commands with the error ``reason``."""
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


def command(kind: str = '') -> Callable[..., Callable[..., 'Future[Any]']]:
    """Make a method a command: a call puts it into the queue, and returns a future.

    ``kind`` is as in ``Command``.
    """

    def decorate(method: Callable[..., Any]) -> Callable[..., 'Future[Any]']:
        @wraps(method)
        def put(self: Any, *args: Any, **options: Any) -> 'Future[Any]':
            future: Future[Any] = self.commands.submit(
                partial(method, self, *args, **options), kind
            )
            return future

        return put

    return decorate
