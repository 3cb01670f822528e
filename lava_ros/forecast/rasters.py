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

"""Maps of others on the cells of a terrain: where vents may open, where lava was seen."""

from pathlib import Path
from typing import Any
import warnings

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.susceptibility import Susceptibility
from lava_ros.geotiff import require_rasterio
from lava_ros.raster_files import open_raster
from lava_ros.scene import Terrain


def susceptibility_from_file(path: str | Path, terrain: Terrain) -> Susceptibility:
    """Read where vents may open: a raster of relative likelihoods.

    Args:
        path: A GeoTIFF or an ESRI ASCII grid; without coordinate system it has the terrain's.
        terrain: The ground.

    Raises:
        LavaError: The file cannot be read, or its values are no likelihoods.
    """
    return Susceptibility(terrain, raster_on(terrain, path, field='--susceptibility'))


def outline_from_file(path: str | Path, terrain: Terrain, time: float) -> Outline:
    """Read where lava was seen: a raster that is above 0 where it was, 0 where it was not.

    Args:
        path: As of ``susceptibility_from_file``; nobody looked where it has no data.
        terrain: The ground.
        time: When, in simulated time [s].

    Raises:
        LavaError: The file cannot be read, or there is no lava in it.
    """
    values = raster_on(terrain, path, field='--observed')
    known = np.isfinite(values) & terrain.has_data
    with np.errstate(invalid='ignore'):
        return Outline(time, (values > 0.0) & known, known)


def raster_on(terrain: Terrain, path: str | Path, *, field: str) -> np.ndarray:
    """Read a raster, and take the value at the middle of each cell of a terrain.

    Args:
        terrain: The terrain.
        path: The file.
        field: What it is called in errors.

    Returns:
        float64, the terrain's shape; NaN where the raster has no data.

    Raises:
        LavaError: The file cannot be read, or nobody knows where it is.
    """
    require_rasterio(path)
    from rasterio.errors import NotGeoreferencedWarning, RasterioError
    from rasterio.transform import from_origin
    from rasterio.warp import reproject, Resampling

    try:
        with warnings.catch_warnings():
            # a file without coordinates is refused below
            warnings.simplefilter('ignore', NotGeoreferencedWarning)
            with open_raster(path) as source:
                band = source.read(1, masked=True).astype(np.float64).filled(np.nan)
                place, crs, count = source.transform, source.crs, source.count
    except (RasterioError, OSError) as error:
        right = f'a GeoTIFF or an ESRI ASCII grid that GDAL can read ({error})'
        raise LavaError(field, str(path), right) from error
    if place.is_identity or count != 1:
        raise LavaError(field, str(path), 'a georeferenced raster with one band')
    target_crs = _coordinates(terrain, crs, path, field)
    result = np.full(terrain.shape, np.nan)
    cell = terrain.resolution
    corner = [start + shift for start, shift in zip(terrain.origin, terrain.offset, strict=True)]
    reproject(
        band,
        result,
        src_transform=place,
        src_crs=crs or target_crs,
        src_nodata=np.nan,
        dst_transform=from_origin(corner[0], corner[1] + terrain.shape[0] * cell, cell, cell),
        dst_crs=target_crs,
        dst_nodata=np.nan,
        # likelihoods and masks are no heights: between two of them there is nothing
        resampling=Resampling.nearest,
    )
    result = np.flipud(result)
    if np.isnan(result[terrain.has_data]).all():
        raise LavaError(field, str(path), 'a raster with data on the terrain')
    return result


def _coordinates(terrain: Terrain, crs: Any, path: str | Path, field: str) -> Any:
    """The terrain's coordinate system; a terrain without one is where its numbers say."""
    from rasterio.crs import CRS

    if terrain.epsg is not None:
        return CRS.from_epsg(terrain.epsg)
    if crs:
        right = 'a raster without coordinate system, as the terrain, or scene.terrain.epsg'
        raise LavaError(field, str(path), right)
    # both are in the same metres, whatever these are called
    return CRS.from_epsg(32631)
