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

"""Thickness, surface slope and the local balance of gravity and basal viscous drag.

Heights are SPH sums (3.9 with q = h); the surface gradient is grad S = grad h + grad H, the first
an SPH sum, the second sampled from the staggered terrain grid. Where inertia and lateral stress
are negligible the depth-averaged velocity is u = -rho g h^2 grad S / (3 mu).
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.simulation.kernels import bessel, smoothing_kernel
from lava_ros.simulation.neighbors import cell_functions, CellFrame, NeighborGrid
from lava_ros.simulation.rheology import Rheology, viscosity_function
from lava_ros.simulation.state import ADVECTION, DIFFUSION, PARTICLES, State
from lava_ros.simulation.terrain import StaggeredTerrain, terrain_functions, TerrainFrame


@wp.struct
class FlowConstants:
    """What the flow's equations need beside the particles.

    ``radius`` is the kernel's [m], ``weight`` is rho g [N/m3], ``stiffness`` the rate at which
    thickness diffuses at the kernel's stiffest wave number, over the diffusivity and over the
    diffusion number [1/m2], and ``reach`` the largest displacement in a step [m].
    """

    radius: wp.float64
    weight: wp.float64
    stiffness: wp.float64
    reach: wp.float64


@lru_cache
def flow_kernel(real: Any, kernel_name: str, ratio: float, effects: Effects) -> Any:
    """Return the kernel that computes thickness and local velocity, for one set of effects."""
    vec2 = wp.types.vector(2, real)
    vec3 = wp.types.vector(3, real)
    vec4 = wp.types.vector(4, real)
    kernel = smoothing_kernel(kernel_name, real, ratio)
    norm, shape, slope, excess = kernel.norm, kernel.shape, kernel.slope, kernel.excess
    gradient_at = terrain_functions(real).gradient_at
    block_around = cell_functions(real).block_around
    viscosity = viscosity_function(real, effects.arrhenius)
    x_k1 = bessel(real).x_k1
    steep, green, helmholtz = effects.steep, effects.green, effects.helmholtz

    @wp.kernel(module='unique', enable_backward=False)
    def thickness_and_velocity(
        ordered: wp.array(dtype=vec4),
        counts: wp.array(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        cells: CellFrame,
        elevation: wp.array2d(dtype=real),
        terrain: TerrainFrame,
        law: Rheology,
        constants: FlowConstants,
        flow: wp.array(dtype=vec3),
        drive: wp.array(dtype=vec3),
        rates: wp.array(dtype=real),
    ):
        i = wp.tid()
        if i >= counts[PARTICLES]:
            return
        p = ordered[i]
        radius = real(constants.radius)
        inverse = real(1.0) / radius
        height = real(0.0)
        rise_x = real(0.0)
        rise_y = real(0.0)
        block = block_around(cells, p[0], p[1])
        for r in range(block[2], block[3]):
            for j in range(
                starts[r * cells.columns + block[0]], starts[r * cells.columns + block[1] + 1]
            ):
                other = ordered[j]
                dx = (p[0] - other[0]) * inverse
                dy = (p[1] - other[1]) * inverse
                square = dx * dx + dy * dy
                if square < real(1.0):
                    q = wp.sqrt(square)
                    height += other[2] * shape(q)
                    pull = other[2] * slope(q)
                    rise_x += pull * dx
                    rise_y += pull * dy
        scale = real(wp.static(norm)) * inverse * inverse
        height *= scale
        height *= real(1.0) - excess(p[2] * inverse * inverse / height)
        ground = gradient_at(elevation, terrain, p[0], p[1])
        surface = vec2(rise_x, rise_y) * (scale * inverse) + ground
        mobility = real(constants.weight) * height * height / (
            real(3.0) * viscosity(law, p[3])
        )
        if wp.static(steep):
            along = real(1.0) / (real(1.0) + wp.dot(ground, ground))
            mobility *= along * along
        velocity = -mobility * surface
        flow[i] = vec3(height, velocity[0], velocity[1])
        stiffness = mobility * height * real(constants.stiffness)
        if wp.static(green or helmholtz):
            # lateral stress divides the response by 1 + q^2 h^2 / 3; with W^ <= 1 no wave then
            # decays faster than D / (l^2 / stiffness + h^2 / 3)
            thick = real(wp.static(kernel.stiffness / 3.0)) * height * height * inverse * inverse
            reduced = stiffness / (real(1.0) + thick)
            if wp.static(green):
                drive[i] = vec3(height * velocity[0], height * velocity[1], p[2] / height)
                # as far as the Green's function is not cut off
                whole = real(1.0) - x_k1(real(wp.static(math.sqrt(3.0))) * radius / height)
                reduced = wp.min(stiffness, reduced / whole)
            stiffness = reduced
        wp.atomic_max(rates, DIFFUSION, stiffness)
        wp.atomic_max(rates, ADVECTION, wp.length(velocity) / real(constants.reach))

    return thickness_and_velocity


def compute_flow(
    state: State,
    neighbors: NeighborGrid,
    terrain: StaggeredTerrain,
    law: Rheology,
    constants: FlowConstants,
    kernel: Any,
) -> None:
    """Fill ``state.flow`` (and ``state.drive``) of the ordered particles and raise the rates."""
    state.rates.zero_()
    wp.launch(
        kernel,
        dim=state.capacity,
        inputs=[
            state.ordered,
            state.counts,
            neighbors.starts,
            neighbors.frame,
            terrain.height,
            terrain.frame,
            law,
            constants,
        ],
        outputs=[state.flow, state.drive if state.effects.green else state.flow, state.rates],
        device=state.device,
    )
