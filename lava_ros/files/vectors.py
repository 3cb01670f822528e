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
from pathlib import Path
import re
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
import warnings
import zipfile

from lava_ros.errors import LavaError
from lava_ros.files import open_input, write_output
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

#: The coordinate system that a GeoJSON file from before RFC 7946 names; GDAL takes one that it
#: does not know for degrees.
_CRS = re.compile(rb'"crs"\s*:\s*\{[^{}]*\{[^{}]*"name"\s*:\s*"([^"]*)"')

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
    named = _CRS.search(data) if known.ending == 'geojson' else None
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
            crs = named[1].decode(errors='replace') if named else meta['crs']
            result.append((f'{where} {number}', item['geometry'], crs, properties))
    return result


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
    ending = path.suffix.lower()[1:]
    ending = ALIASES.get(ending, ending)
    if ending not in FORMATS and ending not in ARCHIVES:
        raise LavaError(field, str(path), f'a file whose name ends with {" or ".join(ENDINGS)}')
    try:
        if ending in ARCHIVES:
            ending, parts = _unpacked(field, path, ARCHIVES[ending])
        elif ending == 'shp':
            names = {item.suffix.lower(): item for item in path.parent.iterdir()
                     if item.stem == path.stem and item.suffix.lower() in _PARTS}
            parts = {name: _bytes(field, item) for name, item in names.items()}
        else:
            parts = {f'.{ending}': _bytes(field, path)}
            journal = path.with_name(f'{path.name}-wal')
            if ending == 'gpkg' and journal.exists() and journal.stat().st_size:
                right = 'a GeoPackage that no program has open: it has changes that are not in it'
                raise LavaError(field, str(path), right)
    except FileNotFoundError:
        raise LavaError(field, str(path), 'a file that exists') from None
    except LavaError:
        raise
    # a damaged archive raises what each of its parts does, which has no class in common
    except Exception as error:
        raise LavaError(field, str(path), f'a readable file ({error})') from error
    known = FORMATS[ending]
    # a KMZ of GDAL has a file for each layer
    contents = [parts[name] for name in sorted(parts) if name.endswith(f'.{ending}')] or [b'']
    contents = [data.removeprefix(b'\xef\xbb\xbf') for data in contents]
    for data in contents:
        # entities may refer to files, and grow without bound
        if not known.begins.match(data[:4096]) or (ending == 'kml' and b'<!DOCTYPE' in data):
            raise LavaError(field, str(path), f'a file of {known.name}')
    if ending != 'shp':
        return known, contents
    lacking = [name for name in _PARTS[:3] if name not in parts]
    if lacking:
        right = f'a Shapefile with its other parts beside it ({", ".join(lacking)})'
        raise LavaError(field, str(path), right)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, 'w') as packed:
        for name, content in parts.items():
            packed.writestr(f'{re.sub(r"[^A-Za-z0-9_-]", "_", path.stem)}{name}', content)
    return known, [archive.getvalue()]


def _bytes(field: str, path: Path) -> bytes:
    """Read a file of limited size."""
    with open_input(path) as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise LavaError(field, str(path), f'a file of at most {MAX_BYTES >> 20} MiB')
    return data


def _unpacked(field: str, path: Path, endings: Sequence[str]) -> tuple[str, dict[str, bytes]]:
    """Read the one vector file of an archive: its ending, and the bytes of its parts by suffix."""
    with open_input(path) as file, zipfile.ZipFile(file) as archive:
        members = [item for item in archive.infolist() if not item.is_dir()]
        if len(members) > MAX_MEMBERS:
            raise LavaError(field, str(path), f'an archive of at most {MAX_MEMBERS} files')
        named = [(Path(item.filename), item) for item in members]
        found = [
            name for name, _ in named
            if name.suffix.lower()[1:] in endings and '__MACOSX' not in name.parts
        ]
        if not found or (len(found) > 1 and endings != ('kml',)):
            shown = ', '.join(map(str, found)) or f'{len(members)} other files'
            known = ', '.join(FORMATS[end].name for end in endings)
            raise LavaError(f'{field}, {path}', shown, f'an archive with one file of {known}')
        wanted = {place.with_suffix(suffix) for place in found for suffix in _PARTS} | {*found}
        parts = [
            (str(name) if name in found and endings == ('kml',) else name.suffix.lower(), item)
            for name, item in named
            if name in found or name.with_suffix(name.suffix.lower()) in wanted
        ]
        if sum(item.file_size for _, item in parts) > MAX_BYTES:
            raise LavaError(field, str(path), f'at most {MAX_BYTES >> 20} MiB when unpacked')
        result = {}
        for suffix, item in parts:
            with archive.open(item) as member:
                # what an archive says of its sizes may be wrong
                result[suffix] = member.read(MAX_BYTES + 1)
        if sum(map(len, result.values())) > MAX_BYTES:
            raise LavaError(field, str(path), f'at most {MAX_BYTES >> 20} MiB when unpacked')
    return found[0].suffix.lower()[1:], result


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

    inner = {'kmz': 'kml', 'zip': 'shp'}.get(ending, ending)
    known = FORMATS.get(inner)
    options: dict[str, Any] = {'CSV': {'GEOMETRY': 'AS_WKT'}, 'GeoJSON': {'RFC7946': 'YES'}}.get(
        'CSV' if known is None else known.driver, {}
    )
    written = []
    try:
        with TemporaryDirectory() as temporary, warnings.catch_warnings():
            # names of a Shapefile's columns have ten letters
            warnings.simplefilter('ignore')
            for name, features in layers.items():
                if not features:
                    if ending == 'geojson':
                        written.append(folder / f'{name}.geojson')
                        empty = {'type': 'FeatureCollection', 'features': list(features)}
                        write_output('output', written[-1], json.dumps(empty) + '\n')
                    continue
                text = json.dumps({'type': 'FeatureCollection', 'features': list(features)})
                meta, _, geometry, values = raw.read(text.encode())
                in_one = known is not None and known.has_layers
                place = Path(temporary, f'{stem if in_one else name}.{inner}')
                raw.write(
                    place, geometry, values, meta['fields'], layer=name,
                    driver='CSV' if known is None else known.driver,
                    geometry_type=features[0]['geometry']['type'], crs=crs, append=place.exists(),
                    layer_options=options,
                )
            made = sorted(Path(temporary).iterdir())
            if ending != inner:
                made = [
                    _packed(place, ending, made) for place in made if place.suffix[1:] == inner
                ]
            for place in made:
                written.append(folder / place.name)
                write_output('output', written[-1], place.read_bytes())
    except LavaError:
        raise
    # what GDAL and SQLite say has no class in common
    except Exception as error:
        raise LavaError('output', str(folder), f'a folder to write to ({error})') from error
    return written


def _packed(place: Path, ending: str, made: Sequence[Path]) -> Path:
    """Pack a file and its other parts into an archive in the same folder, and return its path."""
    path = place.with_suffix(f'.{ending}')
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for part in (item for item in made if item.stem == place.stem):
            archive.write(part, 'doc.kml' if ending == 'kmz' else part.name)
    return path


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
