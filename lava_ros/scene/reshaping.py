# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Changes of a terrain: earth barriers along a line, low-pass filter, refinement."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
import logging
import math
from math import dist
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files import warn_of_unknown
from lava_ros.files.columns import understood
from lava_ros.files.keys import Key, Keys, list_of, schema_of
from lava_ros.scene.features import read_features
from lava_ros.scene.terrain import MAX_COORDINATE, Terrain

_LOG = logging.getLogger(__name__)

#: Limits and units of the numbers of a barrier; that of 1983 on Etna was 18 m high.
LIMITS = {'height': (0.1, 200.0, 'm'), 'width': (0.1, 1000.0, 'm'), 'slope': (0.05, 100.0, '')}

#: Check of a place on the crest of a barrier.
PLACE_CHECK = partial(validation.pair, most=MAX_COORDINATE)

#: Keys of a barrier in a file.
BARRIER_KEYS = Keys({
    'line': Key(
        list_of(schema_of(PLACE_CHECK), 2),
        'Two or more places [easting, northing] along the crest [m]', True,
    ),
    **{
        name: Key(
            partial(validation.number, at_least=least, at_most=most, unit=unit), text,
            name != 'slope',
        )
        for (name, (least, most, unit)), text in zip(LIMITS.items(), (
            'Height above the ground [m]', 'Width of the crest [m]',
            'Slope of the sides, rise over run; 1 if left out',
        ), strict=True)
    },
    'name': Key(validation.text, 'Name in logs, messages and tables'),
})

#: Minimum distance between two successive places of a line [m].
APART = 1e-3

#: Maximum number of places of a crest that are compared with the terrain.
MAX_SAMPLES = 100_000


@dataclass(frozen=True)
class Barrier:
    """An earth dam: height above the ground and width of the crest [m].

    ``line``, the crest, is two or more places (x, y) [m] in projected coordinates. ``slope`` is
    that of the sides, rise over run.
    """

    line: tuple[tuple[float, float], ...]
    height: float
    width: float
    slope: float = 1.0
    name: str = ''

    def __post_init__(self) -> None:
        """Validate and normalise all fields; raise LavaError for an invalid one."""
        expected = 'two or more places [x, y] m'
        places = tuple(
            PLACE_CHECK(*place)
            for place in validation.items('barrier.line', self.line, expected, least=2)
        )
        if any(dist(a, b) < APART for a, b in pairwise(places)):
            raise LavaError('barrier.line', places, 'two or more different points')
        object.__setattr__(self, 'line', places)
        for name, value in BARRIER_KEYS.values('barrier', vars(self)).items():
            object.__setattr__(self, name, value)

    @property
    def length(self) -> float:
        """Length of the crest [m]."""
        return sum(dist(a, b) for a, b in pairwise(self.line))

    @property
    def volume(self) -> float:
        """Volume on level ground [m3]: cross-section times length, and the round ends.

        At a bend, the sides gain as much volume on the outside as they lose on the inside, to
        first order.
        """
        run = self.height / self.slope
        inner, outer = 0.5 * self.width, 0.5 * self.width + run
        # both ends together are a truncated cone
        ends = math.pi * self.height * (outer**2 + outer * inner + inner**2) / 3.0
        return self.length * self.height * (self.width + run) + ends

    def text(self) -> str:
        """Describe the barrier and its volume."""
        return (
            f'barrier{self.name and f" {self.name}"} {self.length:.0f} m long, '
            f'{self.height:g} m high, crest {self.width:g} m wide: '
            f'{self.volume:.0f} m3 of earth by its cross-section'
        )

    def crest_on(self, resolution: float) -> float:
        """Return the width of the crest [m] without gaps on cells of a size [m]."""
        # cells whose centre is within half the width are raised: this leaves no diagonal gap
        return max(self.width, math.sqrt(2.0) * resolution)

    @classmethod
    def from_dict(cls, label: str, data: object) -> 'Barrier':
        """Build a barrier from the plain data of a YAML file; raise LavaError for bad data."""
        return validation.build(cls, label, data)


def read_barriers(
    field: str, path: str | Path, terrain: Terrain,
    usual: Mapping[str, float | None] = {'height': None, 'width': None, 'slope': Barrier.slope},
) -> list[Barrier]:
    """Read the barriers of a file: its lines, with their height, width and slope.

    Args:
        field: Name of the field in errors.
        path: File for ``features.read_features``.
        terrain: Terrain whose coordinate system the result has.
        usual: Default height and width of the crest [m], and slope.

    Raises:
        LavaError: If the file cannot be read or has points or areas, a number is not usable, or a
            line is off the terrain.
    """
    barriers = []
    unknown: list[str] = []
    for feature in read_features(field, path, terrain):
        if feature.kind != 'LineString':
            raise LavaError(feature.where, f'a {feature.kind}', 'a line')
        columns, others = understood(str(path), feature.properties, (*LIMITS, 'name'))
        unknown += others
        numbers = {
            name: columns[name].number(feature.where, feature.properties[columns[name].header])
            if name in columns else value
            for name, value in usual.items()
        }
        line = tuple((float(x), float(y)) for x, y in feature.rings[0])
        try:
            barrier = Barrier(line, name=feature.name, **numbers)  # type: ignore[arg-type]
            # raises for a barrier off the terrain, while its feature is known
            _added(terrain, barrier, is_told=False)
        except LavaError as error:
            name = error.field.removeprefix('barrier.')
            value = list(feature.given) if name == 'line' else error.value
            raise LavaError(f'{feature.where}, {name}', value, error.expected) from None
        barriers.append(barrier)
    warn_of_unknown(path, 'attributes', unknown, f' (of a barrier: name, {", ".join(LIMITS)})')
    return barriers


def with_barriers(
    terrain: Terrain, barriers: Iterable[Barrier], *, is_told: bool = True
) -> Terrain:
    """Raise a terrain by barriers; the higher one counts in an overlap.

    The ground rises by the full height within half the width of the line, and by less along the
    sides. A crest narrower than ``crest_on`` is widened to that, so that it has no gap, with a
    warning if ``is_told``.

    Raises:
        LavaError: If a barrier raises no cell with data.
    """
    raised = terrain
    for barrier in barriers:
        higher = (terrain.elevation + _added(terrain, barrier, is_told)).astype(np.float32)
        raised = replace(
            raised,
            elevation=np.maximum(raised.elevation, higher),
            barriers=(*raised.barriers, barrier.line),
        )
    return raised


def _added(terrain: Terrain, barrier: Barrier, is_told: bool) -> np.ndarray:
    """Return the height that a barrier adds to the ground [m], shape [rows, columns]."""
    rows, columns = terrain.shape
    cell = terrain.resolution
    x, y = (
        start + (np.arange(count) + 0.5) * cell
        for start, count in zip(terrain.corner, (columns, rows), strict=True)
    )
    crest = barrier.crest_on(cell)
    half = 0.5 * crest
    reach = half + barrier.height / barrier.slope
    distance = np.full(terrain.shape, np.inf)
    for start, end in pairwise(barrier.line):
        low, high = np.minimum(start, end) - reach, np.maximum(start, end) + reach
        across = slice(*np.searchsorted(x, (low[0], high[0])))
        up = slice(*np.searchsorted(y, (low[1], high[1])))
        near = np.sqrt(squared_distance(x[across], y[up, None], start, end))
        distance[up, across] = np.minimum(distance[up, across], near)
    added = np.clip(barrier.height - (distance - half) * barrier.slope, 0.0, barrier.height)
    if not (np.isfinite(terrain.elevation) & (added > 0.0)).any():
        expected = f'a line {terrain.bounds(projected=True)}'
        raise LavaError('barrier.line', barrier.line, expected)
    if is_told:
        _warn_of_part_off(terrain, barrier)
    if is_told and crest > barrier.width:
        _LOG.warning(
            f'the crest of the barrier, {barrier.width:g} m wide, becomes {crest:.3g} m wide on '
            f'cells of {cell:g} m, so that it has no gap'
        )
    return np.asarray(added)


def _warn_of_part_off(terrain: Terrain, barrier: Barrier) -> None:
    """Warn if a part of a crest is on no cell with data, and give its first place."""
    line = np.asarray(barrier.line)
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    count = min(math.ceil(2.0 * lengths[-1] / terrain.resolution) + 1, MAX_SAMPLES)
    along = np.linspace(0.0, lengths[-1], count)
    places = np.stack([np.interp(along, lengths, axis) for axis in line.T], axis=-1)
    off = np.isnan(terrain.values_at(terrain.elevation, places - terrain.offset))
    if off.any():
        east, north = places[off][0]
        named = f' {barrier.name}' if barrier.name else ''
        _LOG.warning(
            f'{100.0 * off.mean():.2g} % of the barrier{named} is off the terrain, such as '
            f'{east:.10g}, {north:.10g}, and raises nothing; its length and volume include it'
        )


def squared_distance(x: Any, y: Any, start: Any, end: Any) -> Any:
    """Return the squared distance of places (x, y) from a segment between two pairs (x, y) [m2].

    All are numbers, or arrays whose shapes numpy broadcasts together.
    """
    along, dx, dy = np.subtract(end, start), x - start[0], y - start[1]
    length = np.maximum(along[0] ** 2 + along[1] ** 2, 1e-30)
    fraction = np.clip((dx * along[0] + dy * along[1]) / length, 0.0, 1.0)
    return np.square(dx - fraction * along[0]) + np.square(dy - fraction * along[1])


def low_pass(terrain: Terrain, width: float) -> Terrain:
    """Filter a terrain with a Gaussian of a standard deviation ``width`` [m]; 0 changes nothing.

    Cells without data remain so, and do not count in the means of their neighbours. Waves of
    length L keep exp(-2 (pi width / L)^2) of their height: 0.7 % at L = 2 widths, 73 % at 8.

    Raises:
        LavaError: If the width is not usable.
    """
    rows, columns = terrain.shape
    most = 0.25 * min(rows, columns) * terrain.resolution
    width = validation.number('low_pass', width, at_least=0.0, at_most=most, unit='m')
    # a neighbour would weigh exp(-50)
    if width < 0.1 * terrain.resolution:
        return terrain
    from scipy.ndimage import gaussian_filter

    known = np.isfinite(terrain.elevation)
    # values near zero keep the precision of a float
    level = float(np.mean(terrain.elevation[known], dtype=np.float64))
    cells = width / terrain.resolution
    heights, weights = (
        gaussian_filter(values, cells, mode='constant', radius=math.ceil(4.0 * cells))
        for values in (
            np.where(known, terrain.elevation - level, 0.0).astype(np.float64),
            known.astype(np.float64),
        )
    )
    smooth = np.where(known, level + heights / np.where(known, weights, 1.0), np.nan)
    return replace(terrain, elevation=smooth)


def finer(terrain: Terrain, factor: int) -> Terrain:
    """Sample the quadratic B-spline of a terrain's heights on cells smaller by ``factor``.

    This is the surface of the simulation (simulation/particles/terrain.py). Cells within a cell
    without data have no data.
    """
    if factor == 1:
        return terrain
    height = terrain.elevation.astype(np.float64)
    for axis in (0, 1):
        height = _refine_axis(height, factor, axis)
    fine = replace(terrain, elevation=height, resolution=terrain.resolution / factor)
    known = np.kron(np.isfinite(terrain.elevation), np.ones((factor, factor), dtype=bool))
    return replace(fine, elevation=np.where(known, fine.elevation, np.nan))


def _refine_axis(height: np.ndarray, factor: int, axis: int) -> np.ndarray:
    """Sample the spline along an axis; extrapolate linearly to neighbours without data."""
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
