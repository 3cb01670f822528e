# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""When lava came to each cell, and how thick it got, from the frames of a bag."""

import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.maps.frames import Frame
from lava_ros.maps.layers import IMAGE, Layer
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.inundation import standing_cells

THICKNESS = 'thickness'


class Arrival:
    """First times and largest thicknesses, gathered frame by frame.

    Times are those that the simulation noted at its steps, where the bag has them and the
    threshold is the thickness that inundates ground. Else a frame shows lava that came since the
    frame before: it is at most ``longest_gap`` older than the time of its cell. Frames on another
    terrain than the newest do not count.

    Attributes:
        threshold: Thickness from which on lava has arrived [m].
        times: Simulated time [s] at which lava that thick came, at the latest, float64, shape
            [rows, columns]; NaN where there was none. None before the first frame.
        peak: Largest thickness [m], float32, same shape; 0 without lava.
        is_saturated: Whether a thickness was the largest that its grid can hold.
        longest_gap: Longest time from one frame to the next [s].
        is_noted: Whether the simulation noted the times.
        frame_count: Frames with a thickness so far.
        frame: The newest of them, None before the first.
    """

    def __init__(self, threshold: float) -> None:
        """Start without frames; lava counts as arrived from ``threshold`` [m] on."""
        self.threshold = threshold
        self.times: np.ndarray | None = None
        self.peak: np.ndarray | None = None
        self._clear()

    def _clear(self) -> None:
        self.frame: Frame | None = None
        self.is_saturated = self.is_noted = False
        self.longest_gap, self.frame_count = 0.0, 0

    def add(self, frame: Frame) -> None:
        """Add a frame, later than the one before; frames without thickness or time are ignored.

        LavaError where the frame's layer does not show lava as thin as the threshold.
        """
        shown = frame.layers.get(THICKNESS)
        if shown is None or frame.time is None:
            return
        check_threshold(self.threshold, shown.layer)
        if self.frame is None or _grid(frame) != _grid(self.frame):
            self._clear()
            self.times = np.full(shown.values.shape, np.nan)
            self.peak = np.zeros(shown.values.shape, dtype=np.float32)
        assert self.times is not None and self.peak is not None
        is_noted = frame.inundated is not None and bool(frame.inundated.any())
        if is_noted and math.isclose(self.threshold, COVERED):
            assert frame.arrived is not None
            self.times, self.is_noted = frame.arrived.astype(float), True
        elif not self.is_noted:
            is_there = standing_cells(shown.values, self.threshold)
            self.times[np.isnan(self.times) & is_there] = frame.time
        np.fmax(self.peak, shown.values, out=self.peak)
        self.is_saturated |= shown.is_saturated
        if self.frame is not None and self.frame.time is not None:
            self.longest_gap = max(self.longest_gap, frame.time - self.frame.time)
        self.frame = frame
        self.frame_count += 1


def _grid(frame: Frame) -> tuple[object, ...]:
    return frame.resolution, frame.origin, frame.elevation.shape


def check_threshold(threshold: float, layer: Layer) -> None:
    """Refuse a threshold [m] that is not above 0, or below what a layer of thickness shows."""
    if threshold <= 0.0 or threshold < layer.threshold * (1.0 - 1e-6):
        right = f'at least {layer.threshold:g} m: the layer {layer.name} shows no thinner lava'
        if layer.threshold <= 0.0:
            right = 'above 0 m'
        raise LavaError('threshold', threshold, right)


def rounding(layer: Layer) -> float:
    """Half the step between the values a layer can show, in its unit; 0 where it is not rounded.

    Values beyond the layer's range are at its ends, however far beyond they are.
    """
    if layer.message == IMAGE or layer.range is None:
        return 0.0
    first, last = layer.scale
    return 0.5 * (layer.range[1] - layer.range[0]) / abs(last - first)
