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


"""Points, lines and areas of others: GeoJSON, GeoPackage and tables -> a terrain's coordinates."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.files import open_input
from lava_ros.files.csv import read_table
from lava_ros.files.optional import require
from lava_ros.files.yaml import parse_json
from lava_ros.scene.projection import coordinate_system, transformed
from lava_ros.scene.terrain import MAX_COORDINATE, Terrain

#: Ends of the names of files that can be read.
ENDINGS = ('.geojson', '.json', '.gpkg', '.csv')

#: Columns that say where a row of a table is: in the terrain's own system, or in degrees.
OWN_COLUMNS = (('x', 'y'), ('easting', 'northing'))
DEGREE_COLUMNS = (('lon', 'lat'), ('longitude', 'latitude'))

_DEGREES = 'EPSG:4326'

# What errors call it, its geometry, the system of that (None: the terrain's), what is known of it.
_Found = tuple[str, Mapping[str, Any], str | None, Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class Feature:
    """A point, a line or an area: a ``Point``, ``LineString`` or ``Polygon``.

    ``rings`` are eastings and northings [m], shape [places, 2]: one array, but for an area its
    outer ring and its holes. Errors call it by ``where``.
    """

    where: str
    kind: str
    rings: tuple[np.ndarray, ...]
    properties: Mapping[str, Any]

    @property
    def name(self) -> str:
        """What it is called; may be empty."""
        return str(self.properties.get('name') or '')


def read_features(field: str, path: str | Path, terrain: Terrain) -> list[Feature]:
    """Read the features of a file; a feature of several parts becomes several features.

    GeoJSON is in longitude and latitude unless it names another system, a GeoPackage in the system
    of its layers. A table (.csv) has columns ``x,y`` or ``easting,northing`` in the terrain's
    system, or ``lon,lat`` in degrees; with ``x_end,y_end`` or ``lon_end,lat_end`` a row is a line.
    Coordinates of the result are in the terrain's system. LavaError where the file cannot be read,
    has no features, or has no known coordinate system.
    """
    path = Path(path)
    readers = {'.csv': _from_table, '.gpkg': _from_geopackage}
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise LavaError(field, str(path), f'a file whose name ends with {" or ".join(ENDINGS)}')
    features = []
    for where, geometry, system, properties in readers.get(suffix, _from_geojson)(field, path):
        for kind, part in _parts(where, geometry):
            rings = part if kind == 'Polygon' else [part]
            try:
                arrays = [np.array(ring, dtype=float).reshape(len(ring), -1) for ring in rings]
                arrays = [ring[:, :2] for ring in arrays]
                places = np.concatenate(arrays)
            except (TypeError, ValueError):
                raise LavaError(where, part, 'a geometry of numbers') from None
            if places.shape[1] != 2 or not (np.abs(places) <= MAX_COORDINATE).all():
                raise LavaError(where, part, 'a geometry of two coordinates for each place')
            places = _on(terrain, places, system, where)
            ends = np.cumsum([len(ring) for ring in arrays])[:-1]
            features.append(Feature(where, kind, tuple(np.split(places, ends)), properties))
    if not features:
        raise LavaError(field, str(path), 'a file with at least one point, line or area')
    return features


def _parts(where: str, geometry: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """The single geometries of one; a point is a list of one place."""
    if not isinstance(geometry, Mapping):
        raise LavaError(where, geometry, 'a feature with a geometry')
    kind, places = str(geometry.get('type')), geometry.get('coordinates')
    single = kind.removeprefix('Multi')
    if single not in ('Point', 'LineString', 'Polygon') or not isinstance(places, (list, tuple)):
        raise LavaError(where, kind, 'a point, a line or an area')
    for part in places if single != kind else [places]:
        yield single, [part] if single == 'Point' else part


def _on(terrain: Terrain, places: np.ndarray, system: str | None, where: str) -> np.ndarray:
    """Places [count, 2] of a system in that of a terrain."""
    if system is None:
        return places
    own = coordinate_system(terrain.epsg, terrain.wkt)
    if own is None:
        right = 'coordinates of the terrain, which has no coordinate system'
        raise LavaError(where, f'coordinates of {system}', right)
    try:
        return transformed(system, own, *places.T).T
    except ValueError as error:
        right = f'places of a coordinate system that GDAL knows ({error})'
        raise LavaError(where, f'places of {system}', right) from error


def _from_table(field: str, path: Path) -> Iterator[_Found]:
    rows = read_table(field, path, (), None)
    pairs = [pair for pair in (*OWN_COLUMNS, *DEGREE_COLUMNS) if set(pair) <= set(rows[0][1])]
    if len(pairs) != 1:
        right = ' or '.join(','.join(pair) for pair in (*OWN_COLUMNS, *DEGREE_COLUMNS))
        raise LavaError(f'{path}, first line', ','.join(rows[0][1]), f'the columns {right}')
    system = _DEGREES if pairs[0] in DEGREE_COLUMNS else None
    for where, row in rows:
        ends = [[row.pop(f'{name}{end}', '') for name in pairs[0]] for end in ('', '_end')]
        kind = {'type': 'LineString', 'coordinates': ends}
        if not any(ends[1]):
            kind = {'type': 'Point', 'coordinates': ends[0]}
        yield where, kind, system, {name: text for name, text in row.items() if text}


def _from_geojson(field: str, path: Path) -> Iterator[_Found]:
    try:
        with open_input(path) as file:
            data = parse_json(field, file.read().decode('utf-8-sig'))
    except (OSError, UnicodeDecodeError) as error:
        raise LavaError(field, str(path), f'a readable file ({error})') from error
    items = data.get('features', [data]) if isinstance(data, Mapping) else None
    if not isinstance(items, list) or not all(isinstance(item, Mapping) for item in items):
        raise LavaError(field, str(path), 'GeoJSON: a FeatureCollection')
    # before RFC 7946 a file could name its system, and QGIS still writes such
    named = data.get('crs') or {}
    properties = named.get('properties') if isinstance(named, Mapping) else None
    system = properties.get('name') if isinstance(properties, Mapping) else None
    for index, item in enumerate(items):
        known = item.get('properties')
        geometry = item.get('geometry', item)
        if geometry is not None:
            yield (
                f'{path}, feature {index}', geometry, str(system or _DEGREES),
                known if isinstance(known, Mapping) else {},
            )


def _from_geopackage(field: str, path: Path) -> Iterator[_Found]:
    require('fiona', 'GeoPackage', str(path))
    import fiona
    from fiona.errors import FionaError

    try:
        with open_input(path) as file:
            if file.read(15) != b'SQLite format 3':
                raise LavaError(field, str(path), 'a GeoPackage')
        # an absolute path is no URL
        place = path.absolute()
        for layer in fiona.listlayers(place):
            with fiona.open(place, layer=layer, enabled_drivers=['GPKG']) as source:
                for item in source:
                    if item.geometry is not None:
                        yield (
                            f'{path}, {layer} {item.id}', item.geometry.__geo_interface__,
                            source.crs_wkt or None, dict(item.properties),
                        )
    except (OSError, FionaError) as error:
        raise LavaError(field, str(path), f'a GeoPackage that GDAL can read ({error})') from error
