# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Largest thickness and highest temperature of each cell, kept by the steps themselves."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from lava_ros.simulation.backend.memory import read_parts
from lava_ros.simulation.cells.highest import Highest


class CellPeaks:
    """Peaks of the lava on cells since a time.

    Attributes:
        highest: The arrays that steps update.
    """

    def __init__(self, shape: tuple[int, ...], device: Any) -> None:
        """Allocate for maps of a shape with their ring, without lava."""
        self.highest = Highest()
        self._maps = [wp.zeros(shape, dtype=wp.float32, device=device) for _ in range(2)]
        self.highest.thickness, self.highest.temperature = self._maps

    def restart(self, thickness: np.ndarray, temperature: np.ndarray) -> None:
        """Begin again with lava of a thickness [m] and a temperature [K], maps with their ring."""
        for array, values in zip(self._maps, (thickness, temperature), strict=True):
            array.assign(values.astype(np.float32))

    def move(self, former: 'CellPeaks', into: Callable[[np.ndarray], np.ndarray]) -> None:
        """Continue the peaks of another grid; ``into`` converts a map from its cells."""
        for array, other in zip(self._maps, former._maps, strict=True):
            moved = np.pad(into(other.numpy()[1:-1, 1:-1]), 1).astype(np.float32)
            array.assign(np.fmax(array.numpy(), moved))

    def on_terrain(
        self, onto: Callable[[np.ndarray], np.ndarray], cells: tuple[slice, slice]
    ) -> np.ndarray:
        """Return thickness and temperature on some of the terrain's cells: [2, rows, columns].

        In a cell of several smaller ones it is the mean of their peaks, and the temperature by
        thickness. ``onto`` converts these ``cells`` of the maps.
        """
        highest = self.highest
        thickness, temperature = read_parts([highest.thickness, highest.temperature], cells)
        mean = onto(thickness)
        with np.errstate(invalid='ignore', divide='ignore'):
            warm = onto(thickness * temperature) / mean
        return np.stack([mean, warm])
