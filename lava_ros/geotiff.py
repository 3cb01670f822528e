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

"""Maps as GeoTIFF: north up, with coordinate system, unit and what the numbers mean."""

from collections.abc import Mapping
import os
from pathlib import Path
from typing import Any

import numpy as np

import lava_ros
from lava_ros.errors import LavaError
from lava_ros.scene import Terrain

#: Value of cells without data in files of floating-point numbers, and in those of bytes.
NODATA, NODATA_BYTE = -9999.0, 255


def require_rasterio(path: str | Path) -> None:
    """Do nothing where rasterio can be imported.

    Raises:
        LavaError: It cannot; the message says how to get it.
    """
    try:
        import rasterio  # noqa: F401
    except ImportError as error:
        raise LavaError(
            'GeoTIFF', str(path), "rasterio: pip install 'lava_ros[terrain]'"
        ) from error


def coordinate_system(epsg: int | None) -> Any:
    """What rasterio calls a coordinate system, None for None.

    Raises:
        LavaError: GDAL does not know it.
    """
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    if epsg is None:
        return None
    try:
        return CRS.from_epsg(epsg)
    except CRSError as error:
        raise LavaError('epsg', epsg, f'a coordinate system GDAL knows ({error})') from error


def write_map(
    path: Path,
    values: np.ndarray,
    *,
    corner: tuple[float, float],
    resolution: float,
    crs: Any,
    name: str,
    unit: str,
    meaning: str,
    tags: Mapping[str, str],
) -> None:
    """Write a map; the file is there whole or not at all.

    Args:
        path: The file.
        values: float32 with ``NODATA``, or uint8 with ``NODATA_BYTE``, shape [rows, columns]; row
            0 is the southernmost.
        corner: Easting and northing [m] of the lower-left corner of cell [0, 0].
        resolution: Side of a cell [m].
        crs: What ``coordinate_system`` gives.
        name: Name of the band.
        unit: Its unit.
        meaning: What its numbers are, in words.
        tags: What else is to be known, by name.

    Raises:
        LavaError: The file cannot be written.
    """
    import rasterio
    from rasterio.errors import RasterioError
    from rasterio.transform import from_origin

    rows, columns = values.shape
    partial = path.with_suffix('.partial.tif')
    is_byte = values.dtype == np.uint8
    try:
        with rasterio.open(
            partial,
            'w',
            driver='GTiff',
            width=columns,
            height=rows,
            count=1,
            dtype=values.dtype.name,
            crs=crs,
            transform=from_origin(
                corner[0], corner[1] + rows * resolution, resolution, resolution
            ),
            nodata=NODATA_BYTE if is_byte else NODATA,
            compress='deflate',
            predictor=2 if is_byte else 3,
            bigtiff='if_safer',
        ) as file:
            # Row 0 is the southernmost here and the northernmost in the file.
            file.write(values[::-1], 1)
            file.set_band_description(1, name)
            file.set_band_unit(1, unit)
            file.update_tags(
                TIFFTAG_SOFTWARE=f'lava_ros {lava_ros.__version__}',
                TIFFTAG_IMAGEDESCRIPTION=f'{name} [{unit}]: {meaning}',
                **tags,
            )
        os.replace(partial, path)
    except (OSError, RasterioError) as error:
        raise LavaError('output', str(path), f'a file to write ({error})') from error


def write_grid(
    path: Path, values: np.ndarray, terrain: Terrain, *, unit: str, meaning: str
) -> Path:
    """Write numbers on the cells of a terrain.

    Args:
        path: The file; its name without the ending is the band's.
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
    require_rasterio(path)
    if values.dtype != np.uint8:
        values = np.where(np.isfinite(values), values, NODATA).astype(np.float32)
    write_map(
        path,
        values,
        corner=(
            terrain.offset[0] + terrain.origin[0],
            terrain.offset[1] + terrain.origin[1],
        ),
        resolution=terrain.resolution,
        crs=coordinate_system(terrain.epsg),
        name=path.stem,
        unit=unit,
        meaning=meaning,
        tags={},
    )
    return path
