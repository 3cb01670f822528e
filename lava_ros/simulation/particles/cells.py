# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cells by which particles are sorted, the cells around a particle, and sums over their particles.

Cells are numbered row by row, so the particles in adjacent columns of a row are one contiguous
range. Sums over neighbours have two functions with the same arguments: a GPU thread adds one
neighbour after the other (``sum_neighbors``), a CPU core eight at a time (simd.py).
"""

from functools import lru_cache
from typing import Any, NamedTuple

import warp as wp

from lava_ros.simulation.backend.compiled import access, load_int, on_cuda, write_function
from lava_ros.simulation.backend.simd import over_neighbors
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.layout import arguments_type, cell_frame, ground_type

#: Rows and columns of cells per kernel radius, by minimum radius over spacing. Fewer cells hold
#: more particles out of reach; more rows take more look-ups. With one particle per cell rows are
#: alike, and threads wait less for each other; where that is impossible, longer rows are better.
_CELLS = ((2.8, (3, 3)), (0.0, (2, 4)))


def cells_to_radius(ratio: float) -> tuple[int, int]:
    """Return rows and columns of cells per kernel radius, for a ratio of radius to spacing."""
    return next(cells for min_ratio, cells in _CELLS if ratio >= min_ratio)


class CellFunctions(NamedTuple):
    """Device functions that find cells and their particles.

    ``column_of(cells, x)`` and ``row_of(cells, y)`` are clamped to the grid. ``cells_around(cells,
    x, y, reach)`` returns the first row that a disc touches and the one after the last, then the
    same for columns. ``range_in(cells, row, box)`` returns the first ordered particle of a row of
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
            row_of(cells, y - reach), row_of(cells, y + reach) + 1,
            column_of(cells, x - reach), column_of(cells, x + reach) + 1,
        )

    @wp.func
    def range_in(cells: cell_frame(real), row: int, box: wp.vec4i) -> wp.vec2i:
        first = row * cells.columns
        start = load_int(cells.starts, first + box[2])
        return wp.vec2i(start, load_int(cells.starts, first + box[3]))

    return CellFunctions(column_of, row_of, cells_around, range_in)


@lru_cache
def border_functions(real: Any) -> tuple[Any, Any, Any]:
    """Return the device functions for particles that leave the terrain.

    They return whether a place is on a cell with data, and the item of ``State.left`` and its
    increase for a particle that has left.
    """
    vec4 = wp.types.vector(4, real)

    @wp.func
    def is_known(ground: ground_type(real), x: real, y: real) -> bool:
        j = int(wp.floor((x - ground.x0) / ground.resolution))
        i = int(wp.floor((y - ground.y0) / ground.resolution))
        if i < 0 or j < 0 or i >= ground.rows or j >= ground.columns:
            return False
        return ground.known[i, j] != wp.uint8(0)

    @wp.func
    def side_of(ground: ground_type(real), x: real, y: real) -> int:
        # places are relative to the middle of the grid
        if wp.abs(x) >= -ground.x0 or wp.abs(y) >= -ground.y0:
            return at.BORDER
        if ground.sea:
            j = int(wp.floor((x - ground.x0) / ground.resolution))
            i = int(wp.floor((y - ground.y0) / ground.resolution))
            i = wp.clamp(i, 0, ground.rows - 1)
            j = wp.clamp(j, 0, ground.columns - 1)
            if ground.sea[i, j] != wp.uint8(0):
                return at.SEA
        return at.HOLES

    @wp.func
    def volume_lost(p: vec4) -> wp.float64:
        # a NaN must not count as lava that flowed off: it makes the sum NaN
        return wp.float64(p[2] + real(0.0) * (p[0] + p[1] + p[3]))

    return is_known, side_of, volume_lost


@wp.func_native(on_cuda('return true;', 'return false;'))
def _can_count() -> bool:
    """Return True if many threads may count together: on the CPU Warp's atomics are not atomic."""


@lru_cache
def bin_function(real: Any, has_empty: bool) -> Any:
    """Return the device function that assigns a particle to its cell."""
    vec4 = wp.types.vector(4, real)
    is_known, side_of, volume_lost = border_functions(real)
    column_of, row_of, _, _ = cell_functions(real)

    @wp.func
    def sides_near(cells: cell_frame(real), x: real, y: real) -> int:
        """Return the movable sides of the window that a place is near (``State.counts``)."""
        column = int(wp.floor((x - cells.x0) * cells.columns_per_metre))
        row = int(wp.floor((y - cells.y0) * cells.rows_per_metre))
        sides = int(column < cells.west) + 2 * int(row < cells.south)
        return sides + 4 * int(column >= cells.east) + 8 * int(row >= cells.north)

    @wp.func
    def place(i: int, p: vec4, m: arguments_type(real)):
        """Find a particle's cell and its rank there; particles off the terrain go last.

        On the CPU ranks are counted afterwards, by ``rank_particles``.
        """
        c = m.cells.rows * m.cells.columns
        if not (wp.static(has_empty) and p[2] == real(0.0)):
            # nothing leaves between the stages of a step: a stage may overshoot the border
            number = p[0] + p[1] + p[3]
            if m.counts[at.STAGE] > 0 or (wp.isfinite(number) and is_known(m.ground, p[0], p[1])):
                c = row_of(m.cells, p[1]) * m.cells.columns + column_of(m.cells, p[0])
                near = sides_near(m.cells, p[0], p[1])
                if near != 0:
                    wp.atomic_or(m.counts, at.NEAR_BORDER, near)
            elif _can_count():
                wp.atomic_add(m.left, side_of(m.ground, p[0], p[1]), volume_lost(p))
        m.cell[i] = c
        if _can_count():
            m.rank[i] = wp.atomic_add(m.cells.sizes, c, 1)

    return place


#: Body of a sum over neighbours.
_SUM = """
    sums = ZERO
    for r in range(box[0] + part, box[1], parts):
        near = range_in(cells, r, box)
        for j in range(near[0], near[1]):
            sums = add(sums, j, REST)
    return sums"""

#: Sum of the parts of one thread, in the order in which threads would add up theirs.
_SUM_OF_PARTS = """
    sums = sum_part(part, ALL)
    odd = sum_part(1, ALL)
    sums += sum_part(2, ALL)
    sums += odd + sum_part(3, ALL)
    return sums"""


def sum_neighbors(real: Any, add: Any, lanes: int, parts: int) -> Any:
    """Return the device function that sums over all neighbours that a thread has.

    Its first argument is the thread among those of a particle. The others are the further
    arguments of ``add``, with the cells and the box (``cells_around``) before ``p``.

    Args:
        real: Warp scalar type.
        add: Device function that adds a neighbour. It takes the sums so far, the index of the
            neighbour, and further arguments.
        lanes: Number of threads of a particle.
        parts: Number of parts; part k has every ``parts``-th row of cells. It is 4 or ``lanes``.
    """
    types = dict(add.func.__annotations__)
    sums_type = types.pop('return')
    rest = list(types)[2:]
    place = rest.index('p')
    grid = {'cells': cell_frame(real), 'box': wp.vec4i}
    names = [*rest[:place], *grid, *rest[place:]]
    types = {'part': int} | {name: grid.get(name, types.get(name)) for name in names}
    known = {
        'add': add, 'parts': parts, 'sums_type': sums_type,
        'range_in': cell_functions(real).range_in,
    }
    zero = 'sums_type(0.0)' if sums_type is real else 'sums_type()'
    body = _SUM.replace('REST', ', '.join(rest)).replace('ZERO', zero)
    sum_part = wp.func(write_function(add.func, types, body, known))
    if parts == lanes:
        return sum_part
    body = _SUM_OF_PARTS.replace('ALL', ', '.join(names))
    return wp.func(write_function(add.func, types, body, {'sum_part': sum_part}))


@lru_cache
def sums_function(real: Any, kernel: Any, lanes: int, parts: int, has_heat: bool) -> Any:
    """Return the device function that sums thickness and its gradient over the neighbours.

    The sums (``sum_neighbors``) are of the ``terms`` of a ``SmoothingKernel``. With ``has_heat``
    there is a fourth one: thickness times the excess temperature of the neighbour.
    """
    vec3, vec4 = (wp.types.vector(n, real) for n in (3, 4))
    terms = kernel.terms
    load, _ = access(real, 4)
    sums_type = vec4 if has_heat else vec3

    @wp.func
    def added(
        sums: sums_type, j: int, ordered: wp.array(dtype=vec4), p: vec4, inverse: real
    ) -> sums_type:
        other = load(ordered, j)
        dx = p[0] - other[0]
        dy = p[1] - other[1]
        part = terms(other[2], wp.sqrt(dx * dx + dy * dy), inverse)
        if wp.static(has_heat):
            return vec4(
                sums[0] + part[0], sums[1] + part[1] * dx, sums[2] + part[1] * dy,
                sums[3] + part[0] * (other[3] - p[3]),
            )
        else:
            return vec3(sums[0] + part[0], sums[1] + part[1] * dx, sums[2] + part[1] * dy)

    return sum_neighbors(real, added, lanes, parts)


@lru_cache
def wide_sums_function(wide_terms: str, has_heat: bool) -> Any:
    """Return the float32 device function of the same sums for a CPU."""
    heat = 'sum_3 += shapes * (is_in ? other_3 - p[3] : none);' if has_heat else ''
    sums_type = wp.vec4 if has_heat else wp.vec3

    @wp.func_native(
        over_neighbors(f"""
            const wide dx = is_in ? p[0] - other_0 : none;
            const wide dy = is_in ? p[1] - other_1 : none;
            const wide volume = is_in ? other_2 : none;
            const wide distance = __builtin_elementwise_sqrt(dx * dx + dy * dy);
            {wide_terms}
            sum_0 += shapes;
            sum_1 += slopes * dx;
            sum_2 += slopes * dy;
            {heat}
        """, 4 if has_heat else 3)
    )
    def sums_around(
        part: int, values: wp.array(dtype=wp.vec4), cells: cell_frame(wp.float32), box: wp.vec4i,
        p: wp.vec4, inverse: wp.float32,
    ) -> sums_type: ...

    return sums_around
