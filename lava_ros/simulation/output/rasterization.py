# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Particles to grid: thickness and temperature at the cells of the terrain (section 3.4.2).

A kernel sum extends by its radius past the last particle, and the paper's borders are too round.
Here lava is where the particles' own areas V / h, smoothed by the same kernel, cover more than
half of the ground: at a straight border the lava ends there, whatever the radius. The covered
fraction of a border cell follows from the cover in its middle and the gradient, and the cell's
thickness is the mean over all of it. A cell that lava has not reached (``covered_cells.py``) has
none, unless the lava is too thin to count: standing lava is on ground that lava has reached.

Only cells of the rectangle in which lava has been, and those in reach of it, are visited.

The volume is conserved: each particle distributes all of its volume to the covered cells,

    h_c = f_c sum_j V_j W_cj / N_j,    N_j = A sum_c f_c W_cj,

A the area of a cell. The weight f_c is the covered fraction times the root of the particles' mean
thickness around it over their cover: to first order this undoes the kernel's smoothing
(docs/MODEL.md). A particle far from all covered cells gives its volume to the cell in which it
lies.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.simulation.backend.compiled import access, quick_kernel
from lava_ros.simulation.backend.threads import launch_over
from lava_ros.simulation.output.window import cell_in, CellWindow, Window
from lava_ros.simulation.particles.cells import cell_functions
from lava_ros.simulation.particles.kernels import smoothing_kernel
from lava_ros.simulation.particles.layout import arguments_type, ground_type, PARTICLES, TIME
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.particles.terrain import StaggeredTerrain

#: Fraction of a cell at or above which it holds lava.
COVER_THRESHOLD = 0.5

#: Smoothed weight of the covered cells at a particle, relative to its own thickness, below which
#: it is far from them: smaller sums have few significant digits.
_MIN_NEAR_WEIGHT = 1e-3

#: Minimum thickness of standing lava over the threshold of inundation: maps are rounded.
_MIN_STANDING = 0.999

#: Placeholder for a weight: particles are within reach of the cell, but do not cover it.
_UNCOVERED = wp.constant(wp.float32(-1.0))


@lru_cache
def _middle_function(real: Any) -> Any:
    @wp.func
    def middle(first: wp.float64, n: int, resolution: wp.float64) -> real:
        """Coordinate of the middle of the n-th cell; bitwise identical in all passes."""
        return real(first + (wp.float64(n) + wp.float64(0.5)) * resolution)

    return middle


@lru_cache
def _weigh_kernel(real: Any, kernel_name: str) -> Any:
    norm, shape, slope, *_ = smoothing_kernel(kernel_name, real)
    _, _, cells_around, range_in = cell_functions(real)
    load, _ = access(real, 4)
    middle = _middle_function(real)

    @wp.func
    def part_above(middle: real, rise_x: real, rise_y: real) -> real:
        """Fraction of a cell where a plane is above 0, by its middle and its rises across."""
        wide = real(0.5) * wp.max(wp.abs(rise_x), wp.abs(rise_y))
        narrow = real(0.5) * wp.min(wp.abs(rise_x), wp.abs(rise_y))
        height = wp.abs(middle)
        small = real(0.0)
        if height < wide - narrow:
            small = real(0.5) - real(0.5) * height / wide
        elif height < wide + narrow:
            rest = wide + narrow - height
            small = rest * rest / (real(8.0) * wide * narrow)
        return wp.where(middle > real(0.0), real(1.0) - small, small)

    @quick_kernel(fast_math=False)
    def weigh(
        thread: int, m: arguments_type(real), exact: ground_type(wp.float64), radius: wp.float64,
        thickness: wp.array2d(dtype=wp.float32), temperature: wp.array2d(dtype=wp.float32),
        window: CellWindow,
    ):
        """Weigh the covered cells, and mark those not covered but with lava in reach."""
        cell = cell_in(window, thread)
        i, j = cell[0], cell[1]
        if i < 0:
            return
        temperature[i, j] = wp.float32(wp.nan)
        if exact.known[i, j] == wp.uint8(0):
            thickness[i, j] = wp.float32(wp.nan)
            return
        x = middle(exact.x0, j, exact.resolution)
        y = middle(exact.y0, i, exact.resolution)
        reach = real(radius)
        inverse = real(1.0) / reach
        height = real(0.0)
        cover = real(0.0)
        rise_x = real(0.0)
        rise_y = real(0.0)
        box = cells_around(m.cells, x, y, reach)
        for r in range(box[0], box[1]):
            near = range_in(m.cells, r, box)
            for k in range(near[0], near[1]):
                p = load(m.ordered, k)
                dx = (x - p[0]) * inverse
                dy = (y - p[1]) * inverse
                square = dx * dx + dy * dy
                if square < real(1.0):
                    distance = wp.sqrt(square)
                    area = p[2] / m.flow[k][0]
                    covered = area * shape(distance)
                    height += covered * m.flow[k][0]
                    cover += covered
                    area *= slope(distance)
                    rise_x += area * dx
                    rise_y += area * dy
        if cover == real(0.0):
            thickness[i, j] = wp.float32(0.0)
            return
        mean = height / cover
        scale = real(wp.static(norm)) * inverse * inverse
        cover *= scale
        scale *= real(exact.resolution) * inverse
        rise_x *= scale
        rise_y *= scale
        above = cover - real(wp.static(COVER_THRESHOLD))
        part = part_above(above, rise_x, rise_y)
        # half-way between the highest cover in the cell and the lowest that counts as lava
        change = real(0.5) * (wp.abs(rise_x) + wp.abs(rise_y))
        lowest = wp.max(cover - change, real(wp.static(COVER_THRESHOLD)))
        typical = real(0.5) * (cover + change + lowest)
        weight = wp.float32(part * wp.sqrt(mean * typical) / cover)
        # a cover of NaN is not dry ground
        thickness[i, j] = wp.where(weight > wp.float32(0.0), weight, wp.float32(wp.nan))
        is_dry = m.arrived[i, j] < wp.float32(0.0) and mean >= m.constants.threshold
        if cover > real(0.0) and (part == real(0.0) or is_dry):
            thickness[i, j] = _UNCOVERED

    return weigh


@lru_cache
def _share_out_kernel(real: Any, kernel_name: str) -> Any:
    norm, shape, *_ = smoothing_kernel(kernel_name, real)
    load, _ = access(real, 4)
    middle = _middle_function(real)

    @wp.func
    def cell_at(place: real, first: wp.float64, resolution: wp.float64) -> int:
        return int(wp.floor((wp.float64(place) - first) / resolution))

    @quick_kernel(fast_math=False)
    def share_out(
        k: int, m: arguments_type(real), exact: ground_type(wp.float64), radius: wp.float64,
        thickness: wp.array2d(dtype=wp.float32),
    ):
        """Find a particle's volume per unit of weight, or for the cell in which it lies."""
        if k >= m.counts[PARTICLES]:
            return
        p = load(m.ordered, k)
        reach = real(radius)
        inverse = real(1.0) / reach
        south = wp.max(cell_at(p[1] - reach, exact.y0, exact.resolution), 0)
        north = wp.min(cell_at(p[1] + reach, exact.y0, exact.resolution) + 1, exact.rows)
        west = wp.max(cell_at(p[0] - reach, exact.x0, exact.resolution), 0)
        east = wp.min(cell_at(p[0] + reach, exact.x0, exact.resolution) + 1, exact.columns)
        # the sum and its rounding error: thousands of cells may be in reach
        total = real(0.0)
        excess = real(0.0)
        for i in range(south, north):
            dy = (middle(exact.y0, i, exact.resolution) - p[1]) * inverse
            for j in range(west, east):
                dx = (middle(exact.x0, j, exact.resolution) - p[0]) * inverse
                square = dx * dx + dy * dy
                if square < real(1.0) and thickness[i, j] > wp.float32(0.0):
                    more = real(thickness[i, j]) * shape(wp.sqrt(square)) - excess
                    former = total
                    total = former + more
                    excess = (total - former) - more
        area = real(exact.resolution * exact.resolution)
        m.contribution[k] = p[2] / (area * total)
        m.home[k] = -1
        total *= area * real(wp.static(norm)) * inverse * inverse
        if total > real(wp.static(_MIN_NEAR_WEIGHT)) * wp.sqrt(m.flow[k][0]):
            return
        # the cell in which it lies, or next to a hole, because of rounding, the nearest known one
        nearest = real(1.0)
        is_covered = wp.bool(False)
        for i in range(south, north):
            dy = (middle(exact.y0, i, exact.resolution) - p[1]) * inverse
            for j in range(west, east):
                dx = (middle(exact.x0, j, exact.resolution) - p[0]) * inverse
                square = dx * dx + dy * dy
                if square < nearest and exact.known[i, j] != wp.uint8(0):
                    nearest = square
                    m.home[k] = i * exact.columns + j
                    is_covered = thickness[i, j] > wp.float32(0.0)
        if is_covered:
            m.home[k] = -1
        elif m.home[k] >= 0:
            m.contribution[k] = p[2] / area

    return share_out


@lru_cache
def _gather_kernel(real: Any, kernel_name: str) -> Any:
    vec2 = wp.types.vector(2, real)
    shape = smoothing_kernel(kernel_name, real).shape
    _, _, cells_around, range_in = cell_functions(real)
    load, _ = access(real, 4)
    middle = _middle_function(real)

    @quick_kernel(fast_math=False)
    def gather(
        thread: int, m: arguments_type(real), exact: ground_type(wp.float64), radius: wp.float64,
        thickness: wp.array2d(dtype=wp.float32), temperature: wp.array2d(dtype=wp.float32),
        window: CellWindow,
    ):
        """Sum the particles' contributions to a cell, and their mean temperature."""
        cell = cell_in(window, thread)
        i, j = cell[0], cell[1]
        if i < 0:
            return
        own_weight = thickness[i, j]
        if own_weight == wp.float32(0.0) or wp.isnan(own_weight):
            return
        is_covered = own_weight > wp.float32(0.0)
        own = i * exact.columns + j
        x = middle(exact.x0, j, exact.resolution)
        y = middle(exact.y0, i, exact.resolution)
        reach = real(radius)
        inverse = real(1.0) / reach
        # thickness and its product with the temperature, and the rounding error of both sums:
        # thousands of particles may be in one cell
        total = vec2()
        excess = vec2()
        box = cells_around(m.cells, x, y, reach)
        for r in range(box[0], box[1]):
            near = range_in(m.cells, r, box)
            for k in range(near[0], near[1]):
                part = real(0.0)
                p = load(m.ordered, k)
                if is_covered:
                    dx = (x - p[0]) * inverse
                    dy = (y - p[1]) * inverse
                    square = dx * dx + dy * dy
                    if square < real(1.0) and m.home[k] < 0:
                        part = m.contribution[k] * shape(wp.sqrt(square))
                elif m.home[k] == own:
                    part = m.contribution[k]
                more = vec2(part, part * p[3]) - excess
                former = total
                total = former + more
                excess = (total - former) - more
        if is_covered:
            total *= real(own_weight)
        thickness[i, j] = wp.float32(total[0])
        min_standing = real(wp.static(_MIN_STANDING)) * m.constants.threshold
        if m.arrived[i, j] < wp.float32(0.0) and total[0] >= min_standing:
            # films that are each too thin to count, and together thick enough
            m.arrived[i, j] = wp.float32(m.clock[TIME])
        if total[0] != real(0.0):
            temperature[i, j] = wp.float32(total[1] / total[0])

    return gather


@quick_kernel()
def _clear(thread: int, known: wp.array2d(dtype=wp.uint8), grids: wp.array3d(dtype=wp.float32)):
    """Fill grids with 0 (no lava) on cells with data, and with NaN on others."""
    i = thread // known.shape[1]
    j = thread % known.shape[1]
    dry = wp.float32(0.0)
    if known[i, j] == wp.uint8(0):
        dry = wp.float32(wp.nan)
    for n in range(grids.shape[0]):
        grids[n, i, j] = dry
    grids[1, i, j] = wp.float32(wp.nan)


class Raster:
    """Output grids on a device, one value for each cell of a terrain.

    Attributes:
        COUNT: Number of grids that ``fill`` fills.
        grids: Grids that ``fill`` fills, and additional ones for callers to fill, float32, shape
            [2 or more, rows, columns].
        thickness: The first grid [m], NaN where the terrain has no data.
        window: The cells that lava can reach.
        temperature: The second grid [K], NaN where the ground is dry, too.
    """

    COUNT = 2

    def __init__(
        self, terrain: StaggeredTerrain, radius: float, kernel: str, *, reach: float, more: int
    ) -> None:
        """Allocate the grids.

        Args:
            terrain: The ground.
            radius: Radius of the output's kernel [m], l_render in the paper.
            kernel: Name of the kernel.
            reach: Distance from a particle at which there can be lava of it [m].
            more: Number of additional grids for callers to fill.
        """
        self._terrain, self._radius, self._kernel = terrain, radius, kernel
        device = terrain.known.device
        shape = (self.COUNT + more, terrain.ground.rows, terrain.ground.columns)
        self.grids = wp.zeros(shape, dtype=wp.float32, device=device)
        self.thickness, self.temperature = self.grids[0], self.grids[1]
        self.window = Window(shape[1:], math.ceil(reach / terrain.exact_ground.resolution))
        inputs = [terrain.known, self.grids, 0]
        wp.launch(_clear, dim=self.thickness.size, inputs=inputs, device=device)

    def fill(self, state: State, arguments: Any) -> None:
        """Fill thickness and temperature from the flow of the ordered particles.

        ``arguments`` is the argument of the kernels of a stage.

        Between the passes ``thickness`` holds the cells' weights.
        """
        weigh, share_out, gather = (
            kernel(state.real, self._kernel)
            for kernel in (_weigh_kernel, _share_out_kernel, _gather_kernel)
        )
        maps = [self.thickness, self.temperature]
        inputs = [arguments, self._terrain.exact_ground, self._radius]
        self.window.launch(state, weigh, [*inputs, *maps])
        launch_over(state, share_out, [*inputs, self.thickness])
        self.window.launch(state, gather, [*inputs, *maps])
