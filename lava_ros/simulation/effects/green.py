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

"""Lateral viscous stress by the Green's function of the velocity equation (3.37 to 3.44).

With u' = h^3 u the depth-averaged balance is lap u' - k^2 u' = b, and its Green's function in the
plane is -K0(k r) / (2 pi). The velocity is the K0-weighted mean of the driving term b.
Where the paper's print is inconsistent this is what is computed:

* k = sqrt(3) / h: from 3.37, with the isotropic Newtonian stress tau = 2 mu eps in place of the
  paper's tau = mu eps (whose k is sqrt(3/2) / h).
* K0 takes k r, r the distance of two particles (3.38 prints |u|, 3.41 drops the k).
* the mean of b is divided by k^2 h^3, as u = u' / h^3 and the integral of the Green's function is
  1 / k^2 (3.40 multiplies by h^3). With b = k^2 h^3 u_local, k^2 = 3 / h^2, that is the weighted
  mean of h u_local over the particle's own h.
* a particle's own weight is the mean of K0 over its own area (the paper takes K0(0.001)).
* the weights are divided by their own sum: inside the flow that is the disc's integral
  (2 pi / k^2)(1 - k l K1(k l)) up to the error of the sum, and at a free edge it leaves out the
  part of the disc that holds no lava.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.simulation.compiled import load4, quick_kernel, sum_over
from lava_ros.simulation.kernels import bessel
from lava_ros.simulation.neighbors import cell_frame, cell_functions, NeighborGrid
from lava_ros.simulation.state import PARTICLES, State


@lru_cache
def _kernel(real: Any, lanes: int) -> Any:
    vec3 = wp.types.vector(3, real)
    vec4 = wp.types.vector(4, real)
    _, _, rows_around, range_in = cell_functions(real)
    load = load4(real)
    k0, x_k1 = bessel(real)
    sum_up = sum_over(real, lanes)

    @quick_kernel
    def green_velocity(
        ordered: wp.array(dtype=vec4),
        counts: wp.array(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        cells: cell_frame(real),
        support: wp.float64,
        drive: wp.array(dtype=vec4),
        flow: wp.array(dtype=vec3),
    ):
        i = wp.tid() // lanes
        lane = wp.tid() % lanes
        if i >= counts[PARTICLES]:
            return
        p = load(ordered, i)
        height = flow[i][0]
        k = real(wp.static(math.sqrt(3.0))) / height
        quarter = real(0.25) * k * k
        limit = real(support) * real(support)
        total = real(0.0)
        x = real(0.0)
        y = real(0.0)
        rows = rows_around(cells, p[1], real(support))
        for r in range(rows[0] + lane, rows[1], lanes):
            near = range_in(cells, starts, r, p[0], p[1], real(support))
            for j in range(near[0], near[1]):
                other = load(ordered, j)
                dx = p[0] - other[0]
                dy = p[1] - other[1]
                square = dx * dx + dy * dy
                source = load(drive, j)
                # inside the other's own disc K0 takes the value at that disc's edge
                weight = k0(quarter * wp.max(square, source[3]))
                if square >= limit:
                    weight = real(0.0)
                total += weight * source[2]
                x += weight * source[0]
                y += weight * source[1]
        total = sum_up(total)
        x = sum_up(x)
        y = sum_up(y)
        if lane > 0:
            return
        own = load(drive, i)
        # k times the radius of the disc of area V / h
        ka = k * wp.sqrt(own[2] / real(wp.pi))
        # in place of what it counted as its own neighbour
        weight = real(2.0) / (ka * ka) * (real(1.0) - x_k1(ka)) - k0(quarter * own[3])
        total += weight * own[2]
        x += weight * own[0]
        y += weight * own[1]
        flow[i] = vec3(height, x / (total * height), y / (total * height))

    return green_velocity


def spread_velocity(state: State, neighbors: NeighborGrid, support: float) -> None:
    """Replace the local velocity in ``state.flow`` by the Green's function's.

    Args:
        state: The particles; ``state.drive`` holds volume times local velocity, and area.
        neighbors: Their neighbour grid, built.
        support: Radius at which the Green's function is cut off [m], at most the cells' size.
    """
    wp.launch(
        _kernel(state.real, state.lanes),
        dim=state.capacity * state.lanes,
        inputs=[
            state.ordered,
            state.counts,
            neighbors.starts,
            neighbors.frame,
            support,
            state.drive,
        ],
        outputs=[state.flow],
        device=state.device,
    )
