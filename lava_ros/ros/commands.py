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

"""What waits for the simulation's thread: commands in order, of some kinds the newest alone."""

from collections.abc import Callable
from concurrent.futures import Future
import queue
import threading
from typing import Any, NamedTuple

from lava_ros.errors import LavaError

#: Most commands that wait; kinds of which the newest alone waits count as one each.
MAX_WAITING = 1000


class Command(NamedTuple):
    """Something to be done in the thread, and who waits for it.

    Attributes:
        action: What to do.
        future: What becomes of it.
        kind: What it replaces all of, such as ``vents``; empty when it replaces nothing.
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
            if refusal is None and not command.kind and len(self._waiting) >= self._limit:
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


def finish(
    future: 'Future[Any]', error: Exception | None = None, *, result: Any = None
) -> None:
    """Give a future its result or its error, unless it has been cancelled."""
    if not future.set_running_or_notify_cancel():
        return
    if error is None:
        future.set_result(result)
    else:
        future.set_exception(error)
