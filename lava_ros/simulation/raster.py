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

"""Particles to grid: thickness and temperature at the cells of the terrain (section 3.4.2)."""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from lava_ros.simulation.kernels import smoothing_kernel
from lava_ros.simulation.neighbors import cell_functions, CellFrame, NeighborGrid
from lava_ros.simulation.state import State
from lava_ros.simulation.terrain import StaggeredTerrain, TerrainFrame


@lru_cache
def _kernel(real: Any, kernel_name: str, ratio: float) -> Any:
    vec4 = wp.types.vector(4, real)
    norm, shape, *_ = smoothing_kernel(kernel_name, real, ratio)
    column_of, row_of = cell_functions(real)

    @wp.kernel(module='unique', enable_backward=False)
    def raster(
        ordered: wp.array(dtype=vec4),
        starts: wp.array(dtype=wp.int32),
        cells: CellFrame,
        terrain: TerrainFrame,
        radius: wp.float64,
        thickness: wp.array2d(dtype=wp.float32),
        temperature: wp.array2d(dtype=wp.float32),
    ):
        """Sum V W (thickness) and the V W-weighted mean of T at one cell centre."""
        i, j = wp.tid()
        x = real(terrain.x0 + (wp.float64(j) + wp.float64(0.5)) * terrain.resolution)
        y = real(terrain.y0 + (wp.float64(i) + wp.float64(0.5)) * terrain.resolution)
        reach = real(radius)
        inverse = real(1.0) / reach
        first = column_of(cells, x - reach)
        last = column_of(cells, x + reach)
        height = real(0.0)
        heat = real(0.0)
        for r in range(row_of(cells, y - reach), row_of(cells, y + reach) + 1):
            for k in range(
                starts[r * cells.columns + first], starts[r * cells.columns + last + 1]
            ):
                p = ordered[k]
                dx = (x - p[0]) * inverse
                dy = (y - p[1]) * inverse
                square = dx * dx + dy * dy
                if square < real(1.0):
                    weight = p[2] * shape(wp.sqrt(square))
                    height += weight
                    heat += weight * p[3]
        if height > real(0.0):
            thickness[i, j] = wp.float32(height * real(wp.static(norm)) * inverse * inverse)
            temperature[i, j] = wp.float32(heat / height)
        else:
            thickness[i, j] = wp.float32(0.0)
            temperature[i, j] = wp.float32(wp.nan)

    return raster


class Raster:
    """Output grids on a device, one value for each cell of a terrain."""

    def __init__(
        self, terrain: StaggeredTerrain, radius: float, kernel: str, ratio: float, device: Any
    ) -> None:
        """Allocate the grids.

        Args:
            terrain: The terrain whose cells are filled.
            radius: Kernel radius of the output, l_render in the paper [m].
            kernel: Name of the smoothing kernel.
            ratio: Kernel radius over particle spacing.
            device: Warp device.
        """
        shape = (terrain.frame.rows, terrain.frame.columns)
        self._terrain = terrain
        self._radius = radius
        self._choice = (kernel, ratio)
        self._device = device
        self._thickness = wp.zeros(shape, dtype=wp.float32, device=device)
        self._temperature = wp.zeros(shape, dtype=wp.float32, device=device)

    def fill(self, state: State, neighbors: NeighborGrid) -> tuple[np.ndarray, np.ndarray]:
        """Thickness [m] and temperature [K, NaN where dry] from the ordered particles."""
        wp.launch(
            _kernel(state.real, *self._choice),
            dim=self._thickness.shape,
            inputs=[
                state.ordered,
                neighbors.starts,
                neighbors.frame,
                self._terrain.frame,
                self._radius,
            ],
            outputs=[self._thickness, self._temperature],
            device=self._device,
        )
        # a copy: on the CPU numpy() is a view of the device array
        return self._thickness.numpy().copy(), self._temperature.numpy().copy()
