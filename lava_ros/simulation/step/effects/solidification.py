# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Solidification: a column colder than the solidus stops being fluid and becomes terrain.

At the end of a step the volume V of such a column is spread onto the staggered heights,

    raise_c = V w_c / (A sum w),    w_c = B((x_c - x) / d) B((y_c - y) / d),

A the area of a cell, B the quadratic B-spline of the surface, and the sum over the cells with
data, so that the raised cells hold V wherever the column is. The width d is the side of the
column's own area, sqrt(V / h): an even layer solidifies into an even layer. It is at least a cell,
or the surface would depend on the column's place within the cell. It is also at least 0.65 of the
width that extends as far as the kernel: otherwise irregularly spaced columns would solidify into
bumps that their neighbours' sums had smoothed out, and the order in which they solidify would
decide where later lava turns. It extends at most to the kernel radius. The column is removed from
the particles.

Maps show the column by the same weights, but only on cells of which lava has covered half
(``covered_cells.py``), or if none is near, that lava has reached: no lava is shown on other
ground. The raised ground is the solver's (particles/solidified.py); this effect adds to it.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.effects.heat import heat_loss
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.particles.cells import border_functions
from lava_ros.simulation.particles.layout import arguments_type, ground_type, PARTICLES, TIME
from lava_ros.simulation.particles.solidified import RaisedTerrain, THICKNESS_UNIT
from lava_ros.simulation.step.effects import DevicePart

#: Minimum width over the maximum: wider ones smooth the deposit by more than the bounds of its
#: verification case allow; with narrower ones, runs that differ in rounding diverge sooner.
_MIN_WIDTH_RATIO = 0.65

#: Minimum number of steps in which lava solidifies: a column solidifies at the end of a step, on
#: average half a step late, and advances too far by as much.
_FREEZING_STEPS = 16

#: Minimum excess over the solidus [K]: cooler lava solidifies at its vent.
_MIN_ABOVE_SOLIDUS = 10.0


@lru_cache
def _patch_functions(real: Any) -> tuple[Any, Any, Any]:
    """Return the functions of the width, the weights and the cells of a column's deposit."""

    @wp.func
    def width_of(
        volume: real, thickness: real, exact: ground_type(wp.float64), widest: wp.float64
    ):
        side = wp.sqrt(wp.float64(volume) / wp.float64(thickness))
        min_width = wp.max(wp.float64(_MIN_WIDTH_RATIO) * widest, exact.resolution)
        return wp.max(wp.min(side, widest), min_width)

    @wp.func
    def spline(t: wp.float64) -> wp.float64:
        u = wp.abs(t)
        if u < wp.float64(0.5):
            return wp.float64(0.75) - u * u
        rest = wp.max(wp.float64(1.5) - u, wp.float64(0.0))
        return wp.float64(0.5) * rest * rest

    @wp.func
    def weight_of(
        exact: ground_type(wp.float64), x: real, y: real, width: wp.float64, i: int, j: int
    ):
        """Return the weight of cell [i, j]; the ring is at -1 and past the last."""
        half = wp.float64(0.5)
        cell_x = exact.x0 + (wp.float64(j) + half) * exact.resolution
        cell_y = exact.y0 + (wp.float64(i) + half) * exact.resolution
        return spline((cell_x - wp.float64(x)) / width) * spline((cell_y - wp.float64(y)) / width)

    @wp.func
    def patch_of(exact: ground_type(wp.float64), x: real, y: real, width: wp.float64) -> wp.vec4i:
        """Return the first column and the one after the last, then the same for rows."""
        reach = wp.float64(1.5) * width
        one = wp.float64(1.0)
        west = (wp.float64(x) - reach - exact.x0) / exact.resolution
        east = (wp.float64(x) + reach - exact.x0) / exact.resolution
        south = (wp.float64(y) - reach - exact.y0) / exact.resolution
        north = (wp.float64(y) + reach - exact.y0) / exact.resolution
        return wp.vec4i(
            wp.max(int(wp.floor(west)), -1),
            wp.min(int(wp.floor(east + one)), exact.columns + 1),
            wp.max(int(wp.floor(south)), -1),
            wp.min(int(wp.floor(north + one)), exact.rows + 1),
        )

    return width_of, weight_of, patch_of


@lru_cache
def _deposit_function(real: Any) -> Any:
    """Return the function that turns a column into ground."""
    vec4 = wp.types.vector(4, real)
    width_of, weight_of, patch_of = _patch_functions(real)

    @wp.func
    def is_shown(m: arguments_type(real), row: int, column: int, level: int) -> bool:
        """Return True if a cell has data, on level 1 is reached, and on level 2 half inundated."""
        if m.ground.known[row, column] == wp.uint8(0):
            return False
        if level == 2:
            return m.half_inundated[row, column] >= wp.float32(0.0)
        return level == 0 or m.arrived[row, column] >= wp.float32(0.0)

    @wp.func
    def total_of(
        p: vec4, m: arguments_type(real), exact: ground_type(wp.float64), width: wp.float64,
        level: int,
    ) -> wp.float64:
        """Sum the weights of the cells on a level (``is_shown``)."""
        patch = patch_of(exact, p[0], p[1], width)
        total = wp.float64(0.0)
        for row in range(wp.max(patch[2], 0), wp.min(patch[3], exact.rows)):
            for column in range(wp.max(patch[0], 0), wp.min(patch[1], exact.columns)):
                if is_shown(m, row, column, level):
                    total += weight_of(exact, p[0], p[1], width, row, column)
        return total

    @wp.func
    def lay_down(
        i: int, p: vec4, m: arguments_type(real), widest: wp.float64,
        exact: ground_type(wp.float64), deposit: wp.array2d(dtype=wp.int64),
        placed: wp.array2d(dtype=wp.int64),
    ):
        width = width_of(p[2], m.flow[i][0], exact, widest)
        patch = patch_of(exact, p[0], p[1], width)
        volume = wp.float64(p[2]) / (exact.resolution * exact.resolution)
        volume /= wp.float64(wp.static(THICKNESS_UNIT))
        total = total_of(p, m, exact, width, 0)
        parts = volume / total
        # cells without data and the ring are raised too, so that the deposit has no cliff there
        for row in range(patch[2], patch[3]):
            for column in range(patch[0], patch[1]):
                amount = parts * weight_of(exact, p[0], p[1], width, row, column)
                wp.atomic_add(deposit, row + 1, column + 1, wp.int64(wp.round(amount)))
        # lava too thin to reach any of the cells is placed in all of them
        level = wp.int32(2)
        shown = total_of(p, m, exact, width, level)
        while level > 0 and shown == wp.float64(0.0):
            level -= 1
            shown = total_of(p, m, exact, width, level)
        parts = volume / shown
        for row in range(wp.max(patch[2], 0), wp.min(patch[3], exact.rows)):
            for column in range(wp.max(patch[0], 0), wp.min(patch[1], exact.columns)):
                if is_shown(m, row, column, level):
                    amount = wp.round(parts * weight_of(exact, p[0], p[1], width, row, column))
                    before = wp.atomic_add(placed, row, column, wp.int64(amount))
                    # films too thin to count may add up
                    top = (wp.float64(before) + amount) * wp.float64(wp.static(THICKNESS_UNIT))
                    is_thick = top >= wp.float64(m.constants.threshold)
                    if is_thick and m.arrived[row, column] < wp.float32(0.0):
                        m.arrived[row, column] = wp.float32(m.clock[TIME])
        m.particle[i] = vec4(p[0], p[1], -p[2], p[3])

    return lay_down


@lru_cache
def _kernels(real: Any, threads: int) -> tuple[Any, Any]:
    vec4 = wp.types.vector(4, real)
    is_known, *_ = border_functions(real)
    width_of, _, patch_of = _patch_functions(real)
    lay_down = _deposit_function(real)

    @quick_kernel()
    def freeze(
        thread: int, m: arguments_type(real), solidus: wp.float64, widest: wp.float64,
        exact: ground_type(wp.float64), deposit: wp.array2d(dtype=wp.int64),
        placed: wp.array2d(dtype=wp.int64),
    ):
        """Deposit columns below the solidus; their volume is negative until the next pass."""
        if m.cold[0] == 0:
            return
        for i in range(thread, m.counts[PARTICLES], threads):
            p = m.particle[i]
            # lava off the terrain has left
            if wp.float64(p[3]) < solidus and is_known(m.ground, p[0], p[1]):
                lay_down(i, p, m, widest, exact, deposit, placed)

    @quick_kernel()
    def raise_ground(
        thread: int, m: arguments_type(real), widest: wp.float64, exact: ground_type(wp.float64),
        deposit: wp.array2d(dtype=wp.int64), bare: wp.array2d(dtype=real),
    ):
        """Update the heights under newly solidified columns, and set their volume to 0."""
        if m.cold[0] == 0:
            return
        for i in range(thread, m.counts[PARTICLES], threads):
            p = m.particle[i]
            if p[2] < real(0.0):
                width = width_of(-p[2], m.flow[i][0], exact, widest)
                patch = patch_of(exact, p[0], p[1], width)
                for row in range(patch[2] + 1, patch[3] + 1):
                    for column in range(patch[0] + 1, patch[1] + 1):
                        top = wp.float64(deposit[row, column])
                        top *= wp.float64(wp.static(THICKNESS_UNIT))
                        top += wp.float64(bare[row, column])
                        m.ground.elevation[row, column] = real(top)
                m.particle[i] = vec4(p[0], p[1], real(0.0), p[3])

    return freeze, raise_ground


class Part(DevicePart):
    """The pass that lets lava solidify."""

    terrain: RaisedTerrain

    def prepare(self, scene: Scene) -> None:
        """Prepare for the solidus of the scene's lava."""
        self._solidus, self._widest = scene.lava.solidus, self.accuracy.radius / 1.5

    @staticmethod
    def step_limit(scene: Scene, accuracy: Accuracy, reach: float) -> float:
        """Return the longest step that resolves how lava from the vents solidifies [s]."""
        assert accuracy.thickness is not None
        lava = scene.lava
        soonest, loss_at = math.inf, heat_loss(scene)
        for vent in scene.vents:
            loss = loss_at(vent.temperature)
            if loss > 0.0 and vent.temperature > lava.solidus:
                above = max(vent.temperature - lava.solidus, _MIN_ABOVE_SOLIDUS)
                capacity = lava.density * lava.specific_heat * accuracy.thickness
                soonest = min(soonest, capacity * above / loss)
        return soonest / _FREEZING_STEPS

    def finish_step(self, arguments: Any) -> None:
        """Turn columns that are colder than the solidus into ground."""
        state, terrain = self.state, self.terrain
        threads = state.rare_threads
        freeze, raise_ground = _kernels(state.real, threads)
        laid = [self._widest, terrain.exact_ground, terrain.deposit]
        state.launches(freeze, [arguments, self._solidus, *laid, terrain.placed], dim=threads)
        state.launches(raise_ground, [arguments, *laid, terrain.bare], dim=threads)
