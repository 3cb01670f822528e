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

"""The cells that particles are sorted by, and how those around a particle are found.

Cells are numbered row by row: what is in some columns of a row is one range of the particles.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import warp as wp

from lava_ros.simulation.backend.compiled import load_int

#: Rows and columns of cells to a kernel radius, by the least radius over the spacing. Fewer cells
#: hold more that is out of reach, more rows cost more look-ups. With a particle to each cell rows
#: are alike, and threads wait less for each other; where that cannot be, longer rows are better.
_CELLS = ((2.8, (3, 3)), (0.0, (2, 4)))

#: Neighbours in a row that are summed at once, by whether there are so few particles that waiting
#: takes the time. The threads of a warp wait for the one that has most of them: nothing is left
#: over for a second loop, but what does not come out even counts as nothing.
NEIGHBORS_AT_ONCE = {False: 2, True: 4}


def cells_to_radius(ratio: float) -> tuple[int, int]:
    """Rows and columns of cells to a kernel radius, for that radius over the spacing."""
    return next(cells for least, cells in _CELLS if ratio >= least)


@lru_cache
def cell_frame(real: Any) -> Any:
    """Where the cells lie, relative to the terrain's centre.

    ``rows_per_metre`` and ``columns_per_metre`` are one over a cell's sides [1/m]. ``first_row``
    and ``first_column`` are the window's in the grid of the whole terrain, in which lava before
    column ``west`` and row ``south``, or from ``east`` and ``north`` on, is near its border.
    ``starts`` is the index of each cell's first ordered particle, shape [at least cells + 2]; that
    after the last cell is the number of particles on the terrain, the one after it that of all.
    ``sizes`` counts the particles of each cell while they are binned, and is 0 otherwise.
    """

    @wp.struct
    class CellFrame:
        x0: real
        y0: real
        rows_per_metre: real
        columns_per_metre: real
        first_row: wp.int32
        first_column: wp.int32
        rows: wp.int32
        columns: wp.int32
        west: wp.int32
        south: wp.int32
        east: wp.int32
        north: wp.int32
        starts: wp.array(dtype=wp.int32)
        sizes: wp.array(dtype=wp.int32)

    return CellFrame


class CellFunctions(NamedTuple):
    """Device functions that find cells, and what is in them.

    ``column_of(cells, x)`` and ``row_of(cells, y)`` are clamped to the grid. ``cells_around(cells,
    x, y, reach)`` gives the first row that a disc reaches and the one after the last, then the
    same of columns; ``range_in(cells, row, box)`` the first of the ordered particles of a row of
    these cells, and the one after the last.
    """

    column_of: Any
    row_of: Any
    cells_around: Any
    range_in: Any


@lru_cache
def cell_functions(real: Any) -> CellFunctions:
    """Return the device functions that find cells."""

    @wp.func
    def column_of(cells: cell_frame(real), x: real) -> int:
        column = int(wp.floor((x - cells.x0) * cells.columns_per_metre)) - cells.first_column
        return wp.clamp(column, 0, cells.columns - 1)

    @wp.func
    def row_of(cells: cell_frame(real), y: real) -> int:
        row = int(wp.floor((y - cells.y0) * cells.rows_per_metre)) - cells.first_row
        return wp.clamp(row, 0, cells.rows - 1)

    @wp.func
    def cells_around(cells: cell_frame(real), x: real, y: real, reach: real) -> wp.vec4i:
        return wp.vec4i(
            row_of(cells, y - reach),
            row_of(cells, y + reach) + 1,
            column_of(cells, x - reach),
            column_of(cells, x + reach) + 1,
        )

    @wp.func
    def range_in(cells: cell_frame(real), row: int, box: wp.vec4i) -> wp.vec2i:
        first = row * cells.columns
        start = load_int(cells.starts, first + box[2])
        return wp.vec2i(start, load_int(cells.starts, first + box[3]))

    return CellFunctions(column_of, row_of, cells_around, range_in)
