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

"""Sums over a particle's neighbours of thickness and its gradient.

For each set of hardware there is one function with the same arguments: a GPU's thread takes one
neighbour after the other, a core of a CPU eight at a time (simd.py).
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.backend.compiled import load4, unseen_one
from lava_ros.simulation.backend.simd import over_neighbors
from lava_ros.simulation.cells import cell_frame, cell_functions, NEIGHBORS_AT_ONCE
from lava_ros.simulation.kernels import SmoothingKernel


@lru_cache
def sums_function(real: Any, kernel: SmoothingKernel, parts: int, is_short: bool) -> Any:
    """Return the device function of the sums over the neighbours of thickness and its gradient.

    Its first argument is the number of a part: every so many-th row of cells.
    """
    vec3 = wp.types.vector(3, real)
    vec4 = wp.types.vector(4, real)
    terms = kernel.terms
    range_in = cell_functions(real).range_in
    load = load4(real)
    at_once = NEIGHBORS_AT_ONCE[is_short]

    @wp.func
    def added(sums: vec3, p: vec4, other: vec4, inverse: real) -> vec3:
        dx = p[0] - other[0]
        dy = p[1] - other[1]
        part = terms(other[2], wp.sqrt(dx * dx + dy * dy), inverse)
        return vec3(sums[0] + part[0], sums[1] + part[1] * dx, sums[2] + part[1] * dy)

    @wp.func
    def sums_around(
        part: int,
        ordered: wp.array(dtype=vec4),
        cells: cell_frame(real),
        box: wp.vec4i,
        p: vec4,
        inverse: real,
    ) -> vec3:
        sums = vec3()
        near = range_in(cells, wp.min(box[0] + part, box[1] - 1), box)
        for r in range(box[0] + part, box[1], parts):
            following = near
            if wp.static(is_short):
                following = range_in(cells, wp.min(r + parts, box[1] - 1), box)
            else:
                near = range_in(cells, r, box)
            j = near[0]
            while j < near[1]:
                for n in range(at_once):
                    other = load(ordered, j + n)
                    if j + n >= near[1]:
                        # of the next row, or nothing
                        other[2] = real(0.0)
                    sums = added(sums, p, other, inverse)
                j += at_once * unseen_one()
            near = following
        return sums

    return sums_around


@lru_cache
def wide_sums_function(wide_terms: str) -> Any:
    """Return the same device function of float32 for a CPU."""

    @wp.func_native(
        over_neighbors(f"""
            const wide dx = is_in ? p[0] - other_0 : none;
            const wide dy = is_in ? p[1] - other_1 : none;
            const wide volume = is_in ? other_2 : none;
            const wide distance = __builtin_elementwise_sqrt(dx * dx + dy * dy);
            {wide_terms}
            sum_0 += shapes;
            sum_1 += slopes * dx;
            sum_2 += slopes * dy;
        """)
    )
    def sums_around(
        part: int,
        values: wp.array(dtype=wp.vec4),
        cells: cell_frame(wp.float32),
        box: wp.vec4i,
        p: wp.vec4,
        inverse: wp.float32,
    ) -> wp.vec3: ...

    return sums_around
