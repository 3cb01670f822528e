# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Largest thickness and highest temperature of each cell, kept by the steps themselves."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from lava_ros.simulation.cells.state import Cells, Heat


@wp.struct
class Highest:
    """Peaks since a time: of flowing and solidified lava [m], and of flowing lava [K]; maps."""

    thickness: wp.array2d(dtype=wp.float32)
    temperature: wp.array2d(dtype=wp.float32)


_RAISE = """{
    const long w = s.stride;
    const float* __restrict y = s.stage.data;
    const double* __restrict frozen = m.frozen.data;
    const double* __restrict warmth = m.temperature.data;
    float* __restrict thickness = k.thickness.data;
    float* __restrict temperature = k.temperature.data;
    for (long p = i * w + first; p <= i * w + last; ++p) {
        const float total = y[p] + (float)frozen[p];
        const float warm = y[p] > 0.0f ? (float)warmth[p] : 0.0f;
        thickness[p] = total > thickness[p] ? total : thickness[p];
        temperature[p] = warm > temperature[p] ? warm : temperature[p];
    }
}"""


@lru_cache
def raise_function() -> Any:
    """Return the device function that raises the peaks of a part of a row to the current lava."""

    @wp.func_native(_RAISE)
    def raise_row(s: Cells, m: Heat, k: Highest, i: int, first: int, last: int): ...

    return raise_row


class CellPeaks:
    """Peaks of the lava on cells since a time.

    Attributes:
        highest: The arrays that steps update.
    """

    def __init__(self, shape: tuple[int, ...], device: Any) -> None:
        """Allocate for maps of a shape with their ring, without lava."""
        self.highest = Highest()
        self.highest.thickness = wp.zeros(shape, dtype=wp.float32, device=device)
        self.highest.temperature = wp.zeros(shape, dtype=wp.float32, device=device)

    def restart(self, thickness: np.ndarray, temperature: np.ndarray) -> None:
        """Begin again with lava of a thickness [m] and a temperature [K], maps with their ring."""
        self.highest.thickness.assign(thickness.astype(np.float32))
        self.highest.temperature.assign(temperature.astype(np.float32))

    def move(self, former: 'CellPeaks', into: Callable[[np.ndarray], np.ndarray]) -> None:
        """Continue the peaks of another grid; ``into`` converts a map from its cells."""
        for name in ('thickness', 'temperature'):
            values = getattr(former.highest, name).numpy()[1:-1, 1:-1]
            own = getattr(self.highest, name)
            moved = np.pad(into(values), 1).astype(np.float32)
            own.assign(np.fmax(own.numpy(), moved))

    def maps(self, into: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return thickness and temperature on other cells, to which ``into`` converts a map.

        In a cell of several smaller ones it is the mean of their peaks, and the temperature by
        thickness.
        """
        thickness, temperature = (
            getattr(self.highest, name).numpy()[1:-1, 1:-1]
            for name in ('thickness', 'temperature')
        )
        mean = into(thickness)
        with np.errstate(invalid='ignore', divide='ignore'):
            return mean, into(thickness * temperature) / mean
