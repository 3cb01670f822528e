# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Path of steepest descent, and the profile of the ground across it.

Ground beyond the border of a terrain, or on cells without data, is unknown. Along a line through a
known point it is assumed to continue the mean slope from there to the last known point. So unknown
ground next to or behind lava changes little, and a path ends where unknown ground is the lowest.
"""

from dataclasses import replace
from functools import lru_cache
import math

import numpy as np

from lava_ros.scene import Terrain

#: Maximum number of points of a path, and number of directions in which the next one is searched.
_MAX_POINTS, _DIRECTIONS = 256, 64

#: Distance between two points [cells], and radii over this distance for getting out of a pit.
_STRIDE, _PITS = 4.0, (1, 2, 3, 4, 6, 8)

#: Offsets of the neighbours of a cell at its sides and at its corners, (rows, columns).
_AROUND = ((0, 1), (0, -1), (1, 0), (-1, 0)), ((1, 1), (1, -1), (-1, 1), (-1, -1))

#: Rows of larger cells that are averaged at a time.
_STRIP = 64


@lru_cache(maxsize=4)
def average_terrain(terrain: Terrain, factor: int) -> Terrain:
    """Average a terrain over cells larger by a factor.

    A larger cell has data if at least half of its area has. Strips of rows save memory. Members of
    an ensemble share the result.
    """
    factor = min(factor, min(terrain.shape) // 2)
    if factor <= 1:
        return terrain
    rows, columns = (-(-side // factor) for side in terrain.shape)
    mean = np.empty((rows, columns))
    for row in range(0, rows, _STRIP):
        count = min(_STRIP, rows - row)
        known = terrain.ground[row * factor : (row + count) * factor]
        strip = np.full((count * factor, columns * factor), np.nan)
        strip[: known.shape[0], : known.shape[1]] = known
        blocks = strip.reshape(count, factor, columns, factor)
        number = np.isfinite(blocks).sum(axis=(1, 3))
        total = np.nansum(blocks, axis=(1, 3))
        mean[row : row + count] = np.where(
            2 * number >= factor**2, total / np.maximum(number, 1), np.nan
        )
    if not np.isfinite(mean).any():
        return terrain
    return replace(terrain, elevation=mean, resolution=terrain.resolution * factor)


def slope_at(terrain: Terrain, place: np.ndarray) -> float:
    """Return the slope, rise over run, at a place [m] whose cell and neighbours have data."""
    here = terrain.elevations_at(place)
    steps = terrain.resolution * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    rise = np.abs(terrain.elevations_at(place + steps) - here) / terrain.resolution
    rise = np.nan_to_num(rise)
    return float(math.hypot(rise[:2].max(), rise[2:].max()))


@lru_cache(maxsize=16)
def find_path(terrain: Terrain, start: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return points of the steepest descent [m], shape [points, 2], and their elevation [m].

    Each is the lowest point of a circle around the previous one, never backwards. In a pit the
    circle widens. The path ends in a pit wider than every circle, or with its first point on
    unknown ground; if that is the second point, a point behind the first one is added.
    """
    angle = np.linspace(0.0, 2.0 * math.pi, _DIRECTIONS, endpoint=False)
    directions = np.column_stack([np.cos(angle), np.sin(angle)])
    step = _STRIDE * terrain.resolution
    # one sample in each cell, and one close to the middle: that may be next to a border
    offset = np.array([0.25, *np.arange(1.0, _STRIDE + 1.0)]) * terrain.resolution
    points = [_find_known_place(terrain, np.array(start))]
    heights = [float(_sample_ground(terrain, points[0][None])[0])]
    ahead, is_known = np.ones(_DIRECTIONS, dtype=bool), True
    while is_known and len(points) < _MAX_POINTS:
        for times in _PITS:
            height, known = _sample_circle(terrain, points[-1], directions, times * offset)
            lowest = int(np.argmin(np.where(ahead, height, np.inf)))
            if height[lowest] < heights[-1]:
                break
        else:
            break
        is_known = bool(known[lowest])
        points.append(points[-1] + times * step * directions[lowest])
        heights.append(float(height[lowest]))
        ahead = directions @ directions[lowest] > 0.0
    if not is_known and len(points) == 2:
        points.insert(0, 2.0 * points[0] - points[1])
        heights.insert(0, 2.0 * heights[0] - heights[1])
    return np.array(points), np.array(heights)


def _sample_circle(
    terrain: Terrain, centre: np.ndarray, directions: np.ndarray, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return elevations [m] on a circle, and True where they are known, shape [directions].

    ``offsets`` are distances from the centre [m], the last is the radius. Where even the first is
    on unknown ground, the elevation is on the plane through the centre and the known points
    at the first distance.
    """
    height = _sample_ground(terrain, centre + offsets[-1] * directions)
    if np.isfinite(height).all():
        return height, np.full(height.shape, True)
    offsets = np.concatenate([-offsets[::-1], [0.0], offsets])
    half, middle = len(directions) // 2, len(offsets) // 2
    profile, known = sample_profiles(terrain, centre[None], directions[:half], offsets)
    height, near, is_known, is_near = (
        np.concatenate([item[:, middle + number], item[:, middle - number]])
        for item in (profile, known) for number in (middle, 1)
    )
    if not is_near.all():
        rise = near[is_near] - profile[0, middle]
        plane = np.linalg.lstsq(directions[is_near], rise, rcond=None)[0] / offsets[middle + 1]
        beyond = profile[0, middle] + offsets[-1] * directions @ plane
        height = np.where(is_near, height, beyond)
    return height, is_known


def sample_profiles(
    terrain: Terrain, centres: np.ndarray, directions: np.ndarray, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sample the ground along lines, and continue it where it is unknown.

    Args:
        terrain: The terrain.
        centres: Middle of each line, on known ground [m], shape [lines or 1, 2].
        directions: Unit vectors along the lines, shape [lines, 2].
        offsets: Distances from the middle [m], shape [samples] or [lines, samples], increasing;
            that in the middle is 0.

    Returns:
        Elevations [m], and True where they are known, shape [lines, samples].
    """
    offsets = np.broadcast_to(offsets, (len(directions), np.shape(offsets)[-1]))
    places = centres[:, None, :] + offsets[:, :, None] * directions[:, None, :]
    heights = _sample_ground(terrain, places.reshape(-1, 2)).reshape(offsets.shape)
    known = np.isfinite(heights)
    middle = offsets.shape[1] // 2
    for line in np.flatnonzero(~known.all(axis=1) & known[:, middle]):
        x, z, there = offsets[line], heights[line], np.flatnonzero(known[line])
        first, last = there[0], there[-1]
        z[first:last] = np.interp(x[first:last], x[there], z[there])
        for end, beyond in ((first, slice(None, first)), (last, slice(last + 1, None))):
            slope = (z[end] - z[middle]) / x[end] if end != middle else 0.0
            z[beyond] = z[end] + slope * (x[beyond] - x[end])
    return heights, known


def _find_known_place(terrain: Terrain, place: np.ndarray) -> np.ndarray:
    """Return a place [m], or the nearest middle of a cell with data if it is on none."""
    if terrain.covered(place[None])[0]:
        return place
    rows, columns = np.nonzero(terrain.has_data)
    middles = terrain.origin + (np.column_stack([columns, rows]) + 0.5) * terrain.resolution
    return middles[np.argmin(np.hypot(*(middles - place).T))]


def _sample_ground(terrain: Terrain, places: np.ndarray) -> np.ndarray:
    """Return elevations [m] at places (x, y), shape [places, 2]; NaN on cells without data.

    They are bilinear between the middles of cells. A cell without data next to the place's own
    cell is extrapolated.
    """
    column, row = ((places - terrain.origin) / terrain.resolution - 0.5).T
    j, i = np.floor(column).astype(int), np.floor(row).astype(int)
    s, t = column - j, row - i
    corners = np.array([_read(terrain, i + up, j + right) for up in (0, 1) for right in (0, 1)])
    if np.isnan(corners).any():
        own = terrain.elevations_at(places)
        at_edge = np.isnan(corners).any(axis=0) & np.isfinite(own)
        for number, corner in enumerate(corners):
            empty = at_edge & np.isnan(corner)
            up, right = divmod(number, 2)
            corner[empty] = _extrapolate(terrain, i[empty] + up, j[empty] + right, own[empty])
        corners[:, np.isnan(own)] = np.nan
    lower, lower_right, upper, upper_right = corners
    low = (1.0 - s) * lower + s * lower_right
    return (1.0 - t) * low + t * ((1.0 - s) * upper + s * upper_right)


def _read(terrain: Terrain, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return the elevations of cells [i, j] [m], float64, NaN off the grid."""
    rows, columns = terrain.shape
    inside = (i >= 0) & (j >= 0) & (i < rows) & (j < columns)
    found = terrain.ground[np.where(inside, i, 0), np.where(inside, j, 0)]
    return np.where(inside, found, np.nan).astype(np.float64)


def _extrapolate(
    terrain: Terrain, i: np.ndarray, j: np.ndarray, otherwise: np.ndarray
) -> np.ndarray:
    """Return elevations of cells without data [m]: the mean of lines through two cells each."""
    for neighbors in reversed(_AROUND):
        lines = np.array([
            2.0 * _read(terrain, i + up, j + right) - _read(terrain, i + 2 * up, j + 2 * right)
            for up, right in neighbors
        ])
        count = np.isfinite(lines).sum(axis=0)
        mean = np.nansum(lines, axis=0) / np.maximum(count, 1)
        otherwise = np.where(count, mean, otherwise)
    return otherwise
