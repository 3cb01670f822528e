# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The surface of cells twice as large, on the cells of a terrain.

The ground is the quadratic B-spline of the cells' elevations (particles/terrain.py). That of cells
of twice the size is also a spline on cells of half that size, with the weights of corner cutting
(Chaikin 1974): 3/4 of the larger cell, 1/4 of its neighbour. A run on it has the same cells.
"""

from dataclasses import replace

import numpy as np

from lava_ros.scene import Terrain
from lava_ros.simulation.particles.terrain import ringed_heights


def coarsen_ground(terrain: Terrain) -> Terrain | None:
    """Return the ground of cells twice as large, as elevations of the same cells.

    Cells without data stay so. None means that there are fewer than two larger cells along a side.
    """
    if min(terrain.shape) < 4:
        return None
    coarse = subdivide_ground(halve_ground(terrain))
    fine = coarse.elevation[: terrain.shape[0], : terrain.shape[1]]
    return replace(terrain, elevation=np.where(terrain.has_data, fine, np.float32(np.nan)))


def halve_ground(terrain: Terrain) -> Terrain:
    """Return the mean elevations of cells twice as large; with data if a cell in them has data."""
    height = ringed_heights(terrain)
    # the ground continues beyond cells with data; an odd side gets another row
    height, known = height[1:-1, 1:-1] + _mean(terrain), terrain.has_data
    odd = [(0, side % 2) for side in terrain.shape]
    height = np.pad(height, odd, mode='reflect', reflect_type='odd')
    known = np.pad(known, odd)

    def blocks(values: np.ndarray) -> np.ndarray:
        return values.reshape(len(values) // 2, 2, -1, 2)

    mean = np.where(blocks(known).any(axis=(1, 3)), blocks(height).mean(axis=(1, 3)), np.nan)
    return replace(terrain, elevation=mean, resolution=2.0 * terrain.resolution)


def subdivide_ground(terrain: Terrain) -> Terrain:
    """Return the same ground on cells of half the size."""
    ringed, known, mean = ringed_heights(terrain), terrain.has_data, _mean(terrain)
    for _ in range(2):
        inner, before, after = ringed[1:-1], ringed[:-2], ringed[2:]
        halves = np.stack([0.75 * inner + 0.25 * before, 0.75 * inner + 0.25 * after], axis=1)
        ringed = halves.reshape(-1, ringed.shape[1]).T
    where = np.repeat(np.repeat(known, 2, axis=0), 2, axis=1)
    return replace(
        terrain,
        elevation=np.where(where, ringed + mean, np.nan),
        resolution=0.5 * terrain.resolution,
    )


def _mean(terrain: Terrain) -> float:
    """Return the level that ``ringed_heights`` subtracts [m]."""
    known = terrain.has_data
    return float((terrain.elevation - ringed_heights(terrain)[1:-1, 1:-1])[known].mean())
