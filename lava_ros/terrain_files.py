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

"""Elevation files -> Terrain: GeoTIFF and ESRI ASCII grids through rasterio, and npz."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path
from typing import Any
import warnings
from zipfile import BadZipFile
import zlib

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.raster_files import open_raster
from lava_ros.scene import MAX_SIDE_CELLS, Terrain

#: EPSG code of WGS 84 longitude and latitude.
WGS84 = 4326

#: Names that say metres in a raster's band or coordinate system.
METRES = ('', 'm', 'metre', 'metres', 'meter', 'meters')

#: Beyond this latitude UTM is not defined [degrees].
MAX_UTM_LATITUDE = 84.0

#: Cells this small [m] in a file without coordinate system are degrees.
SMALLEST_CELL = 0.05

NPZ_KEYS = ('elevation', 'resolution', 'dx', 'dy', 'origin', 'epsg', 'offset', 'row_order')


def load_terrain(
    path: str | Path,
    *,
    epsg: int | None = None,
    resolution: float | None = None,
    offset: tuple[float, float] | None = None,
    window: tuple[float, float, float, float] | None = None,
) -> Terrain:
    """Read an elevation file.

    GeoTIFF (.tif, .tiff) and ESRI ASCII grids (.asc) need rasterio. Files in degrees are
    reprojected to their UTM zone; cells that are not square become square, as long as the shorter
    side. Elevations have to be metres.

    An .npz file holds ``elevation`` [m], shape [rows, columns], and ``resolution`` [m], or ``dx``
    and ``dy``; x and y are metres. Optional are ``origin`` and ``offset`` (x, y) [m], ``epsg``,
    and ``row_order``: ``south`` (the default: row 0 has the smallest y) or ``north``.

    Args:
        path: The file.
        epsg: EPSG code of the file's coordinates, for a file that does not say it.
        resolution: Side of the cells to make [m], None for the file's own.
        offset: Easting and northing [m] of the map frame's origin, None for the lower-left corner
            of the grid. An .npz file's own origin and offset stay as they are.
        window: Part to keep: smallest easting and northing, largest easting and northing [m], None
            for all. Cells that are cut by its border are kept.

    Raises:
        LavaError: The file cannot be read, or what it holds cannot be used; the message says what
            to do.
    """
    path = Path(path)
    try:
        is_file = path.is_file()
    except (OSError, ValueError):
        # A name that is too long, or with a null character in it.
        is_file = False
    if not is_file:
        raise LavaError('terrain file', str(path), 'a file that exists')
    if resolution is not None:
        resolution = validation.number('terrain.resolution', resolution, above=0.0, unit='m')
    if offset is not None:
        offset = validation.pair('terrain.offset', offset)
    raster = _read_npz(path) if path.suffix.lower() == '.npz' else _read_gdal(path)
    raster = _in_square_metres(_with_epsg(raster, epsg), resolution)
    if window is not None:
        raster = _cropped(raster, window)
    if offset is None:
        offset = raster.corner if raster.offset is None else raster.offset
    return Terrain(
        elevation=raster.elevation,
        resolution=raster.dx,
        origin=(raster.corner[0] - offset[0], raster.corner[1] - offset[1]),
        epsg=raster.epsg,
        offset=offset,
    )


def demo_terrain() -> Terrain:
    """Return a mountain of real terrain, part of the elevation sample that matplotlib carries.

    The sample is NASA's SRTM elevation of the Jacksboro fault, Tennessee, in cells of 3 seconds of
    arc; the part is 9 km wide and 8 km high, falls from 1070 to 250 m and has cells of 30 m.

    Raises:
        LavaError: matplotlib or rasterio is not installed.
    """
    try:
        from matplotlib import cbook
    except ImportError as error:
        raise LavaError('demo terrain', None, "pip install 'lava_ros[terrain,plot]'") from error
    stored: Any = cbook.get_sample_data('jacksboro_fault_dem.npz')
    with stored as sample:
        # What the sample calls ymin is its northern edge; rows go south from there.
        raster = _Raster(
            elevation=np.flipud(sample['elevation']).astype(np.float32),
            dx=float(sample['dx']),
            dy=float(sample['dy']),
            corner=(float(sample['xmin']), float(sample['ymax'])),
            epsg=WGS84,
        )
    raster = _cropped(_in_square_metres(raster, 30.0), DEMO_WINDOW)
    return Terrain(
        elevation=raster.elevation, resolution=raster.dx, epsg=raster.epsg, offset=raster.corner
    )


#: Smallest easting and northing, largest easting and northing of the demo, UTM zone 16 north [m].
DEMO_WINDOW = (744440.0, 4038400.0, 753440.0, 4046400.0)


@dataclass(frozen=True, eq=False)
class _Raster:
    """A grid on its way to a Terrain: cells may be degrees and not square, row 0 is the south.

    ``corner`` is the lower-left one in the file's coordinates; ``offset`` is None unless the file
    has one. ``wkt`` describes a coordinate system that has no EPSG code. ``is_metric`` says that
    coordinates are metres by the definition of the format.
    """

    elevation: np.ndarray
    dx: float
    dy: float
    corner: tuple[float, float]
    epsg: int | None = None
    offset: tuple[float, float] | None = None
    wkt: str | None = None
    is_metric: bool = False


def _read_npz(path: Path) -> _Raster:
    try:
        with np.load(path, allow_pickle=False) as stored:
            data: dict[str, Any] = {key: stored[key] for key in stored.files}
    except (OSError, ValueError, TypeError, EOFError, BadZipFile, zlib.error) as error:
        raise LavaError('terrain file', str(path), f'a readable .npz file ({error})') from error
    data = validation.keys('terrain file', data, allowed=NPZ_KEYS, required=['elevation'])
    order = validation.choice('row_order', str(data.get('row_order', 'south')), ('south', 'north'))
    elevation = np.asarray(data['elevation'])
    if elevation.ndim != 2 or elevation.dtype.kind not in 'iuf':
        raise LavaError(
            'terrain file elevation',
            f'{elevation.dtype} array of shape {elevation.shape}',
            'numbers [m] of shape [rows, columns]',
        )
    if 'resolution' in data:
        dx = dy = validation.number('resolution', data['resolution'], above=0.0, unit='m')
    else:
        dx = validation.number('dx', data.get('dx'), above=0.0, unit='m')
        dy = validation.number('dy', data.get('dy'), above=0.0, unit='m')
    offset = validation.pair('offset', data['offset']) if 'offset' in data else (0.0, 0.0)
    origin = validation.pair('origin', data['origin']) if 'origin' in data else (0.0, 0.0)
    return _Raster(
        elevation=(elevation[::-1] if order == 'north' else elevation).astype(np.float32),
        dx=dx,
        dy=dy,
        corner=(origin[0] + offset[0], origin[1] + offset[1]),
        epsg=int(validation.number('epsg', data['epsg'])) if 'epsg' in data else None,
        offset=offset,
        is_metric=True,
    )


def _rasterio(reason: object) -> Any:
    """Import rasterio with the modules that are used here."""
    try:
        import rasterio
        import rasterio.crs
        import rasterio.transform
        import rasterio.warp
    except ImportError as error:
        raise LavaError(
            'terrain file', str(reason), "rasterio to read it: pip install 'lava_ros[terrain]'"
        ) from error
    return rasterio


def _read_gdal(path: Path) -> _Raster:
    rasterio = _rasterio(path)
    try:
        with warnings.catch_warnings():
            # A file without coordinates is no surprise here: _checked_transform looks.
            warnings.simplefilter('ignore', rasterio.errors.NotGeoreferencedWarning)
            with open_raster(path) as source:
                _check_raster(source, path)
                band = source.read(1, masked=True)
                transform, crs = source.transform, source.crs
                scale, shift = source.scales[0], source.offsets[0]
    except (rasterio.errors.RasterioError, OSError) as error:
        right = f'a GeoTIFF or an ESRI ASCII grid that GDAL can read ({error})'
        raise LavaError('terrain file', str(path), right) from error
    elevation = band.astype(np.float32).filled(np.nan) * np.float32(scale) + np.float32(shift)
    if transform.e < 0.0:
        elevation = np.flipud(elevation)
    bottom = min(transform.f, transform.f + transform.e * band.shape[0])
    code = crs.to_epsg() if crs else None
    return _Raster(
        elevation=elevation,
        dx=transform.a,
        dy=abs(transform.e),
        corner=(transform.c, bottom),
        epsg=code,
        wkt=crs.to_wkt() if crs and code is None else None,
    )


def _check_raster(source: Any, path: Path) -> None:
    """Refuse what is not an elevation in metres on a north-up grid."""
    transform = source.transform
    if source.count != 1:
        raise LavaError('terrain file', str(path), f'one band of elevations, not {source.count}')
    if np.dtype(source.dtypes[0]).kind not in 'iuf':
        raise LavaError('terrain file', str(path), f'numbers, not {source.dtypes[0]}')
    if max(source.shape) > MAX_SIDE_CELLS:
        raise LavaError(
            'terrain file', str(path), f'at most {MAX_SIDE_CELLS} cells a side, not {source.shape}'
        )
    if transform.is_identity or transform.b or transform.d or transform.a <= 0.0:
        raise LavaError(
            'terrain file', str(path), 'a georeferenced grid with north up (gdalwarp makes one)'
        )
    unit = (source.units[0] or '').lower()
    if unit not in METRES:
        raise LavaError('terrain file', str(path), f'elevations in metres, not {unit}')


def _with_epsg(raster: _Raster, epsg: int | None) -> _Raster:
    """Give the raster the coordinate system the user names, unless it has another."""
    if epsg is None:
        return raster
    if isinstance(epsg, bool) or not isinstance(epsg, int) or epsg < 1024:
        raise LavaError('terrain.epsg', epsg, 'an EPSG code such as 32633')
    if raster.wkt is not None or raster.epsg not in (None, epsg):
        known = f'EPSG:{raster.epsg}' if raster.epsg else 'a coordinate system without a code'
        raise LavaError('terrain.epsg', epsg, f'absent: the file says {known}')
    return replace(raster, epsg=epsg)


def _in_square_metres(raster: _Raster, resolution: float | None) -> _Raster:
    """Reproject degrees to UTM; make cells square and of the wanted size."""
    if raster.is_metric or (raster.epsg is None and raster.wkt is None):
        if min(raster.dx, raster.dy) < SMALLEST_CELL:
            raise LavaError(
                'terrain file cell size',
                raster.dx,
                'metres; an ESRI grid in degrees needs its coordinate system: epsg 4326',
            )
        target = raster.epsg
    else:
        target = _target_epsg(raster)
    square = math.isclose(raster.dx, raster.dy, rel_tol=1e-6)
    if target == raster.epsg and square and resolution in (None, raster.dx):
        return raster
    return _warped(raster, target, resolution)


def _crs(raster: _Raster) -> Any:
    """Return the raster's coordinate system; a raster without one gets any in metres.

    Such a raster is only ever turned into itself at another cell size, so which does not matter.
    """
    rasterio = _rasterio('coordinate systems')
    try:
        if raster.wkt is not None:
            return rasterio.crs.CRS.from_wkt(raster.wkt)
        return rasterio.crs.CRS.from_epsg(raster.epsg or 32631)
    except rasterio.errors.CRSError as error:
        raise LavaError('terrain.epsg', raster.epsg, f'a known EPSG code ({error})') from error


def _target_epsg(raster: _Raster) -> int | None:
    """EPSG code of the coordinates the terrain shall have: the UTM zone for degrees."""
    rasterio = _rasterio('coordinate systems')
    crs = _crs(raster)
    if crs.is_projected:
        if not math.isclose(crs.linear_units_factor[1], 1.0, rel_tol=1e-9):
            raise LavaError(
                'terrain.epsg',
                raster.epsg,
                f'coordinates in metres, such as UTM, not {crs.linear_units}',
            )
        return raster.epsg
    rows, columns = raster.elevation.shape
    x = raster.corner[0] + 0.5 * columns * raster.dx
    y = raster.corner[1] + 0.5 * rows * raster.dy
    (longitude,), (latitude,) = rasterio.warp.transform(crs, f'EPSG:{WGS84}', [x], [y])
    if not abs(latitude) <= MAX_UTM_LATITUDE:
        raise LavaError(
            'terrain latitude', latitude, 'at most 84 degrees north or south, or metres'
        )
    zone = math.floor((longitude + 180.0) / 6.0) % 60 + 1
    return int((32600 if latitude >= 0.0 else 32700) + zone)


def _warped(raster: _Raster, target: int | None, resolution: float | None) -> _Raster:
    """Resample to square cells in the target coordinate system, by cubic interpolation.

    Cells at least twice as large as the file's are averages instead.
    """
    rasterio = _rasterio('resampling')
    source_crs = _crs(raster)
    target_crs = source_crs if target == raster.epsg else rasterio.crs.CRS.from_epsg(target)
    rows, columns = raster.elevation.shape
    west, south = raster.corner
    east, north = west + columns * raster.dx, south + rows * raster.dy
    if target_crs == source_crs:
        native = min(raster.dx, raster.dy)
        left, bottom, right, top = west, south, east, north
    else:
        natural, width, height = rasterio.warp.calculate_default_transform(
            source_crs, target_crs, columns, rows, west, south, east, north
        )
        # Whole centimetres read better in every message and title.
        native = max(round(natural.a, 2), SMALLEST_CELL)
        left, top = natural.c, natural.f
        right, bottom = left + width * natural.a, top - height * natural.a
    cell = resolution or native
    if target_crs != source_crs:
        # Corners that are whole cells from zero give offsets that read well.
        left, bottom = math.floor(left / cell) * cell, math.floor(bottom / cell) * cell
    shape = (math.ceil((top - bottom) / cell - 1e-6), math.ceil((right - left) / cell - 1e-6))
    if not 2 <= min(shape) <= max(shape) <= MAX_SIDE_CELLS:
        raise LavaError(
            'terrain.resolution', cell, f'2 to {MAX_SIDE_CELLS} cells a side, not {shape}'
        )
    average = cell >= 2.0 * native
    result = np.full(shape, np.nan, dtype=np.float32)
    rasterio.warp.reproject(
        np.ascontiguousarray(np.flipud(raster.elevation)),
        result,
        src_transform=rasterio.transform.from_origin(west, north, raster.dx, raster.dy),
        src_crs=source_crs,
        src_nodata=np.nan,
        dst_transform=rasterio.transform.from_origin(left, bottom + shape[0] * cell, cell, cell),
        dst_crs=target_crs,
        dst_nodata=np.nan,
        resampling=rasterio.warp.Resampling.average if average else rasterio.warp.Resampling.cubic,
    )
    return replace(
        raster,
        elevation=np.flipud(result),
        dx=cell,
        dy=cell,
        corner=(left, bottom),
        epsg=target,
        offset=raster.offset if target_crs == source_crs else None,
        wkt=raster.wkt if target_crs == source_crs else None,
    )


def _cropped(raster: _Raster, window: tuple[float, float, float, float]) -> _Raster:
    """Keep the cells that a window in projected coordinates touches."""
    if isinstance(window, str) or not isinstance(window, Sequence) or len(window) != 4:
        raise LavaError('terrain.window', window, 'x0, y0, x1, y1 [m]')
    x0, y0, x1, y1 = (
        validation.number(f'terrain.window[{index}]', value, unit='m')
        for index, value in enumerate(window)
    )
    rows, columns = raster.elevation.shape
    west, south = raster.corner
    first_column = max(math.floor((x0 - west) / raster.dx + 1e-6), 0)
    first_row = max(math.floor((y0 - south) / raster.dy + 1e-6), 0)
    last_column = min(math.ceil((x1 - west) / raster.dx - 1e-6), columns)
    last_row = min(math.ceil((y1 - south) / raster.dy - 1e-6), rows)
    if last_column - first_column < 2 or last_row - first_row < 2:
        east, north = west + columns * raster.dx, south + rows * raster.dy
        raise LavaError(
            'terrain.window',
            tuple(window),
            f'x0, y0, x1, y1 that overlap the file, which covers x {west:.0f} to {east:.0f} m '
            f'and y {south:.0f} to {north:.0f} m',
        )
    return replace(
        raster,
        elevation=raster.elevation[first_row:last_row, first_column:last_column],
        corner=(west + first_column * raster.dx, south + first_row * raster.dy),
    )
