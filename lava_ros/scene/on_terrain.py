# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rasters and polygons from files, as stored and on the cells of a terrain."""

from collections.abc import Sequence
from contextlib import suppress
import logging
import math
from pathlib import Path
import re
from typing import Any, NamedTuple

import numpy as np

from lava_ros.errors import LavaError, RefusalError, refusing
from lava_ros.files import open_input
from lava_ros.files.columns import LENGTHS, normal_unit
from lava_ros.files.optional import require
from lava_ros.files.raster_formats import PICTURES
from lava_ros.files.rasters import read_raster
from lava_ros.scene.features import Feature, read_features
from lava_ros.scene.projection import coordinate_system, horizontal, on_terrain, vertical_unit
from lava_ros.scene.terrain import HALF, PARTS, Terrain

_LOG = logging.getLogger(__name__)

#: Maximum side of a picture at which it is read [pixels].
MAX_PIXELS = 4000


#: Approximate number of cells of a raster, and columns and rows of points of areas, of which the
#: part beyond a terrain is counted.
MAX_SAMPLES, SAMPLES = 1_000_000, (300, 300)


#: Maximum number of squares of cells that are compared with areas at once.
_MAX_SQUARES = 10_000_000


class Band(NamedTuple):
    """The only band of a raster: a masked array as stored, shape [rows, columns].

    ``scale`` and ``offset`` convert it, to metres if the values are lengths; ``place`` is the
    affine transformation of the rows and columns.
    """

    stored: Any
    scale: float
    offset: float
    place: Any
    crs: Any
    description: str
    tags: dict[str, str]

    def converted(self, stored: Any) -> Any:
        """Convert stored values in place, and return them."""
        # the caller refuses infinite values
        with np.errstate(over='ignore', invalid='ignore'):
            stored *= stored.dtype.type(self.scale)
            stored += stored.dtype.type(self.offset)
        return stored


def read_band(
    field: str, path: Path, *, lengths: str = '', kind: type[np.floating[Any]] = np.float64
) -> Band:
    """Read the only band of a georeferenced raster as values of a kind; errors name ``field``.

    ``lengths`` states what the values are if they are lengths, such as elevations.

    Raises:
        LavaError: If the file cannot be read, has several bands, no numbers or no position, or if
            lengths have 8 bits, an unknown unit or two units.
    """
    source = read_raster(field, path, kind=kind)
    stored, scale, offset = np.dtype(source.dtypes[0]), source.scales[0], source.offsets[0]
    expected = ''
    if source.count != 1:
        expected = f'a raster with one band of {lengths or "numbers"}, not {source.count}'
        expected += ' (gdal_translate -b 1 keeps the first one'
        if 'alpha' in source.colours:
            expected += f'; band {source.colours.index("alpha") + 1} only marks cells with data'
        expected += ')'
    elif stored.kind not in 'iuf':
        expected = f'numbers, not {stored}'
    elif lengths and stored.itemsize == 1 and (scale, offset) == (1.0, 0.0):
        expected = f'{lengths}: {stored} is the type of a picture or a mask '
        expected += '(gdal_translate -ot Int16 if these are lengths)'
    if expected:
        raise LavaError(field, str(path), expected)
    _check_placed(field, path, source.place)
    unit, crs = _unit_of(source, path, lengths) if lengths else 1.0, source.crs
    return Band(
        source.values[0], scale * unit, offset * unit,
        # a vertical system in feet no longer holds
        source.place, crs if unit == 1.0 or not crs else horizontal(crs),
        source.descriptions[0] or '', dict(source.tags),
    )


def _check_placed(field: str, path: str | Path, place: Any) -> None:
    """Raise LavaError if an affine transformation is not that of a georeferenced raster."""
    is_placed = all(map(math.isfinite, place)) and not (place.is_identity or place.is_degenerate)
    if not is_placed:
        raise LavaError(field, str(path), 'a georeferenced raster')


def _unit_of(source: Any, path: Path, lengths: str) -> float:
    """Return the unit [m] that the coordinate system, the band or a ``.prj`` file declares."""
    names = [source.units[0] or '']
    if (prj := path.with_suffix('.prj')).is_file():
        with open_input(prj) as file:
            text = file.read(1 << 16).decode(errors='replace')
        # an old ESRI file; "NO" means no heights
        names += re.findall(r'(?im)^\s*zunits\s+(?!no\b)(\S+)', text)
    marks = dict([vertical_unit(source.crs)]) if source.crs else {}
    marks |= {name: LENGTHS.get(normal_unit(name), math.nan) for name in names}
    known = {name: factor for name, factor in marks.items() if name.strip()} or {'m': 1.0}
    unit = next(iter(known.values()))
    # the foot and the US survey foot differ by 2 parts in a million
    if not all(math.isclose(factor, unit, rel_tol=1e-5) for factor in known.values()):
        expected = f'one unit of length, of {", ".join(LENGTHS)}'
        raise LavaError(f'unit of the {lengths} of {path.name}', ' and '.join(known), expected)
    if unit != 1.0:
        _LOG.info(f'{path.name}: {lengths} in {" and ".join(known)} become metres')
    return unit


def read_raster_on(
    terrain: Terrain, path: str | Path, *, field: str, method: str = 'nearest'
) -> np.ndarray:
    """Read a raster at the centres of a terrain's cells: float64, NaN without data.

    With the ``method`` ``average``, a cell has the mean of the raster over its area, of which no
    data count as 0. A raster without a coordinate system is assumed to be in that of the terrain.
    Errors name ``field``.

    Raises:
        LavaError: If the file cannot be read, has more than one band, has no data on the terrain,
            or has an unknown coordinate system.
    """
    band = read_band(field, Path(path))
    values = band.converted(band.stored).filled(0.0 if method == 'average' else np.nan)
    # probabilities and masks must not be interpolated
    result = resampled(terrain, values, band, path, field=field, method=method)
    if np.isnan(result[terrain.has_data]).all():
        raise LavaError(field, str(path), 'a raster with data on the terrain')
    _warn_of_parts_beyond(terrain, path, values > 0.0, band.place, band.crs)
    return result


def read_cover_on(terrain: Terrain, path: str | Path, *, field: str) -> np.ndarray:
    """Mark the cells of a terrain at least half of which a raster covers with values above 0.

    No data count as 0. The raster is otherwise read as by ``read_raster_on``.

    Returns:
        The cells, bool, shape [rows, columns].
    """
    band = read_band(field, Path(path))
    marked = (band.converted(band.stored).filled(0.0) > 0.0).astype(np.float64)
    part = resampled(terrain, marked, band, path, field=field, method='average')
    # rounding, for example of cells of 1/3 m
    return np.nan_to_num(part) >= 0.5 - 1e-6


def _warn_of_parts_beyond(
    terrain: Terrain, path: str | Path, marked: np.ndarray, place: Any, crs: Any = None
) -> None:
    """Warn if marked cells, placed by an affine transformation, are beyond a terrain's grid."""
    from rasterio.transform import xy

    step = math.isqrt(marked.size // MAX_SAMPLES) + 1
    cells = step * np.argwhere(marked[::step, ::step])
    places = np.stack(xy(place, *cells.T), axis=-1)
    with suppress(LavaError):
        # a place outside the domain of the projection is far away, as for a map of the world
        if crs and len(places):
            places = on_terrain(terrain, places, horizontal(crs), '', '')
        low, high = np.reshape(terrain.extent, (2, 2)) + terrain.offset
        beyond = ((places < low) | (places > high)).any(axis=1)
        if beyond.any():
            _LOG.warning(
                f'{path}: {100.0 * beyond.mean():.2g} % of its area is beyond the terrain, and is '
                'left out'
            )


class PlacedPicture(NamedTuple):
    """A picture on the ground.

    Attributes:
        path: Path of its file.
        bands: Red, green and blue, uint8, masked arrays of shape [rows, columns].
        place: Affine transformation of the rows and columns; None covers exactly a terrain.
        crs: Coordinate system, None for that of the terrain.
    """

    path: str
    bands: Sequence[Any]
    place: Any
    crs: Any

    def on(self, terrain: Terrain, *, field: str) -> np.ndarray:
        """Return the colours of a terrain's cells, float64, [rows, columns, 3], NaN outside.

        Raises:
            LavaError: As ``resampled``.
        """
        placed = self
        if self.place is None:
            place, shape = affine_of(terrain), self.bands[0].shape
            rows, columns = np.divide(terrain.shape, shape)
            placed = self._replace(place=place * place.scale(columns, rows), crs=None)
        colours = [
            resampled(terrain, band, placed, self.path, field=field, method='bilinear')
            for band in (item.astype(np.float64).filled(np.nan) for item in self.bands)
        ]
        return np.stack(colours, axis=-1)


def read_placed_picture(path: str, *, field: str) -> PlacedPicture:
    """Read a picture: a GeoTIFF, PNG or JPEG, which may be georeferenced.

    A file of more than ``MAX_PIXELS`` a side is thinned. Errors name ``field``.

    Raises:
        LavaError: If the file cannot be read, or does not have 8 bits a colour.
    """
    source = read_raster(field, path, PICTURES, max_bands=4, max_side=MAX_PIXELS)
    place: Any = source.place
    bands: Any = source.values
    if not place.is_identity:
        _check_placed(field, path, place)
    if set(source.dtypes) != {'uint8'}:
        raise LavaError(field, path, f'a picture of 8 bits per colour, not {source.dtypes[0]}')
    is_placed = not place.is_identity
    rows, columns = np.divide(source.shape, bands.shape[1:])
    place *= place.scale(columns, rows)
    if source.colours[0] == 'palette':
        palette = np.zeros((256, 4), np.uint8)
        for number, colour in source.palette.items():
            palette[number] = colour
        numbers = bands[0]
        bands = [np.ma.array(palette[numbers.data, i], mask=numbers.mask) for i in range(3)]
    bands = bands[:3] if len(bands) > 2 else [bands[0]] * 3
    return PlacedPicture(path, bands, place if is_placed else None, source.crs)


def resampled(
    terrain: Terrain, values: np.ndarray, source: Band | PlacedPicture, path: str | Path, *,
    field: str, method: str,
) -> np.ndarray:
    """Resample a raster to a terrain's cells: float64, NaN without data.

    Args:
        terrain: Target grid.
        values: Raster in the rows and columns of the file, float64, NaN without data.
        source: Position and coordinate system of the raster, None for that of the terrain.
        path: Path of the file, for errors.
        field: Name of the field in errors.
        method: Method of ``rasterio.warp.Resampling``.

    Raises:
        LavaError: If the raster has a coordinate system and the terrain has none, or if one
            cannot be transformed to the other.
    """
    from rasterio.warp import reproject, Resampling

    own, crs = coordinate_system(terrain.epsg, terrain.wkt), source.crs
    if own is None and crs:
        problem = f'{path} has a coordinate system, but the terrain has none'
        raise RefusalError(field, problem, 'Give the EPSG code of the terrain')
    # neither has a system: any gives the same result
    target_crs = own or coordinate_system(32631)
    result = np.full(terrain.shape, np.nan)
    with refusing(field, str(path), 'a raster that GDAL can resample to the terrain'):
        reproject(
            values,
            result,
            src_transform=source.place,
            src_crs=horizontal(crs) if crs else target_crs,
            src_nodata=np.nan,
            dst_transform=affine_of(terrain),
            dst_crs=target_crs,
            dst_nodata=np.nan,
            resampling=Resampling[method],
        )
    return np.flipud(result)


def read_polygons_on(terrain: Terrain, path: str | Path, *, field: str) -> np.ndarray:
    """Mark the cells of a terrain that the polygons of a file cover, as ``mark_cells``."""
    return mark_cells(terrain, read_polygons(field, path, terrain))


def read_polygons(field: str, path: str | Path, terrain: Terrain) -> list[Feature]:
    """Read the polygons of a file as ``read_features``; its points and lines are ignored.

    Raises:
        LavaError: Also if the file has no polygon.
    """
    areas = [item for item in read_features(field, path, terrain) if item.kind == 'Polygon']
    if not areas:
        raise LavaError(field, str(path), 'a file with at least one area')
    require('rasterio', 'polygons')
    from rasterio.transform import from_bounds

    places = np.concatenate([ring for item in areas for ring in item.rings])
    (west, south), (east, north) = places.min(axis=0), places.max(axis=0)
    if west < east and south < north:
        samples = from_bounds(west, south, east, north, *SAMPLES)
        _warn_of_parts_beyond(terrain, path, _mask(areas, SAMPLES[::-1], samples), samples)
    return areas


def mark_cells(terrain: Terrain, polygons: Sequence[Feature]) -> np.ndarray:
    """Mark the cells of a terrain at least half of which some polygons cover: bool.

    Each cell counts as ``PARTS`` by ``PARTS`` squares, which are covered if their centres are.

    Raises:
        LavaError: If rasterio is not installed.
    """
    rows, columns = terrain.shape
    place, found = affine_of(terrain), np.zeros(terrain.shape, dtype=bool)
    step = max(_MAX_SQUARES // (columns * PARTS**2), 1)
    for first in range(0, rows, step):
        count = min(step, rows - first)
        fine = place * place.translation(0.0, first) * place.scale(1.0 / PARTS)
        squares = _mask(polygons, (count * PARTS, columns * PARTS), fine)
        squares = squares.reshape(count, PARTS, columns, PARTS)
        found[first : first + count] = np.count_nonzero(squares, axis=(1, 3)) >= HALF
    return np.flipud(found)


def _mask(polygons: Sequence[Feature], shape: tuple[int, int], place: Any) -> np.ndarray:
    """Mark the cells of a raster whose centre is in one of some polygons: bool, of ``shape``."""
    require('rasterio', 'polygons')
    from rasterio.features import geometry_mask

    areas = [
        {'type': 'Polygon', 'coordinates': [ring.tolist() for ring in item.rings]}
        for item in polygons
    ]
    return np.asarray(geometry_mask(areas, shape, place, invert=True))


def affine_of(terrain: Terrain) -> Any:
    """Return the affine transformation of a terrain with row 0 in the north."""
    from rasterio.transform import from_origin

    cell = terrain.resolution
    west, south = terrain.corner
    return from_origin(west, south + terrain.shape[0] * cell, cell, cell)
