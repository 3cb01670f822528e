# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks of the reader process with rasters: read by GDAL, with the checks that GDAL lacks."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from functools import cache
import logging
from pathlib import PurePath
import re
from typing import Any

from lava_ros.errors import LavaError, refusing
from lava_ros.files import MAX_CELLS, warn_of_unknown
from lava_ros.files.raster_formats import (
    EXPECTED_LINES,
    FORMATS,
    HEADER,
    NUMBER,
    PICTURES,
    POSITION_LINES,
)
from lava_ros.files.reader.confinement import opening
from lava_ros.files.reader.dataset import Dataset, NUMBERS, RasterGdal
from lava_ros.files.reader.gdal import check_tables, FOLDER, VIEWS
from lava_ros.files.reader.memory import Content, Output
from lava_ros.files.systems import plain_system

_LOG = logging.getLogger('lava_ros.files.rasters')

#: Allowed elements of a virtual raster: ``SourceFilename``, and those without files or code.
_VIRTUAL = {
    'VRTDataset', 'SRS', 'GeoTransform', 'Metadata', 'MDI', 'BlockXSize', 'BlockYSize', 'MaskBand',
    'VRTRasterBand', 'NoDataValue', 'HideNoDataValue', 'ColorInterp', 'Description', 'UnitType',
    'Offset', 'Scale', 'SimpleSource', 'ComplexSource', 'SourceFilename', 'SourceBand',
    'SourceProperties', 'SrcRect', 'DstRect', 'NODATA', 'ScaleOffset', 'ScaleRatio',
}

#: Maximum sizes of a virtual raster, and of the part of a header that is read [bytes].
MAX_VIRTUAL, MAX_HEADER = 1 << 22, 1 << 16

#: Part of a text grid that is read at once [bytes], and a mark for each byte: a space, or x.
_PART, _MARKS = 1 << 24, bytes(ord(' ' if byte <= ord(' ') else 'x') for byte in range(256))

#: Drivers of text grids, and the header of a Surfer grid: shape, and ranges of x, y and z.
_TEXT = ('AAIGrid', 'GSAG')
_SURFER = re.compile(rb'DSAA(?:\s+[-+.\deE]+){8}')


@cache
def gdal() -> RasterGdal:
    """Return the GDAL of rasterio, which has only the drivers of known formats."""
    result = RasterGdal()
    result.keep_drivers({item.driver for item in (*FORMATS, *PICTURES)})
    return result


def prepare() -> None:
    """Load GDAL."""
    gdal()


def tile_names(files: Mapping[str, Content], _: Output, *, field: str, path: str) -> list[str]:
    """Return the names of the files of a virtual raster.

    Raises:
        LavaError: If it refers to anything but files in its folder.
    """
    with opening():
        from xml.etree import ElementTree

    (file,) = files.values()
    text, name = file.data[: MAX_VIRTUAL + 1].tobytes(), PurePath(path).name
    with refusing(field, path, 'a readable virtual raster'):
        if len(text) > MAX_VIRTUAL or b'<!' in text:
            raise ValueError(f'at most {MAX_VIRTUAL} bytes, and no document type')
        elements = list(ElementTree.fromstring(text).iter())
    advice = 'of the same folder (gdal_translate makes a GeoTIFF of the virtual raster)'
    names: dict[str, None] = {}
    for item in elements:
        label, value = f'{item.tag} of {name}', (item.text or '').strip()
        if item.tag not in _VIRTUAL or 'subClass' in item.attrib:
            raise LavaError(label, item.get('subClass', value), f'a mosaic of files {advice}')
        if item.tag == 'SRS' and value:
            plain_system(label, value)
        if item.tag == 'SourceFilename':
            if item.get('relativeToVRT') != '1' or not re.fullmatch(r'[^/\\:<>]+', value):
                raise LavaError(label, value, f'the name of a file {advice}')
            names[value] = None
    if not names:
        raise LavaError(field, path, f'a virtual raster with files {advice}')
    return list(names)


def read(
    files: Mapping[str, Content], output: Output, *, field: str, path: str, drivers: Sequence[str],
    tiles: Mapping[str, str], kind: str | None, max_bands: int, max_side: int | None,
) -> dict[str, Any]:
    """Read the first bands of a raster as arrays, and return its properties.

    Args:
        files: The raster and the files that belong to it.
        output: Receives the bands, [bands, rows, columns], and, if cells may lack data, a mask of
            uint8 that is 0 where data are missing.
        field: Name of the field in errors.
        path: Path of the raster in errors.
        drivers: GDAL driver of the raster.
        tiles: Driver of each file of a virtual raster by its name.
        kind: Type of the values, None for the type in the file.
        max_bands: Maximum number of bands.
        max_side: Maximum number of rows and columns; a larger raster is thinned.

    Raises:
        LavaError: If the raster cannot be read.
    """
    name = next(iter(files))
    gdal().warnings.clear()
    with gdal().holding(files), refusing(field, path, 'a raster that GDAL can read'):
        for tile, driver in tiles.items():
            with _opened(field, path, tile, driver, files):
                pass
        with _opened(field, path, name, drivers[0], files) as source:
            count = min(source.count, max_bands)
            step = 1 if max_side is None else max(source.width, source.height) // max_side + 1
            shape = (count, -(-source.height // step), -(-source.width // step))
            kinds = {*source.dtypes[:count]}
            if not kinds <= NUMBERS.keys():
                # the caller refuses complex numbers
                shape, kind = (0, 0, 0), 'float32'
            elif len(kinds) > 1:
                raise ValueError(f'bands of several types: {", ".join(sorted(kinds))}')
            kind = kind or kinds.pop()
            values = output.array(kind, NUMBERS[kind][1], shape)
            if all(shape):
                source.read(values, kind, shape)
                if source.has_missing(count):
                    source.read_masks(output.array('uint8', 1, shape), shape)
            result = source.properties()
    for text in dict.fromkeys(gdal().warnings):
        _LOG.warning(f'{PurePath(path).name}: {text}')
    return result


@contextmanager
def _opened(
    field: str, path: str, name: str, driver: str, files: Mapping[str, Content]
) -> Iterator[Dataset]:
    """Open a file in memory with one driver, and make the checks that GDAL does not make."""
    shown = PurePath(path).name if name == next(iter(files)) else name
    if driver == 'GPKG':
        _check_database(field, path, files[name])
    numbers = _count_numbers(field, shown, files[name].data) if driver in _TEXT else None
    with gdal().opened(f'{FOLDER}/{name}', driver) as source:
        cells = source.width * source.height
        if cells > MAX_CELLS:
            found = f'{source.height} x {source.width} cells'
            expected = f'at most {MAX_CELLS} (gdal_translate -srcwin extracts a part)'
            raise LavaError(f'size of {shown}', found, expected)
        if not source.count:
            names = ', '.join(item.rpartition(':')[2] for item in source.subdatasets)
            expected = f'a file with one raster, not {names or "none"} '
            expected += '(gdal_translate extracts one)'
            raise LavaError(field, path, expected)
        if driver == 'EHdr' or bytes(files[name].data[:3]) == b'CDF':
            _check_size(field, shown, len(files[name].data), source)
        if driver == 'EHdr':
            stem = PurePath(name).stem
            header = next(item for item in (f'{stem}.hdr', f'{stem}.HDR') if item in files)
            text = files[header].data[:MAX_HEADER].tobytes()
            lines = re.findall(rb'^\s*(\S+)[ \t]*(\S*)', text, re.MULTILINE)
            _check_header(field, header, lines)
        if numbers not in (None, cells):
            expected = f'{cells}, the number of cells in the header'
            raise LavaError(f'number of values in {shown}', numbers, expected)
        yield source


def _check_database(field: str, path: str, file: Content) -> None:
    """Raise LavaError for a database with views, and for a damaged one, which GDAL may read."""
    with opening():
        import sqlite3

    place = f'file:/dev/fd/{file.descriptor}?immutable=1'
    with (
        refusing(field, path, 'an undamaged GeoPackage'),
        opening(), closing(sqlite3.connect(place, uri=True)) as database,
    ):
        found, count, size = (
            database.execute(f'PRAGMA {name}').fetchone()[0]
            for name in ('quick_check(1)', 'page_count', 'page_size')
        )
        if found == 'ok' and count * size > len(file.data):
            found = f'{len(file.data)} of {count * size} bytes'
        if found != 'ok':
            raise ValueError(found)
        check_tables(field, [name for (name,) in database.execute(VIEWS)])


def _check_size(field: str, name: str, found: int, source: Dataset) -> None:
    """Raise LavaError for a truncated uncompressed grid, whose missing values GDAL reads as 0."""
    needed = source.width * source.height * source.itemsize
    if name.lower().endswith('.flt'):
        # GDAL derives the type from the size
        needed = 4 * source.width * source.height
    if found < needed:
        raise LavaError(field, f'{found} bytes in {name}', f'{needed} bytes, as its header states')


def _check_header(field: str, name: str, lines: Sequence[tuple[bytes, bytes]]) -> None:
    """Raise LavaError for an incomplete header of an ESRI grid, and warn of unknown lines."""
    names, others = set(), []
    for line, value in lines:
        label = line.decode(errors='replace')
        pattern, expected = EXPECTED_LINES.get(label.lower(), (None, ''))
        if pattern is None:
            others.append(label)
        elif not pattern.fullmatch(value) or label.lower() in names:
            expected = 'only once' if label.lower() in names else expected
            text = value.decode(errors='replace')
            raise LavaError(f'{field}, {label} of {name}', text, expected)
        names.add(label.lower())
    warn_of_unknown(name, 'lines', others)
    for groups in POSITION_LINES:
        found = [item for group in groups for item in group if item in names]
        if tuple(found) in groups:
            continue
        known = ', or '.join(' and '.join(group) for group in groups)
        lacking = next((group for group in groups if set(found) < set(group)), ())
        absent = next((item for item in lacking if item not in found), None)
        raise LavaError(
            f'{field}, {absent or found[-1]} of {name}', None if absent else ' and '.join(found),
            f'a line of the header: {known}',
        )


def _count_numbers(field: str, name: str, data: memoryview) -> int:
    """Count the values of a text grid; raise LavaError for text, which GDAL reads as a number."""
    begin, known, lines = 0, NUMBER, []
    if surfer := _SURFER.match(data):
        begin = surfer.end()
    while line := HEADER.match(data, begin):
        begin = line.end()
        lines.append((bytes(line[1]), bytes(line[2])))
        if lines[-1][0].lower() == b'nodata_value' and lines[-1][1].lower() in (b'nan', b'null'):
            known += b'|' + lines[-1][1]
    if not surfer:
        _check_header(field, name, lines)
    other = re.compile(rb'(?<!\S)(?!(?:' + known + rb')(?!\S))\S+', re.IGNORECASE)
    if found := other.search(data, begin):
        before = data[: found.start()].tobytes().split(b'\n')
        place = f'line {len(before)}, column {len(before[-1]) + 1} of {name}'
        text = bytes(found[0]).decode(errors='replace')
        expected = 'a number with a decimal point; NODATA_value for cells without data'
        raise LavaError(place, text, expected)
    count = 0
    for at in range(begin, len(data), _PART):
        # a number begins after a space
        count += data[at - 1 : at + _PART].tobytes().translate(_MARKS).count(b' x')
    return count
