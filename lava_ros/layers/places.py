# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Named places (points, lines and areas of users' files) on the cells of a terrain."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, groupby
import math
from typing import NamedTuple

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.scene.features import Feature
from lava_ros.scene.reshaping import squared_distance

#: Kind of place by type of feature.
KINDS = {'Point': 'point', 'LineString': 'line', 'Polygon': 'area'}

#: Minimum overlap of an area with a cell, and minimum part of a place off the map [fractions].
_MIN_OVERLAP, _MIN_OFF_MAP = 1e-9, 1e-6

#: Maximum number of cells whose overlap with an area, or distance, is computed at once.
_MAX_BAND_CELLS = 1_000_000


class _Part(NamedTuple):
    """Cells that a part of a place touches, its length or area [m, m2] in each, and in total."""

    rows: np.ndarray
    columns: np.ndarray
    sizes: np.ndarray
    whole: float


@dataclass(frozen=True, eq=False)
class Places:
    """Places on the cells of a terrain.

    Attributes:
        names: Unique names.
        kinds: ``point``, ``line`` or ``area``.
        whole: Length [m] or area [m2] of each, 1 for a point, shape [places].
        off_map: Fraction of each outside cells with data, shape [places].
        segments: Ends of the segments of each [m], map frame, shape [segments, 2, 2]; both ends of
            a point are equal.
        rows, columns: Cells with data that places touch, shape [cells].
        owner: Index of the place that touches a cell, same shape.
        sizes: Length [m] or area [m2] of the place in the cell, same shape.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    whole: np.ndarray
    off_map: np.ndarray
    segments: tuple[np.ndarray, ...]
    rows: np.ndarray
    columns: np.ndarray
    owner: np.ndarray
    sizes: np.ndarray

    def __len__(self) -> int:
        """Return the number of places."""
        return len(self.names)

    def middle(self, index: int) -> tuple[float, float]:
        """Return the map position [m] of a point, or of the middle of a line or an area."""
        segments = self.segments[index]
        if self.kinds[index] != 'area':
            segments = segments[len(segments) // 2]
        x, y = segments.reshape(-1, 2).mean(axis=0).tolist()
        return (x, y)

    def at(self, values: np.ndarray) -> np.ndarray:
        """Return the values of a map in the cells that places touch, shape [cells]."""
        return np.asarray(values[self.rows, self.columns])

    def first(self, values: np.ndarray) -> np.ndarray:
        """Return the minimum value [cells] of each place, float64; NaN without a value."""
        result = np.full(len(self), np.nan)
        # lava reaches only few cells of a large area
        found = np.flatnonzero(np.isfinite(values))
        np.fmin.at(result, self.owner[found], values[found])
        return result

    def inundated(self, part: np.ndarray) -> np.ndarray:
        """Return the length or area of each place that lava has covered, shape [places].

        ``part`` is the inundated fraction of the cells that places touch, NaN without data.
        """
        return np.bincount(self.owner, self.sizes * np.nan_to_num(part), len(self))


def places_on(features: Sequence[Feature], terrain: Terrain) -> Places:
    """Find the cells of a terrain that features touch; the parts of a feature are one place.

    A point is in one cell. A line is in the cells that it crosses, with its length in each. An
    area is in the cells that it overlaps, with the overlap in each.

    Raises:
        LavaError: If a feature has no position in the coordinate system of the terrain, or no
            length or area.
    """
    names: list[str] = []
    kinds, segments, parts = [], [], list[_Part]()
    for (where, kind), group in groupby(features, key=lambda item: (item.where, item.kind)):
        members = [feature.on(terrain) for feature in group]
        rings = [
            [(ring - terrain.corner) / terrain.resolution for ring in feature.rings]
            for feature in members
        ]
        found = [_part(kind, item, terrain.shape) for item in rings]
        scale = {'Point': 1.0, 'LineString': terrain.resolution}.get(kind, terrain.resolution**2)
        size = scale * sum(part.whole for part in found)
        if not size > 0.0:
            expected = {'LineString': 'a line with at least two different points'}
            raise LavaError(
                where, f'a {KINDS[kind]} of size 0', expected.get(kind, 'an area above 0 m2')
            )
        rows, columns, sizes = (
            np.concatenate([part[index] for part in found]) for index in range(3)
        )
        is_known = terrain.has_data[rows, columns]
        parts.append(_Part(rows[is_known], columns[is_known], scale * sizes[is_known], size))
        names.append(_unused(members[0].name or f'{KINDS[kind]} {len(names) + 1}', names))
        kinds.append(KINDS[kind])
        segments.append(_segments(members, terrain))
    whole = np.array([part.whole for part in parts])
    inside = np.array([part.sizes.sum() for part in parts])
    off_map = 1.0 - inside / whole
    # removes rounding errors
    off_map = np.where(off_map < _MIN_OFF_MAP, 0.0, np.where(inside == 0.0, 1.0, off_map))
    return Places(
        tuple(names), tuple(kinds), whole, off_map, tuple(segments),
        # small types, because the millions of cells of a large area are sent to another process
        rows=np.concatenate([part.rows for part in parts]).astype(np.int32),
        columns=np.concatenate([part.columns for part in parts]).astype(np.int32),
        owner=np.repeat(np.arange(len(parts), dtype=np.int32), [len(item.rows) for item in parts]),
        sizes=np.concatenate([part.sizes for part in parts]).astype(np.float32),
    )


def _unused(name: str, names: Sequence[str]) -> str:
    """Return a name, with a number appended if it is in use."""
    number, result = 1, name
    while result in names:
        number += 1
        result = f'{name} ({number})'
    return result


def _segments(members: Sequence[Feature], terrain: Terrain) -> np.ndarray:
    rings = chain.from_iterable(feature.rings for feature in members)
    ends = [np.stack([ring[:-1], ring[1:]], axis=1) if len(ring) > 1 else np.stack([ring, ring], 1)
            for ring in rings]
    return np.asarray(np.concatenate(ends) - np.array(terrain.offset))


def _part(kind: str, rings: Sequence[np.ndarray], shape: tuple[int, int]) -> _Part:
    """Find the cells of a feature, whose rings [places, 2] are in cells from the first corner."""
    if kind == 'Polygon':
        return _area(rings, shape)
    starts, ends = rings[0], rings[0]
    if kind != 'Point':
        starts, ends = _pieces(rings[0][:-1], rings[0][1:], shape)
    sizes = np.ones(len(starts)) if kind == 'Point' else np.hypot(*(ends - starts).T)
    columns, rows = np.floor(0.5 * (starts + ends)).astype(np.int64).T
    inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
    return _Part(rows[inside], columns[inside], sizes[inside], float(sizes.sum()))


def _area(rings: Sequence[np.ndarray], shape: tuple[int, int]) -> _Part:
    """Find the overlap of an area with each cell, from its outer ring and its holes."""
    outer = rings[0]
    # the cells around the area
    low = np.clip(np.floor(outer.min(axis=0)), 0, shape[::-1]).astype(np.int64)
    high = np.clip(np.floor(outer.max(axis=0)) + 1, 0, shape[::-1]).astype(np.int64)
    columns = max(int(high[0] - low[0]), 0)
    sizes = []
    for ring in rings:
        x, y = np.concatenate([ring, ring[:1]]).T - ring[0][:, None]
        sizes.append(0.5 * abs(float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))))
    found = []
    step = max(_MAX_BAND_CELLS // max(columns, 1), 1)
    for first in range(low[1], high[1], step):
        band = (min(step, int(high[1]) - first), columns)
        overlap = np.zeros(band)
        for number, ring in enumerate(rings):
            part = _overlap(np.concatenate([ring, ring[:1]]) - (low[0], first), band)
            overlap += part if number == 0 else -part
        row, column = np.nonzero(overlap > _MIN_OVERLAP)
        found.append((row + first, column + low[0], overlap[row, column]))
    nothing = np.zeros(0, dtype=np.int64)
    rows, places, overlaps = (
        np.concatenate(item) for item in zip((nothing, nothing, np.zeros(0)), *found, strict=True)
    )
    return _Part(rows, places, overlaps, sizes[0] - sum(sizes[1:]))


def _overlap(ring: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Find the fraction of each cell inside a closed ring, by signed areas right of its edges."""
    rows, columns = shape
    starts, ends = ring[:-1], ring[1:]
    bottoms, tops = np.minimum(starts[:, 1], ends[:, 1]), np.maximum(starts[:, 1], ends[:, 1])
    near = (tops > 0.0) & (bottoms < rows)
    starts, ends = _pieces(starts[near], ends[near], shape)
    middle, rise = 0.5 * (starts + ends), ends[:, 1] - starts[:, 1]
    row = np.floor(middle[:, 1]).astype(np.int64)
    column = np.floor(np.clip(middle[:, 0], 0.0, columns)).astype(np.int64)
    inside = (row >= 0) & (row < rows) & (column < columns)
    row, column, rise = row[inside], column[inside], rise[inside]
    right = np.minimum(column + 1.0 - middle[inside, 0], 1.0)
    own, further = np.zeros(shape), np.zeros((rows, columns + 1))
    np.add.at(own, (row, column), rise * right)
    np.add.at(further, (row, column + 1), rise)
    return np.clip(np.abs(own + np.cumsum(further, axis=1)[:, :columns]), 0.0, 1.0)


def _pieces(
    starts: np.ndarray, ends: np.ndarray, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Cut segments where they cross the edges of cells: starts and ends, both [pieces, 2]."""
    pieces = [starts[:0]], [ends[:0]]
    for start, end in zip(starts, ends, strict=True):
        cuts = [np.array([0.0, 1.0])]
        for axis, count in ((0, shape[1]), (1, shape[0])):
            low, high = sorted((start[axis], end[axis]))
            if low < high:
                edges = np.arange(max(math.ceil(low), 0), min(math.floor(high), count) + 1)
                cuts.append((edges - start[axis]) / (end[axis] - start[axis]))
        fractions = np.unique(np.clip(np.concatenate(cuts), 0.0, 1.0))[:, None]
        places = start + fractions * (end - start)
        pieces[0].append(places[:-1])
        pieces[1].append(places[1:])
    return np.concatenate(pieces[0]), np.concatenate(pieces[1])


def front_distances(places: Places, inundated: np.ndarray, terrain: Terrain) -> np.ndarray:
    """Measure the distance of places from lava.

    Args:
        places: The places, also those off the map.
        inundated: Cells that lava has reached, bool, shape [rows, columns].
        terrain: The ground.

    Returns:
        Distance [m] from each place to the centre of the nearest inundated cell, float64, shape
        [places]: 0 if lava has reached the place, NaN without lava.
    """
    box = tuple(
        slice(found[0], found[-1] + 1) if len(found) else slice(0)
        for found in (np.flatnonzero(inundated.any(axis=axis)) for axis in (1, 0))
    )
    marked = inundated[box]
    around = np.pad(marked, 1)
    inner = around[:-2, 1:-1] & around[2:, 1:-1] & around[1:-1, :-2] & around[1:-1, 2:]
    # only cells at the border of the lava can be the nearest ones
    cells = np.argwhere(marked & ~inner) + [part.start or 0 for part in box]
    if not len(cells):
        return np.full(len(places), np.nan)
    middles = np.array(terrain.origin) + (cells[:, ::-1] + 0.5) * terrain.resolution
    is_reached = np.bincount(places.owner[places.at(inundated)], minlength=len(places)) > 0
    result = np.where(is_reached, 0.0, np.inf)
    owner = np.repeat(np.arange(len(places)), [len(item) for item in places.segments])
    is_far = ~is_reached[owner]
    segments, owner = np.concatenate(places.segments)[is_far], owner[is_far]
    step = max(_MAX_BAND_CELLS // len(middles), 1)
    for first in range(0, len(segments), step):
        part = np.s_[first : first + step]
        # the ends of each segment are pairs of columns: [2, segments, 1]
        start, end = segments[part].transpose(1, 2, 0)[..., None]
        near = squared_distance(middles[:, 0], middles[:, 1], start, end).min(axis=1)
        np.minimum.at(result, owner[part], np.sqrt(near))
    return result
