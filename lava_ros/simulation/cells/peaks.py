# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Largest thickness and highest temperature of each cell, kept by the steps themselves."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from lava_ros.simulation.cells.highest import Highest


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

    def on_terrain(self, onto: Callable[[np.ndarray], np.ndarray], rows: slice) -> np.ndarray:
        """Return thickness and temperature on some of the terrain's cells: [2, rows, columns].

        In a cell of several smaller ones it is the mean of their peaks, and the temperature by
        thickness. ``onto`` converts maps of the solver's cells, and needs these ``rows`` of them.
        """
        thickness, temperature = (
            np.zeros(np.subtract(self.highest.thickness.shape, 2), dtype=np.float32)
            for _ in range(2)
        )
        if rows.stop > rows.start:
            for values, array in (
                (thickness, self.highest.thickness), (temperature, self.highest.temperature)
            ):
                values[rows] = array[rows.start + 1 : rows.stop + 1].numpy()[:, 1:-1]
        mean = onto(thickness)
        with np.errstate(invalid='ignore', divide='ignore'):
            warm = onto(thickness * temperature) / mean
        return np.stack([mean, warm])
