# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Opens rasters from anywhere: GeoTIFF and ESRI ASCII grids, by what the file holds."""

from collections.abc import Iterator
from contextlib import contextmanager
import mmap
from pathlib import Path
import re
from typing import Any
import warnings

from lava_ros.errors import LavaError
from lava_ros.files import MOST_CELLS, open_input
from lava_ros.files.optional import require

#: First bytes of TIFF and BigTIFF, in either order of bytes.
_TIFF = (b'II*\0', b'MM\0*', b'II+\0', b'MM\0+')

#: A line of an ESRI ASCII grid's header.
_HEADER = re.compile(
    rb'\s*(ncols|nrows|[xy]ll(?:corner|center)|cellsize|d[xy]|nodata_value|byteorder)\s+(\S+)',
    re.IGNORECASE,
)

#: A number, with a comma in place of the point as GDAL takes it.
_NUMBER = rb'[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:e[-+]?\d+)?'

#: Values of ``NODATA_value`` that are no number and that GDAL knows.
_NO_DATA = (b'nan', b'null')


@contextmanager
def opened_raster(field: str, path: str | Path) -> Iterator[Any]:
    """Open a raster for reading, as ``rasterio.open`` does; it need not be georeferenced.

    GDAL's other drivers are left out: some follow what a file refers to, over a network as well.
    LavaError where it cannot be opened or read, has too many cells or text among its values, or
    rasterio is not installed.
    """
    require('rasterio', field, str(path))
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    # an absolute path is no URL
    place = Path(path).absolute()
    try:
        with open_input(place) as file:
            is_tiff = file.read(4) in _TIFF
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', NotGeoreferencedWarning)
            with rasterio.open(place, driver='GTiff' if is_tiff else 'AAIGrid') as source:
                if source.height * source.width > MOST_CELLS:
                    shown = f'{source.height} x {source.width} cells'
                    right = f'at most {MOST_CELLS} (gdal_translate -srcwin takes a part)'
                    raise LavaError(f'size of {place.name}', shown, right)
                if not is_tiff:
                    _check_numbers(place)
                yield source
    except (RasterioError, OSError) as error:
        right = f'a GeoTIFF or an ESRI ASCII grid that GDAL can read ({error})'
        raise LavaError(field, str(path), right) from error


def _check_numbers(path: Path) -> None:
    """Refuse a grid with text among its values, which GDAL reads as 0."""
    with open_input(path) as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        begin, known = 0, _NUMBER
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
            right = 'a number; of cells without data, that of NODATA_value in the header'
            raise LavaError(place, text, right)
