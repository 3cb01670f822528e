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

"""The thickness on a fine grid, and where on it a front is."""

from dataclasses import dataclass
import math

import numpy as np


@dataclass(frozen=True, eq=False)
class Field:
    """Thickness on a grid of square cells.

    Attributes:
        thickness: Thickness [m], shape [rows, columns].
        cell: Side of a cell [m].
        origin: Position (x, y) [m] of the lower-left corner of cell [0, 0].
    """

    thickness: np.ndarray
    cell: float
    origin: tuple[float, float]

    @property
    def x(self) -> np.ndarray:
        """Places of the columns' middles along x [m]."""
        return self.origin[0] + (np.arange(self.thickness.shape[1]) + 0.5) * self.cell

    @property
    def y(self) -> np.ndarray:
        """Places of the rows' middles along y [m]."""
        return self.origin[1] + (np.arange(self.thickness.shape[0]) + 0.5) * self.cell

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Thickness [m] at places inside the grid [m], bilinear."""
        rows, columns = self.thickness.shape
        column = np.clip((x - self.origin[0]) / self.cell - 0.5, 0.0, columns - 1.0)
        row = np.clip((y - self.origin[1]) / self.cell - 0.5, 0.0, rows - 1.0)
        j = np.minimum(column.astype(int), columns - 2)
        i = np.minimum(row.astype(int), rows - 2)
        s, t = column - j, row - i
        grid = self.thickness
        low = (1.0 - s) * grid[i, j] + s * grid[i, j + 1]
        high = (1.0 - s) * grid[i + 1, j] + s * grid[i + 1, j + 1]
        return (1.0 - t) * low + t * high

    def along_x(self, half_width: float) -> np.ndarray:
        """Mean thickness over the rows within ``half_width`` [m] of y = 0, shape [columns]."""
        return self.thickness[np.abs(self.y) <= max(half_width, self.cell)].mean(axis=0)

    def mean_radius(self, threshold: float, reach: float) -> float:
        """Mean distance [m] from (0, 0) at which the field gets thinner than ``threshold`` [m].

        The mean is over 32 directions, each sampled up to ``reach`` [m].
        """
        distance = np.arange(0.0, reach, 0.5 * self.cell)
        radii = []
        for angle in 2.0 * math.pi * (np.arange(32) + 0.5) / 32:
            values = self.at(distance * math.cos(angle), distance * math.sin(angle))
            radii.append(front(distance, values, threshold))
        return float(np.mean(radii))


def front(place: np.ndarray, thickness: np.ndarray, threshold: float) -> float:
    """Largest place at which the thickness crosses ``threshold`` [m], interpolated [m].

    ``place`` is ascending [m], ``thickness`` the thickness there [m]. The result is NaN if no
    thickness exceeds the threshold, or if the last one still does.
    """
    above = np.flatnonzero(thickness > threshold)
    if len(above) == 0 or above[-1] + 1 == len(place):
        return math.nan
    i = above[-1]
    share = (thickness[i] - threshold) / (thickness[i] - thickness[i + 1])
    return float(place[i] + share * (place[i + 1] - place[i]))


def half_width(place: np.ndarray, thickness: np.ndarray, threshold: float) -> float:
    """Mean distance of the outermost fronts on both sides from 0 [m], as ``front`` has them."""
    above, below = (place, thickness), (-place[::-1], thickness[::-1])
    return 0.5 * (front(*above, threshold) + front(*below, threshold))


def slope_of(x: np.ndarray, y: np.ndarray) -> float:
    """Slope of the straight line through places by least squares, NaN when one of them is."""
    offset = x - np.mean(x)
    return float(offset @ (y - np.mean(y)) / (offset @ offset))
