# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks of the reader process with vector files: the features of GDAL as plain data."""

from collections.abc import Mapping
from functools import cache
import io
import json
import logging
import math
from pathlib import Path
import re
from typing import Any
import warnings

from lava_ros.errors import LavaError, RefusalError
from lava_ros.files import warn_of_unknown
from lava_ros.files.reader.gdal import check_tables, FOLDER, Gdal, VIEWS
from lava_ros.files.reader.memory import Content, Output
from lava_ros.files.systems import plain_system
from lava_ros.files.vectors import Format, FORMATS, Item, MAX_LAYERS

_LOG = logging.getLogger('lava_ros.files.vectors')

#: Attributes of KML features for drawing.
_OF_KML = frozenset((
    'id', 'description', 'Description', 'snippet', 'altitudeMode', 'tessellate', 'extrude',
    'visibility', 'drawOrder', 'icon', 'gx_media_links',
))

#: Members of GeoJSON objects by their type; others have no effect.
_MEMBERS = {
    'FeatureCollection': (
        'type', 'features', 'bbox', 'name', 'description', 'crs', 'xy_coordinate_resolution'
    ),
    'Feature': ('type', 'id', 'geometry', 'properties', 'bbox'),
}
_GEOMETRY = ('type', 'coordinates', 'geometries', 'bbox')


@cache
def prepare() -> None:
    """Load GDAL, and open the data files that it needs."""
    from pyogrio import raw
    own = {name for item in FORMATS.values() for name in item.readers}
    gdal().keep_drivers({*own, 'CSV', 'MEM', 'Memory'})
    point = {'type': 'Point', 'coordinates': [0.0, 0.0]}
    item = {'type': 'Feature', 'properties': {'a': 1}, 'geometry': point}
    text = json.dumps({'type': 'FeatureCollection', 'features': [item]})
    meta, _, geometry, values = raw.read(text.encode())
    _as_geojson(meta, geometry, values)


@cache
def gdal() -> Gdal:
    """Return the GDAL of pyogrio."""
    return Gdal('pyogrio', '_ogr')


def read(files: Mapping[str, Content], _: Output, *, field: str, path: str) -> list[Item]:
    """Read the features of all layers of files, and log warnings of GDAL.

    Args:
        files: Contents of files of one format, which is the suffix of their names.
        field: Name of the field in errors.
        path: Path of the file or archive in errors.

    Raises:
        LavaError: If a file cannot be read.
    """
    known, place = FORMATS[next(iter(files)).rpartition('.')[2]], Path(path)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter('always')
        try:
            result = [
                item for file in files.values()
                for item in _read(field, known, file.data.tobytes(), place)
            ]
        except (LavaError, MemoryError):
            raise
        # the errors of pyogrio have no common class
        except Exception as error:
            expected = f'a file of {known.name} that GDAL can read ({_message(error, place)})'
            raise LavaError(field, path, expected) from error
    # GDAL warns that a file in memory has no suffix
    texts = {_message(item.message, place) for item in told} - {''}
    for text in sorted(text for text in texts if 'file extension' not in text):
        _LOG.warning(f'{path}: {text}')
    return result


def read_wkt(
    files: Mapping[str, Content], _: Output, **__: str
) -> list[Mapping[str, Any] | None]:
    """Return the geometries of a table of well-known text, None for invalid text."""
    from pyogrio import raw

    (name,) = files
    with gdal().holding(files), warnings.catch_warnings():
        # the caller reports invalid text
        warnings.simplefilter('ignore')
        meta, _, geometry, values = raw.read(f'{FOLDER}/{name}', force_2d=True)
    return [item['geometry'] for item in _as_geojson(meta, geometry, values)]


def _message(message: object, path: Path) -> str:
    """Return a message of GDAL with the name of the file instead of its path in memory."""
    return re.sub(r"/vsi[^\s']+", path.name, str(message))


def _read(field: str, known: Format, data: bytes, path: Path) -> list[Item]:
    """Read the features of all layers of a file in memory."""
    from pyogrio import list_layers, raw, read_info

    named = _check_members(path, data) if known.ending == 'geojson' else None
    if known.ending == 'gpkg':
        # GDAL counts the rows of a view when it lists the layers
        check_tables(field, list(raw.read(data, sql=VIEWS)[3][0]))
    layers = list_layers(data)
    if len(layers) > MAX_LAYERS:
        raise LavaError(f'layers of {path}', len(layers), f'at most {MAX_LAYERS}')
    result: list[Item] = []
    for index, (layer, kind) in enumerate(layers):
        if kind is None:
            continue
        driver = read_info(data, layer=index)['driver']
        if driver not in known.readers:
            raise LavaError(f'format of {path}', driver, known.name)
        meta, _, geometry, values = raw.read(data, layer=index, force_2d=True)
        # without a folder in a KML file, the layer has the name of the file in memory
        has_name = known.has_layers and not str(layer).startswith('pyogrio_')
        where = f'{path}, {layer if has_name else "feature"}'
        for number, item in enumerate(_as_geojson(meta, geometry, values)):
            properties = {
                name: value for name, value in (item['properties'] or {}).items()
                if value is not None and (known.ending != 'kml' or name not in _OF_KML)
            }
            crs = named or meta['crs']
            result.append((f'{where} {number}', item['geometry'], crs, properties))
    return result


def _check_members(path: Path, data: bytes) -> str | None:
    """Warn of GeoJSON members that GDAL ignores, and raise LavaError for ambiguous ones.

    Returns the coordinate system that a file in the format before RFC 7946 states; GDAL would
    treat an unknown one as degrees.
    """
    others: list[str] = []

    def check(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        members = dict(pairs)
        if len(members) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            problem = f'{path} contains an object with two members {twice!r}'
            raise RefusalError(str(path), problem, 'Remove one of them')
        for name, value in members.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise LavaError(f'{path}, {name}', value, 'a finite number')
        known = _MEMBERS.get(str(members.get('type')), members)
        for name in ('properties', 'geometry') if known is _MEMBERS['Feature'] else ():
            if not isinstance(members.get(name), dict | None):
                raise LavaError(f'{path}, {name}', members[name], 'an object, or null')
            if name == 'geometry':
                others.extend(key for key in members.get(name) or () if key not in _GEOMETRY)
        others.extend(name for name in members if name not in known)
        return members

    system = json.loads(data, object_pairs_hook=check).get('crs')
    warn_of_unknown(path, 'members', others)
    if system is None:
        return None
    if system.get('type', 'name') != 'name':
        expected = 'a name: an EPSG code, an OGC name or well-known text'
        raise LavaError(f'{path}, crs', system['type'], expected)
    return plain_system(f'{path}, crs', str(system['properties']['name']))


def _as_geojson(meta: Any, geometry: Any, values: Any) -> list[dict[str, Any]]:
    """Convert features of pyogrio to GeoJSON, without a change of coordinates."""
    from pyogrio import raw

    if not len(geometry):
        return []
    text = io.BytesIO()
    with warnings.catch_warnings():
        # pyogrio warns that there is no coordinate system
        warnings.simplefilter('ignore')
        raw.write(
            text, geometry, values, meta['fields'], driver='GeoJSON', geometry_type='Unknown',
            layer_options={'SIGNIFICANT_FIGURES': '17'},
        )
    features: list[dict[str, Any]] = json.loads(text.getvalue())['features']
    return features
