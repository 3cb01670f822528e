# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Agreement of the inundated area of a simulated flow with a mapped flow field.

All numbers are invariant if both are rotated by 90 degrees or mirrored.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
import math

import numpy as np

from lava_ros.files.optional import require
from lava_ros.hindcast.case import Case
from lava_ros.simulation.output.inundation import standing_cells
from lava_ros.simulation.output.snapshot import Snapshot

#: Steps of a path to 16 neighbours: its length then has an error of at most 2.7 %.
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (2, -1), (1, -2))


@dataclass(frozen=True)
class Score:
    """A comparison of a simulated flow with a mapped one.

    Simulated cells are the inundated ones. ``jaccard`` is cells in both over cells in either and
    ``fit`` its square root, e1 in the literature; ``recall`` is the inundated fraction of the
    mapped cells, ``precision`` the mapped fraction of the inundated cells. ``area`` is the
    inundated area [m2], ``standing_area`` the area with lava at the end [m2]. Lengths are runout
    lengths along the path from a vent [m]. Thicknesses are those at the end [m];
    ``mapped_thickness`` is the emitted volume over the mapped area. Errors are relative, positive
    if the simulated flow is too long or too large.
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


@dataclass(frozen=True)
class OutlineScore:
    """Agreement of the inundated area at the time of an outline with the outline.

    Attributes:
        outline: Date or time of the outline.
        time: Its time since the start of the simulation [s].
        jaccard: Cells in both over cells in either.
        recall: Inundated fraction of the mapped cells.
        precision: Mapped fraction of the inundated cells.
        area_error: Relative error of the inundated area, positive if it is too large.
        length_error: Relative error of the runout length, positive if it is too long.
        persistence: Jaccard index of the outline before with this one; None for the first.
        descent: Jaccard index of steepest descent over the same area as the inundated one.
    """

    outline: str
    time: float
    jaccard: float
    recall: float
    precision: float
    area_error: float
    length_error: float
    persistence: float | None
    descent: float

    @property
    def words(self) -> str:
        """The scores as text."""
        before = '' if self.persistence is None else f'outline before: {self.persistence:.3f}, '
        return (
            f'{self.jaccard:.3f} (area {100 * self.area_error:+.0f} %; {before}'
            f'steepest descent: {self.descent:.3f})'
        )


def score(
    thickness: np.ndarray,
    inundated: np.ndarray,
    footprint: np.ndarray,
    *,
    resolution: float,
    vents: Sequence[tuple[int, int]],
    emitted: float,
) -> Score:
    """Compare a simulated flow with a mapped one on the same cells.

    ``thickness`` is that of the simulated lava [m], NaN without data, shape [rows, columns].
    ``inundated`` and ``footprint`` are the simulated and the mapped cells, bool. ``vents`` are
    rows and columns, the side of a cell is in m, and the emitted volume in m3.
    """
    thickness = np.nan_to_num(thickness)
    standing, cell = standing_cells(thickness), resolution**2
    layer = thickness[standing]
    hits = int((inundated & footprint).sum())
    mapped, simulated = int(footprint.sum()), int(inundated.sum())
    jaccard = hits / (mapped + simulated - hits) if mapped + simulated else 0.0
    ways = distances(inundated | footprint, vents) * resolution
    length, mapped_length = _longest(ways, inundated), _longest(ways, footprint)
    return Score(
        jaccard=jaccard,
        recall=hits / mapped if mapped else 0.0,
        precision=hits / simulated if simulated else 0.0,
        fit=math.sqrt(jaccard),
        hits=hits,
        misses=mapped - hits,
        false_alarms=simulated - hits,
        area=simulated * cell,
        standing_area=int(standing.sum()) * cell,
        mapped_area=mapped * cell,
        length=length,
        mapped_length=mapped_length,
        volume=float(thickness.sum()) * cell,
        mean_thickness=float(layer.mean()) if layer.size else 0.0,
        median_thickness=float(np.median(layer)) if layer.size else 0.0,
        thickest=float(layer.max()) if layer.size else 0.0,
        mapped_thickness=emitted / (mapped * cell) if mapped else math.nan,
        length_error=length / mapped_length - 1.0 if mapped_length else math.nan,
        area_error=simulated * cell / (mapped * cell) - 1.0 if mapped else math.nan,
    )


def judge(case: Case, thickness: np.ndarray, inundated: np.ndarray) -> Score:
    """Compare a flow on the cells of a case with its mapped flow field, as in ``score``."""
    return score(
        thickness,
        inundated,
        case.footprint,
        resolution=case.scene.terrain.resolution,
        vents=case.vent_cells,
        emitted=case.volume,
    )


def judge_outlines(case: Case, snapshots: Sequence[Snapshot]) -> list[OutlineScore]:
    """Score the area that at least half of some runs have inundated at the time of each outline.

    The area at an earlier time follows from the arrival times of a run. Two references need no
    model of lava: persistence, which is the outline before, and steepest descent.

    Args:
        case: The case with its outlines.
        snapshots: The end of each run, with arrival times.
    """
    scores, terrain = [], case.scene.terrain
    arrived = [item.arrived for item in snapshots if item.arrived is not None]
    for index, outline in enumerate(case.outlines):
        inundated = np.mean([times <= outline.time for times in arrived], axis=0) >= 0.5
        hits = int((inundated & outline.footprint).sum())
        mapped, simulated = int(outline.footprint.sum()), int(inundated.sum())
        before = case.outlines[index - 1].footprint if index else None
        ways = distances(inundated | outline.footprint, case.vent_cells)
        downhill = descend(terrain.elevation, case.vent_cells, simulated)
        scores.append(OutlineScore(
            outline=outline.text,
            time=outline.time,
            jaccard=jaccard(inundated, outline.footprint),
            recall=hits / mapped,
            precision=hits / simulated if simulated else 0.0,
            area_error=simulated / mapped - 1.0,
            length_error=_longest(ways, inundated) / _longest(ways, outline.footprint) - 1.0,
            persistence=None if before is None else jaccard(before, outline.footprint),
            descent=jaccard(downhill, outline.footprint),
        ))
    return scores


def jaccard(one: np.ndarray, other: np.ndarray) -> float:
    """Return the Jaccard index of two masks: cells in both over cells in either."""
    return float((one & other).sum() / max((one | other).sum(), 1))


def descend(
    elevation: np.ndarray, vents: Sequence[tuple[int, int]], count: int
) -> np.ndarray:
    """Return the cells that steepest descent from the vents covers, bool, shape [rows, columns].

    The lowest neighbour of the covered cells is covered next: a path down the slope, which fills
    pits (the priority flood of Barnes, Lehman and Mulla 2014, from the vents).

    Args:
        elevation: Elevation [m], NaN without data, shape [rows, columns].
        vents: Rows and columns of the vents.
        count: Number of cells to cover; fewer if no others can be reached.
    """
    covered, is_queued = (np.zeros(elevation.shape, dtype=bool) for _ in range(2))
    queue: list[tuple[float, int, int]] = []

    def add(row: int, column: int) -> None:
        inside = 0 <= row < elevation.shape[0] and 0 <= column < elevation.shape[1]
        if inside and not is_queued[row, column] and math.isfinite(elevation[row, column]):
            is_queued[row, column] = True
            heappush(queue, (float(elevation[row, column]), row, column))

    for vent in vents:
        add(*vent)
    while queue and count > 0:
        _, row, column = heappop(queue)
        covered[row, column] = True
        count -= 1
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                add(row + down, column + right)
    return covered


def _longest(ways: np.ndarray, mask: np.ndarray) -> float:
    return float(np.max(ways, where=mask & np.isfinite(ways), initial=0.0))


def distances(mask: np.ndarray, sources: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return the length of the shortest path over a mask, in cells; infinite outside it.

    Sources are rows and columns. A source outside the mask starts from the nearest masked cell;
    parts of the mask without a connection to a source are reached in a straight line.
    """
    require('scipy.sparse', 'the length of the flow')
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
    for step in _STEPS:
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
