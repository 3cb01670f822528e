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

"""The staggered terrain grid: heights at cell centres, gradients at corners (3.15 to 3.22)."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.scene import Terrain
from lava_ros.simulation.state import centre_of, REAL


@wp.struct
class TerrainFrame:
    """Where the grid's cells lie, relative to the terrain's centre."""

    x0: wp.float64
    y0: wp.float64
    resolution: wp.float64
    rows: wp.int32
    columns: wp.int32


class StaggeredTerrain:
    """A terrain on a device.

    Attributes:
        gradient: Gradient of the elevation at the cells' corners, shape [rows + 1, columns + 1].
        known: 1 for cells with data, 0 for others, shape [rows, columns].
        frame: Where the cells lie.
    """

    def __init__(self, terrain: Terrain, precision: str, device: Any) -> None:
        """Compute the corner gradients and move them to the device."""
        rows, columns = terrain.shape
        gradient = corner_gradients(terrain)
        vec2 = wp.types.vector(2, REAL[precision])
        self.gradient = wp.array(gradient, dtype=vec2, device=device)
        self.known = wp.array(terrain.has_data.astype(np.uint8), dtype=wp.uint8, device=device)
        self.frame = TerrainFrame()
        x0, y0 = np.asarray(terrain.origin) - centre_of(terrain)
        self.frame.x0, self.frame.y0 = float(x0), float(y0)
        self.frame.resolution = terrain.resolution
        self.frame.rows, self.frame.columns = rows, columns


def corner_gradients(terrain: Terrain) -> np.ndarray:
    """Gradient (d/dx, d/dy) of the elevation at every corner, shape [rows + 1, columns + 1, 2].

    Equation 3.21 with the divisor dx: the half-heights it differences are dx apart (the paper's
    3.17 prints 2 dx). Outside the grid the terrain goes on with the slope of its border; next to
    cells without data it goes on with the slope of the cells that have some.
    """
    height = terrain.elevation.astype(np.float64)
    if not terrain.has_data.all():
        height = _extended(height)
    height = np.pad(height, 1, mode='reflect', reflect_type='odd')
    east = np.diff(height, axis=1) / terrain.resolution
    north = np.diff(height, axis=0) / terrain.resolution
    along_x = 0.5 * (east[:-1] + east[1:])
    along_y = 0.5 * (north[:, :-1] + north[:, 1:])
    return np.stack([along_x, along_y], axis=-1)


def _extended(height: np.ndarray) -> np.ndarray:
    """Fill cells next to known ones with the mean of their neighbours' linear continuations."""
    rows, columns = height.shape
    wide = np.pad(height, 2, constant_values=np.nan)
    total = np.zeros_like(height)
    number = np.zeros_like(height)
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        near = wide[2 + dy : 2 + dy + rows, 2 + dx : 2 + dx + columns]
        far = wide[2 + 2 * dy : 2 + 2 * dy + rows, 2 + 2 * dx : 2 + 2 * dx + columns]
        continued = np.where(np.isfinite(far), 2.0 * near - far, near)
        usable = np.isfinite(continued)
        total[usable] += continued[usable]
        number += usable
    filled = np.where(number > 0, total / np.maximum(number, 1), np.nanmean(height))
    return np.where(np.isnan(height), filled, height)


class TerrainFunctions(NamedTuple):
    """Device functions that read a staggered terrain."""

    gradient_at: Any
    is_known: Any


@lru_cache
def terrain_functions(real: Any) -> TerrainFunctions:
    """Return bilinear sampling of the gradient (3.22) and the test for cells with data."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def gradient_at(
        gradient: wp.array2d(dtype=vec2), frame: TerrainFrame, x: real, y: real
    ) -> vec2:
        inverse = real(1.0) / real(frame.resolution)
        column = (x - real(frame.x0)) * inverse
        row = (y - real(frame.y0)) * inverse
        i = wp.clamp(int(wp.floor(row)), 0, frame.rows - 1)
        j = wp.clamp(int(wp.floor(column)), 0, frame.columns - 1)
        s = wp.clamp(column - real(j), real(0.0), real(1.0))
        t = wp.clamp(row - real(i), real(0.0), real(1.0))
        low = (real(1.0) - s) * gradient[i, j] + s * gradient[i, j + 1]
        high = (real(1.0) - s) * gradient[i + 1, j] + s * gradient[i + 1, j + 1]
        return (real(1.0) - t) * low + t * high

    @wp.func
    def is_known(known: wp.array2d(dtype=wp.uint8), frame: TerrainFrame, x: real, y: real) -> bool:
        j = int(wp.floor((x - real(frame.x0)) / real(frame.resolution)))
        i = int(wp.floor((y - real(frame.y0)) / real(frame.resolution)))
        if i < 0 or j < 0 or i >= frame.rows or j >= frame.columns:
            return False
        return known[i, j] != wp.uint8(0)

    return TerrainFunctions(gradient_at, is_known)
