# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The size of the cells of lava: 2^k times that of the terrain's cells."""

import math

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.scene.terrain import MAX_SIDE_CELLS, RESOLUTION_RANGE

#: Maximum number of cells of a divided terrain: their arrays take 10 GB.
MAX_CELLS = 2**26


def cell_size(terrain: Terrain, spacing: float) -> float:
    """Return the size of the cells of lava that is nearest to a spacing [m].

    Raises:
        LavaError: If the spacing is too small for the terrain.
    """
    return terrain.resolution * 2.0 ** doublings_of(terrain, spacing)


def doublings_of(terrain: Terrain, spacing: float) -> int:
    """Return the doublings of a terrain's cells to the nearest to a spacing [m], < 0: halvings.

    The terrain limits the doublings: it needs two cells along each side.

    Raises:
        LavaError: If the spacing is too small for the terrain.
    """
    wanted = round(math.log2(spacing / terrain.resolution))
    side, size = min(terrain.shape), terrain.resolution
    halvings = math.log2(min(
        math.sqrt(MAX_CELLS / terrain.elevation.size), MAX_SIDE_CELLS / max(terrain.shape),
        size / RESOLUTION_RANGE[0],
    ))
    if wanted < 0 and -wanted > halvings:
        least = size * 0.5 ** max(math.floor(halvings), 0)
        expected = f'at least {least:.4g} m, the smallest cells that the terrain may have'
        raise LavaError('accuracy.spacing', spacing, expected)
    for count in range(wanted):
        if side < 4 or 2.0 * size > RESOLUTION_RANGE[1]:
            return count
        side, size = (side + 1) // 2, 2.0 * size
    return wanted
