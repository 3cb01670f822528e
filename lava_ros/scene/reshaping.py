# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Terrain -> terrain: barriers of earth along a line, no short waves, finer cells."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
import logging
import math
from math import dist
from pathlib import Path

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.columns import understood
from lava_ros.files.optional import require
from lava_ros.scene.features import read_features
from lava_ros.scene.terrain import MAX_COORDINATE, Terrain

_LOG = logging.getLogger(__name__)

#: Smallest and largest numbers of barriers, and units: that of 1983 on Etna was 18 m high.
LIMITS = {'height': (0.1, 200.0, 'm'), 'width': (0.1, 1000.0, 'm'), 'slope': (0.05, 100.0, '')}

_LOG = logging.getLogger(__name__)

#: Places nearer to each other than this are one [m].
APART = 1e-3


@dataclass(frozen=True)
class Barrier:
    """A dam of earth: its height above the ground and the width of its crest [m].

    The line of the crest is two or more places (x, y) [m] in projected coordinates; ``slope`` is
    the fall of its sides, rise over run.
    """

    line: tuple[tuple[float, float], ...]
    height: float
    width: float
    slope: float = 1.0

    def __post_init__(self) -> None:
        """Validate and normalise every field; LavaError names one that is not usable."""
        if isinstance(self.line, str) or not isinstance(self.line, Sequence):
            raise LavaError('barrier.line', self.line, 'two or more places [x, y] m')
        places = tuple(
            validation.pair(f'barrier.line[{index}]', place, most=MAX_COORDINATE)
            for index, place in enumerate(self.line)
        )
        if len(places) < 2 or any(dist(a, b) < APART for a, b in pairwise(places)):
            raise LavaError('barrier.line', places, 'two or more places that differ')
        object.__setattr__(self, 'line', places)
        for name, (least, most, unit) in LIMITS.items():
            value = validation.number(
                f'barrier.{name}', getattr(self, name), at_least=least, at_most=most, unit=unit
            )
            object.__setattr__(self, name, value)

    @property
    def length(self) -> float:
        """Length of the crest [m]."""
        return sum(dist(a, b) for a, b in pairwise(self.line))

    @property
    def volume(self) -> float:
        """Earth that it takes on even ground [m3]: its cross-section along it, and its round ends.

        It is that of the crest as wide as given. At a bend, the sides add as much earth on the
        outside as they share on the inside, to first order.
        """
        run = self.height / self.slope
        inner, outer = 0.5 * self.width, 0.5 * self.width + run
        # a cone without its top: both ends together
        ends = math.pi * self.height * (outer**2 + outer * inner + inner**2) / 3.0
        return self.length * self.height * (self.width + run) + ends

    def crest_on(self, resolution: float) -> float:
        """Width of the crest [m] on cells of a size [m]: never so narrow that lava finds a gap."""
        # cells whose centre is nearer than half of it are crossed, and those leave no gap to
        # diagonals
        return max(self.width, math.sqrt(2.0) * resolution)

    @classmethod
    def from_dict(cls, label: str, data: object) -> 'Barrier':
        """Build a barrier from the plain data of a YAML file; LavaError names what is wrong."""
        required = ['line', 'height', 'width']
        values = validation.keys(label, data, allowed=[*required, 'slope'], required=required)
        return cls(**values)  # type: ignore[arg-type]


def read_barriers(
    field: str, path: str | Path, terrain: Terrain, usual: Mapping[str, float | None]
) -> list[Barrier]:
    """Read the barriers of a file: its lines, with their height, width and slope.

    Args:
        field: What errors call the file.
        path: A file for ``features.read_features``.
        terrain: The ground, whose coordinate system the result has.
        usual: Height and width of the crest [m], and slope, of lines without their own.

    Raises:
        LavaError: The file cannot be read, has points or areas, or a number is not usable.
    """
    barriers = []
    unknown: dict[str, None] = {}
    for feature in read_features(field, path, terrain):
        if feature.kind != 'LineString':
            raise LavaError(feature.where, f'a {feature.kind}', 'a line')
        columns, others = understood(str(path), feature.properties, (*LIMITS, 'name'))
        unknown |= dict.fromkeys(others)
        numbers = {
            name: columns[name].number(feature.where, feature.properties[columns[name].header])
            if name in columns else value
            for name, value in usual.items()
        }
        line = tuple((float(x), float(y)) for x, y in feature.rings[0])
        try:
            barriers.append(Barrier(line, **numbers))  # type: ignore[arg-type]
        except LavaError as error:
            name = error.field.removeprefix('barrier.')
            raise LavaError(f'{feature.where}, {name}', error.value, error.expected) from None
    if unknown:
        _LOG.warning(
            f'{path}: attributes that are not understood are ignored: {", ".join(unknown)} '
            f'(of a barrier: name, {", ".join(LIMITS)})'
        )
    return barriers


def with_barrier(terrain: Terrain, barrier: Barrier) -> Terrain:
    """Raise a terrain by a barrier; LavaError where its line touches no cell with data.

    The ground is raised by the full height within half the width of the line. Beyond that it is
    raised less and less, to nothing where the barrier's sides reach the ground. If the crest is
    narrower than ``crest_on``, it is widened to that, so that lava finds no gap, and a warning
    says so.
    """
    rows, columns = terrain.shape
    cell = terrain.resolution
    x = terrain.origin[0] + terrain.offset[0] + (np.arange(columns) + 0.5) * cell
    y = terrain.origin[1] + terrain.offset[1] + (np.arange(rows) + 0.5) * cell
    crest = barrier.crest_on(cell)
    half = 0.5 * crest
    reach = half + barrier.height / barrier.slope
    distance = np.full(terrain.shape, np.inf)
    for start, end in pairwise(barrier.line):
        low, high = np.minimum(start, end) - reach, np.maximum(start, end) + reach
        across = slice(*np.searchsorted(x, (low[0], high[0])))
        up = slice(*np.searchsorted(y, (low[1], high[1])))
        near = _distance(x[across], y[up], start, end)
        distance[up, across] = np.minimum(distance[up, across], near)
    added = np.clip(barrier.height - (distance - half) * barrier.slope, 0.0, barrier.height)
    if not (terrain.has_data & (added > 0.0)).any():
        right = f'a line {terrain.bounds(projected=True)}'
        raise LavaError('barrier.line', barrier.line, right)
    if crest > barrier.width:
        _LOG.warning(
            f'the crest of the barrier, {barrier.width:g} m wide, becomes {crest:.3g} m wide on '
            f'cells of {cell:g} m, so that lava finds no gap'
        )
    return replace(
        terrain,
        elevation=(terrain.elevation + added).astype(np.float32),
        barriers=(*terrain.barriers, barrier.line),
    )


def _distance(
    x: np.ndarray, y: np.ndarray, start: tuple[float, float], end: tuple[float, float]
) -> np.ndarray:
    """Distance of the places of a grid from a segment [m], shape [len(y), len(x)]."""
    along = np.subtract(end, start)
    dx, dy = x[None, :] - start[0], y[:, None] - start[1]
    share = np.clip((dx * along[0] + dy * along[1]) / (along @ along), 0.0, 1.0)
    return np.hypot(dx - share * along[0], dy - share * along[1])


#: Standard deviations of the filter up to which cells count: what is left out is 1e-4.
_REACH = 4.0

#: Standard deviation below which it changes nothing [cells]: a neighbour weighs exp(-50).
_LEAST = 0.1


def low_pass(terrain: Terrain, width: float) -> Terrain:
    """Filter a terrain with a Gaussian of a standard deviation ``width`` [m]; 0 changes nothing.

    Cells without data stay without, and do not count in the means of their neighbours. Waves of
    length L keep exp(-2 (pi width / L)^2) of their height: 0.7 % at L = 2 widths, 73 % at 8.
    LavaError where the width is not usable, or scipy is not installed.
    """
    rows, columns = terrain.shape
    most = 0.25 * min(rows, columns) * terrain.resolution
    width = validation.number('low_pass', width, at_least=0.0, at_most=most, unit='m')
    if width < _LEAST * terrain.resolution:
        return terrain
    require('scipy', 'low_pass', width)
    from scipy.ndimage import gaussian_filter

    known = terrain.has_data
    # near zero, lest a float lose the digits of a summit
    level = float(np.mean(terrain.elevation[known], dtype=np.float64))
    cells = width / terrain.resolution
    heights, weights = (
        gaussian_filter(values, cells, mode='constant', radius=math.ceil(_REACH * cells))
        for values in (
            np.where(known, terrain.elevation - level, 0.0).astype(np.float64),
            known.astype(np.float64),
        )
    )
    smooth = np.where(known, level + heights / np.where(known, weights, 1.0), np.nan)
    return replace(terrain, elevation=smooth)


def finer(terrain: Terrain, factor: int) -> Terrain:
    """Sample the quadratic B-spline of a terrain's heights on cells smaller by ``factor``.

    The simulation lets lava flow on this surface (simulation/terrain.py), so maps on the finer
    cells show its shape between the coarse cells' centres. Fine cells within a cell without data
    have none.
    """
    if factor == 1:
        return terrain
    height = terrain.elevation.astype(np.float64)
    for axis in (0, 1):
        height = _along(height, factor, axis)
    fine = replace(terrain, elevation=height, resolution=terrain.resolution / factor)
    known = np.kron(terrain.has_data, np.ones((factor, factor), dtype=bool))
    return replace(fine, elevation=np.where(known, fine.elevation, np.nan))


def _along(height: np.ndarray, factor: int, axis: int) -> np.ndarray:
    """The spline along an axis; a neighbour without data continues the slope of the others."""
    height = np.moveaxis(height, axis, 0)
    padded = np.pad(height, ((1, 1), (0, 0)), mode='reflect', reflect_type='odd')
    before, here, after = padded[:-2], padded[1:-1], padded[2:]
    before, after = (
        np.where(np.isfinite(near), near, np.where(np.isfinite(far), 2.0 * here - far, here))
        for near, far in ((before, after), (after, before))
    )
    fine = np.empty((len(height) * factor, height.shape[1]))
    for number in range(factor):
        place = (number + 0.5) / factor - 0.5
        low, high = 0.5 * (0.5 - place) ** 2, 0.5 * (0.5 + place) ** 2
        fine[number::factor] = low * before + (0.75 - place**2) * here + high * after
    return np.moveaxis(fine, 0, axis)
