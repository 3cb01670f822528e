# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Reader of untrusted rasters, which chooses the GDAL driver by the contents of the file."""

from collections.abc import Callable, Iterator, Sequence
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

from lava_ros.errors import LavaError, refusing
from lava_ros.files import MAX_CELLS, open_input, warn_of_unknown
from lava_ros.files.optional import require


class RasterFormat(NamedTuple):
    """A raster format that can be read.

    Attributes:
        name: Name of the format, for people.
        driver: Name of the GDAL driver.
        suffixes: Usual suffixes of file names.
        head: Pattern of the first bytes of such files.
        needs_suffix: True if the first bytes of such files do not identify them.
        notes: Conditions and limits, for people.
        written: Outputs in this format, for people; empty if it is only read.
    """

    name: str
    driver: str
    suffixes: tuple[str, ...]
    head: re.Pattern[bytes]
    needs_suffix: bool = False
    notes: str = ''
    written: str = ''


#: A line of an ESRI ASCII grid's header.
_HEADER = re.compile(
    rb'\s*(ncols|nrows|[xy]ll(?:corner|center)|cellsize|d[xy]|nodata_value|byteorder)\s+(\S+)',
    re.IGNORECASE,
)

_NUMBER = rb'[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?'

#: Pattern and description of the value of each line in the header of an ESRI grid.
_LINES = {
    name: (re.compile(pattern, re.IGNORECASE), words)
    for names, pattern, words in (
        ('nrows ncols nbands nbits skipbytes bandrowbytes totalrowbytes bandgapbytes', rb'\d+',
         'a whole number'),
        ('ulxmap ulymap xllcorner yllcorner xllcenter yllcenter cellsize xdim ydim dx dy '
         'min_value max_value', _NUMBER, 'a number'),
        ('nodata nodata_value', _NUMBER + rb'|nan|null', 'a number or nan'),
        ('byteorder', rb'[im]|[lm]sbfirst', 'I or M'),
        ('layout', rb'bi[lp]|bsq', 'BIL, BIP or BSQ'),
        ('pixeltype', rb'(un)?signedint|float', 'SIGNEDINT, UNSIGNEDINT or FLOAT'),
    )
    for name in names.split()
}

#: Groups of lines of which one is required: without them GDAL assumes corners at 0 and sides of 1.
_PLACE = (
    ('ulxmap', 'xllcorner', 'xllcenter'), ('ulymap', 'yllcorner', 'yllcenter'),
    ('xdim', 'cellsize', 'dx'), ('ydim', 'cellsize', 'dy'),
)

#: Raster formats in the order of detection.
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
        'NetCDF classic', 'netCDF', ('.nc', '.grd'), re.compile(rb'CDF[\1\2\5]'),
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
        # the first byte of an elevation below 9216 m, which text of another format does not have
        'SRTM', 'SRTMHGT', ('.hgt',), re.compile(rb'[\0-\x23\x80\xfe\xff]'), needs_suffix=True,
        notes='named after its south-west corner, such as `N37E015.hgt`',
    ),
    RasterFormat(
        'ESRI binary grid', 'EHdr', ('.flt', '.bil'), re.compile(b''), needs_suffix=True,
        notes='with its `.hdr` file',
    ),
    RasterFormat(
        'ESRI ASCII grid', 'AAIGrid', ('.asc', '.txt'), _HEADER,
        notes='decimal points only; with a `.prj` file or an EPSG code',
    ),
)

#: Formats of pictures, which need not be georeferenced.
PICTURES = (
    *(item for item in FORMATS if item.driver == 'GTiff'),
    RasterFormat('PNG', 'PNG', ('.png',), re.compile(rb'\x89PNG')),
    RasterFormat('JPEG', 'JPEG', ('.jpg', '.jpeg'), re.compile(rb'\xff\xd8\xff')),
)

#: Drivers of the source files of a virtual raster.
_TILES = ('GTiff', 'HFA', 'SRTMHGT')

#: Allowed elements of a virtual raster: ``SourceFilename``, and those without files or code.
_VIRTUAL = {
    'VRTDataset', 'SRS', 'GeoTransform', 'Metadata', 'MDI', 'BlockXSize', 'BlockYSize', 'MaskBand',
    'VRTRasterBand', 'NoDataValue', 'HideNoDataValue', 'ColorInterp', 'Description', 'UnitType',
    'Offset', 'Scale', 'SimpleSource', 'ComplexSource', 'SourceFilename', 'SourceBand',
    'SourceProperties', 'SrcRect', 'DstRect', 'NODATA', 'ScaleOffset', 'ScaleRatio',
}

#: Definitions of a coordinate system for which GDAL opens no file and no URL.
_SYSTEM = re.compile(r'\s*(EPSG:\d+\s*$|[A-Za-z_]+\[)')

#: Maximum sizes of a virtual raster, and of the part of a header that is read [bytes].
MAX_VIRTUAL, MAX_HEADER = 1 << 22, 1 << 16

#: Drivers of text grids, and the header of a Surfer grid: shape, and ranges of x, y and z.
_TEXT = ('AAIGrid', 'GSAG')
_SURFER = re.compile(rb'DSAA(?:\s+[-+.\deE]+){8}')


@contextmanager
def open_raster(
    field: str, path: str | Path, formats: Sequence[RasterFormat] = FORMATS
) -> Iterator[Any]:
    """Open a raster for reading, as ``rasterio.open`` does; it need not be georeferenced.

    Only the drivers of ``formats`` are used, since others may open files and URLs to which a file
    refers.

    Raises:
        LavaError: If the file cannot be read, has an unknown format, several rasters, too many
            cells, missing data, references to other folders, or text among its values; or if
            rasterio is not installed.
    """
    require('rasterio', field, str(path))
    from rasterio.errors import CRSError, RasterioError

    # an absolute path cannot be a URL
    place = Path(path).absolute()
    # an error of GDAL may contain bytes of a damaged file
    kinds = (CRSError, RasterioError, OSError, UnicodeDecodeError)
    with refusing(field, str(path), 'a raster that GDAL can read', *kinds):
        kind = _format_of(field, place, formats)
        if kind.driver == 'VRT':
            _check_virtual(field, place)
        with _opened(field, place, kind) as source:
            yield source


def _format_of(
    field: str, path: Path, formats: Sequence[RasterFormat] = FORMATS
) -> RasterFormat:
    with open_input(path) as file:
        head = file.read(1024)
    for item in formats:
        if item.head.match(head) and not (
            item.needs_suffix and path.suffix.lower() not in item.suffixes
        ):
            return item
    expected = f'a raster of a known format: {", ".join(item.name for item in formats)} '
    expected += '(gdal_translate turns other formats into GeoTIFF)'
    raise LavaError(field, str(path), expected)


@contextmanager
def _opened(field: str, path: Path, kind: RasterFormat) -> Iterator[Any]:
    """Open a raster with one driver, and make the checks that GDAL does not make."""
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning

    for beside in (Path(f'{path}.msk'), Path(f'{path}.ovr')):
        # GDAL opens these with any driver
        if beside.exists() and _format_of(field, beside).driver != 'GTiff':
            raise LavaError(field, str(beside), 'a mask or overviews in a GeoTIFF')
    if kind.driver == 'GPKG':
        _check_database(field, path)
    numbers = _count_numbers(field, path) if kind.driver in _TEXT else None
    with warnings.catch_warnings(), _without_undecodable_errors():
        warnings.simplefilter('ignore', NotGeoreferencedWarning)
        # the declared no-data value may be beyond float32
        warnings.filterwarnings('ignore', 'overflow encountered in cast', RuntimeWarning)
        with rasterio.open(path, driver=kind.driver) as source:
            cells = source.width * source.height
            if cells > MAX_CELLS:
                shown = f'{source.height} x {source.width} cells'
                expected = f'at most {MAX_CELLS} (gdal_translate -srcwin extracts a part)'
                raise LavaError(f'size of {path.name}', shown, expected)
            if not source.count:
                names = ', '.join(name.rpartition(':')[2] for name in source.subdatasets)
                expected = f'a file with one raster, not {names or "none"} '
                expected += '(gdal_translate extracts one)'
                raise LavaError(field, str(path), expected)
            if any(Path(name).absolute().parent != path.parent for name in source.files):
                raise LavaError(field, str(path), 'a raster without files in other folders')
            if kind.driver == 'EHdr' or kind.name == 'NetCDF classic':
                _check_size(field, path, source)
            if kind.driver == 'EHdr':
                (header,) = (Path(name) for name in source.files if name.lower().endswith('.hdr'))
                text = header.read_bytes()[:MAX_HEADER]
                lines = re.findall(rb'^\s*(\S+)[ \t]*(\S*)', text, re.MULTILINE)
                _check_header(field, header, lines)
            if numbers not in (None, cells):
                expected = f'{cells}, as many as the header has cells'
                raise LavaError(f'number of values in {path.name}', numbers, expected)
            yield source


@contextmanager
def _without_undecodable_errors() -> Iterator[None]:
    """Prevent Python from printing GDAL errors that contain bytes which are not text."""
    hooks = sys.excepthook, sys.unraisablehook

    def report(hook: Callable[..., None], error: object, *found: Any) -> None:
        if not isinstance(error, UnicodeDecodeError):
            hook(*found)

    sys.excepthook = lambda *found: report(hooks[0], found[1], *found)
    sys.unraisablehook = lambda found: report(hooks[1], found.exc_value, found)
    try:
        yield
    finally:
        sys.excepthook, sys.unraisablehook = hooks


def _check_virtual(field: str, path: Path) -> None:
    """Raise LavaError for a virtual raster with sources other than rasters in its folder."""
    with open_input(path) as file:
        text = file.read(MAX_VIRTUAL + 1)
    with refusing(field, str(path), 'a readable virtual raster'):
        if len(text) > MAX_VIRTUAL or b'<!' in text:
            raise ValueError(f'at most {MAX_VIRTUAL} bytes, and no document type')
        elements = list(ElementTree.fromstring(text).iter())
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
    """Raise LavaError for a damaged database, whose missing values GDAL reads as 0."""
    with (
        refusing(field, str(path), 'an undamaged GeoPackage'),
        closing(sqlite3.connect(f'{path.as_uri()}?immutable=1', uri=True)) as database,
    ):
        found, count, size = (
            database.execute(f'PRAGMA {name}').fetchone()[0]
            for name in ('quick_check(1)', 'page_count', 'page_size')
        )
        if found == 'ok' and count * size > path.stat().st_size:
            found = f'{path.stat().st_size} of {count * size} bytes'
        if found != 'ok':
            raise ValueError(found)


def _check_size(field: str, path: Path, source: Any) -> None:
    """Raise LavaError for a truncated uncompressed grid, whose missing values GDAL reads as 0."""
    needed = source.width * source.height * sum(np.dtype(kind).itemsize for kind in source.dtypes)
    found = path.stat().st_size
    if path.suffix.lower() == '.flt':
        # GDAL derives the type from the size
        needed = 4 * source.width * source.height
    if found < needed:
        raise LavaError(field, f'{found} bytes in {path.name}', f'{needed} bytes, as its header')


def _check_header(field: str, path: Path, lines: Sequence[tuple[bytes, bytes]]) -> None:
    """Raise LavaError for an incomplete header of an ESRI grid, and warn of unknown lines."""
    names, others = set(), []
    for line, value in lines:
        label = line.decode(errors='replace')
        pattern, expected = _LINES.get(label.lower(), (None, ''))
        if pattern is None:
            others.append(label)
        elif not pattern.fullmatch(value) or label.lower() in names:
            expected = 'only once' if label.lower() in names else expected
            text = value.decode(errors='replace')
            raise LavaError(f'{field}, {label} of {path.name}', text, expected)
        names.add(label.lower())
    warn_of_unknown(path.name, 'lines', others)
    for group in _PLACE:
        if len(found := names.intersection(group)) != 1:
            expected = f'a line of the header: one of {", ".join(group)}'
            shown = ' and '.join(sorted(found)) or None
            raise LavaError(f'{field}, {group[-1]} of {path.name}', shown, expected)


def _count_numbers(field: str, path: Path) -> int:
    """Count the values of a text grid; raise LavaError for text, which GDAL reads as a number."""
    with open_input(path) as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        begin, known, lines = 0, _NUMBER, []
        if surfer := _SURFER.match(data):
            begin = surfer.end()
        while line := _HEADER.match(data, begin):
            begin = line.end()
            lines.append((line[1], line[2]))
            if line[1].lower() == b'nodata_value' and line[2].lower() in (b'nan', b'null'):
                known += b'|' + line[2]
        if not surfer:
            _check_header(field, path, lines)
        other = re.compile(rb'(?<!\S)(?!(?:' + known + rb')(?!\S))\S+', re.IGNORECASE)
        if found := other.search(data, begin):
            before = data[: found.start()].split(b'\n')
            place = f'line {len(before)}, column {len(before[-1]) + 1} of {path.name}'
            text = found[0].decode(errors='replace')
            expected = 'a number with a decimal point; NODATA_value for cells without data'
            raise LavaError(place, text, expected)
        count = 0
        for at in range(begin, len(data), 1 << 24):
            is_text = np.frombuffer(data[at - 1 : at + (1 << 24)], np.uint8) > ord(' ')
            count += int(np.count_nonzero(is_text[1:] & ~is_text[:-1]))
        return count
