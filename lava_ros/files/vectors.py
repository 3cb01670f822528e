# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Points, lines and areas of other programs: GeoJSON, GeoPackage, Shapefile and KML by GDAL.

A file is read into memory and given to GDAL from there: what it refers to is not opened.
"""

from collections.abc import Mapping, Sequence
import csv
import io
import json
import logging
import math
from pathlib import Path
import re
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
import warnings
import zipfile

from lava_ros.errors import LavaError
from lava_ros.files import open_input, warn_of_others, write_output
from lava_ros.files.optional import require

_LOG = logging.getLogger(__name__)

#: Largest file, unpacked [bytes].
MAX_BYTES = 256 * 2**20

#: Largest number of files in an archive, and of layers in a file.
MAX_MEMBERS, MAX_LAYERS = 1000, 1000


class Format(NamedTuple):
    """A format of vector files.

    Attributes:
        name: Its name, as people call it.
        ending: End of the names of its files, which the option ``--formats`` takes too.
        driver: GDAL's name of it, to write.
        readers: GDAL's names of it that may read it.
        begins: What its files begin with.
        is_degrees: True if its coordinates are longitudes and latitudes.
        has_layers: True if a file has several layers.
    """

    name: str
    ending: str
    driver: str
    readers: tuple[str, ...]
    begins: re.Pattern[bytes]
    is_degrees: bool = False
    has_layers: bool = False


_KML = re.compile(rb'\s*(<\?xml[^>]*\?>\s*)?(<!--.*?-->\s*)*<(\w+:)?kml\b', re.DOTALL)

#: Formats by the end of a file's name.
FORMATS = {
    item.ending: item
    for item in (
        Format('GeoJSON', 'geojson', 'GeoJSON', ('GeoJSON',), re.compile(rb'\s*\{'), True),
        Format('GeoPackage', 'gpkg', 'GPKG', ('GPKG',), re.compile(rb'SQLite format 3\0'),
               has_layers=True),
        Format('Shapefile', 'shp', 'ESRI Shapefile', ('ESRI Shapefile',),
               re.compile(rb'\0\0\x27\x0a')),
        Format('KML', 'kml', 'LIBKML', ('LIBKML', 'KML'), _KML, True, True),
    )
}

#: Other ends of names, and archives, with the formats that they may hold.
ALIASES = {'json': 'geojson'}
ARCHIVES = {'kmz': ('kml',), 'zip': tuple(FORMATS), 'shz': ('shp',)}

#: Ends of the names of files that can be read.
ENDINGS = tuple(f'.{ending}' for ending in (*FORMATS, *ALIASES, *ARCHIVES))

#: Parts of a Shapefile that are read and written; the first three it needs.
_PARTS = ('.shp', '.shx', '.dbf', '.prj', '.cpg')

#: Attributes of each KML feature, which say how it is drawn.
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

#: A feature: its name for errors, the geometry and attributes of GeoJSON, and the definition of
#: its coordinate system (None: unknown).
Item = tuple[str, Mapping[str, Any] | None, str | None, Mapping[str, Any]]


def read_vectors(field: str, path: Path) -> list[Item]:
    """Read the features of all layers of a file, in two dimensions; GDAL's warnings are logged.

    Raises:
        LavaError: The file cannot be read, is too large, or is not what its name says; or pyogrio
            is not installed. Errors name ``field``.
    """
    require('pyogrio', field, str(path))
    known, contents = _content(field, path)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter('always')
        try:
            result = [item for data in contents for item in _read(known, data, path)]
        except LavaError:
            raise
        # pyogrio has errors of several classes, and some of numpy
        except Exception as error:
            right = f'a file of {known.name} that GDAL can read ({_named(error, path)})'
            raise LavaError(field, str(path), right) from error
    # a file in memory has no ending
    texts = {_named(item.message, path) for item in told} - {''}
    for text in sorted(text for text in texts if 'file extension' not in text):
        _LOG.warning(f'{path}: {text}')
    return result


def _named(message: object, path: Path) -> str:
    """Return a message of GDAL with the name of the file instead of its name in memory."""
    return re.sub(r"/vsi[^\s']+", path.name, str(message))


def _read(known: Format, data: bytes, path: Path) -> list[Item]:
    """Read the features of all layers of a file in memory."""
    from pyogrio import list_layers, raw, read_info

    layers = list_layers(data)
    if len(layers) > MAX_LAYERS:
        raise LavaError(f'layers of {path}', len(layers), f'at most {MAX_LAYERS}')
    result: list[Item] = []
    named = _check_members(path, data) if known.ending == 'geojson' else None
    for index, (layer, kind) in enumerate(layers):
        if kind is None:
            continue
        driver = read_info(data, layer=index)['driver']
        if driver not in known.readers:
            raise LavaError(str(path), f'a file of {driver}', f'a file of {known.name}')
        meta, _, geometry, values = raw.read(data, layer=index, force_2d=True)
        where = f'{path}, {layer}' if known.has_layers else f'{path}, feature'
        for number, item in enumerate(_as_geojson(meta, geometry, values)):
            properties = {
                name: value for name, value in (item['properties'] or {}).items()
                if value is not None and (known.ending != 'kml' or name not in _OF_KML)
            }
            crs = named or meta['crs']
            result.append((f'{where} {number}', item['geometry'], crs, properties))
    return result


def _check_members(path: Path, data: bytes) -> str | None:
    """Warn of members of GeoJSON that GDAL passes over, and refuse what it takes for nothing.

    Returns:
        The coordinate system that a file from before RFC 7946 names; GDAL takes one that it does
        not know for degrees.
    """
    others: list[str] = []

    def check(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        members = dict(pairs)
        if len(members) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise LavaError(f'{path}, {twice}', 'given twice', 'each member once')
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
    warn_of_others(path, 'members', others)
    return system and str(system['properties']['name'])


def _as_geojson(meta: Any, geometry: Any, values: Any) -> list[dict[str, Any]]:
    """Return features that pyogrio has read as those of GeoJSON, in their own system."""
    from pyogrio import raw

    if not len(geometry):
        return []
    text = io.BytesIO()
    with warnings.catch_warnings():
        # that it is not told the system
        warnings.simplefilter('ignore')
        raw.write(
            text, geometry, values, meta['fields'], driver='GeoJSON', geometry_type='Unknown',
            layer_options={'SIGNIFICANT_FIGURES': '17'},
        )
    features: list[dict[str, Any]] = json.loads(text.getvalue())['features']
    return features


def _content(field: str, path: Path) -> tuple[Format, list[bytes]]:
    """Return the format of a file, and the bytes for GDAL: an archive of a Shapefile's parts."""
    ending = _ending(path)
    if f'.{ending}' not in ENDINGS:
        raise LavaError(field, str(path), f'a file whose name ends with {" or ".join(ENDINGS)}')
    journal = path.with_name(f'{path.name}-wal')
    try:
        if ending == 'gpkg' and journal.exists() and journal.stat().st_size:
            right = 'a GeoPackage that no program has open: it has changes that are not in it'
            raise LavaError(field, str(path), right)
        files = _files(field, path)
    except FileNotFoundError:
        raise LavaError(field, str(path), 'a file that exists') from None
    except LavaError:
        raise
    # a damaged archive raises what each of its parts does, which has no class in common
    except Exception as error:
        raise LavaError(field, str(path), f'a readable file ({error})') from error
    wanted = ARCHIVES.get(ending, (ending,))
    found = sorted(
        name for name in files if _ending(name) in wanted and '__MACOSX' not in name.parts
    )
    # a KMZ of GDAL has a file for each layer
    if not found or (len(found) > 1 and ending != 'kmz'):
        shown = ', '.join(map(str, found)) or 'other files'
        right = f'an archive with one file of {", ".join(FORMATS[end].name for end in wanted)}'
        raise LavaError(f'{field}, {path}', shown, right)
    known = FORMATS[_ending(found[0])]
    contents = [files[name].removeprefix(b'\xef\xbb\xbf') for name in found]
    for data in contents:
        # entities may refer to files, and grow without bound
        if not known.begins.match(data[:4096]) or (known.ending == 'kml' and b'<!DOCTYPE' in data):
            raise LavaError(field, str(path), f'a file of {known.name}')
    if known.ending != 'shp':
        return known, contents
    parts = {name.suffix.lower(): data for name, data in files.items()
             if name.with_suffix('') == found[0].with_suffix('')}
    if lacking := [name for name in _PARTS[:3] if name not in parts]:
        right = f'a Shapefile with its other parts beside it ({", ".join(lacking)})'
        raise LavaError(field, str(path), right)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, 'w') as archive:
        for name, data in parts.items():
            archive.writestr(f'{re.sub(r"[^A-Za-z0-9_-]", "_", path.stem)}{name}', data)
    return known, [packed.getvalue()]


def _ending(path: Path) -> str:
    """Return the end of a file's name, in lower case and without aliases."""
    ending = path.suffix.lower()[1:]
    return ALIASES.get(ending, ending)


def _files(field: str, path: Path) -> dict[Path, bytes]:
    """Read a file, all parts of a Shapefile, or those files of an archive that may be wanted."""
    unpacked, result = '', {}
    if _ending(path) in ARCHIVES:
        unpacked = ' when unpacked'
        with open_input(path) as file, zipfile.ZipFile(file) as archive:
            members = {
                Path(item.filename): item for item in archive.infolist()
                if Path(item.filename).suffix.lower() in (*ENDINGS, *_PARTS)
            }
            if len(members) > MAX_MEMBERS:
                raise LavaError(field, str(path), f'an archive of at most {MAX_MEMBERS} files')
            # no more is unpacked of a member than the archive says
            if sum(item.file_size for item in members.values()) <= MAX_BYTES:
                return {name: archive.read(item) for name, item in members.items()}
    else:
        beside = path.parent.iterdir() if _ending(path) == 'shp' else ()
        for item in (path, *(item for item in beside if item.stem == path.stem)):
            if item == path or item.suffix.lower() in _PARTS:
                with open_input(item) as file:
                    result[item] = file.read(MAX_BYTES + 1)
        if sum(map(len, result.values())) <= MAX_BYTES:
            return result
    right = f'a file of at most {MAX_BYTES >> 20} MiB{unpacked}'
    raise LavaError(field, str(path), right)


#: Formats that features are written in: ends of names. A zip holds a Shapefile.
WRITTEN = (*FORMATS, 'kmz', 'zip', 'csv')


def write_vectors(
    folder: Path, ending: str, layers: Mapping[str, Sequence[Mapping[str, Any]]], crs: str | None,
    *, stem: str,
) -> list[Path]:
    """Write layers of GeoJSON features, and return the paths of the files.

    Formats with layers have all in ``<stem>.<ending>``, others a file for each layer, named after
    it. A Shapefile has several parts, or one zip. A table has the areas as WKT. Empty layers are
    left out, except in GeoJSON. Files are there whole or not at all.

    Args:
        folder: Where the files go.
        ending: The format, one of ``WRITTEN``.
        layers: The features of each layer, of one kind of geometry, with coordinates in ``crs``.
        crs: Definition of the coordinate system (WKT); None if there is none.
        stem: Name of a file of several layers.

    Raises:
        LavaError: A file cannot be written.
    """
    from pyogrio import raw

    known = FORMATS.get({'kmz': 'kml', 'zip': 'shp'}.get(ending, ending))
    driver = 'CSV' if known is None else known.driver
    options = {'CSV': {'GEOMETRY': 'AS_WKT'}, 'GeoJSON': {'RFC7946': 'YES'}}.get(driver, {})
    written = []
    try:
        with TemporaryDirectory() as temporary, warnings.catch_warnings():
            # names of a Shapefile's columns have ten letters
            warnings.simplefilter('ignore')
            for name, features in layers.items():
                collection = {'type': 'FeatureCollection', 'features': list(features)}
                text = json.dumps(collection) + '\n'
                in_one = known is not None and known.has_layers
                # GDAL packs the parts of a Shapefile of this name
                inner = {'zip': 'shp.zip', 'kmz': 'kml'}.get(ending, ending)
                place = Path(temporary, f'{stem if in_one else name}.{inner}')
                if not features:
                    if ending == 'geojson':
                        place.write_text(text)
                    continue
                meta, _, geometry, values = raw.read(text.encode())
                raw.write(
                    place, geometry, values, meta['fields'], layer=name, driver=driver,
                    geometry_type=features[0]['geometry']['type'], crs=crs, append=place.exists(),
                    layer_options=options,
                )
            for place in sorted(Path(temporary).iterdir()):
                data = place.read_bytes()
                if ending == 'kmz':
                    # GDAL adds no layer to an archive
                    packed = io.BytesIO()
                    with zipfile.ZipFile(packed, 'w', zipfile.ZIP_DEFLATED) as archive:
                        archive.writestr('doc.kml', data)
                    data = packed.getvalue()
                suffix = place.suffix if ending not in ARCHIVES else f'.{ending}'
                written.append(folder / f'{place.name.partition(".")[0]}{suffix}')
                write_output('output', written[-1], data)
    except LavaError:
        raise
    # what GDAL and SQLite say has no class in common
    except Exception as error:
        raise LavaError('output', str(folder), f'a folder to write to ({error})') from error
    return written


def geometries_of_wkt(field: str, texts: Sequence[str]) -> list[Mapping[str, Any] | None]:
    """Read geometries in well-known text as those of GeoJSON; None for text that is not one.

    Raises:
        LavaError: pyogrio is not installed. The error names ``field``.
    """
    require('pyogrio', field, 'well-known text')
    from pyogrio import raw

    with TemporaryDirectory() as temporary, warnings.catch_warnings():
        # what is wrong with a text is the caller's to say
        warnings.simplefilter('ignore')
        place = Path(temporary, 'a.csv')
        with place.open('w', newline='', encoding='utf-8') as file:
            csv.writer(file).writerows([('WKT', 'row'), *((text, 0) for text in texts)])
        meta, _, geometry, values = raw.read(place, force_2d=True)
    return [item['geometry'] for item in _as_geojson(meta, geometry, values)]
