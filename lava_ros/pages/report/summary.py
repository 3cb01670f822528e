# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Summary of the frames of a run, and their maps in compressed form."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
import io
import math
from typing import Any
import zlib

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.maps.arrival import Arrival, THICKNESS
from lava_ros.maps.colours import STYLES
from lava_ros.maps.frames import Frame, Progress, Recording, silent
from lava_ros.maps.layers import Layer, OCCUPANCY_GRID, SOURCES
from lava_ros.maps.plot import shaded_ground

#: Maximum number of frames on a page, and of cells in a frame.
MAX_FRAMES, MAX_CELLS = 120, 90_000

#: Margin around the flow, as a fraction of its size, and minimum size of the map [cells].
MARGIN, MIN_CELLS = 0.15, 48

#: Maximum code of a cell; 0 means no lava.
_MAX_CODE = 250


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
        progress('reading', 0.5 * recording.progress_at(frame))
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
    x = frame.origin[0] + (columns + 0.5) * frame.resolution
    y = frame.origin[1] + (rows + 0.5) * frame.resolution
    nearest = np.full(len(x), np.inf)
    for vent_x, vent_y in vents:
        np.minimum(nearest, np.hypot(x - vent_x, y - vent_y), out=nearest)
    return float(nearest.max())


@dataclass(frozen=True)
class View:
    """The visible rows and columns of the terrain: the first, and the one after the last.

    ``factor`` cells along a side are combined into one.
    """

    rows: tuple[int, int]
    columns: tuple[int, int]
    factor: int

    def cut(self, values: np.ndarray, reduce: np.ufunc) -> np.ndarray:
        """Return the visible cells, combined by a function such as ``np.fmax``."""
        part = values[slice(*self.rows), slice(*self.columns)]
        if self.factor == 1:
            return part
        missing = [(0, -size % self.factor) for size in part.shape]
        padded = np.pad(part.astype(float), missing, constant_values=np.nan)
        rows, columns = (size // self.factor for size in padded.shape)
        blocks = padded.reshape(rows, self.factor, columns, self.factor)
        return np.asarray(reduce.reduce(blocks, axis=(1, 3)))


def view_of(summary: RunSummary) -> View:
    """Return the view of flow and vents with a margin, or of the whole terrain without lava."""
    frame = summary.frame
    rows, columns = np.nonzero(summary.touched)
    places = (summary.vents - np.array(frame.origin)) / frame.resolution
    spans = []
    for size, cells, vents in (
        (frame.elevation.shape[0], rows, places[:, 1]),
        (frame.elevation.shape[1], columns, places[:, 0]),
    ):
        ends = [*map(int, cells), *(math.floor(item) for item in vents)]
        low, high = (min(ends), max(ends) + 1) if ends else (0, size)
        spans.append((low, high, size))
    lengths = [max((high - low) * (1.0 + 2.0 * MARGIN), MIN_CELLS) for low, high, _ in spans]
    # limits the aspect ratio
    lengths[0] = max(lengths[0], 0.55 * lengths[1])
    lengths[1] = max(lengths[1], 0.8 * lengths[0])
    ranges = []
    for (low, high, size), length in zip(spans, lengths, strict=True):
        count = min(size, math.ceil(length))
        first = min(max(0, (low + high - count) // 2), size - count)
        ranges.append((first, first + count))
    cells = math.prod(last - first for first, last in ranges)
    return View(ranges[0], ranges[1], math.ceil(math.sqrt(cells / MAX_CELLS)))


def pack_maps(
    recording: Recording, summary: RunSummary, view: View, progress: Progress = silent
) -> dict[str, Any]:
    """Return the frames as plain data for the page: times, and the packed cells of each layer.

    Row 0 is the southernmost. The cells of a frame are its codes XOR those of the previous frame.
    Code 0 means no lava; the value of any other code is ``low + code * step``.
    """
    shown = _shown(summary.times)
    layers = {
        item: summary.frame.layers[item].layer for item in SOURCES if item in summary.frame.layers
    }
    scales = {
        source: _scale(layer, summary.largest.get(source, 1.0)) for source, layer in layers.items()
    }
    codes: dict[str, list[np.ndarray]] = {source: [] for source in layers}
    times: list[float] = []
    areas: list[float] = []
    fitting = (
        frame for frame in recording.frames() if frame.elevation.shape == summary.touched.shape
    )
    for index, frame in enumerate(fitting):
        if index in shown:
            times.append(frame.time or 0.0)
            areas.append(frame.standing_area)
            for source in layers:
                codes[source].append(_codes(frame, source, view, scales[source]))
            progress('packing', 0.5 + 0.5 * recording.progress_at(frame))
    return {
        'times': times,
        'areas': areas,
        'layers': [
            {
                'name': source,
                'title': STYLES[source].title,
                'unit': STYLES[source].label,
                'colours': list(STYLES[source].colours),
                'classes': list(STYLES[source].classes.items()),
                'low': scales[source][0],
                'step': scales[source][1],
                'most': summary.largest.get(source, 0.0),
                'saturated': source in summary.saturated,
                'cells': _packed(frames),
            }
            for source, frames in codes.items()
        ],
        'arrival': _arrival(summary, view),
    }


def relief(summary: RunSummary, view: View) -> str:
    """Return the shaded ground, north up, as a data URL of a JPEG.

    Raises:
        LavaError: If matplotlib is not installed.
    """
    require('matplotlib', 'report', 'relief')
    from PIL import Image

    ground = shaded_ground(summary.frame)[..., :3]
    count = view.cut(np.ones(ground.shape[:2]), np.add)
    channels = [np.nan_to_num(view.cut(ground[..., i], np.add) / count) for i in range(3)]
    pixels = (255.0 * np.stack(channels, axis=-1)[::-1]).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, 'JPEG', quality=88, subsampling=0)
    return 'data:image/jpeg;base64,' + base64.b64encode(file.getvalue()).decode()


def _packed(frames: Sequence[np.ndarray]) -> str:
    """Return the compressed changes from frame to frame in base64."""
    cells = np.stack(frames)
    cells[1:] ^= cells[:-1].copy()
    return base64.b64encode(zlib.compress(cells.tobytes(), 9)).decode()


def _shown(times: list[float]) -> set[int]:
    """Return the indices of the frames on the page: all, or those at evenly spread times."""
    if len(times) <= MAX_FRAMES:
        return set(range(len(times)))
    wanted = np.linspace(times[0], times[-1], MAX_FRAMES)
    return {int(index) for index in np.searchsorted(times, wanted)}


def _scale(layer: Layer, largest: float) -> tuple[float, float]:
    """Return the value of code 0 and the step between codes; only images are rounded."""
    if layer.message == OCCUPANCY_GRID and layer.range is not None and layer.scale == (0, 100):
        low, high = layer.range
        return low, (high - low) / 100.0
    return 0.0, max(largest, 1e-6) / _MAX_CODE


def _codes(frame: Frame, source: str, view: View, scale: tuple[float, float]) -> np.ndarray:
    """Return the codes of a layer, uint8, 0 if the frame does not have it."""
    shown = frame.layers.get(source)
    values = np.full(frame.elevation.shape, np.nan) if shown is None else shown.values
    # the maximum of combined cells
    values = view.cut(values, np.fmax)
    low, step = scale
    codes = np.clip(np.rint((np.nan_to_num(values) - low) / step), 1, _MAX_CODE)
    return np.where(np.isfinite(values), codes, 0).astype(np.uint8)


def _arrival(summary: RunSummary, view: View) -> dict[str, Any] | None:
    """Return the arrival times with 16 bits per cell, rounded down; 0 means no arrival."""
    times = summary.arrival.times
    if times is None or not np.isfinite(times).any():
        return None
    earliest = view.cut(times, np.fmin)
    start, end = summary.times[0], summary.times[-1]
    most = 65_535
    step = max(end - start, 1.0) / (most - 1)
    codes = 1.0 + np.floor((np.nan_to_num(earliest, nan=start) - start) / step)
    codes = np.where(np.isfinite(earliest), np.clip(codes, 1, most), 0)
    return {
        'title': 'Arrival',
        'colours': list(STYLES['arrival'].colours),
        'start': start,
        'step': step,
        'threshold': summary.arrival.threshold,
        'gap': 0.0 if summary.arrival.is_noted else summary.arrival.longest_gap,
        'cells': _packed([codes.astype('<u2')]),
    }
