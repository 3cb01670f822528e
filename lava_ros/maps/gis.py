# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Maps as what GIS programs read: GeoTIFF with styles of QGIS, vector files, NetCDF.

What writes a file raises LavaError where it cannot be written.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import lava_ros
from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files import vectors, write_output
from lava_ros.files.optional import require
from lava_ros.maps.plot import duration, isochrone_times
from lava_ros.maps.raster_layers import NODATA, RASTER_LAYERS, write_style
from lava_ros.scene import Terrain, Vent
from lava_ros.scene.projection import coordinate_system

#: Probabilities that contours are drawn at [%].
PROBABILITIES = (10.0, 50.0, 90.0)


@dataclass(frozen=True)
class Provenance:
    """Origin of maps, which every GeoTIFF states in its tags.

    Attributes:
        scene: Name of the scene, case or terrain.
        effects: Names of the physical effects that were on; None where they are unknown.
        preset: Name of the accuracy preset.
        version: Version of lava_ros that computed the maps.
        observation: The observation that the maps were weighted by or compared with.
    """

    scene: str
    effects: Collection[str] | None = None
    preset: str = 'unknown'
    version: str = lava_ros.__version__
    observation: str = 'none'

    @property
    def tags(self) -> dict[str, str]:
        """The tags by name."""
        return {
            'scene': self.scene,
            'effects': 'unknown' if self.effects is None else ' '.join(self.effects),
            'preset': self.preset,
            'lava_ros': self.version,
            'observation': self.observation,
        }


@dataclass(frozen=True)
class Place:
    """Where the cells of a map are.

    ``corner`` is easting and northing [m] of the lower-left corner of cell [0, 0], ``resolution``
    the side of a cell [m], and ``crs`` what ``coordinate_system`` gives.
    """

    corner: tuple[float, float]
    resolution: float
    crs: Any


def place_of(terrain: Terrain) -> Place:
    """Where the cells of a terrain are; LavaError where GDAL does not know its system."""
    corner = (terrain.offset[0] + terrain.origin[0], terrain.offset[1] + terrain.origin[1])
    return Place(corner, terrain.resolution, coordinate_system(terrain.epsg, terrain.wkt))


def write_map(
    path: Path,
    name: str,
    values: np.ndarray,
    place: Place,
    origin: Provenance,
    tags: Mapping[str, str] | None = None,
) -> list[Path]:
    """Write a map as GeoTIFF, north up, with its QGIS style; each file is written completely.

    Args:
        path: The GeoTIFF.
        name: Which of ``RASTER_LAYERS`` the map is, and the description of its band.
        values: The map, NaN without data, shape [rows, columns]; row 0 is the southernmost.
        place: Where the cells are.
        origin: Where the map is from.
        tags: Further tags by name.

    Returns:
        The paths of the files.

    Raises:
        LavaError: If the name is unknown, or a file cannot be written.
    """
    from rasterio.errors import RasterioError
    from rasterio.io import MemoryFile
    from rasterio.transform import from_origin

    layer = RASTER_LAYERS[validation.choice('name', name, tuple(RASTER_LAYERS))]
    cells = layer.stored(values)
    rows, columns = cells.shape
    side, (east, south) = place.resolution, place.corner
    try:
        # GDAL only prints that a disk is full: it writes into memory, and we write the file
        with MemoryFile() as memory, memory.open(
            driver='COG',
            overview_resampling='nearest',
            width=columns,
            height=rows,
            count=1,
            dtype=cells.dtype.name,
            crs=place.crs,
            transform=from_origin(east, south + rows * side, side, side),
            nodata=NODATA,
            compress='deflate',
            predictor=2 if layer.is_whole else 3,
            bigtiff='if_safer',
        ) as file:
            # Row 0 is the southernmost here and the northernmost in the file.
            file.write(cells[::-1], 1)
            file.set_band_description(1, name)
            file.set_band_unit(1, layer.unit)
            file.update_tags(
                TIFFTAG_SOFTWARE=f'lava_ros {lava_ros.__version__}',
                TIFFTAG_IMAGEDESCRIPTION=f'{name} [{layer.unit}]: {layer.meaning}',
                **{**origin.tags, **(tags or {})},
            )
            file.close()
            write_output('output', path, memory.read())
    except (OSError, RasterioError) as error:
        raise LavaError('output', str(path), f'a file to write ({error})') from error
    return [path, write_style(path, name, values)]


def write_grid(
    path: Path,
    name: str,
    values: np.ndarray,
    terrain: Terrain,
    origin: Provenance,
    tags: Mapping[str, str] | None = None,
) -> list[Path]:
    """Write values on the cells of a terrain as ``write_map`` does.

    LavaError also where rasterio is not installed, or GDAL does not know the coordinate system.
    """
    require('rasterio', 'GeoTIFF', str(path))
    return write_map(path, name, values, place_of(terrain), origin, tags)


def area(cells: np.ndarray, place: Place, **properties: Any) -> list[dict[str, Any]]:
    """Cells as a list of one GeoJSON feature in the map's coordinates; empty without cells.

    ``cells`` is bool, shape [rows, columns], row 0 the southernmost. The feature has
    ``properties`` and its ``area_m2``.
    """
    from rasterio.features import shapes
    from rasterio.transform import Affine

    if not cells.any():
        return []
    side, (east, north) = place.resolution, place.corner
    found = shapes(
        cells.astype(np.uint8), cells, transform=Affine(side, 0.0, east, 0.0, side, north)
    )
    geometry = {'type': 'MultiPolygon', 'coordinates': [item['coordinates'] for item, _ in found]}
    known = {**properties, 'area_m2': float(cells.sum()) * side**2}
    return [{'type': 'Feature', 'properties': known, 'geometry': geometry}]


def isochrones(times: np.ndarray, place: Place) -> list[dict[str, Any]]:
    """GeoJSON features of the area that lava had reached by each of several round times.

    ``times`` are arrival times [s], shape [rows, columns], NaN where no lava came. Each feature
    includes the area of the earlier ones.
    """
    if not np.isfinite(times).any():
        return []
    ends = isochrone_times(float(np.nanmax(times)))
    known = np.nan_to_num(times, nan=np.inf)
    return [
        feature
        for end in map(float, ends)
        for feature in area(known <= end, place, time_s=end, time=duration(end))
    ]


def vents(items: Sequence[Vent], offset: tuple[float, float]) -> dict[str, list[dict[str, Any]]]:
    """Make layers of GeoJSON features of vents: points (``vents``) and lines (``fissures``).

    Args:
        items: The vents.
        offset: Easting and northing [m] of the map frame's origin.
    """
    layers: dict[str, list[dict[str, Any]]] = {}
    for item in items:
        places = [
            np.add(place, offset).tolist() for place in (item.position, item.end) if place
        ]
        # of a rate that changes the peak, which --vents does not take for a constant
        name = 'effusion_rate' if isinstance(item.discharge, float) else 'peak_effusion_rate'
        known = {'name': item.name, name: item.peak, 'radius': item.radius}
        if item.temperature is not None:
            known['temperature'] = item.temperature
        kind, coordinates = ('LineString', places) if item.end else ('Point', places[0])
        layers.setdefault('fissures' if item.end else 'vents', []).append({
            'type': 'Feature',
            'properties': known,
            'geometry': {'type': kind, 'coordinates': coordinates},
        })
    return layers


def probabilities(percent: np.ndarray, place: Place) -> list[dict[str, Any]]:
    """Where lava comes at least as likely as ``PROBABILITIES``; NaN is unknown."""
    return [
        feature
        for least in PROBABILITIES
        for feature in area(np.nan_to_num(percent) >= least, place, probability_percent=least)
    ]


def usual_formats(crs: Any) -> tuple[str, ...]:
    """Return the formats of an ensemble beside GeoTIFF: GeoJSON in a known coordinate system."""
    return () if crs is None else ('geojson',)


def require_formats(formats: Collection[str], folder: Path, crs: Any) -> None:
    """Refuse formats that lack a library, and GeoJSON and KML without a coordinate system."""
    for name in formats:
        if crs is None and _in_degrees(name):
            right = f'the EPSG code of the map: {name} has longitudes and latitudes'
            raise LavaError('epsg', None, right)
        if name in vectors.WRITTEN:
            require('pyogrio', name, str(folder))
    if 'nc' in formats:
        require('xarray', 'NetCDF', str(folder))
        require('scipy', 'NetCDF', str(folder))


def _in_degrees(name: str) -> bool:
    known = vectors.FORMATS.get('kml' if name == 'kmz' else name)
    return known is not None and known.is_degrees


def write_formats(
    folder: Path,
    formats: Collection[str],
    layers: Mapping[str, Sequence[Mapping[str, Any]]],
    maps: Mapping[str, np.ndarray],
    place: Place,
    title: str,
) -> list[Path]:
    """Write the formats that hold several layers or maps, and return the paths of their files.

    Those of ``vectors.WRITTEN`` hold ``layers``, lists of features by name. ``nc`` holds ``maps``,
    as ``write_netcdf`` takes them. Other formats are ignored. LavaError as in ``require_formats``.
    """
    require_formats(formats, folder, place.crs)
    written = []
    for name in formats:
        if name not in vectors.WRITTEN:
            continue
        features, crs = layers, place.crs.to_wkt() if place.crs else None
        if _in_degrees(name):
            features = {key: _geographic(items, place) for key, items in layers.items()}
            crs = 'EPSG:4326'
        written += vectors.write_vectors(folder, name, features, crs, stem='lava')
    if 'nc' in formats:
        written.append(folder / 'maps.nc')
        write_netcdf(written[-1], maps, place, title)
    return written


def _geographic(features: Sequence[Mapping[str, Any]], place: Place) -> list[dict[str, Any]]:
    """Features in longitude and latitude."""
    from rasterio.warp import transform_geom

    geometries = [item['geometry'] for item in features]
    try:
        geometries = transform_geom(place.crs, 'EPSG:4326', geometries, precision=7)
    # what GDAL says of places has no public class
    except Exception as error:
        right = f'easting and northing that have a longitude and latitude ({error})'
        raise LavaError('the corner of the map', place.corner, right) from error
    return [
        {**item, 'geometry': geometry}
        for item, geometry in zip(features, geometries, strict=True)
    ]


def write_netcdf(
    path: Path, maps: Mapping[str, np.ndarray], place: Place, title: str
) -> None:
    """Write maps to a NetCDF file that follows the CF conventions.

    ``maps`` has the values of each map, NaN without data, by its name in ``RASTER_LAYERS``.
    """
    import xarray

    axes = {}
    shape = next(iter(maps.values())).shape
    for name, start, count in zip('xy', place.corner, shape[::-1], strict=True):
        middles = start + (np.arange(count) + 0.5) * place.resolution
        known = {'units': 'm', 'standard_name': f'projection_{name}_coordinate'}
        axes[name] = ((name,), middles, {**known, 'axis': name.upper()})
    variables: dict[str, Any] = {}
    where = {}
    if place.crs is not None:
        wkt = place.crs.to_wkt()
        variables['crs'] = ((), np.int32(0), {'crs_wkt': wkt, 'spatial_ref': wkt})
        where = {'grid_mapping': 'crs'}
    for name, values in maps.items():
        layer = RASTER_LAYERS[name]
        known = {'units': layer.unit, 'long_name': layer.meaning, **where}
        variables[name] = (('y', 'x'), layer.cells(values).astype(np.float32), known)
    source = f'lava_ros {lava_ros.__version__}'
    told = {'Conventions': 'CF-1.11', 'title': title, 'source': source}
    data = xarray.Dataset(variables, axes, told)
    encoding = {name: {'_FillValue': np.float32(np.nan)} for name in maps}
    made = data.to_netcdf(engine='scipy', format='NETCDF3_64BIT', encoding=encoding)
    write_output('output', path, bytes(made))
