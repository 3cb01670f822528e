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

"""Processes that a command starts, watches and ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
import signal
import subprocess
import sys
from types import FrameType

#: Last lines of a log that are shown when its process has failed.
SHOWN_LINES = 40


class ChildError(Exception):
    """A process ended that should not have, or ended badly; the text holds its log."""


class Child:
    """A Python module that runs in a process of its own, its output in a log file."""

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        *,
        log: Path,
        env: Mapping[str, str],
    ) -> None:
        """Start the process.

        Args:
            name: What it is called in errors.
            module: Module to run.
            arguments: Its arguments.
            log: File for its output.
            env: Its environment.
        """
        self.name = name
        self._log = log
        _end_in_order()
        with log.open('wb') as output:
            self._process = subprocess.Popen(
                [sys.executable, '-u', '-m', module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=dict(env),
                # Ctrl+C is for the command, which then ends its children in order.
                start_new_session=True,
            )

    def check(self) -> None:
        """Do nothing as long as the process runs.

        Raises:
            ChildError: It has ended.
        """
        status = self._process.poll()
        if status is not None:
            raise ChildError(self.failure(f'ended by itself with status {status}'))

    def stop(self, timeout: float = 20.0) -> None:
        """Ask the process to end, and wait for it.

        Raises:
            ChildError: It did not end in time [s], or not with status 0.
        """
        status = self.end(timeout)
        if status is None:
            raise ChildError(self.failure(f'did not end within {timeout:g} s'))
        if status != 0:
            raise ChildError(self.failure(f'ended with status {status}'))

    def end(self, timeout: float = 10.0) -> int | None:
        """End the process: ask first, and kill it when it does not follow in time [s].

        Returns:
            Its exit status, None when it had to be killed.
        """
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        try:
            return self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            return None

    def failure(self, what: str) -> str:
        """Describe a failure with the end of the log."""
        lines = self._log.read_text(errors='replace').splitlines()[-SHOWN_LINES:]
        shown = '\n'.join(f'    {line}' for line in lines) or '    (nothing)'
        return f'the {self.name} {what}; its log ends with\n{shown}'


def _end_in_order() -> None:
    """Let the command end its children when it is told to end, as after Ctrl+C."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        # nohup has it ignored
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _leave)


def _leave(number: int, _: FrameType | None) -> None:
    # once: what is told again and again must not cut short how it ends
    signal.signal(number, signal.SIG_IGN)
    raise SystemExit(128 + number)
