# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A raster of elevations, brought to square cells of metres: cropped, resampled, to UTM."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import json
import logging
import math
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files import MOST_CELLS
from lava_ros.files.optional import require
from lava_ros.scene.terrain import MAX_COORDINATE, MAX_SIDE_CELLS, RESOLUTION_RANGE, Terrain

_LOG = logging.getLogger(__name__)

#: EPSG code of WGS 84 longitude and latitude.
WGS84 = 4326

#: Length of a degree of latitude [m].
METRES_PER_DEGREE = 111_195.0

#: Beyond this latitude UTM is not defined [degrees].
MAX_UTM_LATITUDE = 84.0

#: Cells this small [m] in a file without coordinate system are degrees.
SMALLEST_CELL = 0.05

#: How much lengths of a projected system may differ from those of UTM: Mercator's double at 60
#: degrees, those of national grids differ by less than 0.1 %.
MAX_DISTORTION = 0.01


@dataclass(frozen=True, eq=False)
class Raster:
    """A grid on its way to a Terrain: cells may be degrees and not square, row 0 is the south.

    ``corner`` is the lower-left one in the file's coordinates; ``offset`` is None unless the file
    has one. ``wkt`` is as in ``Terrain``. ``is_metric`` says that coordinates are metres by the
    definition of the format. ``barriers`` are those of ``Terrain``, in a file's own metres.
    """

    elevation: np.ndarray
    dx: float
    dy: float
    corner: tuple[float, float]
    epsg: int | None = None
    offset: tuple[float, float] | None = None
    wkt: str | None = None
    is_metric: bool = False
    source: str = ''
    barriers: tuple[tuple[tuple[float, float], ...], ...] = ()

    @property
    def system(self) -> str:
        """What the file says its coordinates are."""
        return system_name(self.epsg, self.wkt)

    @property
    def is_placed(self) -> bool:
        """Whether the file says what its coordinates are."""
        return self.epsg is not None or self.wkt is not None


def system_name(epsg: int | None, wkt: str | None) -> str:
    """Return the EPSG code of a coordinate system, or its name if it has no code."""
    if epsg is not None:
        return f'EPSG:{epsg}'
    return f'{[*wkt.split(chr(34)), "", ""][1]}, no EPSG code' if wkt else 'no coordinate system'


def coordinate_system(epsg: int | None, wkt: str | None = None) -> Any:
    """Return the horizontal coordinate system of a terrain for rasterio, None without one.

    Args:
        epsg: EPSG code, as ``Terrain.epsg``.
        wkt: Full definition, as ``Terrain.wkt``. The EPSG code takes precedence.

    Raises:
        LavaError: If GDAL cannot use the code or the definition.
    """
    if epsg is None and wkt is None:
        return None
    rasterio = rasterio_for('coordinate systems')
    try:
        if epsg is not None:
            return rasterio.crs.CRS.from_epsg(epsg)
        return horizontal(rasterio.crs.CRS.from_wkt(wkt))
    except rasterio.errors.CRSError as error:
        name = 'epsg' if epsg is not None else 'terrain.wkt'
        expected = f'a coordinate system GDAL knows ({error})'
        raise LavaError(name, epsg or str(wkt)[:40], expected) from error


def horizontal(crs: Any) -> Any:
    """Return the horizontal part of a rasterio coordinate system, which may be compound."""
    parts = _definition(crs)
    if parts.get('type') != 'CompoundCRS':
        return crs
    return type(crs).from_user_input(json.dumps(parts['components'][0]))


def vertical_unit(crs: Any) -> tuple[str, float]:
    """Return the unit of the heights of a compound system, and its length [m].

    The length is NaN for depths and for other units than lengths; ``'', 1`` stands for a system
    without heights.
    """
    parts = _definition(crs)
    if parts.get('type') != 'CompoundCRS':
        return '', 1.0
    # of a bound system the source is meant
    heights = parts['components'][1]
    heights = heights.get('source_crs', heights)
    axis = heights['coordinate_system']['axis'][0]
    unit = axis['unit']
    if isinstance(unit, str):
        unit = {'name': unit, 'conversion_factor': 1.0 if unit == 'metre' else math.nan}
    if axis['direction'] == 'down':
        return f'{unit["name"]} of depth', math.nan
    return unit['name'], float(unit['conversion_factor'])


def _definition(crs: Any) -> dict[str, Any]:
    """The parts of a coordinate system by name (PROJJSON), empty where PROJ has none."""
    from rasterio.errors import CRSError

    try:
        return dict(crs.to_dict(projjson=True))
    except CRSError:
        return {}


def with_epsg(raster: Raster, epsg: int | None) -> Raster:
    """Give the raster the coordinate system that the user names, also in place of its own."""
    if epsg in (None, raster.epsg):
        return raster
    x, y = raster.corner
    has_degrees = abs(x) <= 180.0 and abs(y) <= 90.0 and min(raster.dx, raster.dy) < SMALLEST_CELL
    if has_degrees and not coordinate_system(epsg).is_geographic:
        right = f'the code of a system in degrees: cells are {raster.dx:.3g} wide at {x:g}, {y:g}'
        raise LavaError('terrain.epsg', epsg, right)
    if raster.is_placed:
        _LOG.warning(f'EPSG:{epsg} as given, although the file states {raster.system}')
    return replace(raster, epsg=epsg, wkt=None)


def in_square_metres(raster: Raster, resolution: float | None) -> Raster:
    """Reproject degrees to UTM; make cells square and of the wanted size."""
    for name in ('dx', 'dy'):
        most = RESOLUTION_RANGE[1]
        validation.number(f'terrain file {name}', getattr(raster, name), above=0.0, at_most=most)
    validation.pair('terrain file corner', raster.corner, most=MAX_COORDINATE)
    if raster.is_metric or not raster.is_placed:
        if min(raster.dx, raster.dy) < SMALLEST_CELL:
            right = 'metres; an ESRI grid in degrees needs its coordinate system: epsg 4326'
            raise LavaError('terrain file cell size', raster.dx, right)
        target = raster.epsg
    else:
        target = _target_epsg(raster)
    square = math.isclose(raster.dx, raster.dy, rel_tol=1e-6)
    if target == raster.epsg and square and resolution in (None, raster.dx):
        return raster
    try:
        return _warped(raster, target, resolution)
    except (LavaError, MemoryError):
        raise
    # GDAL's errors have no class in common
    except Exception as error:
        right = f'a place that GDAL can map to square cells of metres ({error})'
        raise LavaError('terrain file corner', raster.corner, right) from error


def _crs(raster: Raster) -> Any:
    """Return the raster's coordinate system; a raster without one gets any in metres.

    Such a raster is only ever turned into itself at another cell size, so which does not matter.
    """
    if not raster.is_placed:
        return coordinate_system(32631)
    return coordinate_system(raster.epsg, raster.wkt)


def _target_epsg(raster: Raster) -> int | None:
    """EPSG code of the coordinates the terrain shall have: the UTM zone for degrees."""
    crs = _crs(raster)
    if crs.is_projected and not math.isclose(crs.linear_units_factor[1], 1.0, rel_tol=1e-9):
        right = f'coordinates in metres, such as UTM, not {crs.linear_units}'
        raise LavaError('terrain.epsg', raster.epsg, right)
    rows, columns = raster.elevation.shape
    x = raster.corner[0] + 0.5 * columns * raster.dx
    y = raster.corner[1] + 0.5 * rows * raster.dy
    try:
        (longitude,), (latitude,) = transformed(crs, f'EPSG:{WGS84}', [x], [y])
    except ValueError as error:
        if not crs.is_geographic:
            return raster.epsg
        right = f'a place on Earth in {raster.system} ({error})'
        raise LavaError('terrain file corner', raster.corner, right) from error
    if crs.is_projected and not abs(latitude) <= MAX_UTM_LATITUDE:
        return raster.epsg
    validation.number('terrain longitude', longitude, unit='degrees')
    if not abs(latitude) <= MAX_UTM_LATITUDE:
        right = 'at most 84 degrees north or south, or metres'
        raise LavaError('terrain latitude', latitude, right)
    zone = math.floor((longitude + 180.0) / 6.0) % 60 + 1
    utm = int((32600 if latitude >= 0.0 else 32700) + zone)
    if crs.is_projected:
        try:
            places = transformed(crs, f'EPSG:{utm}', [x, x + raster.dx], [y, y])
        except ValueError:
            return raster.epsg
        true = math.hypot(*(ends[1] - ends[0] for ends in places))
        if true == 0.0:
            right = f'at least {SMALLEST_CELL:g} m'
            raise LavaError('terrain file cell size', raster.dx, right)
        # of a place that is nowhere on Earth there is no better system
        if not abs(raster.dx / true - 1.0) > MAX_DISTORTION:
            return raster.epsg
    return utm


def _warped(raster: Raster, target: int | None, resolution: float | None) -> Raster:
    """Resample to square cells in the target coordinate system, by cubic interpolation.

    Cells at least twice as large as the file's are averages instead.
    """
    rasterio = rasterio_for('resampling')
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
    if not 2 <= min(shape) <= max(shape) <= MAX_SIDE_CELLS or shape[0] * shape[1] > MOST_CELLS:
        right = f'2 to {MAX_SIDE_CELLS} cells a side and at most {MOST_CELLS}, not {shape}'
        raise LavaError('terrain.resolution', cell, right)
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


def cropped(raster: Raster, window: tuple[float, float, float, float]) -> Raster:
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
        right = f'x0, y0, x1, y1 that overlap the file, which covers x {west:.0f} to {east:.0f} m '
        right += f'and y {south:.0f} to {north:.0f} m'
        raise LavaError('terrain.window', tuple(window), right)
    return replace(
        raster,
        elevation=raster.elevation[first_row:last_row, first_column:last_column],
        corner=(west + first_column * raster.dx, south + first_row * raster.dy),
    )


def is_degrees(place: tuple[float, float]) -> bool:
    """Return True if a place can be longitude and latitude."""
    return abs(place[0]) <= 180.0 and abs(place[1]) <= 90.0


def projected(terrain: Terrain, longitude: float, latitude: float) -> tuple[float, float]:
    """Easting and northing [m] of a place; LavaError for a terrain without coordinate system."""
    target = coordinate_system(terrain.epsg, terrain.wkt)
    if target is None:
        right = 'easting and northing: the terrain has no coordinate system'
        raise LavaError('longitude, latitude', (longitude, latitude), right)
    try:
        (x,), (y,) = transformed(f'EPSG:{WGS84}', target, [longitude], [latitude])
    except ValueError as error:
        right = f'a place in the domain of {system_name(terrain.epsg, terrain.wkt)} ({error})'
        raise LavaError('longitude, latitude', (longitude, latitude), right) from error
    return (float(x), float(y))


def transformed(source: Any, target: Any, x: Any, y: Any) -> np.ndarray:
    """Coordinates of places in another system, float64, shape [2, count].

    ValueError where a place is outside the domain of a system, or a system is unknown.
    """
    rasterio = rasterio_for('coordinate systems')
    try:
        found = np.array(rasterio.warp.transform(source, target, x, y))
    # what GDAL says of systems and of places has no public class
    except Exception as error:
        raise ValueError(str(error)) from error
    if not np.isfinite(found).all():
        raise ValueError('a place is outside the domain of the projection')
    return found


def rasterio_for(reason: object) -> Any:
    """Import rasterio with the modules that are used here."""
    require('rasterio', 'terrain file', str(reason))
    import rasterio.crs
    import rasterio.transform
    import rasterio.warp

    return rasterio
