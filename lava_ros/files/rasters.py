# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Untrusted rasters, which the reader process reads with the driver of their contents."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
import re
from typing import Any

import numpy as np

from lava_ros.errors import LavaError, refusing
from lava_ros.files import open_input
from lava_ros.files.optional import require
from lava_ros.files.raster_formats import FORMATS, RasterFormat, TILE_DRIVERS
from lava_ros.files.reader.client import File, read_in_process, start
from lava_ros.files.systems import plain_system

#: Endings that replace or follow the suffix of a raster in names of files that belong to it.
_ENDINGS = ('.hdr', '.prj', '.tfw', '.tifw', '.wld', '.pgw', '.pngw', '.jgw', '.jpgw', '.ige')
_MORE_ENDINGS = ('.aux.xml', '.msk')


@dataclass(frozen=True, eq=False)
class RasterContent:
    """Contents of a raster file.

    Attributes:
        values: Cells of the bands that were read, as stored, masked array of shape [bands, rows,
            columns].
        place: Affine transformation of the rows and columns of the file.
        crs: Coordinate system of rasterio, None without one.
        shape: Rows and columns of the file, which ``values`` may have thinned.
        count: Number of bands of the file; of each, the following:
        dtypes: Type.
        scales: Factor of the values.
        offsets: Offset of the values after the factor.
        units: Unit, None without one.
        descriptions: Description, None without one.
        colours: Meaning in a picture, such as ``red``, ``alpha`` or ``palette``.
        palette: Red, green, blue and alpha by value, empty without a palette.
        tags: Metadata of the file.
    """

    values: np.ma.MaskedArray[Any, Any]
    place: Any
    crs: Any
    shape: tuple[int, int]
    count: int
    dtypes: Sequence[str]
    scales: Sequence[float]
    offsets: Sequence[float]
    units: Sequence[str | None]
    descriptions: Sequence[str | None]
    colours: Sequence[str]
    palette: Mapping[int, Sequence[int]]
    tags: Mapping[str, str]


def read_raster(
    field: str, path: str | Path, formats: Sequence[RasterFormat] = FORMATS, *,
    kind: type[np.floating[Any]] | None = None, max_bands: int = 1, max_side: int | None = None,
) -> RasterContent:
    """Read a raster, which need not be georeferenced.

    Args:
        field: Name of the field in errors.
        path: Path of the file.
        formats: Formats that the file may have.
        kind: Type of the values, None for the type in the file.
        max_bands: Maximum number of bands to read.
        max_side: Maximum number of rows and columns to read; a larger raster is thinned.

    Raises:
        LavaError: If the file cannot be read, has an unknown format, several rasters, too many
            cells, missing data, references to other folders, or text among its values; or if
            rasterio is not installed.
    """
    start()
    require('rasterio', field, str(path))
    from rasterio.crs import CRS
    from rasterio.transform import Affine

    place = Path(path).absolute()
    with refusing(field, str(path), 'a raster that GDAL can read'):
        item = format_of(field, Path(path), formats)
        tiles = _tiles(field, place) if item.driver == 'VRT' else {}
        files = [file for name in (place, *tiles) for file in _parts(field, name)]
        answer = read_in_process(
            field, path, 'raster', files, drivers=[item.driver],
            tiles={name.name: driver for name, driver in tiles.items()},
            kind=kind and np.dtype(kind).name, max_bands=max_bands, max_side=max_side,
        )
        data, (values, *valid) = answer.data['result'], answer.arrays
        mask = valid[0] == 0 if valid else np.ma.nomask
        system, place = data.pop('system'), Affine(*data.pop('place'))
        crs = system and CRS.from_wkt(plain_system(f'{field}, {path}', system))
        palette = {int(number): colour for number, colour in data.pop('palette')}
        return RasterContent(
            np.ma.MaskedArray(values, mask if np.any(mask) else np.ma.nomask), place, crs,
            tuple(data.pop('shape')), palette=palette, **data,
        )


def format_of(
    field: str, path: Path, formats: Sequence[RasterFormat] = FORMATS
) -> RasterFormat:
    """Return the format of a file by its first bytes; raise LavaError for an unknown one."""
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


def _tiles(field: str, path: Path) -> dict[Path, str]:
    """Return the source files of a virtual raster, which are in its folder, and their drivers."""
    answer = read_in_process(field, path, 'tiles', [(_name(path), path)])
    result = {}
    for name in answer.data['result']:
        if not re.fullmatch(r'[^/\\\0]+', name):
            raise LavaError(f'SourceFilename of {path.name}', name, 'the name of a file')
        source = path.with_name(name)
        result[source] = driver = format_of(field, source).driver
        if driver not in TILE_DRIVERS:
            advice = 'of the same folder (gdal_translate makes a GeoTIFF of the virtual raster)'
            expected = f'a {" or ".join(TILE_DRIVERS)} file {advice}'
            raise LavaError(f'SourceFilename of {path.name}', name, expected)
    return result


def _parts(field: str, path: Path) -> Iterator[File]:
    """Yield a file and the files that belong to it."""
    yield _name(path), path
    own = [path.with_name(path.name + end) for end in _MORE_ENDINGS]
    for end in _ENDINGS:
        own += [path.with_suffix(end), path.with_suffix(end.upper())]
    for item in own:
        if item != path and item.is_file():
            if item.suffix == '.msk' and format_of(field, item).driver != 'GTiff':
                raise LavaError(field, str(item), 'a mask in a GeoTIFF')
            yield _name(item), item


def _name(path: Path) -> str:
    """Return the name of a file for GDAL, which has to be printable."""
    return re.sub(r'[\0-\x1f\ud800-\udfff]', '_', path.name)
