# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rasters of elevation: cropping, resampling to square cells, projection to UTM."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
import json
import logging
import math
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError, refusing
from lava_ros.files import MAX_CELLS
from lava_ros.files.columns import MAX_LATITUDE, MAX_LONGITUDE
from lava_ros.files.optional import is_installed, require
from lava_ros.files.systems import plain_system
from lava_ros.scene.terrain import MAX_COORDINATE, MAX_SIDE_CELLS, RESOLUTION_RANGE, Terrain

_LOG = logging.getLogger(__name__)

#: Longitude and latitude of WGS 84.
DEGREES = 'EPSG:4326'

#: Length of a degree of latitude [m].
METRES_PER_DEGREE = 111_195.0

#: Smaller cells [m] in a file without a coordinate system are in degrees.
SMALLEST_CELL = 0.05


@dataclass(frozen=True, eq=False)
class Raster:
    """A grid read from a file: cells may be in degrees and not square; row 0 is in the south.

    ``corner`` is the lower-left corner in the coordinates of the file; ``offset`` is None unless
    the file has one; its coordinates are then in metres. ``wkt``, ``barriers`` and ``sea_level``
    are those of ``Terrain``.
    """

    elevation: np.ndarray
    dx: float
    dy: float
    corner: tuple[float, float]
    epsg: int | None = None
    offset: tuple[float, float] | None = None
    wkt: str | None = None
    source: str = ''
    barriers: tuple[tuple[tuple[float, float], ...], ...] = ()
    sea_level: float | None = None

    @property
    def system(self) -> str:
        """Name of the coordinate system of the file."""
        return system_name(self.epsg, self.wkt)

    @property
    def is_placed(self) -> bool:
        """True if the file names its coordinate system."""
        return self.epsg is not None or self.wkt is not None

    @property
    def is_square(self) -> bool:
        """True if its cells are squares."""
        return math.isclose(self.dx, self.dy, rel_tol=1e-6)


def system_name(epsg: int | None, wkt: str | None) -> str:
    """Return the EPSG code of a coordinate system, or its name if it has no code."""
    if epsg is not None:
        return f'EPSG:{epsg}'
    return f'{name_in_wkt(wkt)}, no EPSG code' if wkt else 'no coordinate system'


def name_in_wkt(wkt: str) -> str:
    """Return the name of a coordinate system; may be empty."""
    return [*wkt.split('"'), '', ''][1]


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
    name, shown = ('terrain.wkt', str(wkt)[:40]) if epsg is None else ('epsg', epsg)
    with refusing(name, shown, 'a coordinate system that GDAL knows', rasterio.errors.CRSError):
        if epsg is not None:
            return rasterio.crs.CRS.from_epsg(epsg)
        return horizontal(rasterio.crs.CRS.from_wkt(plain_system(name, str(wkt))))


def system_words(epsg: int | None, wkt: str | None) -> str:
    """Return the code of a coordinate system, and its name if GDAL is installed."""
    if not epsg:
        return system_name(None, wkt) if wkt else 'of the map frame: no coordinate system'
    try:
        return f'{name_in_wkt(coordinate_system(epsg).to_wkt())} (EPSG:{epsg})'
    except LavaError:
        return f'EPSG:{epsg}'


def horizontal(crs: Any) -> Any:
    """Return the horizontal part of a rasterio coordinate system, which may be compound."""
    parts = _parts(crs)
    return type(crs).from_user_input(json.dumps(parts[0])) if parts else crs


def epsg_of(crs: Any, place: tuple[float, float]) -> int | None:
    """Return the EPSG code of the horizontal part of a rasterio coordinate system.

    GDAL names a system of the same projection even if it has another datum, or another shift of
    the datum; None if that moves a place by more than a metre.
    """
    flat = horizontal(crs)
    code = flat.to_epsg()
    if code is None:
        return None
    # both are undefined outside the domain of the projection
    with suppress(ValueError):
        own, other = (
            transformed(system, DEGREES, *([value] for value in place))
            for system in (flat, f'EPSG:{code}')
        )
        shift = (own - other + 180.0) % 360.0 - 180.0
        shift[0] *= np.cos(np.radians(own[1]))
        if np.abs(shift).max() > 1.0 / METRES_PER_DEGREE:
            return None
    return int(code)


def vertical_unit(crs: Any) -> tuple[str, float]:
    """Return the unit of the heights of a compound system, and its length [m].

    The length is NaN for depths and for units that are not lengths. A system without heights gives
    ``'', 1``.
    """
    if not (parts := _parts(crs)):
        return '', 1.0
    # a bound system contains the actual one
    heights = parts[1].get('source_crs', parts[1])
    axis = heights['coordinate_system']['axis'][0]
    unit = axis['unit']
    if isinstance(unit, str):
        unit = {'name': unit, 'conversion_factor': 1.0 if unit == 'metre' else math.nan}
    if axis['direction'] == 'down':
        return f'{unit["name"]} of depth', math.nan
    return unit['name'], float(unit['conversion_factor'])


def _parts(crs: Any) -> list[dict[str, Any]]:
    """Return the parts of a compound coordinate system as PROJJSON, none of another system."""
    from rasterio.errors import CRSError

    # PROJ cannot express every system
    with suppress(CRSError):
        return list(crs.to_dict(projjson=True).get('components', ()))
    return []


def metres_per_unit(crs: Any) -> float:
    """Return the approximate unit of a coordinate system [m]: 1, or a degree of latitude."""
    return METRES_PER_DEGREE if crs and crs.is_geographic else 1.0


def with_epsg(raster: Raster, epsg: int | None) -> Raster:
    """Return the raster with the coordinate system that the user gave, if any."""
    if epsg in (None, raster.epsg):
        return raster
    x, y = raster.corner
    has_degrees = is_degrees((x, y)) and min(raster.dx, raster.dy) < SMALLEST_CELL
    # an unknown code is an error, which an .npz file without GDAL cannot find
    system: Any = coordinate_system(epsg) if is_installed('rasterio') or has_degrees else None
    if has_degrees and not system.is_geographic:
        expected = f'a system in degrees: cells are {raster.dx:.3g} wide at {x:g}, {y:g}'
        raise LavaError('terrain.epsg', epsg, expected)
    if raster.is_placed:
        _LOG.warning(f'EPSG:{epsg} as given, although the file states {raster.system}')
    return replace(raster, epsg=epsg, wkt=None)


def to_square_metric_cells(raster: Raster, resolution: float | None) -> Raster:
    """Reproject degrees to UTM, and resample to square cells of a resolution [m]."""
    for name in ('dx', 'dy'):
        most = RESOLUTION_RANGE[1]
        validation.number(f'terrain file {name}', getattr(raster, name), above=0.0, at_most=most)
    validation.pair('terrain file corner', raster.corner, most=MAX_COORDINATE)
    if raster.offset is not None or not raster.is_placed:
        if min(raster.dx, raster.dy) < SMALLEST_CELL:
            expected = 'metres; an ESRI grid in degrees needs its coordinate system: epsg 4326'
            raise LavaError('terrain file cell size', raster.dx, expected)
        target = raster.epsg
    else:
        target = _target_epsg(raster)
    if target == raster.epsg and raster.is_square and resolution in (None, raster.dx):
        return raster
    expected = 'a place that GDAL can map to square cells of metres'
    with refusing('terrain file corner', raster.corner, expected):
        return _resample(raster, target, resolution)


def _crs(raster: Raster) -> Any:
    """Return the raster's coordinate system, or one in metres if it states none."""
    return coordinate_system(raster.epsg, raster.wkt) or coordinate_system(32631)


def _target_epsg(raster: Raster) -> int | None:
    """Return the EPSG code for the terrain: UTM for degrees and for stretched projections."""
    crs = _crs(raster)
    if crs.is_projected and not math.isclose(crs.linear_units_factor[1], 1.0, rel_tol=1e-9):
        expected = f'coordinates in metres, such as UTM, not {crs.linear_units}'
        raise LavaError('coordinate system of the terrain file', raster.system, expected)
    rows, columns = raster.elevation.shape
    x = raster.corner[0] + 0.5 * columns * raster.dx
    y = raster.corner[1] + 0.5 * rows * raster.dy
    try:
        (longitude,), (latitude,) = transformed(crs, DEGREES, [x], [y])
        zone = math.floor((longitude + 180.0) / 6.0) % 60 + 1
        utm = int((32600 if latitude >= 0.0 else 32700) + zone)
        if crs.is_projected:
            there = transformed(crs, f'EPSG:{utm}', [x, x + raster.dx, x], [y, y, y + raster.dx])
    except ValueError as error:
        if not crs.is_geographic:
            return raster.epsg
        expected = f'a place on Earth in {raster.system} ({error})'
        raise LavaError('terrain file corner', raster.corner, expected) from error
    if abs(latitude) > 84.0:
        if crs.is_projected:
            return raster.epsg
        expected = 'at most 84 degrees north or south, or metres'
        raise LavaError('terrain latitude', latitude, expected)
    if crs.is_projected:
        # principal scales: the same in all directions, and without shear, if both are 1
        true = np.linalg.svd((there[:, 1:] - there[:, :1]) / raster.dx, compute_uv=False)
        if true[1] == 0.0:
            expected = f'at least {SMALLEST_CELL:g} m'
            raise LavaError('terrain file cell size', raster.dx, expected)
        # national grids stretch lengths by less than 0.1 %, Mercator at 60 degrees by 100 %
        if np.abs(1.0 / true - 1.0).max() <= 0.01:
            return raster.epsg
    return utm


def _resample(raster: Raster, target: int | None, resolution: float | None) -> Raster:
    """Resample to square cells in the target coordinate system.

    Interpolation is cubic. Cells at least twice as large as those of the file are averages.
    """
    rasterio = rasterio_for('resampling')
    source_crs, is_same = _crs(raster), target == raster.epsg
    target_crs = source_crs if is_same else rasterio.crs.CRS.from_epsg(target)
    rows, columns = raster.elevation.shape
    left, bottom = west, south = raster.corner
    right, top = east, north = west + columns * raster.dx, south + rows * raster.dy
    native = min(raster.dx, raster.dy)
    if not is_same:
        natural, width, height = rasterio.warp.calculate_default_transform(
            source_crs, target_crs, columns, rows, west, south, east, north
        )
        # whole centimetres are easier to read in messages and titles
        native = max(round(natural.a, 2), SMALLEST_CELL)
        left, top = natural.c, natural.f
        right, bottom = left + width * natural.a, top - height * natural.a
    cell = resolution or native
    if not is_same:
        # corners at multiples of the cell size are easier to read
        left, bottom = math.floor(left / cell) * cell, math.floor(bottom / cell) * cell
    shape = (math.ceil((top - bottom) / cell - 1e-6), math.ceil((right - left) / cell - 1e-6))
    if not 2 <= min(shape) <= max(shape) <= MAX_SIDE_CELLS or shape[0] * shape[1] > MAX_CELLS:
        expected = f'2 to {MAX_SIDE_CELLS} cells per side and at most {MAX_CELLS}, not {shape}'
        raise LavaError('terrain.resolution', cell, expected)
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
        offset=raster.offset if is_same else None,
        wkt=raster.wkt if is_same else None,
    )


def crop(raster: Raster, window: tuple[float, float, float, float]) -> Raster:
    """Return the part of a raster that a window in projected coordinates touches."""
    items = validation.items('terrain.window', window, 'x0, y0, x1, y1 [m]', least=4, most=4)
    x0, y0, x1, y1 = (validation.number(*item, unit='m') for item in items)
    corner, cell = np.array(raster.corner), np.array((raster.dx, raster.dy))
    size = raster.elevation.shape[::-1]
    # columns and rows
    first = np.clip(np.floor(((x0, y0) - corner) / cell + 1e-6), 0, size).astype(int)
    last = np.clip(np.ceil(((x1, y1) - corner) / cell - 1e-6), 0, size).astype(int)
    if min(last - first) < 2:
        (west, south), (east, north) = corner, corner + size * cell
        expected = 'x0, y0, x1, y1 that overlap the file, which covers '
        expected += f'x {west:.0f} to {east:.0f} m and y {south:.0f} to {north:.0f} m'
        raise LavaError('terrain.window', tuple(window), expected)
    west, south = (corner + first * cell).tolist()
    part = np.s_[first[1] : last[1], first[0] : last[0]]
    return replace(raster, elevation=raster.elevation[part], corner=(west, south))


def is_degrees(place: Sequence[float]) -> bool:
    """Return True if a pair of coordinates can be longitude and latitude."""
    return abs(place[0]) <= MAX_LONGITUDE and abs(place[1]) <= MAX_LATITUDE


def in_degrees(terrain: Terrain, *places: Sequence[float]) -> bool:
    """Return True if places without a stated system are longitudes and latitudes.

    They are if all values are in the range of degrees, the terrain has a coordinate system, and no
    place is on the terrain as easting and northing.
    """
    return (
        terrain.has_system
        and all(map(is_degrees, places))
        and not any(terrain.covers(*terrain.to_map(x, y)) for x, y in places)
    )


def projected(terrain: Terrain, longitude: float, latitude: float) -> tuple[float, float]:
    """Return the easting and northing [m] of a place.

    Raises:
        LavaError: If the terrain has no coordinate system, or the place is outside its domain.
    """
    place = (longitude, latitude)
    ((x, y),) = on_terrain(terrain, np.array([place]), DEGREES, 'longitude, latitude', place)
    return (float(x), float(y))


def on_terrain(
    terrain: Terrain, places: np.ndarray, system: Any, where: str, shown: object
) -> np.ndarray:
    """Transform places [count, 2] from a system to that of a terrain.

    Raises:
        LavaError: If that is not possible. The error names ``where`` and ``shown``.
    """
    own = coordinate_system(terrain.epsg, terrain.wkt)
    if own is None:
        expected = 'coordinates of the terrain, which has no coordinate system'
        raise LavaError(where, shown, expected)
    expected = f'places in the domain of {system_name(terrain.epsg, terrain.wkt)}, of a '
    with refusing(where, shown, f'{expected}coordinate system that GDAL knows', ValueError):
        return transformed(system, own, *places.T).T


def transformed(source: Any, target: Any, x: Any, y: Any) -> np.ndarray:
    """Transform coordinates to another system: float64, shape [2, count].

    Raises:
        ValueError: If a place is outside the domain of a system, or a system is unknown.
    """
    rasterio = rasterio_for('coordinate systems')
    try:
        found = np.array(rasterio.warp.transform(source, target, x, y))
    # the errors of GDAL have no public class
    except Exception as error:
        raise ValueError(str(error)) from error
    if not np.isfinite(found).all():
        raise ValueError('a place is outside the domain of the projection')
    return found


def rasterio_for(reason: object) -> Any:
    """Import rasterio and the submodules for coordinate systems and resampling."""
    require('rasterio', 'terrain file', str(reason))
    import rasterio.crs
    import rasterio.transform
    import rasterio.warp

    return rasterio
