# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""First arrival time and peak thickness of lava in each cell, from the frames of a bag."""

import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.layers.frame import Frame
from lava_ros.layers.layer import IMAGE, Layer
from lava_ros.simulation.output.inundation import standing_cells

THICKNESS = 'thickness'


class Arrival:
    """First arrival times and peak thicknesses, accumulated frame by frame.

    Times are exact to a time step if the bag contains arrival times and the threshold is the
    inundation thickness. Otherwise the time of a cell is the time of the first frame with lava in
    it, which is late by at most ``longest_gap``. Frames on earlier terrains are discarded.

    Attributes:
        threshold: Lava has arrived where its thickness is at or above this value [m].
        times: First arrival time [s], float64, shape [rows, columns]; NaN in cells without
            arrival. None before the first frame.
        peak: Peak thickness [m], float32, same shape; 0 without lava.
        is_saturated: True if a thickness was the maximum of its grid.
        first_time: Simulated time of the first of these frames [s]; NaN without any.
        is_noted: True if the times are exact to a time step.
        frame_count: Number of frames with a thickness so far.
        frame: The newest of these frames; None before the first.
    """

    def __init__(self, threshold: float) -> None:
        """Initialize without frames; ``threshold`` is the thickness of arrived lava [m]."""
        self.threshold = threshold
        self.times: np.ndarray | None = None
        self.peak: np.ndarray | None = None
        self._clear()

    def _clear(self) -> None:
        self.frame: Frame | None = None
        self.is_saturated = self.is_noted = False
        self.first_time, self._gap, self.frame_count = math.nan, 0.0, 0

    @property
    def longest_gap(self) -> float:
        """Longest simulated time without a frame, from time 0 [s]."""
        return max(self._gap, self.first_time) if self.frame_count else 0.0

    @property
    def begins_late(self) -> bool:
        """True if frames of the beginning are missing, as after a resume."""
        # a run makes its first map one interval after its start
        return self.first_time > 1.5 * self._gap

    def add(self, frame: Frame) -> None:
        """Add the next frame; frames without thickness or time are ignored.

        Raises:
            LavaError: If the frame's layer does not show lava as thin as the threshold.
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
        is_noted = frame.reached is not None and bool(frame.reached.any())
        if is_noted and math.isclose(self.threshold, frame.threshold):
            assert frame.arrived is not None
            self.times, self.is_noted = frame.arrived.astype(float), True
        elif not self.is_noted:
            is_there = standing_cells(shown.values, self.threshold)
            self.times[np.isnan(self.times) & is_there] = frame.time
        np.fmax(self.peak, shown.values, out=self.peak)
        self.is_saturated |= shown.is_saturated
        if self.frame is None or self.frame.time is None:
            self.first_time = frame.time
        else:
            self._gap = max(self._gap, frame.time - self.frame.time)
        self.frame = frame
        self.frame_count += 1


def _grid(frame: Frame) -> tuple[object, ...]:
    return frame.resolution, frame.origin, frame.elevation.shape


def check_threshold(threshold: float, layer: Layer) -> None:
    """Raise LavaError if a threshold [m] is not above 0, or is below the layer's threshold."""
    if threshold <= 0.0 or threshold < layer.threshold * (1.0 - 1e-6):
        expected = f'at least {layer.threshold:g} m: the layer {layer.name} shows no thinner lava'
        if layer.threshold <= 0.0:
            expected = 'above 0 m'
        raise LavaError('threshold', threshold, expected)


def rounding(layer: Layer) -> float:
    """Return half the step between the values of a layer, in its unit; 0 if it is not rounded.

    Values beyond the layer's range are clipped to it, with a larger error.
    """
    if layer.message == IMAGE or layer.range is None:
        return 0.0
    first, last = layer.scale
    return 0.5 * (layer.range[1] - layer.range[0]) / abs(last - first)
