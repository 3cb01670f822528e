# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Columns of lava on the cells of a grid, and on those of another one."""

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np


@dataclass
class Columns:
    """Lava on the cells of a grid, float64, shape [rows, columns].

    Attributes:
        thickness: Thickness of the flowing lava [m].
        temperature: Its temperature [K].
        emission_time: Its mean time of emission [s], or when lava reached the cell
            (``HeatState``).
        solidified: Thickness of the solidified lava [m].
    """

    thickness: np.ndarray
    temperature: np.ndarray
    emission_time: np.ndarray
    solidified: np.ndarray

    def convert(self, into: Callable[[np.ndarray], np.ndarray]) -> 'Columns':
        """Return the lava on other cells: both volumes are kept, and the heat with them.

        ``into`` converts a map from these cells to the others, and keeps its sum per area.
        """
        thickness = into(self.thickness)
        with np.errstate(invalid='ignore', divide='ignore'):
            temperature, emission_time = (
                np.where(
                    thickness > 0.0, into(self.thickness * values) / thickness,
                    values.max(initial=-math.inf),
                )
                for values in (self.temperature, self.emission_time)
            )
        return Columns(thickness, temperature, emission_time, into(self.solidified))
