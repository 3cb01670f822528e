# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Vector files: GeoJSON, GeoPackage, Shapefile and KML, read by the reader process."""

from collections.abc import Mapping, Sequence
import io
import json
from pathlib import Path
import re
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
import warnings
import zipfile

from lava_ros.errors import LavaError, refusing
from lava_ros.files import check_exists, open_input, write_output
from lava_ros.files.csv import format_table
from lava_ros.files.optional import require
from lava_ros.files.reader.client import read_in_process, start
from lava_ros.files.systems import plain_system

#: Maximum size of an unpacked file [bytes].
MAX_BYTES = 256 * 2**20

#: Maximum number of files in an archive, and of layers in a file.
MAX_MEMBERS, MAX_LAYERS = 1000, 1000


class Format(NamedTuple):
    """A format of vector files.

    Attributes:
        name: Name of the format, for people.
        ending: Suffix of file names, which is also the value of the option ``--formats``.
        driver: GDAL driver for writing.
        readers: GDAL drivers for reading.
        begins: Pattern of the first bytes of such files.
        is_degrees: True if coordinates are longitudes and latitudes.
        has_layers: True if a file may have several layers.
    """

    name: str
    ending: str
    driver: str
    readers: tuple[str, ...]
    begins: re.Pattern[bytes]
    is_degrees: bool = False
    has_layers: bool = False


_KML = re.compile(rb'\s*(<\?xml[^>]*\?>\s*)?(<!--.*?-->\s*)*<(\w+:)?kml\b', re.DOTALL)

#: Formats by the suffix of file names.
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

#: Other suffixes, and archives, with the formats that they may contain.
ALIASES = {'json': 'geojson'}
ARCHIVES = {'kmz': ('kml',), 'zip': tuple(FORMATS), 'shz': ('shp',)}

#: Suffixes of files that can be read.
ENDINGS = tuple(f'.{ending}' for ending in (*FORMATS, *ALIASES, *ARCHIVES))

#: Parts of a Shapefile that are read and written; the first three are required.
_PARTS = ('.shp', '.shx', '.dbf', '.prj', '.cpg')

#: Names in a Shapefile, which holds 10 letters, of attributes that would lose their unit.
SHAPEFILE_NAMES = {
    'inundation_threshold_m': 'thresh_m',
    'inundated_area_m2': 'inund_m2',
    'cells_area_m2': 'cells_m2',
    'probability_percent': 'prob_pct',
}

#: A feature: name in errors, geometry of GeoJSON, definition of the coordinate system (None:
#: unknown), and attributes.
Item = tuple[str, Mapping[str, Any] | None, str | None, Mapping[str, Any]]


def read_vectors(field: str, path: Path) -> list[Item]:
    """Read the features of all layers of a file in two dimensions, and log warnings of GDAL.

    Raises:
        LavaError: If the file cannot be read, is too large, is not of the format of its suffix, or
            defines a coordinate system otherwise than by a code, an OGC name or well-known text;
            or if pyogrio is not installed. Errors name ``field``.
    """
    start()
    require('pyogrio', field, str(path))
    known, contents = _content(field, path)
    files = [(f'{number}.{known.ending}', data) for number, data in enumerate(contents)]
    answer = read_in_process(field, path, 'vectors', files)
    systems = {
        system: system and plain_system(f'{path}, crs', system)
        for _, _, system, _ in answer.data['result']
    }
    return [
        (where, geometry, systems[system], properties)
        for where, geometry, system, properties in answer.data['result']
    ]


def _content(field: str, path: Path) -> tuple[Format, list[bytes]]:
    """Return the format of a file, and its bytes for GDAL; a Shapefile becomes an archive."""
    ending = _ending(path)
    check_exists(field, path)
    journal = path.with_name(f'{path.name}-wal')
    with refusing(field, str(path), 'a readable file'):
        if ending == 'gpkg' and journal.exists() and journal.stat().st_size:
            expected = 'a GeoPackage closed by other programs: its -wal file has unsaved changes'
            raise LavaError(field, str(path), expected)
        files = _files(field, path)
    wanted = ARCHIVES.get(ending, (ending,))
    found = sorted(
        name for name in files if _ending(name) in wanted and '__MACOSX' not in name.parts
    )
    # GDAL writes a KMZ with a file for each layer
    if not found or (len(found) > 1 and ending != 'kmz'):
        shown = ', '.join(map(str, found)) or 'other files'
        expected = f'an archive with one file of {", ".join(FORMATS[end].name for end in wanted)}'
        raise LavaError(f'{field}, {path}', shown, expected)
    known = FORMATS[_ending(found[0])]
    contents = [files[name].removeprefix(b'\xef\xbb\xbf') for name in found]
    for data in contents:
        # XML entities may refer to files, and expand without limit
        if not known.begins.match(data[:4096]) or (known.ending == 'kml' and b'<!DOCTYPE' in data):
            raise LavaError(field, str(path), f'a file of {known.name}')
    if known.ending != 'shp':
        return known, contents
    parts = {name.suffix.lower(): data for name, data in files.items()
             if name.with_suffix('') == found[0].with_suffix('')}
    if lacking := [name for name in _PARTS[:3] if name not in parts]:
        expected = f'a Shapefile with its other parts in the same folder ({", ".join(lacking)})'
        raise LavaError(field, str(path), expected)
    stem = re.sub(r'[^A-Za-z0-9_-]', '_', path.stem)
    return known, [_archive({stem + name: data for name, data in parts.items()})]


def _archive(files: Mapping[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return packed.getvalue()


def _ending(path: Path) -> str:
    """Return the suffix of a file name without the dot, in lower case, with aliases resolved."""
    ending = path.suffix.lower()[1:]
    return ALIASES.get(ending, ending)


def _files(field: str, path: Path) -> dict[Path, bytes]:
    """Read a file, all parts of a Shapefile, or all vector files of an archive."""
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
            # zipfile unpacks at most the declared size of a member
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
    expected = f'a file of at most {MAX_BYTES >> 20} MiB{unpacked}'
    raise LavaError(field, str(path), expected)


#: Suffixes of the formats for writing. A zip contains a Shapefile.
WRITTEN = (*FORMATS, 'kmz', 'zip', 'csv')


def write_vectors(
    folder: Path, ending: str, layers: Mapping[str, Sequence[Mapping[str, Any]]], crs: str | None,
    *, stem: str,
) -> list[Path]:
    """Write layers of GeoJSON features, and return the paths of the files.

    A format with layers is one file, ``<stem>.<ending>``; the others have a file named after each
    layer. A CSV file has the geometries as WKT. Empty layers are omitted except in GeoJSON. Each
    file is written completely or not at all.

    Args:
        folder: Folder of the files.
        ending: Format, one of ``WRITTEN``.
        layers: Features of each layer, of one kind of geometry, with coordinates in ``crs``.
        crs: Definition of the coordinate system (WKT); None without one.
        stem: Name of a file with several layers.

    Raises:
        LavaError: If a file cannot be written.
    """
    from pyogrio import raw

    known = FORMATS.get({'kmz': 'kml', 'zip': 'shp'}.get(ending, ending))
    driver = 'CSV' if known is None else known.driver
    options = {'CSV': {'GEOMETRY': 'AS_WKT'}, 'GeoJSON': {'RFC7946': 'YES'}}.get(driver, {})
    written = []
    with (
        refusing('output', str(folder), 'a writable folder'),
        TemporaryDirectory() as temporary,
        warnings.catch_warnings(),
    ):
        # GDAL warns that it cuts column names in a Shapefile
        warnings.simplefilter('ignore')
        for name, features in layers.items():
            collection = {'type': 'FeatureCollection', 'features': list(features)}
            text = json.dumps(collection) + '\n'
            in_one = known is not None and known.has_layers
            # GDAL packs a Shapefile with the suffix .shp.zip
            inner = {'zip': 'shp.zip', 'kmz': 'kml'}.get(ending, ending)
            place = Path(temporary, f'{stem if in_one else name}.{inner}')
            if not features:
                if ending == 'geojson':
                    place.write_text(text)
                continue
            # written as dates, the values would lose their time zone
            meta, _, geometry, values = raw.read(text.encode(), DATE_AS_STRING='YES')
            raw.write(
                place, geometry, values, _named_for(driver, meta['fields']), layer=name,
                driver=driver,
                geometry_type=features[0]['geometry']['type'], crs=crs, append=place.exists(),
                layer_options=options,
            )
        for place in sorted(Path(temporary).iterdir()):
            data = place.read_bytes()
            if ending == 'kmz':
                # GDAL cannot append a layer to an archive
                data = _archive({'doc.kml': data})
            suffix = place.suffix if ending not in ARCHIVES else f'.{ending}'
            written.append(folder / f'{place.name.partition(".")[0]}{suffix}')
            write_output('output', written[-1], data)
    return written


def _named_for(driver: str, fields: Sequence[str]) -> list[str]:
    """Return the names of attributes in files of a GDAL driver."""
    names = SHAPEFILE_NAMES if driver == 'ESRI Shapefile' else {}
    return [names.get(name, name) for name in fields]


def geometries_of_wkt(field: str, texts: Sequence[str]) -> list[Mapping[str, Any] | None]:
    """Convert well-known text to geometries of GeoJSON; None for invalid text.

    Raises:
        LavaError: If pyogrio is not installed. The error names ``field``.
    """
    require('pyogrio', field, 'well-known text')
    rows = ({'WKT': text, 'row': 0} for text in texts)
    table = format_table(['WKT', 'row'], rows).encode()
    answer = read_in_process(field, 'well-known text', 'wkt', [('a.csv', table)])
    found: list[Mapping[str, Any] | None] = answer.data['result']
    return found
