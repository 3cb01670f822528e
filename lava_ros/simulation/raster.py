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

"""Particles to grid: thickness and temperature at the cells of the terrain (section 3.4.2).

A kernel sum reaches its radius past the last particle, and the paper's borders are too round.
Here a cell holds lava where the particles' own areas V / h, smoothed by the same kernel, cover
more than half of it: at a straight border that is where the lava ends, whatever the radius. In a
cell that is covered in part the thickness is that of the covered part.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.simulation.cells import cell_frame, cell_functions
from lava_ros.simulation.compiled import load4, row_from
from lava_ros.simulation.kernels import smoothing_kernel
from lava_ros.simulation.neighbors import NeighborGrid
from lava_ros.simulation.state import State
from lava_ros.simulation.terrain import StaggeredTerrain, terrain_frame
from lava_ros.simulation.threads import launch, LEAST_SUMS

#: Share of a cell from which it holds lava.
LEAST_COVER = 0.5


@lru_cache
def _kernel(real: Any, kernel_name: str, ratio: float) -> Any:
    vec3 = wp.types.vector(3, real)
    vec4 = wp.types.vector(4, real)
    norm, shape, *_ = smoothing_kernel(kernel_name, real, ratio)
    _, _, cells_around, range_in = cell_functions(real)
    load = load4(real)

    @wp.kernel(module='unique', enable_backward=False)
    def raster(
        ordered: wp.array(dtype=vec4),
        flow: wp.array(dtype=vec3),
        starts: wp.array(dtype=wp.int32),
        cells: cell_frame(real),
        terrain: terrain_frame(wp.float64),
        known: wp.array2d(dtype=wp.uint8),
        radius: wp.float64,
        thickness: wp.array2d(dtype=wp.float32),
        temperature: wp.array2d(dtype=wp.float32),
        first: int,
    ):
        """Sum V W over the cover sum (V / h) W, and the V W-weighted mean of T, at a centre."""
        n, j = wp.tid()
        i = row_from(first, n)
        if known[i, j] == wp.uint8(0):
            thickness[i, j] = wp.float32(wp.nan)
            temperature[i, j] = wp.float32(wp.nan)
            return
        x = real(terrain.x0 + (wp.float64(j) + wp.float64(0.5)) * terrain.resolution)
        y = real(terrain.y0 + (wp.float64(i) + wp.float64(0.5)) * terrain.resolution)
        reach = real(radius)
        inverse = real(1.0) / reach
        height = real(0.0)
        cover = real(0.0)
        heat = real(0.0)
        box = cells_around(cells, x, y, reach)
        for r in range(box[0], box[1]):
            near = range_in(cells, starts, r, box)
            for k in range(near[0], near[1]):
                p = load(ordered, k)
                dx = (x - p[0]) * inverse
                dy = (y - p[1]) * inverse
                square = dx * dx + dy * dy
                if square < real(1.0):
                    weight = p[2] * shape(wp.sqrt(square))
                    height += weight
                    cover += weight / flow[k][0]
                    heat += weight * p[3]
        scale = real(wp.static(norm)) * inverse * inverse
        cover *= scale
        if cover > real(wp.static(LEAST_COVER)):
            thickness[i, j] = wp.float32(height * scale / wp.min(cover, real(1.0)))
            temperature[i, j] = wp.float32(heat / height)
        else:
            # a cover that is no number is not dry ground
            thickness[i, j] = wp.where(
                cover <= real(wp.static(LEAST_COVER)), wp.float32(0.0), wp.float32(wp.nan)
            )
            temperature[i, j] = wp.float32(wp.nan)

    return raster


class Raster:
    """Output grids on a device, one value for each cell of a terrain.

    Attributes:
        grids: What ``fill`` fills, and one more grid for what has frozen where there is
            solidification, float32, shape [2 or 3, rows, columns].
        thickness: The first of them [m], NaN where the terrain has no data.
        temperature: The second [K], NaN where it is dry too.
    """

    def __init__(
        self,
        terrain: StaggeredTerrain,
        radius: float,
        kernel: str,
        ratio: float,
        device: Any,
        *,
        has_frozen: bool = False,
    ) -> None:
        """Allocate the grids.

        Args:
            terrain: The terrain whose cells are filled.
            radius: Kernel radius of the output, l_render in the paper [m].
            kernel: Name of the smoothing kernel.
            ratio: Kernel radius over particle spacing.
            device: Warp device.
            has_frozen: Whether there is a grid for what has frozen.
        """
        self._terrain = terrain
        self._radius = radius
        self._choice = (kernel, ratio)
        self._device = device
        shape = (3 if has_frozen else 2, terrain.frame.rows, terrain.frame.columns)
        self.grids = wp.zeros(shape, dtype=wp.float32, device=device)
        self.thickness, self.temperature = self.grids[0], self.grids[1]

    def fill(self, state: State, neighbors: NeighborGrid) -> None:
        """Fill thickness and temperature from the ordered particles' flow."""
        rows, columns = self.thickness.shape
        launch(
            _kernel(state.real, *self._choice),
            rows,
            inputs=[
                state.ordered,
                state.flow,
                neighbors.starts,
                neighbors.frame,
                self._terrain.exact_frame,
                self._terrain.known,
                self._radius,
            ],
            outputs=[self.thickness, self.temperature],
            device=self._device,
            least=math.ceil(LEAST_SUMS / columns),
            columns=columns,
        )
