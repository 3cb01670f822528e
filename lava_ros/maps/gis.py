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

"""Maps as what GIS programs read: GeoTIFF with styles of QGIS, vector files, NetCDF.

What writes a file raises LavaError where it cannot be written.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

import lava_ros
from lava_ros.errors import LavaError
from lava_ros.files import vectors, write_output
from lava_ros.files.optional import require
from lava_ros.maps.plot import duration, STYLES
from lava_ros.scene import Terrain, Vent
from lava_ros.scene.projection import coordinate_system

#: Value of cells without data in files of floating-point numbers, and in those of bytes.
NODATA, NODATA_BYTE = -9999.0, 255

#: Times between isochrones [s], and most isochrones.
_STEPS = (60, 300, 600, 1800, 3600, 7200, 6 * 3600, 12 * 3600, 24 * 3600, 7 * 24 * 3600)
MOST_ISOCHRONES = 12

#: Probabilities that contours are drawn at [%].
PROBABILITIES = (10.0, 50.0, 90.0)

#: What a map is drawn as, by its name: a style of ``plot.py``.
_DRAWN = {
    'height': 'thickness',
    'peak_height': 'thickness',
    'expected_thickness': 'thickness',
    'temperature': 'temperature',
    'hazard': 'hazard',
    'inundation_probability': 'probability',
    'arrival': 'arrival',
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
    values: np.ndarray,
    place: Place,
    name: str,
    unit: str,
    meaning: str,
    tags: Mapping[str, str],
) -> None:
    """Write a map as GeoTIFF, north up; the file is there whole or not at all.

    ``values`` are floating-point numbers, NaN without data, or uint8 with ``NODATA_BYTE``, shape
    [rows, columns]; row 0 is the southernmost. The band has a name, a unit, and a meaning in
    words; ``tags`` are what else is to be known, by name.
    """
    from rasterio.errors import RasterioError
    from rasterio.io import MemoryFile
    from rasterio.transform import from_origin

    rows, columns = values.shape
    side, (east, south) = place.resolution, place.corner
    is_byte = values.dtype == np.uint8
    if not is_byte:
        values = np.where(np.isfinite(values), values, NODATA).astype(np.float32)
    try:
        # GDAL only prints that a disk is full: it writes into memory, and we write the file
        with MemoryFile() as memory, memory.open(
            driver='COG',
            overview_resampling='nearest',
            width=columns,
            height=rows,
            count=1,
            dtype=values.dtype.name,
            crs=place.crs,
            transform=from_origin(east, south + rows * side, side, side),
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
            file.close()
            write_output('output', path, memory.read())
    except (OSError, RasterioError) as error:
        raise LavaError('output', str(path), f'a file to write ({error})') from error


def write_grid(
    path: Path, values: np.ndarray, terrain: Terrain, *, unit: str, meaning: str
) -> Path:
    """Write values on the cells of a terrain as GeoTIFF, and return its path.

    The band is named after the file. LavaError also where rasterio is not installed, or GDAL does
    not know the coordinate system.
    """
    require('rasterio', 'GeoTIFF', str(path))
    write_map(path, values, place_of(terrain), path.stem, unit, meaning, {})
    return path


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
    last = float(np.nanmax(times))
    longest = max(_STEPS[-1], last / MOST_ISOCHRONES)
    step = next((item for item in _STEPS if last <= item * MOST_ISOCHRONES), longest)
    ends = step * np.arange(1, int(np.ceil(last / step)) + 1)
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
    maps: Mapping[str, tuple[np.ndarray, str, str]],
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
    path: Path, maps: Mapping[str, tuple[np.ndarray, str, str]], place: Place, title: str
) -> None:
    """Write maps to a NetCDF file that follows the CF conventions.

    ``maps`` has values (NaN without data), unit and meaning of each map by name.
    """
    import xarray

    axes = {}
    shape = next(iter(maps.values()))[0].shape
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
    for name, (values, unit, meaning) in maps.items():
        known = {'units': unit, 'long_name': meaning, **where}
        variables[name] = (('y', 'x'), values.astype(np.float32), known)
    source = f'lava_ros {lava_ros.__version__}'
    told = {'Conventions': 'CF-1.11', 'title': title, 'source': source}
    data = xarray.Dataset(variables, axes, told)
    encoding = {name: {'_FillValue': np.float32(np.nan)} for name in maps}
    made = data.to_netcdf(engine='scipy', format='NETCDF3_64BIT', encoding=encoding)
    write_output('output', path, bytes(made))


def write_style(path: Path, name: str, values: np.ndarray) -> None:
    """Write the QGIS style of a GeoTIFF beside it; maps without a known style get none."""
    if name not in _DRAWN or not np.isfinite(values).any():
        return
    colours = STYLES[_DRAWN[name]].colours
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if _DRAWN[name] in ('hazard', 'probability'):
        low, high = 1.0, 100.0
    elif _DRAWN[name] == 'thickness':
        low = 0.0
    root = ElementTree.Element('qgis', version='3.28')
    pipe = ElementTree.SubElement(root, 'pipe')
    drawn = ElementTree.SubElement(
        pipe, 'rasterrenderer', type='singlebandpseudocolor', band='1', opacity='0.8'
    )
    drawn.set('classificationMin', repr(low))
    drawn.set('classificationMax', repr(high))
    shader = ElementTree.SubElement(drawn, 'rastershader')
    shader = ElementTree.SubElement(shader, 'colorrampshader', colorRampType='INTERPOLATED')
    for value, colour in zip(np.linspace(low, high, len(colours)), colours, strict=True):
        item = {'value': repr(float(value)), 'color': colour, 'alpha': '255'}
        ElementTree.SubElement(shader, 'item', item, label=f'{value:.4g}')
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding='unicode')
    head = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
    write_output('output', path.with_suffix('.qml'), head + text + '\n')
