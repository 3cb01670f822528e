# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Largest thickness and highest temperature of each cell, kept by the steps themselves."""

from collections.abc import Callable
from typing import Any

import numpy as np

from lava_ros.simulation.backend.memory import ArrayBlock, read_parts
from lava_ros.simulation.cells.highest import Highest
from lava_ros.simulation.cells.state import KernelState, layout_of


class CellPeaks(KernelState):
    """Peaks of the lava on cells since a time, which steps update (``Highest``).

    Attributes:
        block: The maps.
        thickness: Largest thickness of flowing and solidified lava [m], float32, a map.
        temperature: Highest temperature of flowing lava [K], float32, a map.
    """

    STRUCT = Highest
    thickness: Any
    temperature: Any

    def __init__(self, shape: tuple[int, int], device: Any) -> None:
        """Allocate for maps of a shape with their ring, without lava."""
        self.block = ArrayBlock(layout_of(Highest, shape), device)

    def _maps(self) -> tuple[Any, Any]:
        return self.thickness, self.temperature

    def restart(self, thickness: np.ndarray, temperature: np.ndarray) -> None:
        """Begin again with lava of a thickness [m] and a temperature [K], maps with their ring."""
        for array, values in zip(self._maps(), (thickness, temperature), strict=True):
            array.assign(values.astype(np.float32))

    def move(self, former: 'CellPeaks', into: Callable[[np.ndarray], np.ndarray]) -> None:
        """Continue the peaks of another grid; ``into`` converts a map from its cells."""
        for array, other in zip(self._maps(), former._maps(), strict=True):
            moved = np.pad(into(other.numpy()[1:-1, 1:-1]), 1).astype(np.float32)
            array.assign(np.fmax(array.numpy(), moved))

    def on_terrain(
        self, onto: Callable[[np.ndarray], np.ndarray], cells: tuple[slice, slice]
    ) -> np.ndarray:
        """Return thickness and temperature on some of the terrain's cells: [2, rows, columns].

        In a cell of several smaller ones it is the mean of their peaks, and the temperature by
        thickness. ``onto`` converts these ``cells`` of the maps.
        """
        thickness, temperature = read_parts(self._maps(), cells)
        mean = onto(thickness)
        with np.errstate(invalid='ignore', divide='ignore'):
            warm = onto(thickness * temperature) / mean
        return np.stack([mean, warm])
