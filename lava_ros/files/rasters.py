# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Opens rasters from anywhere with the GDAL driver that the content of the file calls for."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
import mmap
from pathlib import Path
import re
import sqlite3
import sys
from typing import Any, NamedTuple
import warnings
from xml.etree import ElementTree

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.files import MOST_CELLS, open_input
from lava_ros.files.optional import require


class RasterFormat(NamedTuple):
    """A raster format that is read.

    Attributes:
        name: Name of the format, for people.
        driver: Name of the GDAL driver.
        suffixes: Usual ends of the names of such files.
        head: Pattern that the first bytes of such files match.
        needs_suffix: True if the first bytes of such files do not identify them.
        is_plain: True if such files hold each value uncompressed, as bytes.
        notes: Conditions and limits, for people.
        written: Outputs in this format, for people; empty if it is only read.
    """

    name: str
    driver: str
    suffixes: tuple[str, ...]
    head: re.Pattern[bytes]
    needs_suffix: bool = False
    is_plain: bool = False
    notes: str = ''
    written: str = ''


#: A line of an ESRI ASCII grid's header.
_HEADER = re.compile(
    rb'\s*(ncols|nrows|[xy]ll(?:corner|center)|cellsize|d[xy]|nodata_value|byteorder)\s+(\S+)',
    re.IGNORECASE,
)

#: Every raster format that GDAL may open, in the order in which they are looked for.
FORMATS = (
    RasterFormat(
        'GDAL virtual raster', 'VRT', ('.vrt',), re.compile(rb'[^\0]*<VRTDataset'),
        notes='mosaic of GeoTIFF, Erdas Imagine or SRTM files of the same folder',
    ),
    RasterFormat(
        'GeoTIFF', 'GTiff', ('.tif', '.tiff'), re.compile(rb'II\*\0|MM\0\*|II\+\0|MM\0\+'),
        notes='also BigTIFF and cloud-optimised (COG)',
        written='maps of `lava export`, `ensemble`, `hindcast` and `barrier`, as COG',
    ),
    RasterFormat('Erdas Imagine', 'HFA', ('.img',), re.compile(rb'EHFA_HEADER_TAG')),
    RasterFormat(
        'NetCDF classic', 'netCDF', ('.nc', '.grd'), re.compile(rb'CDF[\1\2\5]'), is_plain=True,
        notes='a single gridded variable', written='`--formats nc`: all maps, CF conventions',
    ),
    RasterFormat(
        'NetCDF-4', 'netCDF', ('.nc', '.grd'), re.compile(rb'\x89HDF\r\n\x1a\n'),
        notes='a single gridded variable, as GMT writes it',
    ),
    RasterFormat(
        'GeoPackage', 'GPKG', ('.gpkg',), re.compile(rb'SQLite format 3\0'),
        notes='a single raster table',
    ),
    RasterFormat('Surfer 6 text grid', 'GSAG', ('.grd',), re.compile(rb'DSAA')),
    RasterFormat('Surfer 6 binary grid', 'GSBG', ('.grd',), re.compile(rb'DSBB')),
    RasterFormat('Surfer 7 binary grid', 'GS7BG', ('.grd',), re.compile(rb'DSRB')),
    RasterFormat(
        # a height below 9216 m: the text of another format in its place calls another driver
        'SRTM', 'SRTMHGT', ('.hgt',), re.compile(rb'[\0-\x23\x80\xfe\xff]'), needs_suffix=True,
        notes='named after its south-west corner, such as `N37E015.hgt`',
    ),
    RasterFormat(
        'ESRI binary grid', 'EHdr', ('.flt', '.bil'), re.compile(b''), needs_suffix=True,
        is_plain=True, notes='with its `.hdr` file',
    ),
    RasterFormat(
        'ESRI ASCII grid', 'AAIGrid', ('.asc', '.txt'), _HEADER,
        notes='decimal points only; with a `.prj` file or an EPSG code',
    ),
)

#: Drivers of the files of which a virtual raster may consist.
_TILES = ('GTiff', 'HFA', 'SRTMHGT')

#: Elements of a virtual raster that name no file, except ``SourceFilename``, and run no code.
_VIRTUAL = {
    'VRTDataset', 'SRS', 'GeoTransform', 'Metadata', 'MDI', 'BlockXSize', 'BlockYSize', 'MaskBand',
    'VRTRasterBand', 'NoDataValue', 'HideNoDataValue', 'ColorInterp', 'Description', 'UnitType',
    'Offset', 'Scale', 'SimpleSource', 'ComplexSource', 'SourceFilename', 'SourceBand',
    'SourceProperties', 'SrcRect', 'DstRect', 'NODATA', 'ScaleOffset', 'ScaleRatio',
}

#: Definitions of a coordinate system that are looked up in no file and at no address.
_SYSTEM = re.compile(r'\s*(EPSG:\d+\s*$|[A-Za-z_]+\[)')

#: Largest virtual raster [bytes].
MAX_VIRTUAL = 1 << 22

#: Drivers of text grids, and the header of Surfer's: sides, and ranges of x, y and z.
_TEXT = ('AAIGrid', 'GSAG')
_SURFER = re.compile(rb'DSAA(?:\s+[-+.\deE]+){8}')

_NUMBER = rb'[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?'

#: Values of ``NODATA_value`` that are not numbers and that GDAL accepts.
_NO_DATA = (b'nan', b'null')


@contextmanager
def opened_raster(field: str, path: str | Path) -> Iterator[Any]:
    """Open a raster for reading, as ``rasterio.open`` does; it need not be georeferenced.

    Only the drivers of ``FORMATS`` are used: some of the others open what a file refers to, also
    over a network.

    Raises:
        LavaError: If the file cannot be opened or read, is of another format, holds several
            rasters, has too many cells, is truncated, refers to files in other folders, or has
            text among its values; or if rasterio is not installed.
    """
    require('rasterio', field, str(path))
    from rasterio.errors import RasterioError

    # an absolute path is no URL
    place = Path(path).absolute()
    try:
        kind = _format_of(field, place)
        if kind.driver == 'VRT':
            _check_virtual(field, place)
        with _opened(field, place, kind) as source:
            yield source
    # what GDAL says of a damaged file may contain bytes of it
    except (RasterioError, OSError, UnicodeDecodeError) as error:
        raise LavaError(field, str(path), f'a raster that GDAL can read ({error})') from error


def _format_of(field: str, path: Path) -> RasterFormat:
    """Return the format of a file."""
    with open_input(path) as file:
        head = file.read(1024)
    for item in FORMATS:
        if item.head.match(head) and not (
            item.needs_suffix and path.suffix.lower() not in item.suffixes
        ):
            return item
    right = f'a raster of a known format: {", ".join(item.name for item in FORMATS)} '
    right += '(gdal_translate turns other formats into GeoTIFF)'
    raise LavaError(field, str(path), right)


@contextmanager
def _opened(field: str, path: Path, kind: RasterFormat) -> Iterator[Any]:
    """Open a raster with one driver, and check what GDAL does not."""
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning

    for beside in (Path(f'{path}.msk'), Path(f'{path}.ovr')):
        # GDAL opens these with any driver
        if beside.exists() and _format_of(field, beside).driver != 'GTiff':
            raise LavaError(field, str(beside), 'a mask or overviews in a GeoTIFF')
    if kind.driver == 'GPKG':
        _check_database(field, path)
    numbers = _count_numbers(path) if kind.driver in _TEXT else None
    with warnings.catch_warnings(), _without_undecodable_errors():
        warnings.simplefilter('ignore', NotGeoreferencedWarning)
        with rasterio.open(path, driver=kind.driver) as source:
            if source.height * source.width > MOST_CELLS:
                shown = f'{source.height} x {source.width} cells'
                right = f'at most {MOST_CELLS} (gdal_translate -srcwin takes a part)'
                raise LavaError(f'size of {path.name}', shown, right)
            if not source.count:
                names = ', '.join(name.rpartition(':')[2] for name in source.subdatasets)
                right = f'a file with one raster, not {names or "none"} (gdal_translate takes one)'
                raise LavaError(field, str(path), right)
            if any(Path(name).absolute().parent != path.parent for name in source.files):
                raise LavaError(field, str(path), 'a raster without files in other folders')
            if kind.is_plain:
                _check_size(field, path, source)
            cells = source.width * source.height
            if numbers not in (None, cells):
                right = f'{cells}, as many as the header has cells'
                raise LavaError(f'number of values in {path.name}', numbers, right)
            yield source


@contextmanager
def _without_undecodable_errors() -> Iterator[None]:
    """Keep Python from printing errors of GDAL that contain other bytes of a file than text."""
    hooks = sys.excepthook, sys.unraisablehook

    def report(kind: Any, error: Any, traceback: Any) -> None:
        if not isinstance(error, UnicodeDecodeError):
            hooks[0](kind, error, traceback)

    def report_ignored(error: Any) -> None:
        if not isinstance(error.exc_value, UnicodeDecodeError):
            hooks[1](error)

    sys.excepthook, sys.unraisablehook = report, report_ignored
    try:
        yield
    finally:
        sys.excepthook, sys.unraisablehook = hooks


def _check_virtual(field: str, path: Path) -> None:
    """Refuse a virtual raster of anything but rasters in its folder."""
    with open_input(path) as file:
        text = file.read(MAX_VIRTUAL + 1)
    try:
        if len(text) > MAX_VIRTUAL or b'<!' in text:
            raise ValueError(f'at most {MAX_VIRTUAL} bytes, and no document type')
        elements = list(ElementTree.fromstring(text).iter())
    except (ElementTree.ParseError, ValueError) as error:
        raise LavaError(field, str(path), f'a readable virtual raster ({error})') from error
    advice = 'of the same folder (gdal_translate makes a GeoTIFF of the virtual raster)'
    for item in elements:
        name, value = f'{item.tag} of {path.name}', (item.text or '').strip()
        if item.tag not in _VIRTUAL or 'subClass' in item.attrib:
            raise LavaError(name, item.get('subClass', value), f'a mosaic of files {advice}')
        if item.tag == 'SRS' and value and not _SYSTEM.match(value):
            raise LavaError(name, value, 'an EPSG code or WKT')
        if item.tag == 'SourceFilename':
            if item.get('relativeToVRT') != '1' or not re.fullmatch(r'[^/\\:<>]+', value):
                raise LavaError(name, value, f'the name of a file {advice}')
            source = path.with_name(value)
            kind = _format_of(field, source)
            if kind.driver not in _TILES:
                raise LavaError(name, value, f'a {" or ".join(_TILES)} file {advice}')
            with _opened(field, source, kind):
                pass
    if not any(item.tag == 'SourceFilename' for item in elements):
        raise LavaError(field, str(path), f'a virtual raster with files {advice}')


def _check_database(field: str, path: Path) -> None:
    """Refuse a damaged database, whose missing values GDAL reads as 0."""
    try:
        with closing(sqlite3.connect(f'{path.as_uri()}?immutable=1', uri=True)) as database:
            (found,) = database.execute('PRAGMA quick_check(1)').fetchone()
            sizes = [
                database.execute(f'PRAGMA page_{name}').fetchone()[0] for name in ('count', 'size')
            ]
        if found == 'ok' and sizes[0] * sizes[1] > path.stat().st_size:
            found = f'{path.stat().st_size} of {sizes[0] * sizes[1]} bytes'
    except (sqlite3.Error, UnicodeDecodeError) as error:
        found = str(error)
    if found != 'ok':
        raise LavaError(field, str(path), f'an undamaged GeoPackage ({found})')


def _check_size(field: str, path: Path, source: Any) -> None:
    """Refuse a truncated binary grid, whose missing values GDAL reads as 0."""
    needed = source.width * source.height * sum(np.dtype(kind).itemsize for kind in source.dtypes)
    found = path.stat().st_size
    if path.suffix.lower() == '.flt':
        # GDAL guesses the type from the size
        needed = 4 * source.width * source.height
    if found < needed:
        raise LavaError(field, f'{found} bytes in {path.name}', f'{needed} bytes, as its header')


def _count_numbers(path: Path) -> int:
    """Count the values of a text grid; LavaError for text, which GDAL reads as 0 or in part."""
    with open_input(path) as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        begin, known = 0, _NUMBER
        if surfer := _SURFER.match(data):
            begin = surfer.end()
        while line := _HEADER.match(data, begin):
            begin = line.end()
            if line[1].lower() == b'nodata_value':
                declared = line[2].lower()
                if declared in _NO_DATA:
                    known += b'|' + declared
                elif not re.fullmatch(_NUMBER, declared):
                    text = line[2].decode(errors='replace')
                    raise LavaError(f'NODATA_value of {path.name}', text, 'a number or nan')
        other = re.compile(rb'(?<!\S)(?!(?:' + known + rb')(?!\S))\S+', re.IGNORECASE)
        if found := other.search(data, begin):
            before = data[: found.start()].split(b'\n')
            place = f'line {len(before)}, column {len(before[-1]) + 1} of {path.name}'
            text = found[0].decode(errors='replace')
            right = 'a number with a decimal point; of cells without data, that of NODATA_value'
            raise LavaError(place, text, right)
        count = 0
        for at in range(begin, len(data), 1 << 24):
            is_text = np.frombuffer(data[at - 1 : at + (1 << 24)], np.uint8) > ord(' ')
            count += int(np.count_nonzero(is_text[1:] & ~is_text[:-1]))
        return count
