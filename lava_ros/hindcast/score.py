# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Agreement of the inundated area of a simulated flow with a mapped flow field.

All numbers are invariant if both are rotated by 90 degrees or mirrored.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from lava_ros.files.optional import require
from lava_ros.hindcast.case import Case
from lava_ros.simulation.output.inundation import standing_cells

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


def score_case(case: Case, thickness: np.ndarray, inundated: np.ndarray) -> Score:
    """Compare a simulated flow with the mapped flow field of a case, on the cells of the case.

    Args:
        case: The case.
        thickness: Thickness of the simulated lava [m], NaN without data, shape [rows, columns].
        inundated: Cells that it has inundated, bool, same shape.
    """
    terrain, footprint, thickness = case.scene.terrain, case.footprint, np.nan_to_num(thickness)
    places = [place for vent in case.scene.vents for place in (vent.position, vent.end) if place]
    vents = [cell for place in places if (cell := terrain.cell_at(*place)) is not None]
    standing, area = standing_cells(thickness), terrain.resolution**2
    layer = thickness[standing]
    hits = int((inundated & footprint).sum())
    mapped, simulated = int(footprint.sum()), int(inundated.sum())
    jaccard = hits / (mapped + simulated - hits) if mapped + simulated else 0.0
    ways = distances(inundated | footprint, vents) * terrain.resolution
    length, mapped_length = _longest(ways, inundated), _longest(ways, footprint)
    return Score(
        jaccard=jaccard,
        recall=hits / mapped if mapped else 0.0,
        precision=hits / simulated if simulated else 0.0,
        fit=math.sqrt(jaccard),
        hits=hits,
        misses=mapped - hits,
        false_alarms=simulated - hits,
        area=simulated * area,
        standing_area=int(standing.sum()) * area,
        mapped_area=mapped * area,
        length=length,
        mapped_length=mapped_length,
        volume=float(thickness.sum()) * area,
        mean_thickness=float(layer.mean()) if layer.size else 0.0,
        median_thickness=float(np.median(layer)) if layer.size else 0.0,
        thickest=float(layer.max()) if layer.size else 0.0,
        mapped_thickness=case.volume / (mapped * area) if mapped else math.nan,
        length_error=length / mapped_length - 1.0 if mapped_length else math.nan,
        area_error=simulated * area / (mapped * area) - 1.0 if mapped else math.nan,
    )


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
