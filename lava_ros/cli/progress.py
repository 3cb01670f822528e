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

"""The progress of a command that takes a while."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import sys
import time


class Progress:
    """A bar with the time that is left in a terminal, a line for every tenth elsewhere."""

    def __init__(self) -> None:
        """Begin."""
        self._tenths = -1
        self._started = time.monotonic()
        self._bar = None
        if sys.stdout.isatty():
            try:
                from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
                from rich.progress import Progress as Bar
            except ImportError:
                # a bare machine: the lines do
                return
            self._bar = Bar(
                TextColumn('{task.description}'),
                BarColumn(bar_width=None),
                TextColumn('{task.percentage:3.0f} %'),
                TimeRemainingColumn(compact=True),
                transient=True,
            )
            self._task = self._bar.add_task('compiling', total=1.0)

    def __enter__(self) -> Progress:
        """Show the bar."""
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Take it away."""
        if self._bar is not None:
            self._bar.stop()

    def show(self, what: str, share: float) -> None:
        """Show what begins, and the share of the work that is done."""
        if self._bar is not None:
            self._bar.update(self._task, completed=share, description=what)
            return
        tenths = int(10.0 * share)
        if tenths > self._tenths:
            self._tenths = tenths
            elapsed = time.monotonic() - self._started
            left = f', {elapsed / share - elapsed:.0f} s left' if 0.05 < share < 1.0 else ''
            print(f'{10 * tenths:3d} %  {what}{left}', flush=True)


@contextmanager
def in_terminal() -> Iterator[Callable[[str, float], None] | None]:
    """A bar for what takes seconds: None where nobody watches."""
    if not sys.stdout.isatty():
        yield None
        return
    with Progress() as progress:
        yield progress.show
