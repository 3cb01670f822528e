# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Members of a batch (``simulation/batch.py``) whose lava is on cells: one launch steps all."""

from collections.abc import Callable, Iterator
from time import perf_counter
from typing import Any

import numpy as np

from lava_ros.effects import Effects
from lava_ros.simulation.cells.state import TARGET, TIME, WAITING
from lava_ros.simulation.cells.worlds import CLOCK, Worlds

#: Wall time of a launch to aim at [s], and maximum number of steps: members that have arrived wait
#: for its end.
_LAUNCH_TIME, _MAX_STEPS = 0.004, 4096


class CellGroup:
    """Members whose steps run the same kernel, one row each.

    Attributes:
        rounds_at_once: Number of launches in flight.
        under_way: Routes of the members that have been asked to advance, by row.
        free: Rows without a member.
    """

    rounds_at_once = 2

    def __init__(self, effects: Effects, is_heated: bool, device: Any, rows: int) -> None:
        """Prepare for at most some members."""
        self._kind = effects, is_heated
        self._worlds = Worlds(rows, device)
        self._steps = 8
        self.under_way: dict[int, Iterator[None]] = {}
        self.free = list(reversed(range(rows)))

    def put(self, row: int, world: Any) -> None:
        """Assign a row to a member."""
        self._worlds.put(row, world)

    def leave(self, row: int) -> None:
        """Free a row."""
        self.under_way.pop(row, None)
        self.free.append(row)

    def advance(
        self, row: int, order: tuple[np.ndarray, np.ndarray], route: Iterator[None]
    ) -> None:
        """Advance the member of a row by its clock and window; then its route continues."""
        self._worlds.order(row, *order)
        self.under_way[row] = route

    def begin(self) -> Callable[[], list[tuple[Iterator[None], np.ndarray]]]:
        """Start a launch; return a function that waits and returns the due routes."""
        rows, begun = sorted(self.under_way), perf_counter()
        finish = self._worlds.launch(rows, *self._kind, self._steps)

        def end() -> list[tuple[Iterator[None], np.ndarray]]:
            reports = finish()
            due = []
            for row in rows:
                report = reports[row]
                if row not in self.under_way or not self._worlds.is_current(row, report):
                    continue
                clock = report[CLOCK]
                if clock[TIME] >= clock[TARGET] or clock[WAITING] > 0.0:
                    due.append((self.under_way.pop(row), report.copy()))
            spent = perf_counter() - begun
            more = self._steps * 2 if spent < _LAUNCH_TIME else self._steps // 2
            self._steps = min(max(more, 1), _MAX_STEPS)
            return due

        return end
