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
the particles; the solidified volume is summed in ``State.frozen``.

Maps show the column by the same weights, but only on cells that lava has reached
(``own_ground.py``): no lava is shown on ground that lava has not reached.

Solidified lava is stored separately from the ground in integer multiples of 2^-44 m: sums of
integers do not depend on their order, so runs are bitwise identical, and deposits are not lost to
the rounding of a float32 elevation.
"""

from collections.abc import Mapping
from functools import lru_cache
import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects.heat import heat_loss
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.memory import read
from lava_ros.simulation.backend.threads import launch_over
from lava_ros.simulation.particles.cells import border_functions
from lava_ros.simulation.particles.layout import (
    arguments_type,
    BORDER,
    fitting,
    ground_type,
    HOLES,
    PARTICLES,
)
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.particles.terrain import StaggeredTerrain

#: Minimum width over the maximum: wider ones smooth the deposit by more than the bounds of its
#: verification case allow; with narrower ones, runs that differ in rounding diverge sooner.
_MIN_WIDTH_RATIO = 0.65

#: Unit of the solidified lava's thickness [m]; the maximum thickness is 2^63 units.
_PART = 2.0**-44

#: Minimum number of steps in which lava solidifies: a column solidifies at the end of a step, on
#: average half a step late, and advances too far by as much.
_FREEZING_STEPS = 16

#: Minimum excess over the solidus [K]: cooler lava solidifies at its vent.
_MIN_ABOVE_SOLIDUS = 10.0


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


@lru_cache
def _kernels(real: Any, threads: int) -> tuple[Any, Any]:
    vec4 = wp.types.vector(4, real)
    is_known, *_ = border_functions(real)

    @wp.func
    def width_of(
        volume: real, thickness: real, frame: ground_type(wp.float64), widest: wp.float64
    ):
        side = wp.sqrt(wp.float64(volume) / wp.float64(thickness))
        least = wp.max(wp.float64(_MIN_WIDTH_RATIO) * widest, frame.resolution)
        return wp.max(wp.min(side, widest), least)

    @wp.func
    def spline(t: wp.float64) -> wp.float64:
        u = wp.abs(t)
        if u < wp.float64(0.5):
            return wp.float64(0.75) - u * u
        rest = wp.max(wp.float64(1.5) - u, wp.float64(0.0))
        return wp.float64(0.5) * rest * rest

    @wp.func
    def weight_of(
        frame: ground_type(wp.float64), x: real, y: real, width: wp.float64, i: int, j: int
    ):
        """Return the weight of cell [i, j]; the ring is at -1 and past the last."""
        half = wp.float64(0.5)
        cell_x = frame.x0 + (wp.float64(j) + half) * frame.resolution
        cell_y = frame.y0 + (wp.float64(i) + half) * frame.resolution
        return spline((cell_x - wp.float64(x)) / width) * spline((cell_y - wp.float64(y)) / width)

    @wp.func
    def patch_of(
        frame: ground_type(wp.float64), x: real, y: real, width: wp.float64
    ) -> wp.vec4i:
        """Return the first column and the one after the last, then the same for rows."""
        reach = wp.float64(1.5) * width
        one = wp.float64(1.0)
        west = (wp.float64(x) - reach - frame.x0) / frame.resolution
        east = (wp.float64(x) + reach - frame.x0) / frame.resolution
        south = (wp.float64(y) - reach - frame.y0) / frame.resolution
        north = (wp.float64(y) + reach - frame.y0) / frame.resolution
        return wp.vec4i(
            wp.max(int(wp.floor(west)), -1),
            wp.min(int(wp.floor(east + one)), frame.columns + 1),
            wp.max(int(wp.floor(south)), -1),
            wp.min(int(wp.floor(north + one)), frame.rows + 1),
        )

    @wp.func
    def is_shown(m: arguments_type(real), row: int, column: int, is_reached: bool) -> bool:
        if m.ground.known[row, column] == wp.uint8(0):
            return False
        return not is_reached or m.arrived[row, column] >= wp.float32(0.0)

    @wp.func
    def total_of(
        p: vec4, m: arguments_type(real), frame: ground_type(wp.float64), width: wp.float64,
        is_reached: bool,
    ) -> wp.float64:
        """Sum the weights of the cells with data, or of those that are also reached."""
        patch = patch_of(frame, p[0], p[1], width)
        total = wp.float64(0.0)
        for row in range(wp.max(patch[2], 0), wp.min(patch[3], frame.rows)):
            for column in range(wp.max(patch[0], 0), wp.min(patch[1], frame.columns)):
                if is_shown(m, row, column, is_reached):
                    total += weight_of(frame, p[0], p[1], width, row, column)
        return total

    @wp.func
    def lay_down(
        i: int,
        p: vec4,
        m: arguments_type(real),
        widest: wp.float64,
        frame: ground_type(wp.float64),
        deposit: wp.array2d(dtype=wp.int64),
        placed: wp.array2d(dtype=wp.int64),
    ):
        width = width_of(p[2], m.flow[i][0], frame, widest)
        patch = patch_of(frame, p[0], p[1], width)
        volume = wp.float64(p[2]) / (frame.resolution * frame.resolution)
        volume /= wp.float64(wp.static(_PART))
        total = total_of(p, m, frame, width, False)
        parts = volume / total
        # cells without data and the ring are raised too, so that the deposit has no cliff there
        for row in range(patch[2], patch[3]):
            for column in range(patch[0], patch[1]):
                share = parts * weight_of(frame, p[0], p[1], width, row, column)
                wp.atomic_add(deposit, row + 1, column + 1, wp.int64(wp.round(share)))
        reached = total_of(p, m, frame, width, True)
        # lava too thin to reach any of the cells is placed in all of them
        is_reached = reached > wp.float64(0.0)
        parts = volume / wp.where(is_reached, reached, total)
        for row in range(wp.max(patch[2], 0), wp.min(patch[3], frame.rows)):
            for column in range(wp.max(patch[0], 0), wp.min(patch[1], frame.columns)):
                if is_shown(m, row, column, is_reached):
                    share = parts * weight_of(frame, p[0], p[1], width, row, column)
                    wp.atomic_add(placed, row, column, wp.int64(wp.round(share)))
        wp.atomic_add(m.frozen, 0, wp.float64(p[2]))
        m.particle[i] = vec4(p[0], p[1], -p[2], p[3])

    @quick_kernel
    def freeze(
        thread: int,
        m: arguments_type(real),
        solidus: wp.float64,
        widest: wp.float64,
        frame: ground_type(wp.float64),
        deposit: wp.array2d(dtype=wp.int64),
        placed: wp.array2d(dtype=wp.int64),
    ):
        """Deposit columns below the solidus; their volume is negative until the next pass."""
        if m.cold[0] == 0:
            return
        for i in range(thread, m.counts[PARTICLES], threads):
            p = m.particle[i]
            # lava off the terrain has left
            if wp.float64(p[3]) < solidus and is_known(m.ground, p[0], p[1]):
                lay_down(i, p, m, widest, frame, deposit, placed)

    @quick_kernel
    def raise_ground(
        thread: int,
        m: arguments_type(real),
        widest: wp.float64,
        frame: ground_type(wp.float64),
        deposit: wp.array2d(dtype=wp.int64),
        bare: wp.array2d(dtype=real),
    ):
        """Update the heights under newly solidified columns, and set their volume to 0."""
        if m.cold[0] == 0:
            return
        for i in range(thread, m.counts[PARTICLES], threads):
            p = m.particle[i]
            if p[2] < real(0.0):
                width = width_of(-p[2], m.flow[i][0], frame, widest)
                patch = patch_of(frame, p[0], p[1], width)
                for row in range(patch[2] + 1, patch[3] + 1):
                    for column in range(patch[0] + 1, patch[1] + 1):
                        parts = wp.float64(deposit[row, column])
                        top = wp.float64(bare[row, column]) + parts * wp.float64(_PART)
                        m.ground.elevation[row, column] = real(top)
                m.particle[i] = vec4(p[0], p[1], real(0.0), p[3])

    return freeze, raise_ground


@quick_kernel(fast_math=False)
def _show(
    thread: int,
    placed: wp.array2d(dtype=wp.int64),
    known: wp.array2d(dtype=wp.uint8),
    solidus: wp.float32,
    thickness: wp.array2d(dtype=wp.float32),
    temperature: wp.array2d(dtype=wp.float32),
    frozen: wp.array2d(dtype=wp.float32),
):
    """Add solidified lava to a map; where all lava has solidified, it has the solidus."""
    i = thread // known.shape[1]
    j = thread % known.shape[1]
    if known[i, j] == wp.uint8(0):
        frozen[i, j] = wp.float32(wp.nan)
        return
    parts = wp.float64(placed[i, j])
    solid = wp.float32(parts * wp.float64(wp.static(_PART)))
    frozen[i, j] = solid
    thickness[i, j] = thickness[i, j] + solid
    if solid > wp.float32(0.0) and wp.isnan(temperature[i, j]):
        temperature[i, j] = solidus


class AfterStep:
    """Solidified lava on a terrain, and the pass that adds to it."""

    def __init__(
        self, scene: Scene, accuracy: Accuracy, terrain: StaggeredTerrain, state: State
    ) -> None:
        """Initialize without solidified lava."""
        assert accuracy.spacing is not None
        self._solidus = scene.lava.solidus
        self._widest = accuracy.ratio * accuracy.spacing / 1.5
        self._scene_terrain = scene.terrain
        self._terrain = terrain
        self._deposit = wp.zeros(terrain.height.shape, dtype=wp.int64, device=state.device)
        self._placed = wp.zeros(terrain.known.shape, dtype=wp.int64, device=state.device)

    def apply(self, state: State, way: Any) -> None:
        """Turn columns that are colder than the solidus into terrain."""
        threads = state.rare_threads
        freeze, raise_ground = _kernels(state.real, threads)
        laid = [self._widest, self._terrain.exact_ground, self._deposit]
        state.launches(freeze, [way, self._solidus, *laid, self._placed], dim=threads)
        state.launches(raise_ground, [way, *laid, self._terrain.bare], dim=threads)

    def show(self, state: State, grids: Any) -> None:
        """Add the solidified lava to a map.

        The ``grids`` are thickness [m] and temperature [K] of the fluid lava, which become those
        of all lava, and the thickness of solidified lava [m]; float32, on the device.
        """
        maps = [grids[n] for n in range(3)]
        arguments = [self._placed, self._terrain.known, self._solidus, *maps]
        launch_over(state, _show, arguments, count=maps[0].size)

    def thickness(self) -> np.ndarray:
        """Return the solidified thickness as maps show it [m], float64, shape [rows, columns]."""
        parts: np.ndarray = read(self._placed)
        return parts * _PART

    def take_over(self, former: 'AfterStep', state: State) -> None:
        """Transfer the solidified lava of the previous terrain to this one.

        Cells that do not coincide are weighted by their common area. Lava outside this terrain or
        on cells without data counts as having left.
        """
        terrain, before = self._scene_terrain, former._scene_terrain
        if terrain is before:
            self._placed, self._deposit = former._placed, former._deposit
            if self._terrain is not former._terrain:
                self._lay(read(self._deposit))
            return

        def moved(thickness: np.ndarray) -> np.ndarray:
            for axis in (0, 1):
                thickness = _shared(thickness, before, terrain, axis)
            # makes sums of equal maps independent of the memory layout
            return np.ascontiguousarray(thickness)

        frozen = former.thickness()
        thickness = moved(frozen)
        on_map = thickness.sum() * terrain.resolution**2
        lost = np.zeros(2)
        lost[BORDER] = frozen.sum() * before.resolution**2 - on_map
        lost[HOLES] = thickness[~terrain.has_data].sum() * terrain.resolution**2
        total, left = state.frozen.numpy(), state.left.numpy()
        # smaller differences are rounding
        if abs(lost.sum()) > 1e-9 * total[0]:
            state.frozen.assign(total - lost.sum())
            state.left.assign(left + lost)
        raised = read(former._deposit)[1:-1, 1:-1] * _PART
        raised = moved(np.where(before.has_data, raised, 0.0))
        for values in (thickness, raised):
            values[~terrain.has_data] = 0.0
        self._placed.assign(_counted(thickness))
        self._lay(_counted(np.pad(raised, 1, mode='edge')))

    def save(self) -> dict[str, np.ndarray]:
        """Copy the solidified lava."""
        return {'deposit': self._deposit.numpy().copy(), 'placed': self._placed.numpy().copy()}

    def load(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Restore a copy of ``save`` to a terrain without solidified lava.

        Raises:
            LavaError: If the copy belongs to another terrain.
        """
        named = {'deposit': self._deposit, 'placed': self._placed}
        found = {name: arrays.get(name) for name in named}
        if found['placed'] is None and found['deposit'] is not None:
            # older files have one array, which is shown as wide as it raises the ground
            inner = found['deposit'][1:-1, 1:-1]
            found['placed'] = np.where(self._scene_terrain.has_data, inner, 0)
        deposit, placed = (
            fitting(f'solidification.{name}', found[name], array.shape, np.int64)
            for name, array in named.items()
        )
        self._placed.assign(placed)
        self._lay(deposit)

    def _lay(self, parts: np.ndarray) -> None:
        self._deposit.assign(parts)
        self._terrain.height.assign(self._terrain.bare.numpy().astype(np.float64) + parts * _PART)


def _counted(thickness: np.ndarray) -> np.ndarray:
    """Return a thickness [m] in integer units."""
    return np.rint(thickness / _PART).astype(np.int64)


def _shared(values: np.ndarray, before: Terrain, after: Terrain, axis: int) -> np.ndarray:
    """Return means of a terrain's cells over those of another, along rows (axis 0) or columns."""
    side = 1 - axis
    offset = (after.origin[side] - before.origin[side]) / before.resolution
    ratio = after.resolution / before.resolution
    edges = offset + ratio * np.arange(after.shape[axis] + 1)
    # cells that coincide except for rounding
    edges = np.where(np.abs(edges - np.rint(edges)) < 1e-6, np.rint(edges), edges)
    values = np.moveaxis(values, axis, 0)
    start, end = edges[:-1], edges[1:]
    first = np.floor(start).astype(int)
    shared = np.zeros((len(start), values.shape[1]))
    for step in range(math.ceil(ratio) + 1):
        cell = first + step
        common = np.minimum(end, cell + 1) - np.maximum(start, cell)
        common[(cell < 0) | (cell >= len(values))] = 0.0
        shared += np.maximum(common, 0.0)[:, None] * values[np.clip(cell, 0, len(values) - 1)]
    return np.moveaxis(shared / ratio, 0, axis)
