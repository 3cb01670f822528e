# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The GDAL library inside a Python package: its drivers, and files in its memory.

rasterio and pyogrio each contain a GDAL with its own drivers and memory.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
import ctypes
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
import os
from typing import Any

from lava_ros.errors import RefusalError
from lava_ros.files.reader.memory import Content

#: Folder of the files in memory.
FOLDER = '/vsimem/lava'

#: Types of a pointer to an object of GDAL, of a text and of a list of texts that ends with NULL.
HANDLE, TEXT = ctypes.c_void_p, ctypes.c_char_p
TEXTS = ctypes.POINTER(TEXT)

#: Functions in C: the type of the result, and those of the arguments.
_FUNCTIONS = {
    'GDALAllRegister': (None,),
    'GDALGetDriverCount': (ctypes.c_int,),
    'GDALGetDriver': (HANDLE, ctypes.c_int),
    'GDALGetDescription': (TEXT, HANDLE),
    'GDALDeregisterDriver': (None, HANDLE),
    'VSIFileFromMemBuffer': (HANDLE, TEXT, HANDLE, ctypes.c_uint64, ctypes.c_int),
    'VSIFCloseL': (ctypes.c_int, HANDLE),
    'VSIUnlink': (ctypes.c_int, TEXT),
    'CPLSetConfigOption': (None, TEXT, TEXT),
    'OSRSetPROJSearchPaths': (None, TEXTS),
}

#: Query for the layers of a GeoPackage that are not tables of its file.
VIEWS = (
    "SELECT name FROM sqlite_master WHERE name IN (SELECT table_name FROM gpkg_contents) "
    "AND (type <> 'table' OR sql LIKE 'CREATE VIRTUAL%')"
)


def check_tables(field: str, views: Sequence[str]) -> None:
    """Raise LavaError if a GeoPackage has views, which can run without end."""
    if views:
        problem = f'The GeoPackage contains views: {", ".join(map(str, views))}'
        raise RefusalError(field, problem, 'Write them as tables with ogr2ogr')


def names_in_c(names: Collection[bytes]) -> Any:
    """Return a list of texts for a function in C."""
    return (TEXT * (len(names) + 1))(*names, None)


class Gdal:
    """The GDAL library of a package, loaded without importing the package, which takes longer."""

    def __init__(self, package: str, module: str) -> None:
        """Load the library with which an extension module of a package is linked."""
        spec = find_spec(package)
        folders = spec and spec.submodule_search_locations
        if not folders:
            raise ImportError(f'the package {package} is not installed')
        paths = [os.path.join(folders[0], module + suffix) for suffix in EXTENSION_SUFFIXES]
        self._call = ctypes.CDLL(next(filter(os.path.exists, paths), paths[0]))
        self.declare(_FUNCTIONS)
        # wheels contain the data files; other builds of GDAL know where theirs are
        data, systems = (os.path.join(folders[0], name) for name in ('gdal_data', 'proj_data'))
        if os.path.isdir(data) and 'GDAL_DATA' not in os.environ:
            self._call.CPLSetConfigOption(b'GDAL_DATA', os.fsencode(data))
        if os.path.isdir(systems) and not os.environ.keys() & {'PROJ_DATA', 'PROJ_LIB'}:
            self._call.OSRSetPROJSearchPaths(names_in_c([os.fsencode(systems)]))

    def declare(self, functions: Mapping[str, tuple[Any, ...]]) -> None:
        """Declare functions in C by name: the type of the result, and those of the arguments."""
        for name, (result, *arguments) in functions.items():
            function = getattr(self._call, name)
            function.restype, function.argtypes = result, arguments

    def __getattr__(self, name: str) -> Any:
        """Return a function of the library."""
        return getattr(self._call, name)

    def keep_drivers(self, names: Collection[str]) -> None:
        """Remove all other drivers, because a file could use them by reference."""
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
                made = self._call.VSIFileFromMemBuffer(path, file.memory, len(file.data), 0)
                self._call.VSIFCloseL(made)
            yield
        finally:
            for path in paths:
                self._call.VSIUnlink(path)
