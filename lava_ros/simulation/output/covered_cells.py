# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Covered fraction of each cell, and the times at which lava touched it and had covered half.

Each cell is divided into ``PARTS`` by ``PARTS`` squares. A particle of volume V and thickness h
stands for lava on the square of side ``WIDTH`` sqrt(V / h) around it. At the end of each time step
it covers the squares of cells whose centres are in its own square, and touches its cell, if its
lava is thick enough (``Accuracy.inundation_threshold``). Lava that erupts touches its cell.
Covered squares stay covered, so the result does not depend on the times of maps (docs/MODEL.md).
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.scene.terrain import HALF, PARTS
from lava_ros.simulation.backend.compiled import raise_to
from lava_ros.simulation.particles.layout import arguments_type

#: Side of a particle's square over the root of its area V / h. Squares of exactly that area
#: overlap where particles are disordered, and leave gaps: their union is too small.
WIDTH = 1.35

#: All squares of a cell.
WHOLE = (1 << PARTS * PARTS) - 1

#: One bit in each row of squares.
_COLUMN = sum(1 << PARTS * row for row in range(PARTS))

#: Strides of a 2-D array are in bytes.
_SQUARE = """
    const int* row = reinterpret_cast<const int*>(
        reinterpret_cast<const char*>(values.data) + size_t(i) * values.strides[0]) + j;
    const int* next = reinterpret_cast<const int*>(
        reinterpret_cast<const char*>(row) + values.strides[0]);
    return wp::vec_t<4, int>(row[0], row[1], next[0], next[1]);
"""
#: Most marks are there already, and a read takes less time than an atomic operation.
_MARK_BITS = """
    int* place = reinterpret_cast<int*>(
        reinterpret_cast<char*>(values.data) + size_t(i) * values.strides[0]) + j;
#if defined(__CUDA_ARCH__)
    int found = *reinterpret_cast<volatile int*>(place);
    if ((found & bits) != bits)
        found = atomicOr(place, bits) | bits;
    return __popc(found);
#else
    int found = __atomic_load_n(place, __ATOMIC_RELAXED);
    if ((found & bits) != bits)
        found = __atomic_fetch_or(place, bits, __ATOMIC_RELAXED) | bits;
    return __builtin_popcount(found);
#endif
"""


@wp.func_native(_SQUARE)
def _load_square(values: wp.array2d(dtype=wp.int32), i: int, j: int) -> wp.vec4i:
    """Read items [i, j], [i, j + 1], [i + 1, j] and [i + 1, j + 1]."""
    ...


@wp.func_native(_MARK_BITS)
def mark_bits(values: wp.array2d(dtype=wp.int32), i: int, j: int, bits: int) -> int:
    """Set bits of item [i, j], together with other threads; return how many are then set.

    All threads of a launch see their own bits; the last one sees those of all.
    """
    ...


@lru_cache
def note_function(real: Any, is_new: bool) -> Any:
    """Return the device function that records the ground covered by a particle.

    Its arguments: the particle, its thickness [m], the end of the step [s], and the argument of
    all kernels of a stage. A particle that ``is_new`` has no thickness yet, and only touches its
    cell. Threads with a common cell write the same time.
    """
    vec4: Any = wp.types.vector(4, real)
    vec4i: Any = wp.vec4i
    raised = raise_to(wp.int32)

    @wp.func
    def squares_before(place: int, cell: int) -> int:
        """Return the number of squares of a cell, along an axis, before a place among all."""
        return wp.clamp(place - cell * wp.static(PARTS), 0, wp.static(PARTS))

    @wp.func
    def bits_of(south: int, north: int, west: int, east: int, row: int, column: int) -> int:
        """Return the bits of a cell's squares in a rectangle of squares, counted among all."""
        # bits of the first column of squares before the first row of them and up to the last one
        below = (1 << (wp.static(PARTS) * squares_before(south, row))) - 1
        above = (1 << (wp.static(PARTS) * squares_before(north, row))) - 1
        left = (1 << squares_before(west, column)) - 1
        right = (1 << squares_before(east, column)) - 1
        return (wp.max(above - below, 0) & wp.static(_COLUMN)) * wp.max(right - left, 0)

    @wp.func
    def note(p: vec4, thickness: real, end: wp.float64, m: arguments_type(real)):
        inverse = real(1.0) / m.ground.resolution
        x, y = (p[0] - m.ground.x0) * inverse, (p[1] - m.ground.y0) * inverse
        own_row, own_column = int(wp.floor(y)), int(wp.floor(x))
        rows, columns = m.ground.rows, m.ground.columns
        # squares from the first one with its centre in that of the particle to the end
        south = wp.int32(0)
        north = wp.int32(0)
        west = wp.int32(0)
        east = wp.int32(0)
        first_row, last_row = own_row, own_row
        first_column, last_column = own_column, own_column
        # false for NaN
        is_thick = thickness >= m.constants.threshold
        if wp.static(not is_new):  # noqa: SIM102, the static test decides what is compiled
            if is_thick:
                parts = real(wp.static(PARTS))
                half = real(wp.static(0.5 * WIDTH)) * wp.sqrt(p[2] / thickness) * inverse
                row = int(wp.floor(y - half))
                column = int(wp.floor(x - half))
                # mostly a square touches at most two by two cells, which are read at once
                is_small = y + half < real(row + 2) and x + half < real(column + 2)
                is_small = is_small and row >= 0 and row + 1 < rows
                is_small = is_small and column >= 0 and column + 1 < columns
                found = vec4i(0)
                if is_small:
                    found = _load_square(m.covered, row, column)
                    if found[0] & found[1] & found[2] & found[3] == wp.static(WHOLE):
                        return
                south = int(wp.ceil((y - half) * parts - real(0.5)))
                north = int(wp.ceil((y + half) * parts - real(0.5)))
                west = int(wp.ceil((x - half) * parts - real(0.5)))
                east = int(wp.ceil((x + half) * parts - real(0.5)))
                if is_small:
                    new = bits_of(south, north, west, east, row, column) & ~found[0]
                    new |= bits_of(south, north, west, east, row, column + 1) & ~found[1]
                    new |= bits_of(south, north, west, east, row + 1, column) & ~found[2]
                    new |= bits_of(south, north, west, east, row + 1, column + 1) & ~found[3]
                    own = wp.where(
                        own_row == row, wp.where(own_column == column, found[0], found[1]),
                        wp.where(own_column == column, found[2], found[3]),
                    )
                    if new == 0 and own != 0:
                        return
                last_row = wp.max(own_row, wp.max(north - 1, 0) // wp.static(PARTS))
                last_column = wp.max(own_column, wp.max(east - 1, 0) // wp.static(PARTS))
                first_row = wp.min(own_row, wp.max(south, 0) // wp.static(PARTS))
                first_column = wp.min(own_column, wp.max(west, 0) // wp.static(PARTS))
        first_row, last_row = wp.max(first_row, 0), wp.min(last_row, rows - 1)
        first_column, last_column = wp.max(first_column, 0), wp.min(last_column, columns - 1)
        if first_row > last_row or first_column > last_column:
            return
        raised(m.bounds, 0, rows - first_row)
        raised(m.bounds, 1, last_row + 1)
        raised(m.bounds, 2, columns - first_column)
        raised(m.bounds, 3, last_column + 1)
        if wp.static(not is_new):  # noqa: SIM102, the static test decides what is compiled
            if not is_thick:
                return
        time = wp.float32(end)
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1):
                bits = bits_of(south, north, west, east, row, column)
                is_own = row == own_row and column == own_column
                is_known = m.ground.known[row, column] != wp.uint8(0)
                if is_known and (bits != 0 or is_own):
                    count = mark_bits(m.covered, row, column, bits)
                    if m.arrived[row, column] < wp.float32(0.0):
                        m.arrived[row, column] = time
                    is_half = count >= wp.static(HALF)
                    if is_half and m.half_inundated[row, column] < wp.float32(0.0):
                        m.half_inundated[row, column] = time

    return note
