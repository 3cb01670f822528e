# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rasters of others on the cells of a terrain, and the maps of an ensemble as rasters."""

from collections.abc import Collection, Mapping
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.files.rasters import opened_raster
from lava_ros.forecast.members import Plan
from lava_ros.maps import gis
from lava_ros.maps.forecast import HazardMaps
from lava_ros.scene import Terrain
from lava_ros.scene.features import ENDINGS, read_features
from lava_ros.scene.projection import coordinate_system, horizontal


def seen_in_file(path: str | Path, terrain: Terrain) -> tuple[np.ndarray, np.ndarray]:
    """Read from a file where lava was observed, and which cells were: bool, the terrain's shape.

    The file has areas (``areas_on``), or is a raster (``raster_on``) with values above 0 where
    lava was, 0 where it was not, and no data where nobody looked.

    Raises:
        LavaError: If the file cannot be read, or has no lava on the terrain.
    """
    field = '--observed'
    # a grid may be a .txt
    suffix = Path(path).suffix.lower()
    read = areas_on if suffix in ENDINGS and suffix != '.txt' else raster_on
    values = read(terrain, path, field=field).astype(np.float64)
    known = np.isfinite(values) & terrain.has_data
    lava = (values > 0.0) & known
    if not lava.any():
        raise LavaError(field, str(path), f'observed lava {terrain.bounds(projected=True)}')
    return lava, known


def raster_on(terrain: Terrain, path: str | Path, *, field: str) -> np.ndarray:
    """Read a raster at the centres of a terrain's cells: float64, NaN where it has no data.

    A raster without a coordinate system is taken to be in the terrain's. Errors name ``field``.

    Raises:
        LavaError: The file cannot be read, has more than one band, has no data on the terrain, or
            has no known coordinate system.
    """
    with opened_raster(field, path) as source:
        from rasterio.warp import reproject, Resampling

        band = source.read(1, masked=True).astype(np.float64).filled(np.nan)
        place, crs, count = source.transform, source.crs, source.count
    is_placed = all(map(math.isfinite, place)) and not (place.is_identity or place.is_degenerate)
    if not is_placed or count != 1:
        raise LavaError(field, str(path), 'a georeferenced raster with one band')
    target_crs = _coordinates(terrain, crs, path, field)
    result = np.full(terrain.shape, np.nan)
    reproject(
        band,
        result,
        src_transform=place,
        src_crs=horizontal(crs) if crs else target_crs,
        src_nodata=np.nan,
        dst_transform=_grid(terrain),
        dst_crs=target_crs,
        dst_nodata=np.nan,
        # likelihoods and masks are no heights: between two of them there is nothing
        resampling=Resampling.nearest,
    )
    result = np.flipud(result)
    if np.isnan(result[terrain.has_data]).all():
        raise LavaError(field, str(path), 'a raster with data on the terrain')
    return result


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
    """Where the cells of a terrain are, row 0 in the north."""
    from rasterio.transform import from_origin

    cell = terrain.resolution
    west, south = np.add(terrain.origin, terrain.offset)
    return from_origin(west, south + terrain.shape[0] * cell, cell, cell)


def _coordinates(terrain: Terrain, crs: Any, path: str | Path, field: str) -> Any:
    """The terrain's coordinate system; a terrain without one is where its numbers say."""
    own = coordinate_system(terrain.epsg, terrain.wkt)
    if own is None and crs:
        right = "a file without coordinate system, as the terrain's, or an epsg for the terrain"
        raise LavaError(field, str(path), right)
    # without systems both are in the same metres, whatever these are called
    return own or coordinate_system(32631)


def write_atlas(
    folder: Path,
    maps: HazardMaps,
    plan: Plan,
    origin: gis.Provenance,
    tags: Mapping[str, str],
    formats: Collection[str] | None = None,
) -> list[Path]:
    """Write the maps of an ensemble to a folder, replacing files of the same names.

    The maps are probability, arrival times, expected peak thickness and elevation, as GeoTIFF.
    ``formats`` are further formats, of ``export.FORMATS``; vector formats hold contours of
    probability and isochrones. None stands for GeoJSON where the terrain's coordinate system is
    known, else for no further format.

    Returns:
        The paths of the files.

    Raises:
        LavaError: A file cannot be written, or a library for a format is missing.
    """
    place = gis.place_of(plan.scene.terrain)
    tags = {
        'members': str(maps.members),
        'effective_members': repr(maps.effective_members),
        'horizon_s': repr(plan.horizon),
        'threshold_m': repr(plan.threshold),
        'arrival_error_s': repr(maps.arrival_error),
        **tags,
    }
    layers = {
        'inundation_probability': maps.probability,
        'expected_peak_thickness': maps.thickness,
        'elevation': plan.scene.terrain.elevation,
    }
    shapes = {'inundation_probability': gis.probabilities(maps.probability, place)}
    for share, values in maps.arrival.items():
        name = f'arrival_time_p{round(100 * share)}'
        layers[name], shapes[name] = values, gis.isochrones(values, place)
    written = []
    for name, values in layers.items():
        # the style belongs to its GeoTIFF
        written += gis.write_map(folder / f'{name}.tif', name, values, place, origin, tags)[:1]
    if formats is None:
        formats = gis.usual_formats(place.crs)
    title = f'lava flow, {maps.members} members'
    return [*written, *gis.write_formats(folder, formats, shapes, layers, place, title)]
