# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral viscous stress by solving the depth-integrated momentum balance on the particles.

3 mu u / h - 6/5 div(mu h grad u) = -rho g h grad S, or d u / h - div(h grad u) = d u_local / h
with d = 5/2 (``LATERAL_DRAG``), for a viscosity that varies little over a thickness. On a uniform
layer its response to sin(q x) is 1 / (1 + q^2 / k^2), k^2 = d / h^2, which the Green's function
approximates; its natural boundary is free of stress, like the edge of a flow.

On ``steep`` ground u_local is cos^4 b of its value for level ground, so the drag on u is d / h
over cos^4 b: the driving weight is the same. The work of the weight is then that of a positive
definite matrix, and the energy never grows; with the drag of level ground neighbours pushed lava
up walls.

The Laplacian is the SPH one of Brookshaw (1985): with F = -2 W'(r) / r the sum over neighbours of
A_j h_ij F_ij (u_i - u_j), h_ij the mean thickness. The matrix is symmetric and diagonally
dominant; Chebyshev iteration with the diagonal as preconditioner needs no dot product, so nothing
is read back and a fixed number of sweeps is part of a CUDA graph.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.effects.laws import LATERAL_DRAG, MAX_SWEEPS, REDUCTION
from lava_ros.scene import Scene
from lava_ros.simulation.backend.compiled import (
    access,
    FEW_THREADS,
    quick_kernel,
    raise_to,
    sum_over,
)
from lava_ros.simulation.backend.simd import over_neighbors
from lava_ros.simulation.backend.threads import launch_over, MIN_MOVES
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.cells import cell_functions, sum_neighbors
from lava_ros.simulation.particles.kernels import smoothing_kernel, SmoothingKernel
from lava_ros.simulation.particles.layout import arguments_type, cell_frame
from lava_ros.simulation.particles.terrain import speed_limit_function, terrain_functions
from lava_ros.simulation.step.effects import DevicePart

#: Threads per block, and blocks for which a GPU processor must have registers: a sweep waits for
#: memory, and more threads hide the latency.
_MANY_THREADS = 256, 6

#: Upper bound of the eigenvalues of the matrix over its diagonal (Gershgorin).
LARGEST_EIGENVALUE = 2.0


@lru_cache
def _sums_function(real: Any, kernel: SmoothingKernel, lanes: int, parts: int) -> Any:
    """Return the device function of the neighbour sums of A_j h_ij F_ij and of its pull.

    It is a ``sum_neighbors``. F is without ``norm``, ``factor`` and l^4; the pull is
    the sum weighted by u_j - u_i. The particle is its own neighbour.
    """
    vec2, vec3, vec4 = (wp.types.vector(n, real) for n in (2, 3, 4))
    terms = kernel.terms
    (load, _), (load_pair, _) = access(real, 4), access(real, 2)

    @wp.func
    def added(
        sums: vec3, j: int, layer: wp.array(dtype=vec4), solution: wp.array(dtype=vec2), p: vec4,
        u: vec2, inverse: real,
    ) -> vec3:
        other = load(layer, j)
        dx = p[0] - other[0]
        dy = p[1] - other[1]
        # A_j h_ij with h_ij = (h_i + h_j) / 2, twice
        amount = other[2] * (p[3] + other[3])
        weight = terms(amount, wp.sqrt(dx * dx + dy * dy), inverse)[1]
        pull = weight * (load_pair(solution, j) - u)
        return sums + vec3(weight, pull.x, pull.y)

    return sum_neighbors(real, added, lanes, parts)


@lru_cache
def _wide_sums_function(wide_terms: str) -> Any:
    """Return the float32 device function of the same sums for a CPU."""

    @wp.func_native(
        over_neighbors(f"""
            wide early, late;
            __builtin_memcpy(&early, solution.data + place, 32);
            __builtin_memcpy(&late, solution.data + place + 4, 32);
            const wide there_x = __builtin_shufflevector(early, late, 0, 2, 4, 6, 8, 10, 12, 14);
            const wide there_y = __builtin_shufflevector(early, late, 1, 3, 5, 7, 9, 11, 13, 15);
            const wide dx = p[0] - other_0;
            const wide dy = p[1] - other_1;
            const wide distance = __builtin_elementwise_sqrt(dx * dx + dy * dy);
            const wide volume = other_2 * (p[3] + other_3);
            {wide_terms}
            sum_0 += is_in ? slopes : none;
            sum_1 += is_in ? slopes * (there_x - u[0]) : none;
            sum_2 += is_in ? slopes * (there_y - u[1]) : none;
        """)
    )
    def sums_around(
        part: int, values: wp.array(dtype=wp.vec4), solution: wp.array(dtype=wp.vec2),
        cells: cell_frame(wp.float32), box: wp.vec4i, p: wp.vec4, u: wp.vec2, inverse: wp.float32,
    ) -> wp.vec3: ...

    return sums_around


@lru_cache
def _kernels(
    real: Any, kernel_name: str, lanes: int, parts: int, is_wide: bool, steep: Any,
) -> tuple[Any, Any, Any]:
    vec2, vec3, vec4 = (wp.types.vector(n, real) for n in (2, 3, 4))
    kernel = smoothing_kernel(kernel_name, real)
    factor = -kernel.norm * kernel.factors[1]
    terms = kernel.terms
    cells_around = cell_functions(real).cells_around
    (load, store), total = access(real, 4), sum_over(real, lanes)
    limit_speed = speed_limit_function(real)
    gradient_at, raised = terrain_functions(real).gradient_at, raise_to(real)
    sums_around = _sums_function(real, kernel, lanes, parts)
    if is_wide and kernel.wide_terms:
        sums_around = _wide_sums_function(kernel.wide_terms)

    @quick_kernel()
    def start(i: int, m: arguments_type(real)):
        """Start from the local velocity; store the values that a sweep reads contiguously."""
        if i < m.counts[at.PARTICLES]:
            p = load(m.ordered, i)
            f = m.flow[i]
            store(m.layer, i, vec4(p[0], p[1], p[2] / f[0], f[0]))
            m.solution[i] = vec2(f[1], f[2])
            m.correction[i] = vec2()
            if wp.static(steep is not None):
                # the drag of the sweeps is LATERAL_DRAG divided by this
                drags = f[0] * steep(gradient_at(m.ground, p[0], p[1]))
                m.flow[i] = vec3(drags, f[1], f[2])

    @quick_kernel(bounds=FEW_THREADS if parts > lanes else _MANY_THREADS)
    def sweep(
        thread: int, m: arguments_type(real), momentum: real, relaxation: real,
        solution: wp.array(dtype=vec2), next_solution: wp.array(dtype=vec2),
    ):
        """Run one Chebyshev sweep: the residual over the diagonal, plus momentum."""
        i = thread // lanes
        lane = thread % lanes
        if i >= m.counts[at.PARTICLES]:
            return
        p = load(m.layer, i)
        u = solution[i]
        inverse = real(1.0) / m.constants.radius
        box = cells_around(m.cells, p[0], p[1], m.constants.radius)
        sums = sums_around(lane, m.layer, solution, m.cells, box, p, u, inverse)
        diagonal = total(sums[0])
        pull = vec2(total(sums[1]), total(sums[2]))
        if lane > 0:
            return
        f = m.flow[i]
        scale = real(wp.static(factor)) * inverse * inverse * inverse * inverse
        drag = real(wp.static(LATERAL_DRAG)) / f[0]
        # remove its own weight as its own neighbour
        own = terms(p[2] * (p[3] + p[3]), real(0.0), inverse)[1]
        diagonal = drag + scale * (diagonal - own)
        pull = drag * (vec2(f[1], f[2]) - u) + scale * pull
        change = momentum * m.correction[i] + relaxation / diagonal * pull
        m.correction[i] = change
        next_solution[i] = u + change

    @quick_kernel()
    def finish(i: int, m: arguments_type(real), solution: wp.array(dtype=vec2)):
        if i < m.counts[at.PARTICLES]:
            p = load(m.layer, i)
            u = limit_speed(solution[i], p[3], vec2(p[0], p[1]), m)
            m.flow[i] = vec3(p[3], u[0], u[1])
            raised(m.rates, at.ADVECTION, wp.length(u) / m.constants.reach)

    return start, sweep, finish


@lru_cache
def _schedule(thickness: float, radius: float) -> list[tuple[float, float]]:
    """Return momentum and relaxation of each sweep, for thickness and radius [m].

    The neighbours' sum over the drag d / h is 28 h^2 / (d l^2) for Wendland C2: the integral of
    F is 28 / l^2. The smallest eigenvalue of the preconditioned matrix is one over one plus that.
    The number of Chebyshev sweeps, at most ``MAX_SWEEPS`` (reached if the
    expected thickness is 22 kernel radii), reduces the error by ``REDUCTION``.
    """
    stress_over_drag = 28.0 * thickness**2 / (LATERAL_DRAG * radius**2)
    condition = LARGEST_EIGENVALUE * (1.0 + stress_over_drag)
    sweeps = math.ceil(0.5 * math.sqrt(condition) * math.log(2.0 / REDUCTION))
    sweeps = min(max(2, sweeps), MAX_SWEEPS)
    smallest = LARGEST_EIGENVALUE / condition
    centre = 0.5 * (LARGEST_EIGENVALUE + smallest)
    half = 0.5 * (LARGEST_EIGENVALUE - smallest)
    rho = half / centre
    weights = [(0.0, 1.0 / centre)]
    while len(weights) < sweeps:
        new_rho = 1.0 / (2.0 * centre / half - rho)
        weights.append((new_rho * rho, 2.0 * new_rho / half))
        rho = new_rho
    return weights


class Part(DevicePart):
    """The sweeps that solve the momentum balance.

    Up to ``MAX_SOLVED`` times the expected thickness they reduce the error by ``REDUCTION``.
    """

    def prepare(self, scene: Scene) -> None:
        """Compute the weights of the sweeps for the expected thickness."""
        thickness, radius = self.accuracy.thickness, self.accuracy.radius
        assert thickness is not None
        self._weights = _schedule(at.MAX_SOLVED * thickness, radius)

    def compute_velocity(self, arguments: Any) -> None:
        """Replace the local velocity in ``flow`` by the solution, and raise ``rates`` to it."""
        state = self.state
        start, sweep, finish = _kernels(
            state.real, self.accuracy.kernel, state.lanes, state.parts, state.is_wide,
            state.effects.function('factor', state.real),
        )
        launch_over(state, start, [arguments], min_items=MIN_MOVES)
        current, following = (state.arrays[name] for name in ('solution', 'next_solution'))
        for weights in self._weights:
            pair = [current, following]
            launch_over(state, sweep, [arguments, *weights, *pair], lanes=state.lanes)
            current, following = following, current
        launch_over(state, finish, [arguments, current], min_items=MIN_MOVES)
