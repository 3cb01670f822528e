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


"""The maps of a hindcast as GeoTIFF."""

import os
from pathlib import Path

import numpy as np

import lava_ros
from lava_ros.errors import LavaError
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.run import Result
from lava_ros.hindcast.score import THRESHOLD
from lava_ros.scene import Terrain

#: Value of cells without data in files of floating-point numbers.
NODATA = -9999.0

#: What a cell of the comparison says.
NEITHER, HIT, MISS, FALSE_ALARM, UNKNOWN = 0, 1, 2, 3, 255


def comparison(thickness: np.ndarray, footprint: np.ndarray) -> np.ndarray:
    """Hits, misses and false alarms, uint8, shape [rows, columns]."""
    covered = np.nan_to_num(thickness) >= THRESHOLD
    codes = np.full(footprint.shape, NEITHER, np.uint8)
    codes[covered & footprint] = HIT
    codes[~covered & footprint] = MISS
    codes[covered & ~footprint] = FALSE_ALARM
    codes[np.isnan(thickness) & ~footprint] = UNKNOWN
    return codes


def write_maps(case: Case, result: Result, folder: Path) -> list[Path]:
    """Write the maps, north up, on the grid of the elevation.

    Args:
        case: The case.
        result: Its run.
        folder: Where the files go; there are ones of these names no longer.

    Returns:
        The files.

    Raises:
        LavaError: rasterio is not installed, or a file cannot be written.
    """
    snapshot, terrain = result.snapshot, case.scene.terrain
    dry = np.where(terrain.has_data, 0.0, np.nan)
    thickness = np.where(terrain.has_data, snapshot.thickness, np.nan)
    maps = {
        'thickness': (thickness, 'm', 'thickness of the lava at the end; 0: none'),
        'peak_thickness': (result.peak + dry, 'm', 'largest thickness in any map; 0: none'),
        'arrival': (result.arrival, 's', 'time of the first map with lava; no data: none came'),
        'temperature': (snapshot.temperature - 273.15, 'degC', 'temperature; no data: no lava'),
    }
    files = [
        write_grid(folder / f'{name}.tif', values, terrain, unit=unit, meaning=meaning)
        for name, (values, unit, meaning) in maps.items()
    ]
    meaning = '0: neither, 1: hit, 2: miss, 3: false alarm'
    codes = comparison(snapshot.thickness, case.footprint)
    path = folder / 'comparison.tif'
    return [*files, write_grid(path, codes, terrain, unit='1', meaning=meaning)]


def write_grid(
    path: Path, values: np.ndarray, terrain: Terrain, *, unit: str, meaning: str
) -> Path:
    """Write numbers on the cells of a terrain.

    Args:
        path: The file.
        values: Floating-point numbers, NaN without data, or bytes; shape [rows, columns], row 0 in
            the south.
        terrain: The grid they are on.
        unit: Their unit.
        meaning: What they are, in a few words.

    Returns:
        The file.

    Raises:
        LavaError: rasterio is not installed, or the file cannot be written.
    """
    try:
        import rasterio
        from rasterio.crs import CRS
        from rasterio.errors import RasterioError
        from rasterio.transform import from_origin
    except ImportError as error:
        right = "rasterio: pip install 'lava_ros[terrain]'"
        raise LavaError('output', str(path), right) from error
    is_byte = values.dtype == np.uint8
    rows, columns = values.shape
    west = terrain.offset[0] + terrain.origin[0]
    north = terrain.offset[1] + terrain.origin[1] + rows * terrain.resolution
    if not is_byte:
        values = np.where(np.isfinite(values), values, NODATA).astype(np.float32)
    partial = path.with_suffix('.partial.tif')
    try:
        with rasterio.open(
            partial,
            'w',
            driver='GTiff',
            width=columns,
            height=rows,
            count=1,
            dtype=values.dtype.name,
            crs=CRS.from_epsg(terrain.epsg) if terrain.epsg else None,
            transform=from_origin(west, north, terrain.resolution, terrain.resolution),
            nodata=UNKNOWN if is_byte else NODATA,
            compress='deflate',
            predictor=2 if is_byte else 3,
        ) as file:
            # row 0 is the southernmost here and the northernmost in the file
            file.write(values[::-1], 1)
            file.set_band_description(1, path.stem)
            file.set_band_unit(1, unit)
            file.update_tags(
                TIFFTAG_SOFTWARE=f'lava_ros {lava_ros.__version__}',
                TIFFTAG_IMAGEDESCRIPTION=f'{path.stem} [{unit}]: {meaning}',
            )
        os.replace(partial, path)
    except (OSError, RasterioError) as error:
        raise LavaError('output', str(path), f'a file to write ({error})') from error
    return path
