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

"""Lateral viscous stress by solving the depth-integrated momentum balance on the particles.

3 mu u / h - div(mu h grad u) = -rho g h grad S, or (3 / h) u - div(h grad u) = (3 / h) u_local
for a viscosity that varies little over a thickness. On a uniform layer its response to sin(q x)
is 1 / (1 + q^2 h^2 / 3), k^2 = 3 / h^2, which the Green's function approximates; its natural
boundary is free of stress, as the edge of a flow is.

The Laplacian is the SPH one of Brookshaw (1985): with F = -2 W'(r) / r the sum over neighbours of
A_j h_ij F_ij (u_i - u_j), h_ij the mean thickness. The matrix is symmetric and diagonally
dominant; Chebyshev iteration with the diagonal as preconditioner needs no dot product, so nothing
is read back and a fixed number of sweeps is part of a CUDA graph.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.simulation.compiled import counted_from, load2, load4, quick_kernel, sum_over
from lava_ros.simulation.kernels import smoothing_kernel
from lava_ros.simulation.neighbors import cell_frame, cell_functions, NeighborGrid
from lava_ros.simulation.state import PARTICLES, State
from lava_ros.simulation.threads import launch_over

#: Factor by which the sweeps reduce the error of the initial guess, the local velocity.
REDUCTION = 1e-4

#: The diagonal's share of a row, times this, bounds the eigenvalues from above (Gershgorin).
LARGEST_EIGENVALUE = 2.0


@lru_cache
def _kernels(real: Any, kernel_name: str, ratio: float, lanes: int) -> tuple[Any, Any, Any]:
    vec2 = wp.types.vector(2, real)
    vec3 = wp.types.vector(3, real)
    vec4 = wp.types.vector(4, real)
    kernel = smoothing_kernel(kernel_name, real, ratio)
    norm, slope = kernel.norm, kernel.slope
    _, _, cells_around, range_in = cell_functions(real)
    load, load_pair, total = load4(real), load2(real), sum_over(real, lanes)

    @quick_kernel
    def start(
        counts: wp.array(dtype=wp.int32),
        flow: wp.array(dtype=vec3),
        solution: wp.array(dtype=vec2),
        correction: wp.array(dtype=vec2),
    ):
        i = wp.tid()
        if i < counts[PARTICLES]:
            solution[i] = vec2(flow[i][1], flow[i][2])
            correction[i] = vec2()

    @quick_kernel
    def sweep(
        ordered: wp.array(dtype=vec4),
        counts: wp.array(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        cells: cell_frame(real),
        radius: wp.float64,
        momentum: wp.float64,
        relaxation: wp.float64,
        flow: wp.array(dtype=vec3),
        solution: wp.array(dtype=vec2),
        correction: wp.array(dtype=vec2),
        next_solution: wp.array(dtype=vec2),
        first: int,
    ):
        """One Chebyshev sweep: the residual over the diagonal, and the momentum of the last."""
        i = counted_from(first, wp.tid() // lanes)
        lane = wp.tid() % lanes
        if i >= counts[PARTICLES]:
            return
        p = load(ordered, i)
        f = flow[i]
        u = solution[i]
        inverse = real(1.0) / real(radius)
        diagonal = real(0.0)
        pull = vec2()
        scale = -real(wp.static(norm)) * inverse * inverse * inverse * inverse
        box = cells_around(cells, p[0], p[1], real(radius))
        for r in range(box[0] + lane, box[1], lanes):
            near = range_in(cells, starts, r, box)
            for j in range(near[0], near[1]):
                other = load(ordered, j)
                dx = (p[0] - other[0]) * inverse
                dy = (p[1] - other[1]) * inverse
                square = dx * dx + dy * dy
                if j != i and square < real(1.0):
                    h = flow[j][0]
                    # A_j h_ij F_ij with h_ij = (h_i + h_j) / 2
                    weight = scale * slope(wp.sqrt(square)) * other[2] / h * (f[0] + h)
                    diagonal += weight
                    pull += weight * (load_pair(solution, j) - u)
        drag = real(3.0) / f[0]
        diagonal = drag + total(diagonal)
        pull = drag * (vec2(f[1], f[2]) - u) + vec2(total(pull.x), total(pull.y))
        if lane > 0:
            return
        change = real(momentum) * correction[i] + real(relaxation) / diagonal * pull
        correction[i] = change
        next_solution[i] = u + change

    @quick_kernel
    def finish(
        counts: wp.array(dtype=wp.int32),
        solution: wp.array(dtype=vec2),
        flow: wp.array(dtype=vec3),
    ):
        i = wp.tid()
        if i < counts[PARTICLES]:
            flow[i] = vec3(flow[i][0], solution[i][0], solution[i][1])

    return start, sweep, finish


def condition_number(thickness: float, radius: float) -> float:
    """Bound on the largest over the smallest eigenvalue of the preconditioned matrix.

    The neighbours' sum over the drag 3 / h is 28 h^2 / (3 l^2) for Wendland C2: the integral of
    F is 28 / l^2. The smallest eigenvalue is one over one plus that.
    """
    return LARGEST_EIGENVALUE * (1.0 + 28.0 * thickness**2 / (3.0 * radius**2))


def sweeps_for(thickness: float, radius: float) -> int:
    """Chebyshev sweeps that reduce the error by ``REDUCTION``, for thickness and radius [m]."""
    root = math.sqrt(condition_number(thickness, radius))
    return max(2, math.ceil(0.5 * root * math.log(2.0 / REDUCTION)))


@lru_cache
def _schedule(thickness: float, radius: float) -> list[tuple[float, float]]:
    """Momentum and relaxation of each sweep, for thickness and radius [m]."""
    smallest = LARGEST_EIGENVALUE / condition_number(thickness, radius)
    centre = 0.5 * (LARGEST_EIGENVALUE + smallest)
    half = 0.5 * (LARGEST_EIGENVALUE - smallest)
    rho = half / centre
    weights = [(0.0, 1.0 / centre)]
    while len(weights) < sweeps_for(thickness, radius):
        new_rho = 1.0 / (2.0 * centre / half - rho)
        weights.append((new_rho * rho, 2.0 * new_rho / half))
        rho = new_rho
    return weights


def solve_velocity(
    state: State,
    neighbors: NeighborGrid,
    *,
    radius: float,
    thickness: float,
    kernel: str,
    ratio: float,
) -> None:
    """Replace the local velocity in ``state.flow`` by the solution of the balance.

    Args:
        state: The particles.
        neighbors: Their neighbour grid, built.
        radius: Kernel radius [m].
        thickness: Thickness up to which the sweeps converge as far as ``REDUCTION`` says [m].
        kernel: Name of the smoothing kernel.
        ratio: Kernel radius over particle spacing.
    """
    start, sweep, finish = _kernels(state.real, kernel, ratio, state.lanes)
    state.launches(
        start,
        dim=state.capacity,
        inputs=[state.counts, state.flow],
        outputs=[state.solution, state.correction],
    )
    current, following = state.solution, state.next_solution
    for momentum, relaxation in _schedule(thickness, radius):
        launch_over(
            state,
            sweep,
            inputs=[
                state.ordered,
                state.counts,
                neighbors.starts,
                neighbors.frame,
                radius,
                momentum,
                relaxation,
                state.flow,
                current,
            ],
            outputs=[state.correction, following],
            lanes=state.lanes,
        )
        current, following = following, current
    state.launches(
        finish,
        dim=state.capacity,
        inputs=[state.counts, current],
        outputs=[state.flow],
    )
