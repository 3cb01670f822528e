# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Reading of rasters with the C functions of GDAL.

rasterio would give the same result, but importing it and NumPy takes three times as long as
starting the reader process without them.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import ctypes
from ctypes import byref, c_double, c_int, POINTER
from typing import Any

from lava_ros.files.reader.gdal import Gdal, HANDLE, names_in_c, TEXT, TEXTS

#: Types of cells by their number in GDAL: the name in NumPy, complex integers as complex numbers,
#: and the size [bytes].
TYPES = {
    1: ('uint8', 1), 2: ('uint16', 2), 3: ('int16', 2), 4: ('uint32', 4), 5: ('int32', 4),
    6: ('float32', 4), 7: ('float64', 8), 8: ('complex64', 4), 9: ('complex64', 8),
    10: ('complex64', 8), 11: ('complex128', 16), 12: ('uint64', 8), 13: ('int64', 8),
    14: ('int8', 1), 15: ('float16', 2), 16: ('complex64', 4),
}

#: Number in GDAL and size [bytes] of each type that can be read.
NUMBERS = {
    name: (number, size) for number, (name, size) in TYPES.items() if 'complex' not in name
}

#: Flags of ``GDALOpenEx``: a raster, and error messages; a valid mask; classes of messages.
_OPEN, _ALL_VALID, _WARNING, _FAILURE = 0x42, 1, 2, 3


class _Colour(ctypes.Structure):
    """An entry of a palette."""

    _fields_ = [(name, ctypes.c_short) for name in ('red', 'green', 'blue', 'alpha')]


_HANDLER = ctypes.CFUNCTYPE(None, c_int, c_int, TEXT)
_SIZES = [c_int] * 4

_FUNCTIONS = {
    'CPLSetErrorHandler': (HANDLE, _HANDLER),
    'GDALOpenEx': (HANDLE, TEXT, ctypes.c_uint, TEXTS, TEXTS, TEXTS),
    'GDALClose': (None, HANDLE),
    'GDALGetRasterXSize': (c_int, HANDLE),
    'GDALGetRasterYSize': (c_int, HANDLE),
    'GDALGetRasterCount': (c_int, HANDLE),
    'GDALGetMetadata': (TEXTS, HANDLE, TEXT),
    'GDALGetGeoTransform': (c_int, HANDLE, POINTER(c_double)),
    'GDALGetProjectionRef': (TEXT, HANDLE),
    'GDALGetRasterBand': (HANDLE, HANDLE, c_int),
    'GDALGetRasterDataType': (c_int, HANDLE),
    'GDALGetRasterScale': (c_double, HANDLE, POINTER(c_int)),
    'GDALGetRasterOffset': (c_double, HANDLE, POINTER(c_int)),
    'GDALGetRasterUnitType': (TEXT, HANDLE),
    'GDALGetRasterColorInterpretation': (c_int, HANDLE),
    'GDALGetColorInterpretationName': (TEXT, c_int),
    'GDALGetRasterColorTable': (HANDLE, HANDLE),
    'GDALGetColorEntryCount': (c_int, HANDLE),
    'GDALGetColorEntry': (POINTER(_Colour), HANDLE, c_int),
    'GDALGetMaskFlags': (c_int, HANDLE),
    'GDALGetMaskBand': (HANDLE, HANDLE),
    'GDALRasterIO': (
        c_int, HANDLE, c_int, *_SIZES, HANDLE, c_int, c_int, c_int, c_int, c_int,
    ),
    'GDALDatasetRasterIO': (
        c_int, HANDLE, c_int, *_SIZES, HANDLE, c_int, c_int, c_int, c_int, POINTER(c_int), c_int,
        c_int, c_int,
    ),
    'OSRNewSpatialReference': (HANDLE, TEXT),
    'OSRImportFromEPSG': (c_int, HANDLE, c_int),
    'OSRDestroySpatialReference': (None, HANDLE),
}


class RasterGdal(Gdal):
    """The GDAL of rasterio.

    Attributes:
        warnings: Warnings since the last ``opened``.
    """

    def __init__(self) -> None:
        """Load the library, and open the files that coordinate systems need."""
        super().__init__('rasterio', '_io')
        self.declare(_FUNCTIONS)
        self.warnings: list[str] = []
        self._failure = ''
        # keep a reference, because GDAL keeps none
        self._handler = _HANDLER(self._receive)
        self.CPLSetErrorHandler(self._handler)
        system = self.OSRNewSpatialReference(None)
        self.OSRImportFromEPSG(system, 32633)
        self.OSRDestroySpatialReference(system)

    @contextmanager
    def opened(self, path: str, driver: str) -> Iterator['Dataset']:
        """Open a raster with one driver.

        Raises:
            OSError: If GDAL cannot open it.
        """
        self._failure = ''
        drivers = names_in_c([driver.encode()])
        handle = self.GDALOpenEx(path.encode(), _OPEN, drivers, None, None)
        if not handle:
            raise OSError(self._failure or f'{path} is not a file of {driver}')
        try:
            yield Dataset(self, handle)
        finally:
            self.GDALClose(handle)

    def check(self, function: Callable[..., int], *arguments: Any) -> None:
        """Call a function that returns 0 for success.

        Raises:
            OSError: If it fails.
        """
        self._failure = ''
        if function(*arguments):
            raise OSError(self._failure or f'{function.__name__} failed')

    def _receive(self, level: int, _: int, message: bytes) -> None:
        text = message.decode(errors='replace').replace('`', "'")
        if level == _WARNING:
            self.warnings.append(text)
        elif level >= _FAILURE:
            self._failure = text


class Dataset:
    """An open raster.

    Attributes:
        width: Number of columns.
        height: Number of rows.
        count: Number of bands.
        dtypes: Types of the bands.
    """

    def __init__(self, gdal: RasterGdal, handle: int) -> None:
        """Describe a raster that GDAL has opened."""
        self._gdal, self._handle = gdal, handle
        self.width: int = gdal.GDALGetRasterXSize(handle)
        self.height: int = gdal.GDALGetRasterYSize(handle)
        self.count: int = gdal.GDALGetRasterCount(handle)
        self._bands = [gdal.GDALGetRasterBand(handle, band + 1) for band in range(self.count)]
        self.dtypes = [TYPES[gdal.GDALGetRasterDataType(band)][0] for band in self._bands]

    @property
    def itemsize(self) -> int:
        """Size of a cell of all bands [bytes]."""
        return sum(TYPES[self._gdal.GDALGetRasterDataType(band)][1] for band in self._bands)

    def tags(self, domain: bytes | None = None) -> dict[str, str]:
        """Return the metadata of a domain."""
        found = self._gdal.GDALGetMetadata(self._handle, domain) or [None]
        result, index = {}, 0
        while text := found[index]:
            key, _, value = text.decode(errors='replace').partition('=')
            result[key] = value
            index += 1
        return result

    @property
    def subdatasets(self) -> list[str]:
        """Names of the rasters in a file that contains several."""
        tags = self.tags(b'SUBDATASETS')
        return [value.replace('"', '') for key, value in tags.items() if key.endswith('_NAME')]

    def properties(self) -> dict[str, Any]:
        """Return the properties of ``RasterContent``, with the coordinate system as text."""
        gdal, place = self._gdal, (c_double * 6)()
        # the identity without a position
        gdal.GDALGetGeoTransform(self._handle, place)
        x, a, b, y, d, e = place
        meanings = [gdal.GDALGetRasterColorInterpretation(band) for band in self._bands]
        colours = [_text(gdal.GDALGetColorInterpretationName(item)).lower() for item in meanings]
        return {
            'count': self.count, 'shape': (self.height, self.width), 'dtypes': self.dtypes,
            'scales': [gdal.GDALGetRasterScale(band, None) for band in self._bands],
            'offsets': [gdal.GDALGetRasterOffset(band, None) for band in self._bands],
            'units': [_text(gdal.GDALGetRasterUnitType(band)) or None for band in self._bands],
            'descriptions': [_text(gdal.GDALGetDescription(band)) or None for band in self._bands],
            'tags': self.tags(), 'place': (a, b, x, d, e, y),
            'system': _text(gdal.GDALGetProjectionRef(self._handle)) or None,
            'colours': colours, 'palette': self._palette() if colours[0] == 'palette' else [],
        }

    def _palette(self) -> list[tuple[int, tuple[int, ...]]]:
        gdal, table = self._gdal, self._gdal.GDALGetRasterColorTable(self._bands[0])
        entries = [
            gdal.GDALGetColorEntry(table, number).contents
            for number in range(gdal.GDALGetColorEntryCount(table) if table else 0)
        ]
        return [
            (number, (item.red, item.green, item.blue, item.alpha))
            for number, item in enumerate(entries)
        ]

    def has_missing(self, count: int) -> bool:
        """Return True if one of the first bands may have cells without data."""
        get = self._gdal.GDALGetMaskFlags
        return not all(get(band) & _ALL_VALID for band in self._bands[:count])

    def read(self, memory: Any, kind: str, shape: tuple[int, int, int]) -> None:
        """Read the first bands, thinned to a shape, as numbers of a type.

        Raises:
            OSError: If GDAL cannot read them.
        """
        count, rows, columns = shape
        bands = (c_int * count)(*range(1, count + 1))
        self._gdal.check(
            self._gdal.GDALDatasetRasterIO, self._handle, 0, 0, 0, self.width, self.height, memory,
            columns, rows, NUMBERS[kind][0], count, bands, 0, 0, 0,
        )

    def read_masks(self, memory: Any, shape: tuple[int, int, int]) -> None:
        """Read which cells of the first bands have data: uint8, 0 without data.

        Raises:
            OSError: If GDAL cannot read them.
        """
        count, rows, columns = shape
        for band in range(count):
            mask = self._gdal.GDALGetMaskBand(self._bands[band])
            place = byref(memory, band * rows * columns)
            self._gdal.check(
                self._gdal.GDALRasterIO, mask, 0, 0, 0, self.width, self.height, place, columns,
                rows, NUMBERS['uint8'][0], 0, 0,
            )


def _text(text: bytes | None) -> str:
    return (text or b'').decode(errors='replace')
