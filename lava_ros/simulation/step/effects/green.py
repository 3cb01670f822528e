# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral viscous stress by the Green's function of the velocity equation (3.37 to 3.44).

With u' = h^3 u the depth-averaged balance is lap u' - k^2 u' = b, and its Green's function in the
plane is -K0(k r) / (2 pi). The velocity is the K0-weighted mean of the driving term b.
Where the paper's print is inconsistent, this is computed:

* k = sqrt(5/2) / h (``LATERAL_DRAG``): from 3.37, whose k is sqrt(3/2) / h, with the isotropic
  Newtonian stress tau = 2 mu eps in place of the paper's tau = mu eps and the parabolic profile.
* K0 takes k r, r the distance of two particles (3.38 prints |u|, 3.41 drops the k).
* the mean of b is divided by k^2 h^3, as u = u' / h^3 and the integral of the Green's function is
  1 / k^2 (3.40 multiplies by h^3). With b = k^2 h^3 u_local that is the weighted mean of
  h u_local over the particle's own h.
* a particle's own weight is the mean of K0 over its own area (the paper takes K0(0.001)).
* the weights are divided by their own sum: inside the flow that is the disc's integral
  (2 pi / k^2)(1 - k l K1(k l)) up to the error of the sum, and at a free edge it leaves out the
  part of the disc that holds no lava.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.effects.laws import LATERAL_DRAG
from lava_ros.simulation.backend.compiled import (
    access,
    load1,
    load_uncached,
    quick_kernel,
    sum_over,
    wait_for,
)
from lava_ros.simulation.backend.simd import over_neighbors
from lava_ros.simulation.backend.threads import launch_over, MIN_SUMS
from lava_ros.simulation.particles.cells import cell_functions, sum_neighbors
from lava_ros.simulation.particles.kernels import (
    bessel,
    k0_within,
    MIN_SQUARED_DISTANCE,
    SQUARED_SUPPORT,
    WIDE_K0,
)
from lava_ros.simulation.particles.layout import arguments_type, cell_frame, PARTICLES
from lava_ros.simulation.particles.terrain import speed_limit_function
from lava_ros.simulation.step.effects import DevicePart
from lava_ros.simulation.step.outlets import Outlets
from lava_ros.simulation.step.timestep import FIRST_BLOCK, StageChoice, StepLimits

#: The squared distance within which K0 is constant, over the area of a particle's own disc: the
#: value there is the mean of ln r over the disc. As K0 is convex in ln r, its mean is no less, and
#: a neighbour, however near, counts no more than the particle itself: two push each other apart.
_NEAR = math.exp(-1.0) / math.pi

#: Minimum number of particles per part on the CPU: K0 takes as long as three other kernels.
_MIN_PARTICLES_PER_PART = MIN_SUMS // 2


@lru_cache
def _sums_function(real: Any, lanes: int, parts: int) -> Any:
    """Return the device function of the K0-weighted sums of area and of volume times velocity.

    It is a ``sum_neighbors``. Distances are in the units of ``K0Within``, ``min_square`` is the
    minimum square of one, ``powers`` the values that K0 needs of k.
    """
    vec3, vec4 = (wp.types.vector(n, real) for n in (3, 4))
    (load, _), load_number = access(real, 4), load1(real)
    within = k0_within(real)
    k0, k0_powers = within.at, within.powers

    @wp.func
    def added(
        sums: vec3, j: int, source: wp.array(dtype=vec4), area: wp.array(dtype=real), p: vec4,
        powers: k0_powers, min_square: real,
    ) -> vec3:
        other = load(source, j)
        size = load_number(area, j)
        dx = p[0] - other[0]
        dy = p[1] - other[1]
        square = dx * dx + dy * dy
        weight = k0(powers, wp.max(square, min_square))
        if square >= real(SQUARED_SUPPORT):
            weight = real(0.0)
        return sums + weight * vec3(size, other[2], other[3])

    return sum_neighbors(real, added, lanes, parts)


@lru_cache
def _wide_sums_function() -> Any:
    """Return the float32 device function of the same sums for a CPU."""
    k0_powers = k0_within(wp.float32).powers

    @wp.func_native(
        over_neighbors(f"""
            wide size;
            __builtin_memcpy(&size, area.data + place, 32);
            const wide dx = p[0] - other_0;
            const wide dy = p[1] - other_1;
            const wide square = dx * dx + dy * dy;
            const wide squares = square > min_square ? square : none + min_square;
            {WIDE_K0}
            const whole counts = is_in & (square < {SQUARED_SUPPORT!r}f);
            sum_0 += counts ? weights * size : none;
            sum_1 += counts ? weights * other_2 : none;
            sum_2 += counts ? weights * other_3 : none;
        """)
    )
    def sums_around(
        part: int, values: wp.array(dtype=wp.vec4), area: wp.array(dtype=wp.float32),
        cells: cell_frame(wp.float32), box: wp.vec4i, p: wp.vec4, powers: k0_powers,
        min_square: wp.float32,
    ) -> wp.vec3: ...

    return sums_around


@lru_cache
def _velocity_function(real: Any, lanes: int, parts: int, is_wide: bool) -> Any:
    """Return the device function that computes a particle's velocity from the local ones.

    A particle has as many threads as lanes, and only the first one's result counts; its neighbours
    are summed in parts.
    """
    vec3, vec4 = (wp.types.vector(n, real) for n in (3, 4))
    cells_around = cell_functions(real).cells_around
    _, x_k1 = bessel(real)
    within = k0_within(real)
    powers_of, k0 = within.powers_of, within.at
    sum_up = sum_over(real, lanes)
    sums_around = _wide_sums_function() if is_wide else _sums_function(real, lanes, parts)

    @wp.func
    def velocity_of(lane: int, here: vec4, p: vec4, own: real, m: arguments_type(real)) -> vec3:
        """Return thickness and velocity."""
        support = m.constants.radius
        height = here[2] / own
        k = real(wp.static(math.sqrt(LATERAL_DRAG))) / height
        powers = powers_of(k * support)
        # inside the particle's own disc K0 is constant
        unit = real(wp.static(math.sqrt(SQUARED_SUPPORT))) / support
        min_square = wp.max(own * real(_NEAR) * unit * unit, real(MIN_SQUARED_DISTANCE))
        box = cells_around(m.cells, here[0], here[1], support)
        sums = sums_around(lane, m.source, m.area, m.cells, box, p, powers, min_square)
        total = sum_up(sums[0])
        x = sum_up(sums[1])
        y = sum_up(sums[2])
        # k times the radius of the disc of area V / h
        ka = k * wp.sqrt(own / real(wp.pi))
        # replaces the weight that it had as its own neighbour
        weight = real(2.0) / (ka * ka) * (real(1.0) - x_k1(ka)) - k0(powers, min_square)
        weight = wp.max(weight, real(0.0))
        total += weight * own
        x += weight * p[2]
        y += weight * p[3]
        return vec3(height, x / (total * height), y / (total * height))

    return velocity_of


@lru_cache
def _velocity_kernel(real: Any, lanes: int, parts: int, is_wide: bool) -> Any:
    vec2, vec3 = (wp.types.vector(n, real) for n in (2, 3))
    (load, _), load_number = access(real, 4), load1(real)
    velocity_of = _velocity_function(real, lanes, parts, is_wide)
    limit_speed = speed_limit_function(real)

    @quick_kernel()
    def green_velocity(thread: int, m: arguments_type(real)):
        i = thread // lanes
        lane = thread % lanes
        if i < m.counts[PARTICLES]:
            here, p, own = load(m.ordered, i), load(m.source, i), load_number(m.area, i)
            f = velocity_of(lane, here, p, own, m)
            if lane == 0:
                u = limit_speed(vec2(f[1], f[2]), f[0], vec2(here[0], here[1]), m)
                m.flow[i] = vec3(f[0], u[0], u[1])

    return green_velocity


@lru_cache
def _motion_kernel(
    real: Any, lanes: int, parts: int, is_wide: bool, motion: Any, choose_and_emit: Any,
    bounds: tuple[int, int] | None,
) -> Any:
    vec2, vec3 = (wp.types.vector(n, real) for n in (2, 3))
    (load, _), load_number = access(real, 4), load1(real)
    velocity_of = _velocity_function(real, lanes, parts, is_wide)
    limit_speed = speed_limit_function(real)

    @quick_kernel(bounds=bounds)
    def green_motion(thread: int, limits: StepLimits, outlets: Outlets, m: arguments_type(real)):
        if wp.static(choose_and_emit is not None):
            if thread < wp.static(FIRST_BLOCK):
                choose_and_emit(thread, limits, outlets, m)
                return
            thread -= wp.static(FIRST_BLOCK)
        i = thread // lanes
        lane = thread % lanes
        if i >= load_uncached(m.counts, PARTICLES):
            return
        here, driven, own = load(m.ordered, i), load(m.source, i), load_number(m.area, i)
        f = velocity_of(lane, here, driven, own, m)
        if lane > 0:
            return
        if wp.static(choose_and_emit is not None):
            wait_for(m.chosen)
        # read again: keeping it would take registers from the sums
        p = load(m.ordered, i)
        u = limit_speed(vec2(f[1], f[2]), f[0], vec2(p[0], p[1]), m)
        motion(i, p, vec3(f[0], u[0], u[1]), m)

    return green_motion


class Part(DevicePart):
    """The velocity of the Green's function, for output or within the motion.

    ``source`` and ``area`` must be filled; the kernel radius cuts the function off.
    """

    def compute_velocity(self, arguments: Any) -> None:
        """Replace the local velocity in ``flow`` by the Green's function's."""
        state = self.state
        kernel = _velocity_kernel(state.real, state.lanes, state.parts, state.is_wide)
        launch_over(
            state, kernel, [arguments], min_items=_MIN_PARTICLES_PER_PART, lanes=state.lanes
        )

    def move_particles(self, arguments: Any, choice: StageChoice, motion: Any) -> None:
        """Move the ordered particles over the stage by the Green's function's velocity."""
        state = self.state
        kernel = _motion_kernel(
            state.real, state.lanes, state.parts, state.is_wide, motion, choice.function,
            choice.bounds,
        )
        launch_over(
            state, kernel, [choice.limits, choice.outlets, arguments],
            min_items=_MIN_PARTICLES_PER_PART, lanes=state.lanes, ahead=choice.threads,
        )
