# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Limits of memory and time for reading hostile files."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import resource
import signal


@contextmanager
def bounded(memory: int = 3 << 30, patience: int = 120) -> Iterator[None]:
    """Raise an error if memory grows by more than a limit [bytes], or after a CPU time [s]."""

    def end(*_: object) -> None:
        raise TimeoutError

    before = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
    signal.signal(signal.SIGPROF, end)
    # not the time of the clock, which other programs use too
    signal.setitimer(signal.ITIMER_PROF, patience)
    resource.setrlimit(resource.RLIMIT_AS, (now + memory, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
