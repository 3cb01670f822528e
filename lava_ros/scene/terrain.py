# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Elevation of the ground on a regular grid."""

from dataclasses import dataclass, replace
from functools import cached_property, partial
import math
from typing import NamedTuple

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError
from lava_ros.files.systems import plain_system

#: Maximum number of cells along a side: users of nav_msgs/MapMetaData index with 16-bit integers.
MAX_SIDE_CELLS = 32767

#: Squares along each side of a cell, and the number of them that is at least half of a cell. What
#: covers a cell, lava or a mapped outline, is counted in squares.
PARTS = 5
HALF = (PARTS * PARTS + 1) // 2

#: Minimum and maximum side of a cell [m]: from a laboratory table to a planet.
RESOLUTION_RANGE = (1e-4, 1e5)

#: Maximum absolute elevation [m]; that of Mars is 22 km.
MAX_ELEVATION = 1e5

#: Minimum EPSG code.
MIN_EPSG = 1024

#: Maximum length of the WKT of a coordinate system [characters].
MAX_WKT = 100_000

#: Check of a sea level.
SEA_LEVEL_CHECK = partial(
    validation.number, at_least=-MAX_ELEVATION, at_most=MAX_ELEVATION, unit='m'
)

#: Minimum distance between origins of map frames that differ [m].
APART = 1e-3

#: Maximum absolute map or projected coordinate [m].
MAX_COORDINATE = 1e9


class Georeference(NamedTuple):
    """Coordinate system of the map frame, and easting and northing [m] of its origin.

    The fields are those of ``Terrain``.
    """

    epsg: int | None = None
    offset: tuple[float, float] = (0.0, 0.0)
    wkt: str | None = None

    @property
    def system(self) -> str | None:
        """The coordinate system in the notation of GDAL; None if it is unknown."""
        return self.wkt if self.epsg is None else f'EPSG:{self.epsg}'


class Cells:
    """Base of classes with an elevation on square cells in the map frame."""

    elevation: np.ndarray
    resolution: float
    origin: tuple[float, float]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the grid."""
        return self.elevation.shape

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Smallest x, smallest y, largest x and largest y of the grid [m]."""
        rows, columns = self.shape
        x, y = self.origin
        return (x, y, x + columns * self.resolution, y + rows * self.resolution)

    @property
    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """Map coordinates of the centres of columns and of rows [m]."""
        rows, columns = self.shape
        x = self.origin[0] + (np.arange(columns) + 0.5) * self.resolution
        return x, self.origin[1] + (np.arange(rows) + 0.5) * self.resolution


@dataclass(frozen=True, eq=False)
class Terrain(Cells):
    """Ground elevation on a regular grid of square cells in the map frame (ENU).

    Attributes:
        elevation: Elevation of the cell centres [m], float32, shape [rows, columns]; row 0 has the
            smallest y. NaN marks cells without data: lava that reaches them leaves the domain.
        resolution: Side of a cell [m].
        origin: Map position (x, y) [m] of the lower-left corner of cell [0, 0].
        epsg: EPSG code of the projected coordinate system.
        offset: Easting and northing [m] of the map frame's origin in that system.
        source: Origin of the data, for people; may be empty.
        barriers: Crest lines of the barriers in the elevation, each two or more eastings and
            northings [m]. Maps draw them.
        wkt: Full definition (WKT) of a coordinate system that ``epsg`` does not define completely:
            a local system without a code, or a projected one with a vertical datum.
        sea_level: Elevation [m] at or below which a cell is sea, which lava leaves the domain for,
            as for a cell without data; None without a sea.
    """

    elevation: np.ndarray
    resolution: float
    origin: tuple[float, float] = (0.0, 0.0)
    epsg: int | None = None
    offset: tuple[float, float] = (0.0, 0.0)
    source: str = ''
    barriers: tuple[tuple[tuple[float, float], ...], ...] = ()
    wkt: str | None = None
    sea_level: float | None = None

    def __post_init__(self) -> None:
        """Validate and normalise all fields; raise LavaError for an invalid one."""
        put = object.__setattr__
        field = 'terrain.elevation'
        try:
            if np.asarray(self.elevation).dtype.kind not in 'fiubO':
                raise TypeError
            with np.errstate(over='ignore', invalid='ignore'):
                elevation = np.array(self.elevation, dtype=np.float32, order='C')
        except (TypeError, ValueError, OverflowError):
            found = type(self.elevation).__name__
            raise LavaError(field, found, 'a 2-D array of numbers [m]') from None
        sides = elevation.shape
        if len(sides) != 2 or not 2 <= min(sides) <= max(sides) <= MAX_SIDE_CELLS:
            expected = f'a 2-D array of 2 to {MAX_SIDE_CELLS} cells per side'
            raise LavaError(field, f'array of shape {sides}', expected)
        # NaN compares as False.
        beyond = np.abs(elevation) > MAX_ELEVATION
        if beyond.any():
            expected = f'at most {MAX_ELEVATION:g} m above or below zero, NaN where unknown'
            raise LavaError(field, float(elevation[beyond][0]), expected)
        if np.isnan(elevation).all():
            raise LavaError(field, math.nan, 'at least one cell with data')
        elevation.setflags(write=False)
        put(self, 'elevation', elevation)
        least, most = RESOLUTION_RANGE
        field, value = 'terrain.resolution', self.resolution
        value = validation.number(field, value, at_least=least, at_most=most, unit='m')
        put(self, 'resolution', value)
        for name in ('origin', 'offset'):
            place = validation.pair(f'terrain.{name}', getattr(self, name), most=MAX_COORDINATE)
            put(self, name, place)
        check_epsg('terrain.epsg', self.epsg)
        put(self, 'barriers', crest_lines('terrain.barriers', self.barriers))
        if self.wkt is not None and not (
            isinstance(self.wkt, str) and 0 < len(self.wkt) <= MAX_WKT
        ):
            expected = f'a coordinate system in WKT, at most {MAX_WKT} characters, or None'
            raise LavaError('terrain.wkt', str(self.wkt)[:40], expected)
        if self.wkt is not None:
            plain_system('terrain.wkt', self.wkt)
        if self.sea_level is not None:
            put(self, 'sea_level', SEA_LEVEL_CHECK('terrain.sea_level', self.sea_level))
            if not self.has_data.any():
                expected = f'below {float(np.nanmax(elevation)):g} m, the highest ground'
                raise LavaError('terrain.sea_level', self.sea_level, expected)

    @property
    def has_system(self) -> bool:
        """True if the coordinate system is known."""
        return self.epsg is not None or self.wkt is not None

    @property
    def georeference(self) -> Georeference:
        """Coordinate system and offset."""
        return Georeference(self.epsg, self.offset, self.wkt)

    def with_georeference(self, georeference: Georeference) -> 'Terrain':
        """Return the same ground with another georeference.

        Map positions do not change, those of the barriers included.
        """
        shift = np.subtract(georeference.offset, self.offset)
        barriers = tuple(tuple(map(tuple, (crest + shift).tolist())) for crest in self.barriers)
        return replace(self, **georeference._asdict(), barriers=barriers)

    @property
    def centre(self) -> tuple[float, float]:
        """Map position [m] of the centre, the origin of the solver's particle positions."""
        x0, y0, x1, y1 = self.extent
        return (0.5 * (x0 + x1), 0.5 * (y0 + y1))

    @property
    def corner(self) -> tuple[float, float]:
        """Easting and northing [m] of the lower-left corner of cell [0, 0]."""
        return (self.origin[0] + self.offset[0], self.origin[1] + self.offset[1])

    @cached_property
    def has_data(self) -> np.ndarray:
        """True on ground: with data and not in the sea, bool, shape [rows, columns]."""
        mask = np.isfinite(self.elevation) & ~self.is_sea
        mask.setflags(write=False)
        return mask

    @cached_property
    def is_sea(self) -> np.ndarray:
        """True in the sea, bool, shape [rows, columns]."""
        level = -math.inf if self.sea_level is None else self.sea_level
        mask = self.elevation <= level
        mask.setflags(write=False)
        return mask

    @cached_property
    def ground(self) -> np.ndarray:
        """The elevation [m], NaN also in the sea, float32, shape [rows, columns]."""
        if self.sea_level is None:
            return self.elevation
        ground = np.where(self.has_data, self.elevation, np.float32(np.nan))
        ground.setflags(write=False)
        return ground

    def cell_at(self, x: float, y: float) -> tuple[int, int] | None:
        """Return the row and column of the cell at a map position, None outside the grid."""
        column = math.floor((x - self.origin[0]) / self.resolution)
        row = math.floor((y - self.origin[1]) / self.resolution)
        rows, columns = self.shape
        return (row, column) if 0 <= row < rows and 0 <= column < columns else None

    def covers(self, x: float, y: float) -> bool:
        """Return True if a map position is on a cell with data."""
        cell = self.cell_at(x, y)
        return cell is not None and bool(self.has_data[cell])

    def elevations_at(self, places: np.ndarray) -> np.ndarray:
        """Return the ``ground`` of the cells at map positions [m], as ``values_at``."""
        return self.values_at(self.ground, places)

    def values_at(self, values: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return the values of the cells at map positions [m], NaN off the grid.

        Args:
            values: A map, shape [rows, columns].
            places: Map positions (x, y) [m], shape [..., 2].
        """
        cells = np.floor((places - np.asarray(self.origin)) / self.resolution)
        rows, columns = self.shape
        on_grid = ((cells >= 0) & (cells < (columns, rows))).all(axis=-1)
        column, row = np.moveaxis(np.where(on_grid[..., None], cells, 0).astype(np.int64), -1, 0)
        return np.where(on_grid, values[row, column], np.nan)

    def covered(self, places: np.ndarray) -> np.ndarray:
        """Mark the map positions, shape [count, 2], on a cell with data: bool, shape [count]."""
        return np.isfinite(self.elevations_at(places))

    def bounds(self, *, projected: bool = False) -> str:
        """Describe the extent in map or projected coordinates, for messages."""
        x0, y0, x1, y1 = self.extent
        names = ('easting', 'northing') if projected else ('x', 'y')
        east, north = self.offset if projected else (0.0, 0.0)
        return (
            f'on the terrain, which covers {names[0]} {x0 + east:.10g} to {x1 + east:.10g} m and '
            f'{names[1]} {y0 + north:.10g} to {y1 + north:.10g} m (cells without data excluded'
            + ('' if self.sea_level is None else f', and the sea up to {self.sea_level:g} m') + ')'
        )

    def to_map(self, easting: float, northing: float) -> tuple[float, float]:
        """Convert projected coordinates [m] to map coordinates [m]."""
        return (easting - self.offset[0], northing - self.offset[1])


def has_same_cells(one: Terrain, other: Terrain) -> bool:
    """Return True if two terrains have the same cells; elevations and missing data may differ."""
    cells = [(item.shape, item.resolution, item.origin) for item in (one, other)]
    return cells[0] == cells[1]


def is_same_ground(one: Terrain, other: Terrain, *, within: float = 0.0) -> bool:
    """Return True for the same cells and sea, with elevations within a limit [m]."""
    is_same = has_same_cells(one, other) and one.sea_level == other.sea_level
    return is_same and np.allclose(
        one.elevation, other.elevation, rtol=0.0, atol=within, equal_nan=True
    )


def conflict_of_frames(terrain: Terrain, former: Terrain) -> RefusalError | None:
    """Return the error about a terrain that places the map frame elsewhere than a former one.

    Lava and vents keep their places in the map frame, and would move on the Earth. A terrain
    without a coordinate system is taken to be in the same frame.
    """
    own, known = terrain.georeference, former.georeference
    is_known = terrain.has_system and former.has_system
    is_same = own.system == known.system and math.dist(own.offset, known.offset) <= APART
    if is_same or not is_known:
        return None
    shown, expected = (
        f'{str(item.system)[:40]}, offset {item.offset[0]:.10g} {item.offset[1]:.10g}'
        for item in (own, known)
    )
    problem = f'The map frame of the terrain ({shown}) is not that of the lava ({expected})'
    return RefusalError('terrain', problem, 'Keep the map frame, or start the node again')


def check_epsg(field: str, code: object) -> None:
    """Raise LavaError, which names ``field``, for neither an EPSG code nor None."""
    is_code = isinstance(code, int) and not isinstance(code, bool) and MIN_EPSG <= code < 2**31
    if code is not None and not is_code:
        raise LavaError(field, code, 'an EPSG code such as 32633')


def crest_lines(field: str, lines: object) -> tuple[tuple[tuple[float, float], ...], ...]:
    """Return the crest lines of barriers as tuples of two or more (x, y) pairs [m].

    Raises:
        LavaError: If ``lines`` is not a list of such lines. The error names ``field``.
    """
    expected = 'a list of crests, each two or more [easting, northing] m'
    return tuple(
        tuple(
            validation.pair(*place, most=MAX_COORDINATE)
            for place in validation.items(*line, expected, least=2)
        )
        for line in validation.items(field, lines, expected)
    )
