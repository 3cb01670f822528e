# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rectangle of the terrain's cells in which there can be lava: maps visit no other cells.

It contains all cells in which particles have been (``State.bounds``), and a margin. A CPU launches
only its cells. A GPU launches all cells, because the host would have to wait for the bounds, and
threads beyond them return at once.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import warp as wp

from lava_ros.simulation.backend.memory import read
from lava_ros.simulation.backend.threads import Extent, launch_over
from lava_ros.simulation.particles.layout import CellMaps


@wp.struct
class CellWindow:
    """The cells of a launch: whole rows or a rectangle.

    ``margin`` is the number of cells around the bounds that lava can reach, ``rows`` and
    ``columns`` are those of the terrain, and ``width`` is the number of columns of the launch.
    """

    first_row: wp.int32
    first_column: wp.int32
    width: wp.int32
    margin: wp.int32
    rows: wp.int32
    columns: wp.int32
    bounds: wp.array(dtype=wp.int32)


@wp.func
def cell_in(window: CellWindow, thread: int) -> wp.vec2i:
    """Return row and column of the cell of a thread; the row is -1 if lava cannot be in it."""
    i = window.first_row + thread // window.width
    j = window.first_column + thread % window.width
    is_below = i < window.rows - window.bounds[0] - window.margin
    is_left = j < window.columns - window.bounds[2] - window.margin
    is_above = i >= window.bounds[1] + window.margin
    if is_below or is_left or is_above or j >= window.bounds[3] + window.margin:
        i = -1
    return wp.vec2i(i, j)


class Bounded(Extent, Protocol):
    """The state of a flow, as far as a window reads it (``State``)."""

    cell_maps: CellMaps


class Window:
    """The cells of a terrain that launches visit, for lava that reaches beyond its particles."""

    def __init__(self, shape: tuple[int, ...], margin: int) -> None:
        """Initialize for rows and columns, and the number of cells that lava can reach."""
        self._shape, self._margin = shape, margin
        self._made: tuple[Any, Any, Any] = None, None, None

    def rectangle(self, state: Bounded) -> tuple[slice, slice]:
        """Return the rows and columns around all lava so far."""
        return self.within(read(state.cell_maps.bounds).tolist())

    def within(self, bounds: Sequence[int]) -> tuple[slice, slice]:
        """Return the rows and columns around the cells in ``CellMaps.bounds``."""
        if not bounds[1]:
            return slice(0, 0), slice(0, 0)
        parts = (
            slice(max(count - before - self._margin, 0), min(end + self._margin, count))
            for count, before, end in zip(self._shape, bounds[::2], bounds[1::2], strict=True)
        )
        return tuple(parts)  # type: ignore[return-value]

    def launch(self, state: Bounded, kernel: Any, arguments: Sequence[Any]) -> None:
        """Launch a kernel over the cells; its last argument is a ``CellWindow``."""
        rows, columns = (slice(0, count) for count in self._shape)
        if not state.device.is_cuda:
            rows, columns = self.rectangle(state)
        ends = rows.start, rows.stop, columns.start, columns.stop
        # launches are cached by their arguments
        bounds = state.cell_maps.bounds
        if self._made[0] is not bounds or self._made[1] != ends:
            cells = CellWindow()
            cells.first_row, cells.first_column = ends[0], ends[2]
            cells.width, cells.margin = max(ends[3] - ends[2], 1), self._margin
            cells.rows, cells.columns = self._shape
            cells.bounds = bounds
            self._made = bounds, ends, cells
        count = (ends[1] - ends[0]) * (ends[3] - ends[2])
        if count:
            launch_over(state, kernel, [*arguments, self._made[2]], count=count)
