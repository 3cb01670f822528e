# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Elevation files: reading of GDAL rasters and npz files, and warnings of suspect data."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial, reduce
from itertools import product
import json
import logging
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files import check_exists
from lava_ros.files.keys import any_of, Key, Keys, list_of, number, TEXT
from lava_ros.files.npz import read_arrays
from lava_ros.files.yaml import parse_json
from lava_ros.scene.missing_data import check_missing, NODATA_ADVICE
from lava_ros.scene.on_terrain import read_band
from lava_ros.scene.plausibility import doubts_of_sea, doubts_of_terrain, report
from lava_ros.scene.projection import (
    coordinate_system,
    crop,
    epsg_of,
    metres_per_unit,
    Raster,
    rasterio_for,
    to_square_metric_cells,
    with_epsg,
)
from lava_ros.scene.terrain import (
    check_epsg,
    crest_lines,
    MIN_EPSG,
    SEA_LEVEL_CHECK,
    Terrain,
)

_LOG = logging.getLogger(__name__)

#: Demonstration terrain of the package.
DEMO = Path(__file__).with_name('st_helens.npz')

#: GeoTIFF tag or .npz key of the barrier crests, as JSON.
_BARRIERS = 'lava_ros_barriers'

#: GeoTIFF tag of the sea level [m].
_SEA_LEVEL = 'lava_ros_sea_level'

NPZ_KEYS = (
    'elevation', 'resolution', 'origin', 'epsg', 'wkt', 'offset', 'source', 'sea_level', _BARRIERS,
)

#: Options of ``load_terrain`` that a scene file may give; the function checks their values.
TERRAIN_OPTIONS: dict[str, Key] = {
    'epsg': Key(
        {'type': 'integer', 'minimum': MIN_EPSG},
        'EPSG code of the coordinates; replaces the one in the file',
    ),
    'resolution': Key(
        partial(validation.number, above=0.0, unit='m'), 'Side of the cells to make [m]'
    ),
    'offset': Key(validation.pair, 'Easting and northing of the origin of the map frame [m]'),
    'window': Key(
        list_of(number(), 4, 4),
        'Part to keep: smallest easting and northing, largest easting and northing [m]',
    ),
    'fill_holes': Key(validation.flag, 'Fill cells without data that data surround'),
    'nodata': Key(
        any_of(number(), {'const': 'none'}),
        'Value of cells without data that the file does not declare; none: all have data',
    ),
    'sea_level': Key(
        SEA_LEVEL_CHECK,
        'Elevation at or below which the ground is sea [m], where lava leaves the map',
    ),
}

#: Keys of the terrain in a scene file.
TERRAIN_KEYS = Keys({
    'file': Key(TEXT, 'File, relative to this one', True), **TERRAIN_OPTIONS,
})

#: Minimum elevation, and maximum elevation on Earth [m].
LOWEST, HIGHEST = -12_000.0, 9_000.0


def terrain_path(name: str, folder: Path = Path()) -> Path:
    """Return the path of an elevation file, relative to a folder.

    ``st_helens.npz`` is the file of the package unless the folder has one.
    """
    path = folder / name
    return DEMO if name == DEMO.name and not path.exists() else path


def load_terrain(
    path: str | Path,
    *,
    epsg: int | None = None,
    resolution: float | None = None,
    offset: tuple[float, float] | None = None,
    window: tuple[float, float, float, float] | None = None,
    fill_holes: bool = False,
    nodata: float | str | None = None,
    sea_level: float | None = None,
    insist: bool = False,
) -> Terrain:
    """Read an elevation file, log its properties, and warn of suspect data.

    The formats of ``files.raster_formats.FORMATS`` need rasterio. Files in degrees, and those
    whose projection stretches lengths (Web Mercator), are reprojected to their UTM zone. Cells
    become square with the shorter side. Elevations in feet, by the unit of the band, the vertical
    coordinate system or an ESRI ``.prj`` file, become metres.

    An .npz file has ``elevation`` and ``resolution``, and optionally ``origin``, ``offset``,
    ``epsg``, ``wkt``, ``source`` and ``sea_level``, as in ``Terrain``.

    Args:
        path: Path of the file.
        epsg: EPSG code that replaces that of the file.
        resolution: Side of a cell of the result [m], None for that of the file.
        offset: Easting and northing [m] of the map frame's origin, None for the lower-left corner
            of the grid, or for the origin and offset of an .npz file.
        window: Part to keep: minimum easting and northing, maximum easting and northing [m], None
            for all. Cells on its border are kept.
        fill_holes: True to interpolate enclosed cells without data, and pits of a single cell.
        nodata: Value of cells without data as stored in the file, in addition to that which the
            file declares; ``'none'`` if all undeclared values are ground.
        sea_level: Elevation [m] at or below which a cell is sea, None for that of an .npz file or
            of a file of ``lava barrier``, otherwise no sea.
        insist: True to accept elevations and cells that cannot be.

    Raises:
        LavaError: If the file cannot be read, or its contents cannot be used.
    """
    path = Path(path)
    check_exists('terrain file', path)
    check_epsg('terrain.epsg', epsg)
    given = {
        'resolution': resolution, 'offset': offset, 'fill_holes': fill_holes,
        'sea_level': sea_level,
    }
    valid = TERRAIN_KEYS.values('terrain', {k: v for k, v in given.items() if v is not None})
    resolution, offset, sea_level = map(valid.get, ('resolution', 'offset', 'sea_level'))
    if nodata is not None and nodata != 'none':
        nodata = validation.number('terrain.nodata', nodata)
    is_npz = path.suffix.lower() == '.npz'
    read = _read_npz if is_npz else partial(_read_gdal, epsg=epsg)
    raster = read(path, nodata, sea_level)
    source = with_epsg(raster, epsg)
    _check_heights(source, path)
    raster = to_square_metric_cells(source, resolution)
    if window is not None:
        raster = crop(raster, window)
    if offset is None:
        offset = raster.corner if raster.offset is None else raster.offset
    try:
        terrain = Terrain(
            elevation=raster.elevation,
            resolution=raster.dx,
            origin=(raster.corner[0] - offset[0], raster.corner[1] - offset[1]),
            epsg=raster.epsg,
            offset=offset,
            source=raster.source or path.name,
            barriers=raster.barriers,
            wkt=raster.wkt,
            sea_level=raster.sea_level if sea_level is None else sea_level,
        )
    except LavaError as error:
        if error.field != 'terrain.elevation':
            raise
        raise error.named(f'elevation of {path.name}') from None
    wrong = _holes_and_pits(terrain)
    if fill_holes and wrong.any():
        terrain = replace(terrain, elevation=_interpolate(terrain, wrong))
    _log_summary(path, terrain, source, wrong, fill_holes)
    report(doubts_of_terrain(terrain, path.name), insist=insist)
    if nodata is None and terrain.sea_level is None:
        report(doubts_of_sea(source.elevation, path.name, is_on_earth=source.is_placed))
    return terrain


def _read_npz(path: Path, nodata: float | str | None, sea_level: float | None) -> Raster:
    arrays = read_arrays('terrain file', path)
    data: Any = validation.keys(
        'terrain file', arrays, allowed=NPZ_KEYS, required=['elevation', 'resolution']
    )
    elevation = data.pop('elevation')
    if elevation.ndim != 2 or elevation.dtype.kind not in 'iuf':
        found = f'{elevation.dtype} array of shape {elevation.shape}'
        raise LavaError('terrain file elevation', found, 'numbers [m] of shape [rows, columns]')
    data = {name: item.tolist() for name, item in data.items()}
    cell = validation.number('resolution', data['resolution'], above=0.0, unit='m')
    epsg = data.get('epsg')
    level = data.get('sea_level', sea_level) if sea_level is None else sea_level
    offset, origin = (
        validation.pair(name, data.get(name, (0.0, 0.0))) for name in ('offset', 'origin')
    )
    return Raster(
        elevation=_with_missing(elevation.astype(np.float32), cell, nodata, path, sea=level),
        dx=cell,
        dy=cell,
        corner=(origin[0] + offset[0], origin[1] + offset[1]),
        epsg=epsg,
        offset=offset,
        source=str(data.get('source', '')),
        barriers=_barriers(data, epsg, path),
        wkt=str(data['wkt']) if 'wkt' in data else None,
        sea_level=data.get('sea_level'),
    )


def _read_gdal(
    path: Path, nodata: float | str | None, sea_level: float | None, *, epsg: int | None
) -> Raster:
    band = read_band('terrain file', path, lengths='elevations', kind=np.float32)
    place, crs = band.place, band.crs
    if place.b or place.d or place.a <= 0.0:
        raise LavaError('terrain file', str(path), 'a grid with north up (gdalwarp makes one)')
    code = epsg_of(crs, (place.c, place.f)) if crs else None
    own = _sea_level(band.tags, path)
    cell = abs(place.e) * metres_per_unit(crs if epsg is None else coordinate_system(epsg))
    # missing data have a stored value, without unit and scale
    stored = _with_missing(
        band.stored.filled(np.nan), cell, nodata, path, band.scale,
        sea=own if sea_level is None else sea_level,
    )
    elevation = band.converted(stored)
    if place.e < 0.0:
        elevation = np.flipud(elevation)
    return Raster(
        elevation=elevation,
        dx=place.a,
        dy=abs(place.e),
        corner=(place.c, min(place.f, place.f + place.e * elevation.shape[0])),
        epsg=code,
        wkt=crs.to_wkt() if crs and None in (code, crs.to_epsg()) else None,
        barriers=_barriers(band.tags, code, path),
        sea_level=own,
    )


def barrier_tags(terrain: Terrain) -> dict[str, str]:
    """Return the barriers of a terrain as tags of its file, which ``load_terrain`` reads."""
    if not terrain.barriers:
        return {}
    return {_BARRIERS: json.dumps({'epsg': terrain.epsg, 'crests': terrain.barriers})}


def geotiff_tags(terrain: Terrain) -> dict[str, str]:
    """Return the GeoTIFF tags of a terrain: its barriers and its sea level."""
    level = terrain.sea_level
    return barrier_tags(terrain) | ({} if level is None else {_SEA_LEVEL: f'{level:.17g}'})


def _sea_level(tags: Mapping[str, object], path: Path) -> float | None:
    """Return the sea level of a file, which bounds the flow; None without one.

    Raises:
        LavaError: If it is damaged.
    """
    if _SEA_LEVEL not in tags:
        return None
    return SEA_LEVEL_CHECK(f'{_SEA_LEVEL} of {path.name}', str(tags[_SEA_LEVEL]))


def _barriers(
    tags: Mapping[str, object], epsg: int | None, path: Path
) -> tuple[tuple[tuple[float, float], ...], ...]:
    """Read the barriers of a file; only warn of damaged data, since only maps show them."""
    if _BARRIERS not in tags:
        return ()
    try:
        known = parse_json(_BARRIERS, str(tags[_BARRIERS]))
        if known['epsg'] != epsg:
            # other programs copy tags unchanged when they reproject a file
            raise LavaError(f'{_BARRIERS}.epsg', known['epsg'], f'{epsg}, that of the file')
        return crest_lines(_BARRIERS, known['crests'])
    except (LavaError, KeyError, TypeError, ValueError) as error:
        _LOG.warning(f'{path.name}: maps will not show its barriers: {error}')
        return ()


def _with_missing(
    elevation: np.ndarray, cell: float, nodata: float | str | None, path: Path, unit: float = 1.0,
    *, sea: float | None = None,
) -> np.ndarray:
    """Replace ``nodata`` by NaN; without it, raise LavaError for a likely undeclared value.

    A value at or below the ``sea`` level [m] may be that of the sea.
    """
    if isinstance(nodata, float):
        # a value beyond float32 is infinite, both here and in the array
        with np.errstate(over='ignore'):
            is_missing = elevation == np.float32(nodata)
        if not is_missing.any():
            _LOG.warning(f'{path.name}: no cell has the value {nodata:g} that nodata declares')
        return np.where(is_missing, np.float32(np.nan), elevation)
    if nodata is None:
        field = f'elevation of {path.name}'
        check_missing(field, elevation, cell, unit=unit, advice=NODATA_ADVICE, sea=sea)
    return elevation


def _check_heights(raster: Raster, path: Path) -> None:
    """Raise LavaError for impossible elevations."""
    known = raster.elevation[np.isfinite(raster.elevation)]
    if not known.size:
        return
    low, high = float(known.min()), float(known.max())
    if low < LOWEST:
        expected = f'at least {LOWEST:g} m ({NODATA_ADVICE.format(f"{low:g}")})'
        raise LavaError(f'the lowest elevation of {path.name}', low, expected)
    # a grid without coordinate system may be on another planet
    if high > HIGHEST and raster.is_placed:
        expected = f'at most {HIGHEST:g} m; multiply feet by 0.3048'
        raise LavaError(f'the highest elevation of {path.name}', high, expected)


def _log_summary(
    path: Path, terrain: Terrain, source: Raster, wrong: np.ndarray, is_filled: bool
) -> None:
    """Log the properties of a file, and warn of holes and pits (``wrong``) and other suspects."""
    system, sides = source.system, ''
    if source.epsg == terrain.epsg and not source.is_square:
        sides = f' (in the file {source.dx:g} by {source.dy:g})'
    if terrain.epsg and system != f'EPSG:{terrain.epsg}':
        system = f'{system} taken to EPSG:{terrain.epsg}'
    low, high = float(np.nanmin(terrain.elevation)), float(np.nanmax(terrain.elevation))
    rows, columns = terrain.shape
    holes = int(np.isnan(terrain.elevation).sum())
    _LOG.info(
        f'{path.name}: {system}, {columns} x {rows} cells of {terrain.resolution:g} m{sides}, '
        f'{holes or "none"} without data, elevations {low:.6g} to {high:.6g} m'
        + ('' if terrain.sea_level is None else
           f', {int(terrain.is_sea.sum())} in the sea up to {terrain.sea_level:g} m')
    )
    if wrong.any():
        count, (row, column) = int(wrong.sum()), np.argwhere(wrong)[0]
        middle = (np.array((column, row)) + 0.5) * terrain.resolution
        east, north = np.add(terrain.corner, middle)
        done = 'the simulation would lose or trap lava there '
        done += '(--fill-holes, or fill_holes: true, fills them)'
        if is_filled:
            done = 'they were filled from the cells around them'
        _LOG.warning(
            f'{path.name}: {count} cells inside have no data or lie deep below all their '
            f'neighbours, the first at {east:.10g}, {north:.10g}: {done}'
        )
    if low >= 0.0 and 1.0 < high <= 90.0 and terrain.epsg is not None:
        _LOG.warning(
            f'{path.name}: elevations {low:.6g} to {high:.6g} m: '
            'they may be slopes in degrees instead of heights'
        )


def _holes_and_pits(terrain: Terrain) -> np.ndarray:
    """Mark enclosed cells without data, and pits two cells deep: bool."""
    holes, known = np.zeros(terrain.shape, dtype=bool), np.isfinite(terrain.elevation)
    if not known.all():
        from scipy.ndimage import binary_fill_holes

        holes = binary_fill_holes(known) & ~known
    padded = np.pad(terrain.elevation, 1, constant_values=np.nan)
    rows, columns = terrain.shape
    neighbours = (
        padded[row : row + rows, column : column + columns]
        for row, column in product(range(3), range(3))
        if (row, column) != (1, 1)
    )
    # NaN propagates: cells next to a hole or the border are not pits
    lowest = reduce(np.minimum, neighbours)
    return holes | (terrain.elevation < lowest - 2.0 * terrain.resolution)


def _interpolate(terrain: Terrain, wrong: np.ndarray) -> np.ndarray:
    """Return the elevation with the marked cells interpolated from those around them."""
    rasterio_for('fill_holes')
    from rasterio.fill import fillnodata

    known = np.isfinite(terrain.elevation) & ~wrong
    around = np.where(known, terrain.elevation, np.float32(0.0))
    filled = fillnodata(around, mask=known, max_search_distance=1000.0)
    return np.where(wrong, filled, terrain.elevation)


def demo_terrain() -> Terrain:
    """Return Mount St. Helens after 1980, 7.8 km by 7.8 km, in cells of 30 m.

    Part of a DEM of the United States Geological Survey, in the public domain; UTM zone 10 north,
    NAD27.
    """
    return replace(load_terrain(DEMO), source='United States Geological Survey')
