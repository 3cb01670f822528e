# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The parent's end of a child process: its start, its end and its exit status.

Both ends share a pair of sockets. The child reads it in a thread (``received``), and ends when the
parent has closed it or is gone.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
import os
from pathlib import Path
import signal
import socket
import subprocess
import sys
from typing import Any
import weakref

import lava_ros
from lava_ros.errors import RefusalError

#: Code of a child. The first argument of ``main`` is the descriptor of the connection.
_CODE = 'import sys; sys.path[:] = {paths}\nfrom {module} import main; main(*sys.argv[1:])'

#: Folder of the package, which a hook may import from elsewhere than ``sys.path``.
_FOLDER = str(Path(lava_ros.__file__).parents[1])

#: Maximum wait for the exit status of a process that has closed its connection [s].
_END_TIMEOUT = 2.0


class Child:
    """A Python process that runs the ``main`` of a module and ends with this process.

    Attributes:
        channel: The parent's end of the connection.
        process: The process.
        pid: Process ID.
    """

    _connect: Callable[[], tuple[Any, Any]] = staticmethod(socket.socketpair)

    def __init__(
        self, module: str, *arguments: str, switches: Sequence[str] = (), **options: Any
    ) -> None:
        """Start the process.

        Args:
            module: Name of the module.
            arguments: Arguments of its ``main``, after the descriptor of the connection.
            switches: Switches of Python.
            options: Further options of ``subprocess.Popen``.

        Raises:
            LavaError: If the system cannot start another process.
        """
        paths = list(dict.fromkeys(os.path.abspath(item) for item in (*sys.path, _FOLDER)))
        code = _CODE.format(paths=ascii(paths), module=module)
        try:
            self.channel, theirs = self._connect()
            # the parent handles Ctrl+C in a terminal, and ends the process
            with theirs, interrupts_withheld():
                self.process = subprocess.Popen(
                    [sys.executable, *switches, '-c', code, str(theirs.fileno()), *arguments],
                    stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()], **options,
                )
                self.pid = self.process.pid
                self._finalizer = weakref.finalize(self, _end, self.process)
                # a thread that waits for it would report an error while this process exits
                self._finalizer.atexit = False
        except OSError as error:
            problem = f'A child process cannot be started: {error}'
            remedy = 'Check the memory and the limits of processes and open files'
            raise RefusalError('child process', problem, remedy) from error

    @property
    def is_usable(self) -> bool:
        """True if the process runs, and this process is its parent and not a copy of that."""
        return self.process.poll() is None

    def exit_status(self) -> int | None:
        """Return the status of a process that has closed its connection.

        Returns:
            The status, negative for a signal; None if the process does not end.
        """
        with suppress(subprocess.TimeoutExpired):
            return self.process.wait(_END_TIMEOUT)
        return None

    def ended(self) -> ChildProcessError:
        """Return the error about a process that has closed its connection."""
        status = self.exit_status()
        reason = f'exit status {status}'
        if status is None:
            reason = 'or no longer answers'
        elif status < 0:
            reason = f'killed by signal {-status}'
        return ChildProcessError(f'the process has ended ({reason})')

    def end(self) -> None:
        """End the process, even in the middle of its work."""
        self.channel.close()
        self._finalizer()


def _end(process: subprocess.Popen[bytes]) -> None:
    # in a copy of the parent, this does nothing
    process.kill()
    process.wait()


@contextmanager
def interrupts_withheld() -> Iterator[None]:
    """Block Ctrl+C in processes that are started here, including their start-up."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
