# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A summary of all frames of a run: how far the lava came, and its numbers over time."""

from dataclasses import dataclass, field
import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.maps.arrival import Arrival, THICKNESS
from lava_ros.maps.frames import Frame, Progress, Recording, silent


@dataclass(eq=False)
class Survey:
    """A run as a whole: its last frame, and curves with one value for each frame.

    ``touched`` are the cells that ever had lava, and ``vents`` the positions [m] of the vents that
    ever emitted. ``front`` is the distance [m] of the farthest touched cell from its nearest such
    vent; ``area`` is in m2, ``hottest`` in Celsius; NaN without lava. ``largest`` has the largest
    value by source, and ``saturated`` the sources with values at the limit of their grid.
    """

    frame: Frame
    arrival: Arrival
    touched: np.ndarray
    vents: np.ndarray
    times: list[float] = field(default_factory=list)
    area: list[float] = field(default_factory=list)
    front: list[float] = field(default_factory=list)
    hottest: list[float] = field(default_factory=list)
    largest: dict[str, float] = field(default_factory=dict)
    saturated: set[str] = field(default_factory=set)


def survey(recording: Recording, progress: Progress = silent) -> Survey:
    """Read every frame of the last run, and summarise it.

    Raises:
        LavaError: The bag is damaged, or has no map or no simulated times.
    """
    if not recording.timeline.moments:
        right = 'a bag with /diagnostics of the node, which say the simulated time'
        raise LavaError('bag', str(recording.bag.path), right)
    # the least thickness that every layer of it shows, and at least a centimetre
    layers = recording.layers.values()
    least = max([0.01, *(item.threshold for item in layers if item.source == THICKNESS)])
    result: Survey | None = None
    for frame in recording.frames():
        if result is None or frame.elevation.shape != result.touched.shape:
            # another terrain: earlier frames do not fit it
            result = Survey(
                frame,
                Arrival(least),
                np.zeros(frame.elevation.shape, dtype=bool),
                np.empty((0, 2)),
            )
        _add(result, frame)
        progress('reading', 0.5 * recording.share_at(frame))
    if result is None:
        raise LavaError('bag', str(recording.bag.path), 'a bag with at least one map')
    return result


def _add(result: Survey, frame: Frame) -> None:
    result.frame = frame
    result.arrival.add(frame)
    wet = np.zeros(frame.elevation.shape, dtype=bool)
    most = {}
    for source, shown in frame.layers.items():
        here = np.isfinite(shown.values)
        if here.any():
            most[source] = float(shown.values[here].max())
            result.largest[source] = max(result.largest.get(source, -math.inf), most[source])
        if shown.is_saturated:
            result.saturated.add(source)
        wet |= here
    fresh = wet & ~result.touched
    result.touched |= wet
    before = result.front[-1] if result.front else math.nan
    if not set(map(tuple, frame.vents)) <= set(map(tuple, result.vents)):
        result.vents = np.unique(np.concatenate([result.vents, frame.vents]), axis=0)
        # earlier cells may be nearer to the new vent
        fresh, before = result.touched, math.nan
    result.times.append(frame.time or 0.0)
    result.area.append(frame.area)
    result.front.append(float(np.fmax(before, _farthest(frame, fresh, result.vents))))
    result.hottest.append(most.get('temperature', math.nan))


def _farthest(frame: Frame, cells: np.ndarray, vents: np.ndarray) -> float:
    """Largest distance [m] of cells from the nearest vent, NaN without cells or vents."""
    rows, columns = np.nonzero(cells)
    if len(rows) == 0 or len(vents) == 0:
        return math.nan
    x = frame.origin[0] + (columns + 0.5) * frame.resolution
    y = frame.origin[1] + (rows + 0.5) * frame.resolution
    nearest = np.full(len(x), np.inf)
    for vent_x, vent_y in vents:
        np.minimum(nearest, np.hypot(x - vent_x, y - vent_y), out=nearest)
    return float(nearest.max())
