# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Maps as files of GIS programs: GeoTIFF with QGIS styles, vector files, NetCDF.

Functions that write a file raise LavaError if it cannot be written.
"""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

import lava_ros
from lava_ros import validation
from lava_ros.errors import LavaError, refusing
from lava_ros.files import vectors, write_output
from lava_ros.files.optional import require
from lava_ros.layers.numbers import duration
from lava_ros.products.plot import isochrone_times
from lava_ros.products.raster_layers import NODATA, RASTER_LAYERS, write_style
from lava_ros.scene import Terrain, Vent
from lava_ros.scene.on_terrain import affine_of
from lava_ros.scene.onset import Onset
from lava_ros.scene.projection import coordinate_system

#: Values of a map, and its tags by name.
Made = tuple[np.ndarray, Mapping[str, str]]

#: Names without suffix of a vector file with several layers, and of a NetCDF file.
STEMS = 'lava', 'maps'

#: Probabilities of contours [%].
PROBABILITIES = (10.0, 50.0, 90.0)


@dataclass(frozen=True)
class Provenance:
    """Origin of maps, for the tags of each GeoTIFF.

    Attributes:
        scene: Name of the scene, case or terrain.
        effects: Names of the physical effects that were on; None where they are unknown.
        preset: Name of the accuracy preset.
        version: Version of lava_ros that computed the maps.
        observation: Observation with which the maps were weighted or compared.
        onset: Date and time of simulated time 0; None if it is unknown.
    """

    scene: str
    effects: Collection[str] | None = None
    preset: str = 'unknown'
    version: str = lava_ros.__version__
    observation: str = 'none'
    onset: Onset | None = None

    @property
    def tags(self) -> dict[str, str]:
        """The tags by name."""
        return {
            'scene': self.scene,
            'effects': 'unknown' if self.effects is None else ' '.join(self.effects),
            'preset': self.preset,
            'lava_ros': self.version,
            'observation': self.observation,
            'onset': 'unknown' if self.onset is None else self.onset.text,
        }


def time_tags(time: float | None, onset: Onset | None) -> dict[str, str]:
    """Return the tags of a map of a simulated time [s], with its date if the onset is known."""
    if time is None:
        return {}
    date = {} if onset is None else {'date_utc': onset.utc(time)}
    return {'simulated_time_s': repr(time), **date}


def write_grid(
    path: Path,
    name: str,
    values: np.ndarray,
    terrain: Terrain,
    origin: Provenance,
    tags: Mapping[str, str] | None = None,
) -> list[Path]:
    """Write a map as GeoTIFF, north up, with its QGIS style.

    Args:
        path: The GeoTIFF.
        name: Key of the map in ``RASTER_LAYERS``, and description of its band.
        values: The map, NaN without data, shape [rows, columns]; row 0 is the southernmost.
        terrain: Terrain with these cells.
        origin: Origin of the map.
        tags: Further tags by name.

    Returns:
        The paths of the files.

    Raises:
        LavaError: If the name is unknown, a file cannot be written, rasterio is missing, or GDAL
            does not support the coordinate system.
    """
    require('rasterio', 'GeoTIFF', str(path))
    from rasterio.errors import RasterioError
    from rasterio.io import MemoryFile

    layer = RASTER_LAYERS[validation.choice('name', name, tuple(RASTER_LAYERS))]
    cells = layer.stored(values)
    rows, columns = cells.shape
    # GDAL raises no error if the disk is full, so it writes into memory
    with (
        refusing('output', str(path), 'a writable file', OSError, RasterioError),
        MemoryFile() as memory,
        memory.open(
            driver='COG',
            overview_resampling='nearest',
            width=columns,
            height=rows,
            count=1,
            dtype=cells.dtype.name,
            crs=coordinate_system(terrain.epsg, terrain.wkt),
            transform=affine_of(terrain),
            nodata=NODATA,
            compress='deflate',
            predictor=2 if layer.is_whole else 3,
            bigtiff='if_safer',
        ) as file,
    ):
        # row 0 of the file is the northernmost
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
    return [path, write_style(path, name, values)]


def area(cells: np.ndarray, terrain: Terrain, **properties: Any) -> list[dict[str, Any]]:
    """Return cells as a list of one GeoJSON feature in map coordinates; empty without cells.

    ``cells`` is bool, shape [rows, columns], row 0 the southernmost. The feature has
    ``properties`` and the area of the cells, ``cells_area_m2``, which is that of its polygons.
    """
    from rasterio.features import shapes
    from rasterio.transform import Affine

    if not cells.any():
        return []
    side, (east, north) = terrain.resolution, terrain.corner
    found = shapes(
        cells.astype(np.uint8), cells, transform=Affine(side, 0.0, east, 0.0, side, north)
    )
    geometry = {'type': 'MultiPolygon', 'coordinates': [item['coordinates'] for item, _ in found]}
    known = {**properties, 'cells_area_m2': float(cells.sum()) * side**2}
    return [{'type': 'Feature', 'properties': known, 'geometry': geometry}]


def isochrones(
    times: np.ndarray, terrain: Terrain, onset: Onset | None = None, **properties: Any
) -> list[dict[str, Any]]:
    """Return GeoJSON features of the cells that lava has reached by each of some round times.

    ``times`` are arrival times [s], shape [rows, columns], NaN without arrival. Each feature
    includes the cells of the earlier ones, has a date if ``onset`` is given, and ``properties``.
    The inundated area is smaller than that of its cells, and is only known at the end.
    """
    if not np.isfinite(times).any():
        return []
    ends = isochrone_times(float(np.nanmax(times)))
    known = np.nan_to_num(times, nan=np.inf)
    return [
        feature
        for end in map(float, ends)
        for feature in area(
            known <= end, terrain, time_s=end, time=duration(end), **properties,
            **({} if onset is None else {'date_utc': onset.utc(end)}),
        )
    ]


def vents(items: Sequence[Vent], offset: tuple[float, float]) -> dict[str, list[dict[str, Any]]]:
    """Return layers of GeoJSON features of vents: points (``vents``) and lines (``fissures``).

    ``offset`` is easting and northing [m] of the map frame's origin.
    """
    layers: dict[str, list[dict[str, Any]]] = {}
    for item in items:
        places = [
            np.add(place, offset).tolist() for place in (item.position, item.end) if place
        ]
        # a rate that changes has another name, so that --vents does not read it as a constant rate
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


def probabilities(
    percent: np.ndarray, terrain: Terrain, **properties: Any
) -> list[dict[str, Any]]:
    """Return features of the areas at or above each of ``PROBABILITIES``; NaN is unknown."""
    return [
        feature
        for least in PROBABILITIES
        for feature in area(
            np.nan_to_num(percent) >= least, terrain, probability_percent=least, **properties
        )
    ]


def usual_formats(crs: Any) -> tuple[str, ...]:
    """Return the formats in addition to GeoTIFF: GeoJSON if the coordinate system is known."""
    return () if crs is None else ('geojson',)


def require_formats(formats: Collection[str], folder: Path, crs: Any) -> None:
    """Raise LavaError if a library is missing, or a coordinate system for GeoJSON or KML."""
    for name in formats:
        if crs is None and _in_degrees(name):
            expected = f'the EPSG code of the map, because {name} has longitudes and latitudes'
            raise LavaError('epsg', None, expected)
        if name in vectors.WRITTEN:
            require('pyogrio', name, str(folder))


def _in_degrees(name: str) -> bool:
    known = vectors.FORMATS.get('kml' if name == 'kmz' else name)
    return known is not None and known.is_degrees


def write_formats(
    folder: Path,
    formats: Collection[str],
    layers: Mapping[str, Sequence[Mapping[str, Any]]],
    maps: Mapping[str, Made],
    terrain: Terrain,
    title: str,
    origin: Provenance,
) -> list[Path]:
    """Write files of several layers or maps, and return their paths.

    Formats of ``vectors.WRITTEN`` contain ``layers``, lists of features by name; ``nc`` contains
    ``maps``, the argument of ``write_netcdf``. Other formats are ignored.
    """
    crs = coordinate_system(terrain.epsg, terrain.wkt)
    require_formats(formats, folder, crs)
    written = []
    for name in formats:
        if name not in vectors.WRITTEN:
            continue
        features, system = layers, crs.to_wkt() if crs else None
        if _in_degrees(name):
            features = {
                key: _geographic(items, crs, terrain.corner) for key, items in layers.items()
            }
            system = 'EPSG:4326'
        written += vectors.write_vectors(folder, name, features, system, stem=STEMS[0])
    if 'nc' in formats:
        written.append(folder / f'{STEMS[1]}.nc')
        write_netcdf(written[-1], maps, terrain, title, origin)
    return written


def _geographic(
    features: Sequence[Mapping[str, Any]], crs: Any, corner: tuple[float, float]
) -> list[dict[str, Any]]:
    from rasterio.warp import transform_geom

    geometries = [item['geometry'] for item in features]
    expected = 'an easting and northing that can be converted to longitude and latitude'
    with refusing('the corner of the map', corner, expected):
        geometries = transform_geom(crs, 'EPSG:4326', geometries, precision=7)
    return [
        {**item, 'geometry': geometry}
        for item, geometry in zip(features, geometries, strict=True)
    ]


def write_netcdf(
    path: Path, maps: Mapping[str, Made], terrain: Terrain, title: str, origin: Provenance
) -> None:
    """Write maps to a NetCDF file that follows the CF conventions.

    ``maps`` has the values of each map, NaN without data, and its tags, by its name in
    ``RASTER_LAYERS``. These tags and the tags of the origin become attributes, as in a GeoTIFF.
    """
    from scipy.io import netcdf_file

    content = BytesIO()
    with netcdf_file(content, 'w', version=2) as file:
        attributes = {
            'Conventions': 'CF-1.11', 'title': title, 'source': f'lava_ros {lava_ros.__version__}',
            **origin.tags,
        }
        _describe(file, attributes)
        shape = next(iter(maps.values()))[0].shape
        for name, start, count in zip('xy', terrain.corner, shape[::-1], strict=True):
            file.createDimension(name, count)
            axis = file.createVariable(name, 'd', (name,))
            axis[:] = start + (np.arange(count) + 0.5) * terrain.resolution
            known = {'units': 'm', 'standard_name': f'projection_{name}_coordinate'}
            _describe(axis, {**known, 'axis': name.upper()})
        where = {}
        if (crs := coordinate_system(terrain.epsg, terrain.wkt)) is not None:
            wkt = crs.to_wkt()
            system = {'crs_wkt': wkt, 'spatial_ref': wkt, **_grid_mapping(crs)}
            _describe(file.createVariable('crs', 'i', ()), system)
            where = {'grid_mapping': 'crs'}
        for name, (values, tags) in maps.items():
            layer = RASTER_LAYERS[name]
            variable = file.createVariable(name, 'f', ('y', 'x'))
            variable[:] = layer.cells(values)
            variable._FillValue = np.float32(np.nan)
            _describe(variable, {'units': layer.unit, 'long_name': layer.meaning, **where, **tags})
        file.flush()
        made = content.getvalue()
    write_output('output', path, made)


#: CF attributes of the parameters of a transverse Mercator projection.
_TRANSVERSE_MERCATOR = {
    'Latitude of natural origin': 'latitude_of_projection_origin',
    'Longitude of natural origin': 'longitude_of_central_meridian',
    'Scale factor at natural origin': 'scale_factor_at_central_meridian',
    'False easting': 'false_easting',
    'False northing': 'false_northing',
}


def _grid_mapping(crs: Any) -> dict[str, str | float]:
    """Return the CF attributes of a transverse Mercator system, such as UTM; none of others."""
    from rasterio.errors import CRSError

    # PROJ cannot express every system, and some have other parameters or units
    with suppress(CRSError, KeyError, TypeError):
        plain = crs.to_dict(projjson=True)
        base, conversion = plain['base_crs'], plain['conversion']
        if conversion['method']['name'] == 'Transverse Mercator':
            ellipsoid = base.get('datum', base.get('datum_ensemble'))['ellipsoid']
            return {
                'grid_mapping_name': 'transverse_mercator',
                **{_TRANSVERSE_MERCATOR[item['name']]: float(item['value'])
                   for item in conversion['parameters']},
                **{name: float(ellipsoid[name])
                   for name in ('semi_major_axis', 'inverse_flattening')},
            }
    return {}


def _describe(item: Any, values: Mapping[str, str | float]) -> None:
    """Set attributes of a NetCDF file or variable.

    scipy accepts non-ASCII text as bytes, and rounds a Python float to single precision.
    """
    for name, value in values.items():
        setattr(item, name, value.encode() if isinstance(value, str) else np.float64(value))
