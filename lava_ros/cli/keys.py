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

"""Keys of a terminal, one by one and unseen, without waiting for Enter."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
import select
import signal
import sys
import termios
import time
import tty

_NAMES = {
    b' ': 'space',
    # as terminals send arrows in either of their modes
    **{
        lead + letter: name
        for lead in (b'\x1b[', b'\x1bO')
        for letter, name in ((b'A', 'up'), (b'B', 'down'), (b'C', 'right'), (b'D', 'left'))
    },
}

#: How long the rest of an arrow may take [s].
_REST = 0.05


class Keys:
    """Reads keys from a terminal that ``keys_of`` has set up."""

    def __init__(self, descriptor: int) -> None:
        """Read from a file descriptor."""
        self._descriptor = descriptor
        self._bytes = b''

    def read(self, timeout: float) -> str:
        """Wait for a key.

        Args:
            timeout: How long [s].

        Returns:
            ``space``, ``up``, ``down``, ``left``, ``right`` or the character; empty when there
            was none, or one without a name.
        """
        if not self._bytes:
            self._fetch(timeout)
        if self._bytes in (b'\x1b', b'\x1b[', b'\x1bO'):
            self._fetch(_REST)
        is_sequence = self._bytes[:2] in (b'\x1b[', b'\x1bO')
        length = 3 if is_sequence else 1
        key, self._bytes = self._bytes[:length], self._bytes[length:]
        return _NAMES.get(key, key.decode('ascii', 'ignore') if key.isalnum() else '')

    def _fetch(self, timeout: float) -> None:
        if not _is_in_foreground(self._descriptor):
            # to read now would stop the process
            time.sleep(timeout)
        elif select.select([self._descriptor], [], [], timeout)[0]:
            self._bytes += os.read(self._descriptor, 64)


@contextmanager
def keys_of(descriptor: int) -> Iterator[Keys]:
    """Have a terminal give its keys at once and unseen, and put it back afterwards.

    Call it from the main thread. In the background the terminal is left alone.
    """
    saved = termios.tcgetattr(descriptor)

    def set_up(*_: object) -> None:
        if _is_in_foreground(descriptor):
            tty.setcbreak(descriptor, termios.TCSADRAIN)

    set_up()
    # the shell has put the terminal back when the replay was stopped with Ctrl+Z
    previous = signal.signal(signal.SIGCONT, set_up)
    try:
        yield Keys(descriptor)
    finally:
        signal.signal(signal.SIGCONT, previous)
        if _is_in_foreground(descriptor):
            termios.tcsetattr(descriptor, termios.TCSADRAIN, saved)


def is_at_terminal() -> bool:
    """Whether standard input and output are a terminal."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def _is_in_foreground(descriptor: int) -> bool:
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:
        # the terminal of another session: there are no jobs to be in front of
        return True
