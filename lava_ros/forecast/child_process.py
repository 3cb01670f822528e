# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Child processes of a node that execute requests, and both ends of their connection.

A request is the name of a method and its arguments; so is a reply. They are pickled, which is safe
because no other process has an end of the connection. The child computes in short slices with
pauses in between, up to a maximum fraction of the time. It ends when the connection is closed.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
import multiprocessing
from multiprocessing.connection import Connection
import os
from pathlib import Path
import queue
import subprocess
import sys
import threading
import time
import traceback
from typing import Any

import lava_ros
from lava_ros.forecast.pool import interrupts_withheld

#: Niceness of a child of a node: it gets a tenth of a core that it shares with another process.
NICENESS = 10

#: Wall time of a slice, wall time between two reports of progress, and maximum pause [s].
SLICE_WALL_TIME, REPORT_TIME, _MAX_REST = 0.05, 0.5, 60.0

#: Maximum wait for the process to end before it is killed [s].
_END_TIMEOUT = 2.0

Request = tuple[str, dict[str, Any]]
Answer = Callable[..., None]


class ChildProcess:
    """A child process that runs a module and ends with its parent.

    Attributes:
        connection: The parent's end of the connection.
    """

    def __init__(self, module: str) -> None:
        """Start the process."""
        package = str(Path(lava_ros.__file__).resolve().parents[1])
        paths = [package, *filter(None, [os.environ.get('PYTHONPATH')])]
        self.connection, other_end = multiprocessing.Pipe()
        # the node handles Ctrl+C in a terminal and then closes the connection
        with other_end, interrupts_withheld():
            self._child = subprocess.Popen(
                [sys.executable, '-m', module, str(other_end.fileno())],
                stdin=subprocess.DEVNULL,
                # compilers and drivers may write to stdout
                stdout=sys.__stderr__,
                env=os.environ | {'PYTHONPATH': os.pathsep.join(paths)},
                pass_fds=[other_end.fileno()],
            )

    @property
    def pid(self) -> int:
        """Process ID."""
        return self._child.pid

    def request(self, name: str, **values: Any) -> None:
        """Send a request; errors as for ``reply``."""
        try:
            self.connection.send((name, values))
        except OSError as error:
            raise self._ended() from error

    def reply(self, timeout: float) -> Request | None:
        """Return the name and the values of the next reply, None if none arrives in time.

        Raises:
            ChildProcessError: If the process has ended.
        """
        try:
            if not self.connection.poll(timeout):
                return None
            name, values = self.connection.recv()
            return name, values
        except (EOFError, OSError) as error:
            raise self._ended() from error

    def end(self, timeout: float = _END_TIMEOUT) -> None:
        """End the process, after ``timeout`` [s] in the middle of a step."""
        self.connection.close()
        if self._exit_status(timeout) is None:
            self._child.kill()
            self._child.wait()

    def _ended(self) -> ChildProcessError:
        status = self._exit_status()
        reason = 'or no longer answers' if status is None else f'exit status {status}'
        if status is not None and status < 0:
            reason = f'killed by signal {-status}'
        return ChildProcessError(f'the process has ended ({reason})')

    def _exit_status(self, timeout: float = _END_TIMEOUT) -> int | None:
        """Wait for the end of the process; return None if it does not end in time."""
        with suppress(subprocess.TimeoutExpired):
            return self._child.wait(timeout)
        return None


class RequestLoop(ABC):
    """Executes requests, which are its methods, and slices of its work in between."""

    def __init__(self, requests: 'queue.Queue[Request]', answer: Answer) -> None:
        """Initialize without work; ``answer`` is called with each reply to ``requests``."""
        self._requests = requests
        self._answer = answer
        self._share = 1.0
        self._next_slice = 0.0

    @property
    @abstractmethod
    def is_busy(self) -> bool:
        """True while there is work."""

    @abstractmethod
    def take_slice(self) -> None:
        """Work for about ``SLICE_WALL_TIME``."""

    def turn(self) -> None:
        """Execute the next request, or a slice if that is due first."""
        wait = max(0.0, self._next_slice - time.monotonic())
        try:
            name, values = self._requests.get(timeout=wait if self.is_busy else None)
        except queue.Empty:
            begun = time.monotonic()
            self.take_slice()
            now = time.monotonic()
            rest = (now - begun) * (1.0 / self._share - 1.0)
            self._next_slice = now + min(rest, _MAX_REST)
        else:
            getattr(self, name)(**values)

    def share(self, share: float) -> None:
        """Set the maximum fraction of the time for slices."""
        self._share = share


def serve(make_loop: Callable[['queue.Queue[Request]', Answer], RequestLoop]) -> None:
    """Execute requests of the parent until it closes the connection, the argument of the process.

    Args:
        make_loop: Makes the loop of the queue of requests, and of the function that replies.
    """
    parent = Connection(int(sys.argv[1]))
    requests: queue.Queue[Request] = queue.Queue()
    threading.Thread(target=_read, args=(parent, requests), daemon=True).start()
    loop = make_loop(requests, lambda name, **values: parent.send((name, values)))
    try:
        while True:
            loop.turn()
    except ChildProcessError:
        # a child of this process has ended; the parent may start both again
        raise
    except OSError:
        # the parent has closed the connection
        sys.exit(0)


def explain(error: Exception) -> str:
    """Return the message of an error, with its type unless that is a ValueError."""
    name = '' if isinstance(error, ValueError) else f'{type(error).__name__}: '
    return f'{name}{error}'


def _read(parent: Connection, requests: 'queue.Queue[Request]') -> None:
    status = 1
    try:
        while True:
            requests.put(parent.recv())
    except (EOFError, OSError):
        # the parent has closed the connection
        status = 0
    except Exception:
        traceback.print_exc()
    finally:
        # even in the middle of a step
        os._exit(status)
