# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The solver's grid: cells of 2^k times the size of a terrain's, and maps between both."""

from functools import lru_cache
import math

import numpy as np

from lava_ros.scene import Terrain
from lava_ros.simulation.cells.cell_size import doublings_of
from lava_ros.simulation.particles.terrain import averaged
from lava_ros.simulation.setup.coarse_ground import halve_ground, subdivide_ground


@lru_cache(maxsize=2)
def grid_of(terrain: Terrain, spacing: float) -> Terrain:
    """Return the ground on cells of 2^k times the terrain's size, the nearest to a spacing [m].

    The ground is the B-spline of the terrain, as for particles. Members of an ensemble, and their
    partners on larger cells, share it.

    Raises:
        LavaError: If the spacing is too small for the terrain.
    """
    grid, doublings = terrain, doublings_of(terrain, spacing)
    for _ in range(doublings):
        grid = halve_ground(grid)
    for _ in range(-doublings):
        grid = subdivide_ground(grid)
    return grid


@lru_cache(maxsize=2)
def fraction_with_data(terrain: Terrain, grid: Terrain) -> np.ndarray | None:
    """Return the fraction of each of the solver's cells that the terrain's data cover.

    It is 1 in cells without any data. None means that data cover all cells.
    """
    if grid.resolution <= terrain.resolution:
        return None
    fraction = averaged(terrain.has_data.astype(np.float64), terrain, grid)
    fraction[fraction == 0.0] = 1.0
    return None if (fraction == 1.0).all() else fraction


#: Rows and columns of a map.
Part = tuple[slice, slice]


def cells_under(part: Part, grid: Terrain, terrain: Terrain) -> Part:
    """Return the rows and columns of the solver's cells under some of the terrain's."""
    scale = terrain.resolution / grid.resolution
    rows, columns = (
        slice(math.floor(one.start * scale), min(math.ceil(one.stop * scale), count))
        for one, count in zip(part, grid.shape, strict=True)
    )
    return rows, columns


def within_ring(part: Part) -> Part:
    """Return the rows and columns of a part in maps with a ring of one cell."""
    rows, columns = (slice(one.start + 1, one.stop + 1) for one in part)
    return rows, columns


def on_terrain(values: np.ndarray, grid: Terrain, terrain: Terrain, part: Part) -> np.ndarray:
    """Return values of ``cells_under`` a part on the terrain's cells, with the same volume."""
    if grid.shape == terrain.shape:
        return values
    ratio = round(terrain.resolution / grid.resolution)
    if np.array_equal(np.multiply(terrain.shape, ratio), grid.shape):
        shape = [number for one in part for number in (one.stop - one.start, ratio)]
        return values.reshape(shape).mean(axis=(1, 3))
    # a larger cell of an odd side continues beyond the terrain
    ratio = round(grid.resolution / terrain.resolution)
    places = (np.arange(one.start, one.stop) // ratio - one.start // ratio for one in part)
    return values[np.ix_(*places)]


def deposit(
    grid: Terrain, places: np.ndarray, amounts: np.ndarray, sides: np.ndarray
) -> np.ndarray:
    """Distribute amounts evenly over squares around places: columns of an even lattice are even.

    What would be on cells outside of the ground goes to the cell of the place.

    Args:
        grid: The solver's cells.
        places: Map positions (x, y) [m], shape [count, 2], on cells of ground.
        amounts: Amounts, shape [count].
        sides: Sides of the squares [m], shape [count].

    Returns:
        Sums of the amounts, float64, shape [rows, columns].
    """
    rows, columns = grid.shape
    place, half = (places - grid.origin) / grid.resolution, 0.5 * sides / grid.resolution
    own = np.floor(place).astype(int)
    own = np.clip(own[:, 1], 0, rows - 1) * columns + np.clip(own[:, 0], 0, columns - 1)
    low, high = place - half[:, None], place + half[:, None]
    first = np.floor(low).astype(int)
    count = int((np.floor(high).astype(int) - first).max(initial=0)) + 1
    total, is_ground = np.zeros(rows * columns), grid.has_data.ravel()

    def part(axis: int, step: int) -> np.ndarray:
        """Return the fraction of the squares in a row or column of cells."""
        cell = first[:, axis] + step
        common = np.minimum(high[:, axis], cell + 1) - np.maximum(low[:, axis], cell)
        return np.maximum(common, 0.0) / (2.0 * half)

    for up in range(count):
        for right in range(count):
            i, j = first[:, 1] + up, first[:, 0] + right
            inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
            cell = np.where(inside, i * columns + j, own)
            cell = np.where(is_ground[cell], cell, own)
            share = amounts * part(1, up) * part(0, right)
            total += np.bincount(cell, weights=share, minlength=total.size)
    return total.reshape(rows, columns)
