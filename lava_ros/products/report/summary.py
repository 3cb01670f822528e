# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Summary of the frames of a run."""

from dataclasses import dataclass, field
import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.layers.arrival import Arrival, THICKNESS
from lava_ros.layers.frame import Frame
from lava_ros.layers.recording import Progress, Recording, silent


@dataclass(eq=False)
class RunSummary:
    """Summary of a run: its last frame, and curves with one value for each frame.

    ``touched`` are the cells that have had lava, and ``vents`` the positions [m] of the vents that
    have emitted. ``front`` is the maximum distance [m] of these cells from their nearest vent.
    ``inundated`` and ``standing`` are the inundated area so far and the area of standing lava
    [m2], the first NaN without arrival times; ``hottest`` is in Celsius, NaN without lava.
    ``largest`` has the maximum by source, and ``saturated`` the sources with values at the limit
    of their grid.
    """

    frame: Frame
    arrival: Arrival
    touched: np.ndarray
    vents: np.ndarray
    times: list[float] = field(default_factory=list)
    inundated: list[float] = field(default_factory=list)
    standing: list[float] = field(default_factory=list)
    front: list[float] = field(default_factory=list)
    hottest: list[float] = field(default_factory=list)
    largest: dict[str, float] = field(default_factory=dict)
    saturated: set[str] = field(default_factory=set)


def summarize(recording: Recording, progress: Progress = silent) -> RunSummary:
    """Read and summarise all frames of the last run.

    Raises:
        LavaError: If the bag is damaged, or has no map or no simulated times.
    """
    if not recording.timeline.moments:
        expected = 'a bag with /diagnostics of the node, which contain the simulated time'
        raise LavaError('bag', str(recording.bag.path), expected)
    # the inundation thickness, unless a layer shows only thicker lava
    layers = recording.layers.values()
    shown = (item.threshold for item in layers if item.source == THICKNESS)
    least = max([recording.inundation_threshold, *shown])
    result: RunSummary | None = None
    for frame in recording.frames():
        if result is None or frame.elevation.shape != result.touched.shape:
            # discards the frames of an earlier terrain
            result = RunSummary(
                frame,
                Arrival(least),
                np.zeros(frame.elevation.shape, dtype=bool),
                np.empty((0, 2)),
            )
        _add(result, frame)
        progress('reading', recording.progress_at(frame))
    if result is None:
        raise LavaError('bag', str(recording.bag.path), 'a bag with at least one map')
    return result


def _add(result: RunSummary, frame: Frame) -> None:
    result.frame = frame
    result.arrival.add(frame)
    wet = frame.lava
    most = {}
    for source, shown in frame.layers.items():
        here = np.isfinite(shown.values)
        if here.any():
            most[source] = float(shown.values[here].max())
            result.largest[source] = max(result.largest.get(source, -math.inf), most[source])
        if shown.is_saturated:
            result.saturated.add(source)
    fresh = wet & ~result.touched
    result.touched |= wet
    before = result.front[-1] if result.front else math.nan
    if not set(map(tuple, frame.vents)) <= set(map(tuple, result.vents)):
        result.vents = np.unique(np.concatenate([result.vents, frame.vents]), axis=0)
        # cells may be nearer to the new vent
        fresh, before = result.touched, math.nan
    result.times.append(frame.time or 0.0)
    unknown = np.nan if frame.inundated is None else frame.area(frame.inundated)
    result.inundated.append(unknown)
    result.standing.append(frame.standing_area)
    result.front.append(float(np.fmax(before, _front_distance(frame, fresh, result.vents))))
    result.hottest.append(most.get('temperature', math.nan))


def _front_distance(frame: Frame, cells: np.ndarray, vents: np.ndarray) -> float:
    """Return the maximum distance [m] of cells from their nearest vent, NaN without either."""
    rows, columns = np.nonzero(cells)
    if len(rows) == 0 or len(vents) == 0:
        return math.nan
    x, y = frame.centres
    nearest = np.full(len(rows), np.inf)
    for vent_x, vent_y in vents:
        np.minimum(nearest, np.hypot(x[columns] - vent_x, y[rows] - vent_y), out=nearest)
    return float(nearest.max())
