# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rasters and vector files in UTM zone 33, and scene files, for tests of several rooms."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from rasterio.transform import from_origin
import yaml

#: Upper left corner of rasters, easting and northing [m].
NORTH_WEST = (500_000.0, 4_180_000.0)


def write_raster(
    path: Path, values: np.ndarray, *, cell: float = 10.0,
    north_west: tuple[float, float] = NORTH_WEST, **options: Any,
) -> Path:
    """Write a raster, by default a GeoTIFF; return its path.

    Args:
        path: The file.
        values: Cells of one band or of several, rows from the north.
        cell: Side of a cell [m].
        north_west: Upper left corner [m].
        options: Options of rasterio; ``unit``, ``description``, and ``scale`` with its offset
            describe the first band.
    """
    bands = values if values.ndim == 3 else values[None]
    unit, description, scale = (options.pop(key, None) for key in ('unit', 'description', 'scale'))
    profile = {
        'driver': 'GTiff', 'crs': 'EPSG:32633', 'dtype': bands.dtype.name,
        'transform': from_origin(*north_west, cell, cell), **options,
    }
    count, rows, columns = bands.shape
    with rasterio.open(path, 'w', count=count, height=rows, width=columns, **profile) as file:
        file.write(bands)
        if unit:
            file.set_band_unit(1, unit)
        if description:
            file.set_band_description(1, description)
        if scale:
            file.scales, file.offsets = [scale[0]], [scale[1]]
    return path


def write_scene(
    folder: Path, elevation: np.ndarray, cell: float, scene: dict[str, Any] | str, **place: Any
) -> Path:
    """Write an elevation [m] with square cells, and a scene file on it; return its path.

    ``scene`` is the content without the terrain, or its text; ``place`` has more of the elevation.
    """
    np.savez(folder / 'ground.npz', elevation=elevation, resolution=cell, **place)
    text = scene if isinstance(scene, str) else yaml.safe_dump(scene)
    (folder / 'scene.yaml').write_text(f'terrain: {{file: ground.npz}}\n{text}')
    return folder / 'scene.yaml'


def feature(kind: str, places: Any, **properties: Any) -> dict[str, Any]:
    """Return a feature of GeoJSON with a geometry of a kind and places."""
    geometry = {'type': kind, 'coordinates': places}
    return {'type': 'Feature', 'properties': properties, 'geometry': geometry}


def write_features(path: Path, *features: dict[str, Any]) -> Path:
    """Write GeoJSON in UTM zone 33; return its path."""
    crs = {'type': 'name', 'properties': {'name': 'EPSG:32633'}}
    data = {'type': 'FeatureCollection', 'crs': crs, 'features': features}
    path.write_text(json.dumps(data, default=lambda numbers: numbers.tolist()))
    return path
