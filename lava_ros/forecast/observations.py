# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Observed lava from files."""

from pathlib import Path

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.scene.features import ENDINGS
from lava_ros.scene.on_terrain import read_cover_on, read_polygons_on, read_raster_on


def observed_in_file(path: str | Path, terrain: Terrain) -> tuple[np.ndarray, np.ndarray]:
    """Read observed lava from a file.

    The file contains areas, or a raster with values above 0 for lava, 0 for no lava, and no data
    for cells that were not observed. Lava is in cells at least half of which it covers.

    Returns:
        Cells with lava and observed cells, each bool, shape [rows, columns] of the terrain.

    Raises:
        LavaError: If the file cannot be read, or has no lava on the terrain.
    """
    field = '--observed'
    # a .txt file may be a grid
    suffix = Path(path).suffix.lower()
    if suffix in ENDINGS and suffix != '.txt':
        lava, known = read_polygons_on(terrain, path, field=field), terrain.has_data
    else:
        known = np.isfinite(read_raster_on(terrain, path, field=field)) & terrain.has_data
        lava = read_cover_on(terrain, path, field=field)
    lava &= known
    if not lava.any():
        raise LavaError(field, str(path), f'observed lava {terrain.bounds(projected=True)}')
    return lava, known
