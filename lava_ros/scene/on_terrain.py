# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rasters and areas of other programs' files on the cells of a terrain."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.files.rasters import opened_raster
from lava_ros.scene.features import read_features
from lava_ros.scene.projection import coordinate_system, horizontal
from lava_ros.scene.terrain import Terrain


def raster_on(terrain: Terrain, path: str | Path, *, field: str) -> np.ndarray:
    """Read a raster at the centres of a terrain's cells: float64, NaN where it has no data.

    A raster without a coordinate system is taken to be in the terrain's. Errors name ``field``.

    Raises:
        LavaError: The file cannot be read, has more than one band, has no data on the terrain, or
            has no known coordinate system.
    """
    with opened_raster(field, path) as source:
        band = source.read(1, masked=True).astype(np.float64).filled(np.nan)
        place, crs, count = source.transform, source.crs, source.count
    if count != 1:
        raise LavaError(field, str(path), 'a georeferenced raster with one band')
    # likelihoods and masks are no heights: between two of them there is nothing
    result = resampled(terrain, band, place, crs, path, field=field, method='nearest')
    if np.isnan(result[terrain.has_data]).all():
        raise LavaError(field, str(path), 'a raster with data on the terrain')
    return result


def resampled(
    terrain: Terrain, values: np.ndarray, place: Any, crs: Any, path: str | Path, *, field: str,
    method: str,
) -> np.ndarray:
    """Resample a raster to a terrain's cells: float64, NaN where it has no data.

    Args:
        terrain: The terrain.
        values: The raster as it is in the file, float64, NaN without data.
        place: The affine transformation of its cells.
        crs: Its coordinate system, None for that of the terrain.
        path: The file, for errors.
        field: What errors call it.
        method: A method of ``rasterio.warp.Resampling``.

    Raises:
        LavaError: The raster is not georeferenced, only one of both has a coordinate system, or
            none leads to the other.
    """
    from rasterio.warp import reproject, Resampling

    check_placed(place, path, field=field)
    target_crs = _coordinates(terrain, crs, path, field)
    result = np.full(terrain.shape, np.nan)
    try:
        reproject(
            values,
            result,
            src_transform=place,
            src_crs=horizontal(crs) if crs else target_crs,
            src_nodata=np.nan,
            dst_transform=_grid(terrain),
            dst_crs=target_crs,
            dst_nodata=np.nan,
            resampling=Resampling[method],
        )
    # GDAL's errors have no class in common
    except Exception as error:
        right = f'a raster that GDAL can put on the terrain ({error})'
        raise LavaError(field, str(path), right) from error
    return np.flipud(result)


def check_placed(place: Any, path: str | Path, *, field: str) -> None:
    """Refuse the affine transformation of a raster that is not georeferenced."""
    is_placed = all(map(math.isfinite, place)) and not (place.is_identity or place.is_degenerate)
    if not is_placed:
        raise LavaError(field, str(path), 'a georeferenced raster with one band')


def areas_on(terrain: Terrain, path: str | Path, *, field: str) -> np.ndarray:
    """Mark the cells of a terrain whose centre is in one of the areas of a file: bool.

    The file is one for ``features.read_features``; its points and lines are ignored. Errors name
    ``field``.

    Raises:
        LavaError: The file cannot be read, has no area or no known coordinate system, or rasterio
            is not installed.
    """
    require('rasterio', 'GeoTIFF', str(path))
    from rasterio.features import rasterize

    areas = [
        {'type': 'Polygon', 'coordinates': [ring.tolist() for ring in feature.rings]}
        for feature in read_features(field, path, terrain)
        if feature.kind == 'Polygon'
    ]
    if not areas:
        raise LavaError(field, str(path), 'a file with at least one area')
    marked = rasterize(areas, terrain.shape, transform=_grid(terrain), dtype=np.uint8)
    return np.flipud(marked) > 0


def _grid(terrain: Terrain) -> Any:
    """Return where the cells of a terrain are for rasterio, row 0 in the north."""
    from rasterio.transform import from_origin

    cell = terrain.resolution
    west, south = np.add(terrain.origin, terrain.offset)
    return from_origin(west, south + terrain.shape[0] * cell, cell, cell)


def _coordinates(terrain: Terrain, crs: Any, path: str | Path, field: str) -> Any:
    """Return the terrain's coordinate system; a terrain without one is where its numbers say."""
    own = coordinate_system(terrain.epsg, terrain.wkt)
    if own is None and crs:
        right = "a file without coordinate system, as the terrain's, or an epsg for the terrain"
        raise LavaError(field, str(path), right)
    # without systems both are in the same metres, whatever these are called
    return own or coordinate_system(32631)
