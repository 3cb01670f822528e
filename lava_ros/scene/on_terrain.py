# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rasters and polygons from files, resampled to the cells of a terrain."""

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lava_ros.errors import LavaError, refusing
from lava_ros.files.optional import require
from lava_ros.files.rasters import open_raster, PICTURES
from lava_ros.scene.features import read_features
from lava_ros.scene.projection import coordinate_system, horizontal
from lava_ros.scene.terrain import Terrain

#: Maximum side of a picture at which it is read [pixels].
MAX_PIXELS = 4000


def read_raster_on(terrain: Terrain, path: str | Path, *, field: str) -> np.ndarray:
    """Read a raster at the centres of a terrain's cells: float64, NaN without data.

    A raster without a coordinate system is assumed to be in that of the terrain. Errors name
    ``field``.

    Raises:
        LavaError: If the file cannot be read, has more than one band, has no data on the terrain,
            or has an unknown coordinate system.
    """
    with open_raster(field, path) as source:
        band = source.read(1, masked=True).astype(np.float64) * source.scales[0]
        band = (band + source.offsets[0]).filled(np.nan)
        place, crs, count = source.transform, source.crs, source.count
    if count != 1:
        raise LavaError(field, str(path), 'a georeferenced raster with one band')
    # probabilities and masks must not be interpolated
    result = resampled(terrain, band, place, crs, path, field=field, method='nearest')
    if np.isnan(result[terrain.has_data]).all():
        raise LavaError(field, str(path), 'a raster with data on the terrain')
    return result


class PlacedPicture(NamedTuple):
    """A picture on the ground.

    Attributes:
        path: Path of its file.
        bands: Red, green and blue, uint8, masked arrays of shape [rows, columns].
        place: Affine transformation of the rows and columns; None covers exactly a terrain.
        crs: Coordinate system, None for that of the terrain.
    """

    path: str
    bands: Sequence[Any]
    place: Any
    crs: Any

    def on(self, terrain: Terrain, *, field: str) -> np.ndarray:
        """Return the colours of a terrain's cells, float64, [rows, columns, 3], NaN outside.

        Raises:
            LavaError: As ``resampled``.
        """
        from rasterio.transform import from_bounds

        options = {'field': field, 'method': 'bilinear'}
        (west, south), (rows, columns) = terrain.corner, terrain.shape
        east, north = west + columns * terrain.resolution, south + rows * terrain.resolution
        place = self.place or from_bounds(west, south, east, north, *self.bands[0].shape[::-1])
        colours = [
            resampled(terrain, values, place, self.crs, self.path, **options)
            for values in (band.astype(np.float64).filled(np.nan) for band in self.bands)
        ]
        return np.stack(colours, axis=-1)


def read_placed_picture(path: str, *, field: str) -> PlacedPicture:
    """Read a picture: a GeoTIFF, PNG or JPEG, which may be georeferenced.

    A file of more than ``MAX_PIXELS`` a side is thinned. Errors name ``field``.

    Raises:
        LavaError: If the file cannot be read, or does not have 8 bits a colour.
    """
    with open_raster(field, path, PICTURES) as source:
        if set(source.dtypes) != {'uint8'}:
            raise LavaError(field, path, f'8 bits a colour, not {source.dtypes[0]}')
        step = max(source.shape) // MAX_PIXELS + 1
        rows, columns = (-(-side // step) for side in source.shape)
        bands = source.read(out_shape=(source.count, rows, columns), masked=True)
        place = source.transform
        is_placed = not place.is_identity
        place *= place.scale(source.width / columns, source.height / rows)
        if source.colorinterp[0].name == 'palette':
            palette = np.zeros((256, 4), np.uint8)
            for number, colour in source.colormap(1).items():
                palette[number] = colour
            numbers = bands[0]
            bands = [np.ma.array(palette[numbers.data, i], mask=numbers.mask) for i in range(3)]
        bands = bands[:3] if len(bands) > 2 else [bands[0]] * 3
        return PlacedPicture(path, bands, place if is_placed else None, source.crs)


def resampled(
    terrain: Terrain, values: np.ndarray, place: Any, crs: Any, path: str | Path, *, field: str,
    method: str,
) -> np.ndarray:
    """Resample a raster to a terrain's cells: float64, NaN without data.

    Args:
        terrain: Target grid.
        values: Raster as stored in the file, float64, NaN without data.
        place: Affine transformation of the raster.
        crs: Coordinate system of the raster, None for that of the terrain.
        path: Path of the file, for errors.
        field: Name of the field in errors.
        method: Method of ``rasterio.warp.Resampling``.

    Raises:
        LavaError: If the raster is not georeferenced, if the raster has a coordinate system and
            the terrain has none, or if one cannot be transformed to the other.
    """
    from rasterio.warp import reproject, Resampling

    check_placed(place, path, field=field)
    own = coordinate_system(terrain.epsg, terrain.wkt)
    if own is None and crs:
        expected = "a file without coordinate system, as the terrain's, or an epsg for the terrain"
        raise LavaError(field, str(path), expected)
    # neither has a system: any gives the same result
    target_crs = own or coordinate_system(32631)
    result = np.full(terrain.shape, np.nan)
    with refusing(field, str(path), 'a raster that GDAL can put on the terrain'):
        reproject(
            values,
            result,
            src_transform=place,
            src_crs=horizontal(crs) if crs else target_crs,
            src_nodata=np.nan,
            dst_transform=affine_of(terrain),
            dst_crs=target_crs,
            dst_nodata=np.nan,
            resampling=Resampling[method],
        )
    return np.flipud(result)


def check_placed(place: Any, path: str | Path, *, field: str) -> None:
    """Raise LavaError if an affine transformation is not that of a georeferenced raster."""
    is_placed = all(map(math.isfinite, place)) and not (place.is_identity or place.is_degenerate)
    if not is_placed:
        raise LavaError(field, str(path), 'a georeferenced raster with one band')


def read_polygons_on(terrain: Terrain, path: str | Path, *, field: str) -> np.ndarray:
    """Mark the cells of a terrain whose centre is in a polygon of a file: bool.

    ``features.read_features`` reads the file; its points and lines are ignored. Errors name
    ``field``.

    Raises:
        LavaError: If the file cannot be read, has no polygon or an unknown coordinate system, or
            if rasterio is not installed.
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
    marked = rasterize(areas, terrain.shape, transform=affine_of(terrain), dtype=np.uint8)
    return np.flipud(marked) > 0


def affine_of(terrain: Terrain) -> Any:
    """Return the affine transformation of a terrain with row 0 in the north."""
    from rasterio.transform import from_origin

    cell = terrain.resolution
    west, south = terrain.corner
    return from_origin(west, south + terrain.shape[0] * cell, cell, cell)
