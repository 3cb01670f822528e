# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Flows emplaced before the start: as lava that still flows, as ground, or as lava on ground.

Outlines with a volume have the profile of a perfectly plastic flow on level ground: the thickness
is proportional to the square root of the distance from the margin (Nye 1952, Journal of Glaciology
2, 103-107, for ice; Blake 1990, in Lava Flows and Domes, 88-126, for lava).
"""

from dataclasses import dataclass, field, replace
from functools import partial
import hashlib
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError
from lava_ros.files import vectors
from lava_ros.files.keys import FILE_NAME, Key, Keys
from lava_ros.scene.on_terrain import mark_cells, read_band, read_polygons, resampled
from lava_ros.scene.projection import coordinate_system, horizontal, metres_per_unit, on_terrain
from lava_ros.scene.reshaping import finer
from lava_ros.scene.terrain import MAX_SIDE_CELLS, Terrain
from lava_ros.scene.vent_keys import TEMPERATURE_CHECK

_LOG = logging.getLogger(__name__)

#: Maximum thickness of an emplaced flow [m]; lava lakes and domes reach 400 m.
MAX_THICKNESS = 500.0

#: Maximum number of cells of a flow whose cells are smaller than those of the terrain.
MAX_CELLS = 4_000_000

#: Roles of a flow: lava at the start, or ground.
KINDS = ('lava', 'ground')

#: Check of the lower fraction of a flow that is solid.
SOLIDIFIED_CHECK = partial(validation.number, at_least=0.0, at_most=0.99)

#: Keys of a flow in a scene file.
FLOW_KEYS = Keys({
    'file': Key(FILE_NAME, 'Raster of thickness [m], or outlines; relative to this file', True),
    'as': Key(
        partial(validation.choice, allowed=KINDS),
        'Lava that can flow, or part of the ground; lava if left out',
    ),
    'thickness': Key(
        partial(validation.number, above=0.0, at_most=MAX_THICKNESS, unit='m'),
        'Thickness of outlines [m]',
    ),
    'volume': Key(
        partial(validation.number, above=0.0, unit='m3'),
        'Volume of outlines [m3], in place of a thickness: the flow thins towards its margin',
    ),
    'solidified': Key(
        SOLIDIFIED_CHECK,
        'Lower fraction of the thickness that is solid, and part of the ground; 0 if left out',
    ),
    'temperature': Key(
        TEMPERATURE_CHECK, 'Temperature of the lava [K]; the eruption temperature if left out'
    ),
})


@dataclass(frozen=True, eq=False)
class EmplacedFlow:
    """Lava on the terrain at the start.

    Attributes:
        thickness: Thickness on square cells [m], float64, shape [rows, columns], 0 without lava;
            row 0 has the smallest y.
        resolution: Side of a cell [m].
        origin: Map position (x, y) [m] of the lower-left corner of cell [0, 0].
        temperature: Temperature of the lava [K]; None: a scene sets it to
            ``Lava.reference_temperature``.
        source: Origin of the data, for people.
    """

    thickness: np.ndarray = field(repr=False)
    resolution: float
    origin: tuple[float, float]
    temperature: float | None = None
    source: str = ''

    def __post_init__(self) -> None:
        """Validate the thickness and the resolution; raise LavaError for an invalid one."""
        thickness = np.asarray(self.thickness, dtype=np.float64)
        # NaN compares as False
        if thickness.ndim != 2 or not ((thickness >= 0.0) & (thickness <= MAX_THICKNESS)).all():
            expected = f'a 2-D array of 0 to {MAX_THICKNESS:g} m'
            raise LavaError('emplaced_flow.thickness', f'array of {thickness.shape}', expected)
        object.__setattr__(self, 'thickness', thickness)
        validation.number('emplaced_flow.resolution', self.resolution, above=0.0, unit='m')

    @property
    def volume(self) -> float:
        """Volume [m3]."""
        return math.fsum(self.thickness[self.thickness > 0.0]) * self.resolution**2

    @property
    def area(self) -> float:
        """Area [m2]."""
        return float((self.thickness > 0.0).sum()) * self.resolution**2

    def columns(self, spacing: float) -> tuple[np.ndarray, np.ndarray]:
        """Divide the lava into columns with at most a given spacing [m].

        A column is an equal part of a cell or a block of whole cells. Each is in the centre of
        mass of its part, and the volumes add up to ``volume``.

        Returns:
            Map positions [m], float64, shape [count, 2], and volumes [m3], float64, shape [count].
        """
        row, column = np.nonzero(self.thickness > 0.0)
        volume: np.ndarray = self.thickness[row, column] * self.resolution**2
        parts = math.ceil(self.resolution / spacing * (1.0 - 1e-9))
        # centres of the parts of a cell, as fractions of its side
        steps = (np.arange(parts) + 0.5) / parts
        up, right = (axis.ravel() for axis in np.meshgrid(steps, steps, indexing='ij'))
        cells = np.stack([np.add.outer(column, right), np.add.outer(row, up)], axis=-1)
        cells = cells.reshape(-1, 2)
        volume = np.repeat(volume / parts**2, parts**2)
        side = max(math.floor(spacing / self.resolution * (1.0 + 1e-9)), 1)
        if side > 1:
            block = (row // side) * self.thickness.shape[1] + column // side
            _, first, owner = np.unique(block, return_index=True, return_inverse=True)
            total = np.bincount(owner, volume)
            middle = np.stack(
                [np.bincount(owner, volume * axis) / total for axis in cells.T], axis=-1
            )
            # the centre of a ring of lava is outside the lava
            at = np.floor(middle).astype(np.int64)
            is_dry = self.thickness[at[:, 1], at[:, 0]] <= 0.0
            middle[is_dry] = cells[first[is_dry]]
            cells, volume = middle, total
        return np.asarray(self.origin) + cells * self.resolution, volume


def flow_to_dict(flow: EmplacedFlow) -> dict[str, Any]:
    """Return plain data that describes a flow without its thickness, for logs and bags."""
    thickness = np.ascontiguousarray(flow.thickness)
    return {
        'source': flow.source,
        'volume': flow.volume,
        'temperature': flow.temperature,
        'resolution': flow.resolution,
        'origin': list(flow.origin),
        'digest': hashlib.blake2b(thickness.tobytes(), digest_size=16).hexdigest(),
    }


def read_flows(
    label: str, items: object, folder: Path, terrain: Terrain
) -> tuple[Terrain, list[EmplacedFlow]]:
    """Read the emplaced flows of a scene file, and log the volume of each.

    Args:
        label: Name of the flows in errors.
        items: Plain data: a list of mappings with ``FLOW_KEYS``, of which ``file`` is required.
        folder: Folder to which file names are relative.
        terrain: Terrain before the flows.

    Returns:
        Terrain raised by the flows that are ground, and the other flows.

    Raises:
        LavaError: If a file or a number cannot be used.
    """
    flows, expected = [], f'a list of mappings with keys {", ".join(FLOW_KEYS.keys)}'
    for name, item in validation.items(label, items, expected):
        data = FLOW_KEYS(name, item)
        path, kind = folder / data['file'], data.get('as', 'lava')
        temperature = data.get('temperature')
        for key in ('temperature', 'solidified'):
            if key in data and kind == 'ground':
                raise validation.surplus(f'{name}.{key}', 'to ground')
        if 'thickness' in data and 'volume' in data:
            raise validation.conflict(f'{name}.thickness', f'{name}.volume')
        thickness = _thickness_on(
            name, path, terrain, data.get('thickness'), data.get('volume'),
            is_ground=kind == 'ground',
        )
        if kind == 'ground':
            told = _described(thickness, terrain)
            _LOG.info(f'{path.name}: the ground is raised by an emplaced flow of {told}')
            terrain = replace(terrain, elevation=terrain.elevation + thickness)
        else:
            terrain, flow = emplace(
                thickness, terrain, path.name, temperature, data.get('solidified', 0.0)
            )
            flows.append(flow)
    return terrain, flows


def emplace(
    thickness: np.ndarray, terrain: Terrain, name: str, temperature: float | None = None,
    solidified: float = 0.0,
) -> tuple[Terrain, EmplacedFlow]:
    """Return a terrain raised by the solid part of a flow, and the lava on it.

    Args:
        thickness: Thickness [m] on the cells of the terrain or on whole fractions of them, shape
            [rows, columns].
        terrain: Terrain below the flow.
        name: Origin of the flow, for people.
        temperature: Temperature of the lava [K]; None for that of erupting lava.
        solidified: Lower fraction of the thickness that is solid.
    """
    _LOG.info(f'{name}: lava at the start: {_described(thickness, terrain)}')
    parts = len(thickness) // terrain.shape[0]
    flow = EmplacedFlow(
        (1.0 - solidified) * thickness, terrain.resolution / parts, terrain.origin, temperature,
        name,
    )
    if solidified:
        rows, columns = terrain.shape
        mean = thickness.reshape(rows, parts, columns, parts).mean(axis=(1, 3))
        _LOG.info(f'{name}: {100.0 * solidified:g} % of its thickness are solid, and ground')
        terrain = replace(terrain, elevation=terrain.elevation + solidified * mean)
    return terrain, flow


def profile_of(covered: np.ndarray, volume: float, cell: float) -> np.ndarray:
    """Return the thickness [m] of a plastic flow, proportional to the root of the distance.

    Args:
        covered: Cells in the outline, bool, shape [rows, columns].
        volume: Volume [m3].
        cell: Side of a cell [m].
    """
    from scipy.ndimage import distance_transform_edt

    # from the centre of a cell to the margin, half a cell less than to the next centre
    distance = np.where(covered, distance_transform_edt(np.pad(covered, 1))[1:-1, 1:-1] - 0.5, 0.0)
    root = np.sqrt(distance)
    return root * (volume / max(float(root.sum()) * cell**2, 1e-9))


def _described(thickness: np.ndarray, terrain: Terrain) -> str:
    cell = terrain.resolution * terrain.shape[0] / len(thickness)
    area = float((thickness > 0.0).sum()) * cell**2
    return (f'{thickness.sum() * cell**2:,.0f} m3 over {area:,.0f} m2, '
            f'up to {thickness.max():.3g} m thick')


def _thickness_on(
    label: str, path: Path, terrain: Terrain, given: float | None, volume: float | None = None,
    *, is_ground: bool,
) -> np.ndarray:
    """Return the thickness on the cells of a terrain, or on finer cells [m], 0 without lava.

    The file has outlines if a thickness is ``given``, or a ``volume``. Ground is resampled to the
    cells of the terrain, and may extend beyond it, with a warning.
    """
    name, suffix = f'{label}.file', path.suffix.lower()
    if given is not None or volume is not None:
        areas = read_polygons(name, path, terrain)
        covered = mark_cells(terrain, areas) & terrain.has_data
        if given is not None:
            result = np.where(covered, given, 0.0)
        elif volume is not None:
            result = profile_of(covered, volume, terrain.resolution)
        places = np.concatenate([item.rings[0] for item in areas])
        _check_on_terrain(name, path, terrain, places, np.ones(len(places)), is_ground)
    elif suffix in vectors.ENDINGS and suffix != '.gpkg':
        expected = f'a thickness [m] or volume [m3], which the outlines of {path.name} do not have'
        raise LavaError(f'{label}.thickness', None, expected)
    else:
        result = _raster_on(name, path, terrain, is_ground)
    if not (result > 0.0).any():
        expected = f'a flow with a cell {terrain.bounds(projected=True)}'
        raise LavaError(name, str(path), expected)
    return result


def _raster_on(field: str, path: Path, terrain: Terrain, is_ground: bool) -> np.ndarray:
    """Read a raster of thickness on the cells of a terrain, or on finer cells [m]."""
    band = read_band(field, path, lengths='thickness')
    where, crs = f'thickness in {path.name}', band.crs
    if 'peak' in band.description.lower():
        expected = 'the thickness at one time: peak values contain more lava than there ever was'
        raise LavaError(where, band.description, expected)
    lava = band.converted(band.stored).filled(0.0)
    if (bad := lava[~np.isfinite(lava)]).size:
        expected = 'finite numbers; gdal_edit.py -a_nodata declares the value of empty cells'
        raise LavaError(where, f'{bad[0]} in {bad.size} cells', expected)
    low, high = float(lava.min()), float(lava.max())
    if low < 0.0:
        expected = f'at least 0 m (if {low:g} means no lava, declare it with '
        expected += f'gdal_edit.py -a_nodata {low:g})'
        raise LavaError(where, f'{low:g} in {int((lava < 0.0).sum())} cells', expected)
    if high > MAX_THICKNESS:
        expected = f'at most {MAX_THICKNESS:g} m: a thickness [m], not an elevation'
        raise LavaError(where, high, expected)
    from rasterio.transform import xy

    area = abs(band.place.determinant)
    if not is_ground:
        terrain = _subdivide(terrain, math.sqrt(area) * metres_per_unit(crs))
    result = np.nan_to_num(resampled(terrain, lava, band, path, field=field, method='average'))
    result = np.where(terrain.has_data, result, 0.0)
    cells = np.nonzero(lava > 0.0)
    places, volumes = np.stack(xy(band.place, *cells), axis=-1), lava[cells]
    is_same = not crs or horizontal(crs) == coordinate_system(terrain.epsg, terrain.wkt)
    if not is_same:
        places = on_terrain(terrain, places, horizontal(crs), field, str(path))
    is_inside = _check_on_terrain(field, path, terrain, places, volumes, is_ground)
    _check_not_elevation(where, result, terrain)
    if is_same and is_inside and result.any():
        # averages on a different grid lose some of the volume in cells at the outline
        result *= volumes.sum() * area / (result.sum() * terrain.resolution**2)
    return result


def _subdivide(terrain: Terrain, cell: float) -> Terrain:
    """Divide the cells of a terrain into smaller ones, as small as ``cell`` [m] if possible."""
    rows, columns = terrain.shape
    most = min(math.isqrt(MAX_CELLS // (rows * columns)), MAX_SIDE_CELLS // max(rows, columns))
    factor = math.ceil(min(terrain.resolution / cell * (1.0 - 1e-6), most))
    return finer(terrain, max(factor, 1))


def _check_on_terrain(
    field: str, path: Path, terrain: Terrain, places: np.ndarray, volumes: np.ndarray,
    may_exceed: bool,
) -> bool:
    """Return True if all ``places`` [m], shape [count, 2], of a flow are on cells with data.

    Raises:
        LavaError: If all places are elsewhere, or if one is and ``may_exceed`` is False.
    """
    is_on = terrain.covered(places - np.asarray(terrain.offset))
    if is_on.all():
        return True
    east, north = places[~is_on][0]
    off = 100.0 * volumes[~is_on].sum() / volumes.sum()
    found = f'{off:.3g} % of {path.name} is off the terrain, such as {east:.10g}, {north:.10g}'
    if not is_on.any() or not may_exceed:
        remedy = f'Use a flow {terrain.bounds(projected=True)}'
        raise RefusalError(field, f'{field}: {found}', remedy)
    _LOG.warning(f'{found}: this part is left out')
    return False


def _check_not_elevation(where: str, thickness: np.ndarray, terrain: Terrain) -> None:
    """Raise LavaError if a thickness is within a tenth of the elevation of the ground."""
    is_lava = (thickness > 0.0) & terrain.has_data
    if not is_lava.any():
        return
    ground = terrain.elevation[is_lava].astype(np.float64)
    off = thickness[is_lava] - ground
    if abs(off.mean()) <= 0.1 * abs(ground.mean()) and off.std() <= 0.1 * ground.std():
        expected = f'a thickness, not an elevation: it differs by only {off.mean():.3g} m on '
        expected += 'average from the elevation of the ground'
        raise LavaError(where, f'{float(thickness[is_lava].mean()):.6g} m on average', expected)
