# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""GDAL as a package contains it: its drivers, and files in its memory.

rasterio and pyogrio have a GDAL each, with drivers and a memory of its own.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
import ctypes
from importlib import import_module

from lava_ros.errors import LavaError
from lava_ros.files.reader.memory import Content

#: Folder of the files in memory.
FOLDER = '/vsimem/lava'

#: Query for the layers of a GeoPackage that are not tables of its file.
VIEWS = (
    "SELECT name FROM sqlite_master WHERE name IN (SELECT table_name FROM gpkg_contents) "
    "AND (type <> 'table' OR sql LIKE 'CREATE VIRTUAL%')"
)


def check_tables(field: str, views: Sequence[str]) -> None:
    """Raise LavaError if a GeoPackage has views, which can run without end."""
    if views:
        expected = 'a GeoPackage whose layers are tables (ogr2ogr writes the result of a view)'
        raise LavaError(field, f'a view: {", ".join(map(str, views))}', expected)


class Gdal:
    """The GDAL library of a package."""

    def __init__(self, module: str) -> None:
        """Load the library with which an extension module is linked."""
        path = import_module(module).__file__
        self._call = ctypes.CDLL(path)
        pointers = {
            'GDALGetDriver': [ctypes.c_int],
            'GDALGetDriverByName': [ctypes.c_char_p],
            'GDALGetDescription': [ctypes.c_void_p],
            'GDALDeregisterDriver': [ctypes.c_void_p],
            'VSIFileFromMemBuffer': [
                ctypes.c_char_p, ctypes.c_void_p, ctypes.c_uint64, ctypes.c_int,
            ],
            'VSIFCloseL': [ctypes.c_void_p],
        }
        for name, kinds in pointers.items():
            function = getattr(self._call, name)
            function.argtypes = kinds
            function.restype = ctypes.c_void_p
        self._call.GDALGetDescription.restype = ctypes.c_char_p

    def keep_drivers(self, names: Collection[str]) -> None:
        """Remove all other drivers, which files could use by references."""
        self._call.GDALAllRegister()
        drivers = [
            self._call.GDALGetDriver(number) for number in range(self._call.GDALGetDriverCount())
        ]
        for driver in drivers:
            if self._call.GDALGetDescription(driver).decode() not in names:
                self._call.GDALDeregisterDriver(driver)

    @contextmanager
    def holding(self, files: Mapping[str, Content]) -> Iterator[None]:
        """Make the bytes of files readable as ``FOLDER/name``, without a copy."""
        paths = [f'{FOLDER}/{name}'.encode() for name in files]
        try:
            for path, file in zip(paths, files.values(), strict=True):
                place, size = file.data.ctypes.data, file.data.size
                made = self._call.VSIFileFromMemBuffer(path, place, size, 0)
                self._call.VSIFCloseL(made)
            yield
        finally:
            for path in paths:
                self._call.VSIUnlink(path)
