# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Agreement of the inundated area of a simulated flow with a mapped flow field.

All numbers are invariant if both are rotated by 90 degrees or mirrored.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from heapq import heappop, heappush
import math

import numpy as np

from lava_ros.hindcast.case import Case
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.output.inundation import (
    area_of,
    footprint_cells,
    standing_cells,
    standing_part,
)
from lava_ros.simulation.output.snapshot import Snapshot

#: Number of paths of steepest descent, and the noise on the ground of each [m].
PATHS, NOISE = 100, 3.0

#: Steps to the neighbours of a cell.
_NEIGHBORS = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)

#: Steps of a path which, with their opposites, lead to 16 neighbours: the error of its length is
#: at most 2.7 %.
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (2, -1), (1, -2))


@dataclass(frozen=True)
class Score:
    """A comparison of a simulated flow with a mapped one.

    Simulated cells are those of which lava has covered at least half (the footprint); mapped
    cells are those of which the outline covers at least half. ``jaccard`` is cells in both
    over cells in either and ``fit`` its square root, e1 in the literature; ``recall`` is the
    simulated fraction of the mapped cells, ``precision`` the mapped fraction of the simulated
    cells. ``area`` is the inundated area [m2], ``standing_area`` the area with lava at the end
    [m2]. Lengths are runout lengths along the path from a vent [m]. Thicknesses are those at
    the end [m]; ``mapped_thickness`` is the emitted volume over the mapped area. Errors are
    relative, positive if the simulated flow is too long or too large.
    """

    jaccard: float
    recall: float
    precision: float
    fit: float
    hits: int
    misses: int
    false_alarms: int
    area: float
    standing_area: float
    mapped_area: float
    length: float
    mapped_length: float
    volume: float
    mean_thickness: float
    median_thickness: float
    thickest: float
    mapped_thickness: float
    length_error: float
    area_error: float
    footprint_area_error: float


@dataclass(frozen=True)
class OutlineScore:
    """Agreement of the inundated area at the time of an outline with the outline.

    Attributes:
        outline: Date or time of the outline.
        time: Its time since the start of the simulation [s].
        jaccard: Cells in both over cells in either.
        recall: Inundated fraction of the mapped cells.
        precision: Mapped fraction of the inundated cells.
        footprint_area_error: Relative error of the area of the footprint, positive if it is too
            large.
        length_error: Relative error of the runout length, positive if it is too long.
    """

    outline: str
    time: float
    jaccard: float
    recall: float
    precision: float
    footprint_area_error: float
    length_error: float


@dataclass(frozen=True)
class Reference:
    """Jaccard indices of an outline with references that need no model of lava.

    ``persistence`` is the index of the previous outline, None without one; ``descent`` is the
    index of steepest descent that covers as large an area as the inundated one.
    """

    persistence: float | None
    descent: float

    @property
    def words(self) -> str:
        """The scores as text."""
        before = '' if self.persistence is None else f'outline before: {self.persistence:.3f}, '
        return f'{before}steepest descent: {self.descent:.3f}'


def score_case(
    case: Case, thickness: np.ndarray, inundated: np.ndarray, threshold: float = COVERED
) -> Score:
    """Compare a simulated flow with the mapped flow field of a case, on the cells of the case.

    Args:
        case: The case.
        thickness: Thickness of the simulated lava [m], NaN without data, shape [rows, columns].
        inundated: Fraction of each cell that it has inundated, or the cells of its footprint,
            float or bool, same shape.
        threshold: Minimum thickness of lava that counts [m].
    """
    terrain, footprint, thickness = case.scene.terrain, case.footprint, np.nan_to_num(thickness)
    standing, area = standing_cells(thickness, threshold), terrain.resolution**2
    inundated_area = area_of(inundated, terrain.resolution)
    standing_area = area_of(standing_part(standing, inundated), terrain.resolution)
    inundated = footprint_cells(inundated)
    layer = thickness[standing]
    hits = int((inundated & footprint).sum())
    mapped, simulated = int(footprint.sum()), int(inundated.sum())
    index = jaccard(inundated, footprint)
    ways = distances(inundated | footprint, case.vent_cells) * terrain.resolution
    length, mapped_length = _longest(ways, inundated), _longest(ways, footprint)
    return Score(
        jaccard=index,
        recall=hits / mapped if mapped else 0.0,
        precision=hits / simulated if simulated else 0.0,
        fit=math.sqrt(index),
        hits=hits,
        misses=mapped - hits,
        false_alarms=simulated - hits,
        area=inundated_area,
        standing_area=standing_area,
        mapped_area=mapped * area,
        length=length,
        mapped_length=mapped_length,
        volume=float(thickness.sum()) * area,
        mean_thickness=float(layer.mean()) if layer.size else 0.0,
        median_thickness=float(np.median(layer)) if layer.size else 0.0,
        thickest=float(layer.max()) if layer.size else 0.0,
        mapped_thickness=case.volume / (mapped * area) if mapped else math.nan,
        length_error=length / mapped_length - 1.0 if mapped_length else math.nan,
        area_error=inundated_area / (mapped * area) - 1.0 if mapped else math.nan,
        footprint_area_error=simulated / mapped - 1.0 if mapped else math.nan,
    )


def score_snapshot(case: Case, snapshot: Snapshot) -> Score:
    """Compare a flow at its end with the mapped flow field of a case."""
    assert snapshot.inundated is not None
    return score_case(case, snapshot.thickness, snapshot.inundated, snapshot.threshold)


def score_outlines(case: Case, snapshots: Sequence[Snapshot]) -> list[OutlineScore]:
    """Score the footprint of at least half of some runs at the time of each outline.

    The footprint at an earlier time follows from the times at which cells were half inundated.

    Args:
        case: The case with its outlines.
        snapshots: The end of each run, with arrival times.
    """
    scores = []
    times_of = [item.half_inundated for item in snapshots if item.half_inundated is not None]
    for outline in case.outlines:
        inundated = np.mean([times <= outline.time for times in times_of], axis=0) >= 0.5
        # the scores of an outline do not depend on the thickness, which is that at the end
        found = score_case(
            replace(case, footprint=outline.footprint), snapshots[0].thickness, inundated
        )
        known = {item.name: getattr(found, item.name) for item in fields(OutlineScore)[2:]}
        scores.append(OutlineScore(outline.text, outline.time, **known))
    return scores


def most_visited(visits: np.ndarray, cells: int) -> np.ndarray:
    """Return the most visited cells, at most a number of them, as bool of the same shape."""
    order = np.argsort(visits, axis=None, kind='stable')[::-1][:cells]
    covered = np.zeros(visits.shape, dtype=bool)
    covered.flat[order] = True
    return covered & (visits > 0)


def refer(
    case: Case, area_errors: Mapping[str, float], before: np.ndarray | None = None
) -> dict[str, Reference]:
    """Score two references that need no model of lava on dated outlines.

    Args:
        case: The case with its outlines.
        area_errors: Relative error of the area of the footprint, by the outline: steepest descent
            covers the same area.
        before: Outline that persists; None: for each date the previous outline.
    """
    visits = count_visits(case.scene.terrain.elevation, case.vent_cells)
    found, last = {}, case.initial if before is None else before
    for outline in case.outlines:
        if outline.text in area_errors:
            cells = round((1.0 + area_errors[outline.text]) * int(outline.footprint.sum()))
            found[outline.text] = Reference(
                None if last is None else jaccard(last, outline.footprint),
                jaccard(most_visited(visits, cells), outline.footprint),
            )
        last = outline.footprint if before is None else before
    return found


def jaccard(one: np.ndarray, other: np.ndarray) -> float:
    """Return the Jaccard index of two masks: cells in both over cells in either."""
    return float((one & other).sum() / max((one | other).sum(), 1))


def count_visits(elevation: np.ndarray, vents: Sequence[tuple[int, int]]) -> np.ndarray:
    """Count how many paths of steepest descent from the vents visit each cell.

    Each path is on the ground plus uniform noise, as in DOWNFLOW (Favalli, Pareschi, Neri and
    Isola 2005, Geophysical Research Letters 32, L03305).

    Args:
        elevation: Elevation [m], NaN without data, shape [rows, columns].
        vents: Rows and columns of the vents.

    Returns:
        The number of paths, int, same shape.
    """
    visits = np.zeros(elevation.shape, dtype=int)
    random = np.random.default_rng(0)
    for _ in range(PATHS):
        visits += descend(elevation + random.uniform(-NOISE, NOISE, elevation.shape), vents)
    return visits


def descend(elevation: np.ndarray, vents: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return the cells of a path of steepest descent, which fills pits, to the border.

    The lowest neighbour of the visited cells is visited next (the priority flood of Barnes, Lehman
    and Mulla 2014, Computers & Geosciences 62, from the vents).

    Args:
        elevation: Elevation [m], NaN without data, shape [rows, columns].
        vents: Rows and columns of the vents.

    Returns:
        The cells, bool, same shape.
    """
    visited, is_queued = (np.zeros(elevation.shape, dtype=bool) for _ in range(2))
    heights = np.pad(elevation, 1, constant_values=np.nan)
    queue: list[tuple[float, int, int]] = []
    for vent in vents:
        is_queued[vent] = True
        heappush(queue, (float(elevation[vent]), *vent))
    while queue:
        _, row, column = heappop(queue)
        visited[row, column] = True
        around = heights[row : row + 3, column : column + 3]
        if np.isnan(around).any():
            break
        for down, right in _NEIGHBORS:
            place = row + down, column + right
            if not is_queued[place]:
                is_queued[place] = True
                heappush(queue, (float(elevation[place]), *place))
    return visited


def _longest(ways: np.ndarray, mask: np.ndarray) -> float:
    return float(np.max(ways, where=mask & np.isfinite(ways), initial=0.0))


def distances(mask: np.ndarray, sources: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return the length of the shortest path over a mask, in cells; infinite outside it.

    Sources are rows and columns. A source outside the mask starts from the nearest masked cell;
    parts of the mask without a connection to a source are reached in a straight line.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    result = np.full(mask.shape, np.inf)
    cells = np.argwhere(mask)
    if not len(cells) or not len(sources):
        return result
    # add a border, so that steps across the edge of the mask lead to no cell
    numbers = np.full(np.add(mask.shape, 4), -1)
    numbers[tuple(cells.T + 2)] = np.arange(len(cells))
    pairs = []
    for step in STEPS:
        there = numbers[tuple((cells + step).T + 2)]
        here = np.flatnonzero(there >= 0)
        pairs.append((here, there[here], np.full(here.size, math.hypot(*step))))
    here, there, lengths = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    graph = coo_matrix((lengths, (here, there)), shape=(len(cells), len(cells))).tocsr()
    straight = np.stack([np.hypot(*(cells - source).T) for source in sources])
    starts = straight.argmin(axis=1)
    ways = dijkstra(graph, directed=False, indices=starts)
    ways += straight[np.arange(len(starts)), starts][:, None]
    nearest = ways.min(axis=0)
    result[mask] = np.where(np.isfinite(nearest), nearest, straight.min(axis=0))
    return result
