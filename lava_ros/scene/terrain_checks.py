# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What looks wrong in a file of elevations: refused, warned of, or filled."""

from functools import reduce
from itertools import product
import logging
from pathlib import Path

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.files.optional import is_installed
from lava_ros.scene.projection import Raster, rasterio_for
from lava_ros.scene.terrain import Terrain

_LOG = logging.getLogger(__name__)

#: Heights of ground [m]: below the first nothing is, above the second nothing on Earth.
LOWEST, HIGHEST = -12_000.0, 9_000.0

#: A height that is a trench of the ocean, or no data: then no ground is so little above it [m].
MARK, LEAST_GAP = -9999.0, 1000.0

#: Depth of a cell below all its neighbours, in cells, from which on it is an error of the file.
PIT_DEPTH = 2.0

#: How far holes are filled from [cells].
FILL_DISTANCE = 1000.0


def check_heights(raster: Raster, path: Path) -> None:
    """Raise LavaError for heights that no ground has: marks of missing data, and feet."""
    known = raster.elevation[np.isfinite(raster.elevation)]
    if not known.size:
        return
    low, high = float(known.min()), float(known.max())
    above = known[known > low]
    stands_apart = low == MARK and bool(above.size) and float(above.min()) > low + LEAST_GAP
    if low < LOWEST or stands_apart:
        right = f'at least {LOWEST:g} m; a cell without data has the value that the header calls '
        right += f'NODATA_value (gdal_edit.py -a_nodata {low:g} says it in a GeoTIFF)'
        raise LavaError(f'a height of {path.name}', low, right)
    # what does not say where it is may be another planet
    if high > HIGHEST and raster.is_placed:
        right = f'metres, on Earth at most {HIGHEST:g}: feet times 0.3048'
        raise LavaError(f'a height of {path.name}', high, right)


def tell(path: Path, terrain: Terrain, source: str, wrong: np.ndarray, *, is_filled: bool) -> None:
    """Log how a file was read, and warn of what looks wrong in it.

    ``source`` is the coordinate system that the file states. ``wrong`` marks its holes and pits,
    bool, shape [rows, columns]; ``is_filled`` says that they have been filled.
    """
    system = source
    if terrain.epsg and source != f'EPSG:{terrain.epsg}':
        system = f'{source} taken to EPSG:{terrain.epsg}'
    low, high = float(np.nanmin(terrain.elevation)), float(np.nanmax(terrain.elevation))
    rows, columns = terrain.shape
    holes = int((~terrain.has_data).sum())
    _LOG.info(
        f'{path.name}: {system}, {columns} x {rows} cells of {terrain.resolution:g} m, '
        f'{holes or "none"} without data, elevations {low:.6g} to {high:.6g} m'
    )
    if wrong.any():
        count = int(wrong.sum())
        row, column = np.argwhere(wrong)[0]
        east, north = (
            terrain.offset[axis] + terrain.origin[axis] + (cell + 0.5) * terrain.resolution
            for axis, cell in enumerate((column, row))
        )
        done = 'the simulation would lose or trap lava there '
        done += '(--fill-holes, or fill_holes: true, fills them)'
        if is_filled:
            done = 'they were filled from the cells around them'
        _LOG.warning(
            f'{path.name}: {count} cells inside have no data or lie deep below all their '
            f'neighbours, the first at {east:.10g}, {north:.10g}: {done}'
        )
    if low >= 0.0 and 1.0 < high <= 90.0 and terrain.epsg is not None:
        _LOG.warning(
            f'{path.name}: elevations {low:.6g} to {high:.6g} m: '
            'they may be slopes in degrees instead of heights'
        )


def holes_and_pits(terrain: Terrain) -> np.ndarray:
    """Cells without data that data surround, where scipy is installed, and deep pits, bool."""
    return np.asarray(_inner_holes(terrain) | _pits(terrain))


def _inner_holes(terrain: Terrain) -> np.ndarray:
    if terrain.has_data.all() or not is_installed('scipy'):
        return np.zeros(terrain.shape, dtype=bool)
    from scipy.ndimage import binary_fill_holes

    return np.asarray(binary_fill_holes(terrain.has_data) & ~terrain.has_data)


def _pits(terrain: Terrain) -> np.ndarray:
    """Cells that lie deep below all their neighbours, bool."""
    padded = np.pad(terrain.elevation, 1, constant_values=np.nan)
    rows, columns = terrain.shape
    neighbours = (
        padded[row : row + rows, column : column + columns]
        for row, column in product(range(3), range(3))
        if (row, column) != (1, 1)
    )
    # NaN stays NaN: what is beside a hole or the border is no pit
    lowest = reduce(np.minimum, neighbours)
    return np.asarray(terrain.elevation < lowest - PIT_DEPTH * terrain.resolution)


def filled(terrain: Terrain, wrong: np.ndarray) -> np.ndarray:
    """The elevation with some cells interpolated from what is around them."""
    rasterio_for('fill_holes')
    from rasterio.fill import fillnodata

    known = terrain.has_data & ~wrong
    around = np.where(known, terrain.elevation, np.float32(0.0))
    filled = fillnodata(around, mask=known, max_search_distance=FILL_DISTANCE)
    return np.where(wrong, filled, terrain.elevation)
