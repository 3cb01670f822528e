# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Child processes that execute requests, and both ends of their connection.

A request is the name of a method and its arguments; so is a reply. They are pickled, which is safe
because no other process has an end of the connection. The child computes in short slices with
pauses in between, up to a maximum fraction of the time.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
import multiprocessing
from multiprocessing.connection import Connection, wait
import os
import pickle
import queue
import sys
import threading
import time
import traceback
from typing import Any

from lava_ros.processes.child import Child
from lava_ros.processes.received import receive_in_thread

#: Niceness of a child of a node: it gets a tenth of a core that it shares with another process.
NICENESS = 10

#: Wall time of a slice, and wall time between two reports of progress [s].
SLICE_WALL_TIME, REPORT_TIME = 0.05, 0.5

Request = tuple[str, dict[str, Any]]
Answer = Callable[..., None]


class ChildProcess(Child):
    """A child process that executes requests by a ``RequestLoop``."""

    _connect = staticmethod(multiprocessing.Pipe)

    def __init__(self, loop: str) -> None:
        """Start the process; ``loop`` has the module and the name of a ``RequestLoop``.

        Raises:
            LavaError: If the system cannot start another process.
        """
        # compilers and drivers may write to stdout
        super().__init__(__name__, *loop.split(':'), stdout=sys.__stderr__)

    def request(self, name: str, **values: Any) -> None:
        """Send a request.

        Raises:
            ChildProcessError: If the process has ended.
        """
        try:
            self.channel.send((name, values))
        except OSError as error:
            raise self.ended() from error

    def reply(self, timeout: float) -> Request | None:
        """Return the name and the values of the next reply, None if none arrives in time.

        Raises:
            ChildProcessError: If the process has ended.
            Exception: The one that a request or a slice has raised. There are no more replies.
        """
        try:
            if not self.channel.poll(timeout):
                return None
            data = self.channel.recv_bytes()
        except (EOFError, OSError) as error:
            raise self.ended() from error
        name, values = pickle.loads(data)
        if name == 'failed':
            raise values['error'] from ChildProcessError(values['trace'])
        return name, values


def with_reply(processes: Sequence[ChildProcess], timeout: float | None) -> list[ChildProcess]:
    """Return the processes that have replied or ended within a time [s], None for any time."""
    ready = wait([process.channel for process in processes], timeout)
    return [process for process in processes if process.channel in ready]


class RequestLoop:
    """Executes requests, which are its methods, and slices of its work in between.

    Attributes:
        niceness: Increase of the niceness of its process.
        max_rest: Maximum pause between two slices [s].
    """

    niceness, max_rest = 0, 60.0

    def __init__(self, requests: 'queue.SimpleQueue[Request]', answer: Answer) -> None:
        """Initialize without work; ``answer`` is called with each reply to ``requests``."""
        self._requests = requests
        self._answer = answer
        self._share = 1.0
        self._next_slice = 0.0

    @property
    def is_busy(self) -> bool:
        """True while there is work."""
        return False

    def take_slice(self) -> None:
        """Work for about ``SLICE_WALL_TIME``."""

    def turn(self) -> None:
        """Execute the next request, or a slice if that is due first."""
        wait = max(0.0, self._next_slice - time.monotonic())
        try:
            name, values = self._requests.get(timeout=wait if self.is_busy else None)
        except queue.Empty:
            begun = self.clock()
            self.take_slice()
            rest = (self.clock() - begun) * (1.0 / self._share - 1.0)
            self._next_slice = time.monotonic() + min(rest, self.max_rest)
        else:
            getattr(self, name)(**values)

    def clock(self) -> float:
        """Return the time by which slices are measured [s]."""
        return time.monotonic()

    def share(self, share: float) -> None:
        """Set the maximum fraction of the time for slices."""
        self._share = share


def explain(error: Exception) -> str:
    """Return the message of an error, with its type unless that is a ValueError."""
    name = '' if isinstance(error, ValueError) else f'{type(error).__name__}: '
    return f'{name}{error}'


class _Requests(queue.SimpleQueue[Any]):
    """Pickled requests.

    The thread that receives them must not import modules: they may just be imported.
    """

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Return the next request."""
        return pickle.loads(super().get(block, timeout))


def main(descriptor: str, module: str, loop: str) -> None:
    """Execute requests by a loop, until the parent closes the connection or an error is raised."""
    parent, requests = Connection(int(descriptor)), _Requests()
    receive_in_thread(parent.recv_bytes, requests)

    def answer(name: str, **values: Any) -> None:
        data = pickle.dumps((name, values))
        try:
            parent.send_bytes(data)
        except OSError:
            # the parent has closed the connection
            os._exit(0)

    try:
        kind: type[RequestLoop] = getattr(import_module(module), loop)
        os.nice(kind.niceness)
        made = kind(requests, answer)
        while True:
            made.turn()
    except Exception as error:
        answer('failed', error=_portable(error), trace=traceback.format_exc())
    # the parent ends this process
    threading.Event().wait()


def _portable(error: Exception) -> Exception:
    """Return an exception that can be pickled; its text if it cannot."""
    try:
        again = pickle.loads(pickle.dumps(error))
        return error if str(again) == str(error) else RuntimeError(explain(error))
    except Exception:
        return RuntimeError(explain(error))
