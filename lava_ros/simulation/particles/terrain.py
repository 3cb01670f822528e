# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The staggered terrain grid (3.15 to 3.22): heights at cell centres, gradients between them.

At the cells' corners the gradient is the paper's 3.21. Between them the paper interpolates it
bilinearly, component by component; no surface has that gradient, and a pond on it never comes to
rest. Here it is the gradient of the quadratic B-spline of the heights: linear along its own
direction, quadratic across, the same at the corners, and curl-free.
"""

from functools import lru_cache
import math
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.scene import Terrain
from lava_ros.simulation.backend.memory import shared_array
from lava_ros.simulation.particles.layout import arguments_type, centre_of, ground_type, REAL

#: Strides of a 2-D array are in bytes.
_PATCH = """
    wp::mat_t<3, 3, NUMBER> patch;
    for (int n = 0; n < 3; ++n) {
        const NUMBER* row = reinterpret_cast<const NUMBER*>(
            reinterpret_cast<const char*>(values.data) + size_t(i + n) * values.strides[0]) + j;
        for (int m = 0; m < 3; ++m) {
#if defined(__CUDA_ARCH__)
            patch.data[n][m] = __ldg(row + m);
#else
            patch.data[n][m] = row[m];
#endif
        }
    }
    return patch;
"""

#: Maps of a terrain that simulations share.
_HAS_DATA, _IS_SEA = attrgetter('has_data'), attrgetter('is_sea')


def known_on(terrain: Terrain, device: Any) -> Any:
    """Return ``StaggeredTerrain.known``, which must not be written to."""
    return shared_array(_HAS_DATA, terrain, wp.uint8, device)


class StaggeredTerrain:
    """A terrain on a device; simulations on the same one share its arrays.

    Attributes:
        height: Elevation of the cells and of a ring around them, above a level [m], shape
            [rows + 2, columns + 2].
        bare: ``height`` without solidified lava.
        known: 1 for cells of ground, 0 for those without data and the sea, shape [rows, columns].
        sea: 1 for cells in the sea, 0 for others, same shape; None without a sea.
        ground: Argument of kernels with all of these.
        exact_ground: The same argument in float64, without elevations.
    """

    def __init__(self, terrain: Terrain, precision: str, device: Any) -> None:
        """Copy the heights to the device."""
        rows, columns = terrain.shape
        self.bare = shared_array(ringed_heights, terrain, REAL[precision], device)
        self.height, self.known, self.sea = self.bare, known_on(terrain, device), None
        if terrain.sea_level is not None:
            self.sea = shared_array(_IS_SEA, terrain, wp.uint8, device)
        x0, y0 = np.asarray(terrain.origin) - centre_of(terrain)
        self.ground, self.exact_ground = ground_type(REAL[precision])(), ground_type(wp.float64)()
        for ground in (self.ground, self.exact_ground):
            ground.x0, ground.y0 = float(x0), float(y0)
            ground.resolution = terrain.resolution
            ground.rows, ground.columns = rows, columns
            ground.known = self.known
            if self.sea is not None:
                ground.sea = self.sea
        self.ground.elevation = self.height

    def raise_to(self, places: np.ndarray, top: Any) -> None:
        """Raise a height [m], shape [1] on the device, to the highest ground of some places.

        They are relative to the terrain's centre [m], shape [count, 2].
        """
        real, device = self.height.dtype, self.height.device
        where = wp.array(places, dtype=wp.types.vector(2, real), device=device)
        wp.launch(_raise(real), len(places), [where, self.ground], [top], device=device)


@lru_cache
def _raise(real: Any) -> Any:
    height_at = terrain_functions(real).height_at

    @wp.kernel(module='unique', enable_backward=False)
    def raise_top(
        places: wp.array(dtype=wp.types.vector(2, real)),
        ground: ground_type(real),
        top: wp.array(dtype=real),
    ):
        place = places[wp.tid()]
        wp.atomic_max(top, 0, height_at(ground, place[0], place[1]))

    return raise_top


def sampled(values: np.ndarray, before: Terrain, after: Terrain, *, outside: float) -> np.ndarray:
    """Sample values at the middles of the cells of another terrain, from the cells around them.

    ``values`` have the shape of the terrain ``before``; cells beyond it become ``outside``.
    """
    index, is_inside = [], []
    for axis in (0, 1):
        middles = (np.arange(after.shape[axis]) + 0.5) * after.resolution
        middles += after.origin[1 - axis] - before.origin[1 - axis]
        place = np.floor(middles / before.resolution).astype(int)
        is_inside.append((place >= 0) & (place < before.shape[axis]))
        index.append(np.clip(place, 0, before.shape[axis] - 1))
    return np.where(np.logical_and.outer(*is_inside), values[np.ix_(*index)], outside)


def averaged(values: np.ndarray, before: Terrain, after: Terrain) -> np.ndarray:
    """Average values over the cells of another terrain, weighted by the common area.

    ``values`` have the shape of the terrain ``before``; outside of it they are 0. The sum over the
    common area is kept, and values on the same cells do not change.
    """
    for axis in (0, 1):
        values = _averaged_along(axis, values, before, after)
    # makes sums of equal maps independent of the memory layout
    return np.ascontiguousarray(values)


def _averaged_along(axis: int, values: np.ndarray, before: Terrain, after: Terrain) -> np.ndarray:
    """Return the means along the columns (axis 0) or the rows of a grid."""
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


@lru_cache(maxsize=3)
def ringed_heights(terrain: Terrain) -> np.ndarray:
    """Return elevations above a level [m], extended by one cell, shape [rows + 2, columns + 2].

    Outside the grid the terrain continues with the slope of its border; on cells without data it
    continues with the slope of adjacent cells. A level near the mean saves digits in float32.
    Members of an ensemble on the same terrain share the array.
    """
    height = terrain.elevation.astype(np.float64)
    if np.isnan(height).any():
        height = _extended(height)
    return np.pad(height - _level(height), 1, mode='reflect', reflect_type='odd')


def _level(height: np.ndarray) -> float:
    """Return the mean, rounded to a multiple of a power of two that the relief exceeds [m].

    With the mean itself, ground that is raised anywhere would change all rounding errors.
    """
    mean, relief = float(height.mean()), float(np.ptp(height))
    if relief == 0.0:
        return mean
    unit = 2.0 ** math.floor(math.log2(relief))
    return unit * round(mean / unit)


def _extended(height: np.ndarray) -> np.ndarray:
    """Fill cells next to known ones with the mean of their neighbours' linear continuations."""
    rows, columns = height.shape
    wide = np.pad(height, 2, constant_values=np.nan)
    total = np.zeros_like(height)
    number = np.zeros_like(height)
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        near = wide[2 + dy : 2 + dy + rows, 2 + dx : 2 + dx + columns]
        far = wide[2 + 2 * dy : 2 + 2 * dy + rows, 2 + 2 * dx : 2 + 2 * dx + columns]
        continued = np.where(np.isfinite(far), 2.0 * near - far, near)
        usable = np.isfinite(continued)
        total[usable] += continued[usable]
        number += usable
    filled = np.where(number > 0, total / np.maximum(number, 1), np.nanmean(height))
    return np.where(np.isnan(height), filled, height)


class TerrainFunctions(NamedTuple):
    """Device functions that read a staggered terrain."""

    gradient_at: Any
    curvature_at: Any
    height_at: Any


@lru_cache
def _patch_function(real: Any) -> Any:
    """Return the device function that reads rows i to i + 2, columns j to j + 2 of a 2-D array."""
    mat33 = wp.types.matrix((3, 3), real)

    @wp.func_native(_PATCH.replace('NUMBER', f'wp::{real.__name__}'))
    def load(values: wp.array2d(dtype=real), i: int, j: int) -> mat33: ...

    return load


@lru_cache
def terrain_functions(real: Any) -> TerrainFunctions:
    """Return the functions for gradient, curvature and height."""
    vec2 = wp.types.vector(2, real)
    patch = _patch_function(real)

    @wp.func
    def spline(n: int, t: real) -> real:
        """Weight of the n-th of three rows (or columns): a quadratic B-spline."""
        if n == 1:
            return real(0.75) - t * t
        side = real(0.5) + wp.where(n == 0, -t, t)
        return real(0.5) * side * side

    @wp.func
    def cell_at(ground: ground_type(real), x: real, y: real):
        """Return row and column of the cell at a place, and the place relative to its centre."""
        inverse = real(1.0) / ground.resolution
        column = (x - ground.x0) * inverse
        row = (y - ground.y0) * inverse
        i = wp.clamp(int(wp.floor(row)), 0, ground.rows - 1)
        j = wp.clamp(int(wp.floor(column)), 0, ground.columns - 1)
        s = wp.clamp(column - real(j) - real(0.5), real(-0.5), real(0.5))
        t = wp.clamp(row - real(i) - real(0.5), real(-0.5), real(0.5))
        return i, j, s, t

    @wp.func
    def gradient_at(ground: ground_type(real), x: real, y: real) -> vec2:
        inverse = real(1.0) / ground.resolution
        i, j, s, t = cell_at(ground, x, y)
        before_s = real(0.5) - s
        after_s = real(0.5) + s
        before_t = real(0.5) - t
        after_t = real(0.5) + t
        rise = vec2()
        around = patch(ground.elevation, i, j)
        for n in range(3):
            east = before_s * (around[n, 1] - around[n, 0])
            east += after_s * (around[n, 2] - around[n, 1])
            north = before_t * (around[1, n] - around[0, n])
            north += after_t * (around[2, n] - around[1, n])
            rise += vec2(spline(n, t) * east, spline(n, s) * north)
        return rise * inverse

    @wp.func
    def curvature_at(ground: ground_type(real), x: real, y: real) -> real:
        """Largest curvature of the surface whose gradient is ``gradient_at``, 0 on a dome."""
        inverse = real(1.0) / ground.resolution
        i, j, s, t = cell_at(ground, x, y)
        along = real(0.0)
        across = real(0.0)
        twist = real(0.0)
        around = patch(ground.elevation, i, j)
        for n in range(3):
            west = around[n, 1] - around[n, 0]
            east = around[n, 2] - around[n, 1]
            south = around[1, n] - around[0, n]
            north = around[2, n] - around[1, n]
            along += spline(n, t) * (east - west)
            across += spline(n, s) * (north - south)
            # the derivative of the spline's weight
            change = real(-2.0) * t
            if n != 1:
                change = t + wp.where(n == 0, real(-0.5), real(0.5))
            twist += change * ((real(0.5) - s) * west + (real(0.5) + s) * east)
        mean = real(0.5) * (along + across)
        half = real(0.5) * (along - across)
        largest = mean + wp.sqrt(half * half + twist * twist)
        return wp.max(largest, real(0.0)) * inverse * inverse

    @wp.func
    def height_at(ground: ground_type(real), x: real, y: real) -> real:
        """Height of the surface whose gradient is ``gradient_at``."""
        i, j, s, t = cell_at(ground, x, y)
        total = real(0.0)
        around = patch(ground.elevation, i, j)
        for m in range(3):
            for n in range(3):
                total += spline(m, t) * spline(n, s) * around[m, n]
        return total

    return TerrainFunctions(gradient_at, curvature_at, height_at)


@lru_cache
def speed_limit_function(real: Any) -> Any:
    """Return the device function that limits a velocity at a place to the speed of free fall."""
    vec2 = wp.types.vector(2, real)
    height_at = terrain_functions(real).height_at

    @wp.func
    def limit_speed(velocity: vec2, thickness: real, place: vec2, m: arguments_type(real)) -> vec2:
        square = wp.dot(velocity, velocity)
        head = square / (real(2.0) * m.constants.gravity) - thickness
        kept = velocity
        # read the ground's height only for the few particles this fast
        if head > real(0.0):
            fall = wp.max(m.top[0] - height_at(m.ground, place[0], place[1]), real(0.0))
            if head > fall:
                kept *= wp.sqrt((fall + thickness) / (head + thickness))
        return kept

    return limit_speed
