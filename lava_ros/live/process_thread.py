# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A thread that lets a child process compute for the live simulation."""

from abc import ABC, abstractmethod
import threading

from lava_ros.errors import Guard
from lava_ros.processes.requests import ChildProcess


class ProcessThread(ABC):
    """A thread that repeats ``_step`` until it is stopped, and then ends its child process."""

    def __init__(self, name: str, task: str) -> None:
        """Prepare the thread; ``start`` runs it. ``task`` describes it in reports of errors."""
        self._guard = Guard(f'thread of {task}', ChildProcessError)
        self._process: ChildProcess | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self, timeout: float | None = None) -> bool:
        """End the thread and the process; return True if both ended within ``timeout`` [s]."""
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._stopping.is_set():
            self._guard.run(self._step, self._fail)
        self._guard.run(self._end_process)

    @abstractmethod
    def _step(self) -> None:
        """Begin work that is due, and process one reply."""

    @abstractmethod
    def _fail(self, error: Exception) -> None:
        """Report an error of a step, and end the process."""

    def _end_process(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.end()
