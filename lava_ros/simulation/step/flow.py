# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Thickness, surface slope and the local balance of gravity and basal viscous drag.

Heights are SPH sums (3.9 with q = h). Where inertia and lateral stress are negligible the
depth-averaged velocity is u = -rho g h^2 grad S / (3 mu). The surface gradient has two forms:

* energy, e: grad S = grad h + grad H, the first the sum of V_j grad W_ij, the second sampled from
  the staggered terrain grid. It is the gradient of sum_i V_i (h_i / 2 + H_i), which never grows,
  and it keeps the particles evenly spaced. On a level surface it is not quite 0.
* balanced: d + r. The difference form d is the sum of V_j / h_j (S_j - S_i) grad W_ij with
  S = h + H at the particles, times the inverse of its matrix for S = x (Bonet & Lok 1999), so that
  an edge does not halve it. It is 0 where S is constant, but not the gradient of an energy: alone
  it would not keep the particles apart. r is e - d limited to the length of d, so that the sum is
  e unless the surface is nearly level. The energy never grows either: where r is limited,
  e . (d + r) >= |d|^2 - (1 + |d| / |e - d|) |d| |e - d| + |d| |e - d| = 0.

Viscosity and yield strength follow the mean temperature of the lava around a particle:

    T = T_i + max(0, 1 - l |grad h| / (3 h)) sum_j V_j W_ij (T_j - T_i) / sum_j V_j W_ij.

In a depth-averaged flow, all lava in one place has one velocity. With a viscosity by its own
temperature, a hot particle would overtake a cold one in the same place. At an edge the mean is
one-sided, so it has no weight there, where l |grad h| is 3 h. The mean exchanges no heat.

The balance has no inertia, so nothing bounds its speed: at a wall, or where lava is thin as water,
it could exceed any free fall. The speed is therefore limited by the energy of the fall. A particle
on ground of height H has limit_speed from at most the highest ground that lava came from,
``State.top``, and lies h deep: u^2 <= 2 g (max(top - H, 0) + h). The limit never affects lava with
u^2 <= 2 g h. Since inertia is selected where u^2 / (g h) exceeds 0.1 (``selection.py``), that is
all lava for which the balance is valid.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.effects import EFFECTS, Effects
from lava_ros.effects.column import column_type
from lava_ros.effects.laws import LATERAL_DRAG, speed_function, viscosity_function
from lava_ros.simulation.backend.compiled import (
    access,
    FEW_THREADS,
    quick_kernel,
    raise_to,
    sum_over,
)
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.cells import (
    cell_functions,
    sum_neighbors,
    sums_function,
    wide_sums_function,
)
from lava_ros.simulation.particles.kernels import bessel, smoothing_kernel, SQUARED_SUPPORT
from lava_ros.simulation.particles.layout import age_at, arguments_type
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.particles.terrain import speed_limit_function, terrain_functions

#: Slope of an even layer at its edge, over the thickness there and times the kernel's radius.
_EDGE = 3.0


@lru_cache
def _balance_function(real: Any, stiffness: float, effects: Effects) -> Any:
    """Return the device function from a surface gradient to velocity, drive and rates."""
    vec2, vec3, vec4 = (wp.types.vector(n, real) for n in (2, 3, 4))
    _, store = access(real, 4)
    viscosity = viscosity_function(wp, real, effects)
    _, x_k1 = bessel(real)
    # each form of the lateral stress has its own limit of stability
    green, helmholtz = 'green' in effects, 'helmholtz' in effects
    steep, along = effects.function('factor', real), effects.function('along', real)
    speed = speed_function(wp, real, effects)
    has_age = speed is not None and any(
        EFFECTS[name].needs_age for name in effects.having('strength')
    )
    has_velocity = effects.any('needs_velocity')
    is_lateral = effects.any('is_lateral')
    column_struct, raised = column_type(real), raise_to(real)
    limit_speed, curvature_at = speed_limit_function(real), terrain_functions(real).curvature_at

    @wp.func
    def balance(
        i: int, p: vec4, temperature: real, height: real, surface: vec2, ground: vec2,
        m: arguments_type(real), fills_flow: bool,
    ):
        place = vec2(p[0], p[1])
        curvature = curvature_at(m.ground, p[0], p[1])
        weight = m.constants.weight
        if wp.static(speed is None):
            mobility = weight * height * height / (real(3.0) * viscosity(m.law, temperature))
            if wp.static(steep is not None):
                mobility *= steep(ground)
            largest = mobility
        else:
            column = column_struct()
            column.thickness = height
            column.normal_thickness = height
            column.slope = wp.length(surface)
            column.temperature = temperature
            on_map = real(1.0)
            if wp.static(along is not None):
                layer = along(height, surface, ground)
                column.normal_thickness = layer[0]
                column.slope = layer[1]
                on_map = layer[2]
            if wp.static(has_age):
                column.age = real(age_at(m.clock[at.TIME], m.ordered_emission_time[i]))
            response = on_map * speed(m.law, weight, column)
            mobility = response[0]
            largest = response[1]
        if largest > m.constants.max_mobility:
            # as with a higher viscosity
            mobility *= m.constants.max_mobility / largest
            largest = m.constants.max_mobility
        velocity = -mobility * surface
        bounded = velocity
        if wp.static(not has_velocity):
            bounded = limit_speed(velocity, height, place, m)
        if wp.static(not is_lateral):
            # lateral stress uses it as the driving force, and the mean is limited
            velocity = bounded
        if fills_flow:
            m.flow[i] = vec3(height, velocity[0], velocity[1])
        if m.slope:
            m.slope[i] = surface
        rate = largest * height * m.constants.stiffness
        if wp.static(is_lateral):
            # lateral stress divides the response by 1 + q^2 / k^2; with W^ <= 1 no wave then
            # decays faster than D / (l^2 / stiffness + 1 / k^2), k^2 = LATERAL_DRAG / h^2
            stressed = height
            if wp.static(helmholtz):
                # thicker lava keeps the local balance, and its rate, in the sweeps
                stressed = wp.min(height, m.constants.thickest)
            radius = m.constants.radius
            thick = stressed * stressed / (radius * radius)
            thick *= real(wp.static(stiffness / LATERAL_DRAG))
            if wp.static(helmholtz and steep is not None):
                # in proportion to the increase of the drag, which divides it (effects/helmholtz)
                thick *= steep(ground)
            reduced = rate / (real(1.0) + thick)
            if wp.static(green):
                # distances in the units of K0Within
                near = place * (real(wp.static(math.sqrt(SQUARED_SUPPORT))) / radius)
                store(m.source, i, vec4(near.x, near.y, p[2] * velocity.x, p[2] * velocity.y))
                m.area[i] = p[2] / height
                # corrected for the cut-off of the Green's function
                support = real(wp.static(math.sqrt(LATERAL_DRAG))) * radius / height
                whole = real(1.0) - x_k1(support)
                reduced = wp.min(rate, reduced / whole)
            rate = reduced
        # lava flows to the bottom of a hollow, and would overshoot it as on level ground
        rate += largest * curvature * m.constants.inverse_diffusion_number
        if wp.static(has_velocity):
            # the balance of momentum needs the slope, and has its own limits
            m.flow[i] = vec3(height, surface.x, surface.y)
        else:
            raised(m.rates, at.DIFFUSION, rate)
            if wp.static(not helmholtz):
                # the speed under lateral stress is known only after it is solved
                raised(m.rates, at.ADVECTION, wp.length(bounded) / m.constants.reach)

    return balance


def flow_kernels(state: State, kernel_name: str, *, has_means: bool) -> tuple[Any, Any]:
    """Return the kernels that compute thickness and local velocity of the particles of a state.

    The first one, ``elevate``, is None unless the gradient needs the surface at the particles.
    Without ``has_means`` each particle moves by its own temperature.
    """
    real, effects, shared = state.real, state.effects, (state.lanes, state.parts)
    has_heat = has_means and effects.any('stiffens')
    if state.form.has_surface:
        elevate = _elevation_kernel(real, kernel_name, *shared)
        return elevate, _balanced_kernel(real, kernel_name, effects, has_heat, *shared)
    return None, _energy_kernel(
        real, kernel_name, effects, has_heat, *shared, state.is_short, state.is_wide
    )


@lru_cache
def _mean_temperature_function(real: Any) -> Any:
    vec2 = wp.types.vector(2, real)

    @wp.func
    def mean_temperature(own: real, warmer: real, rise: vec2, height: real, radius: real) -> real:
        steepness = wp.length(rise) * radius / (real(_EDGE) * height)
        return own + wp.max(real(1.0) - steepness, real(0.0)) * warmer

    return mean_temperature


@lru_cache
def _energy_kernel(
    real: Any, kernel_name: str, effects: Effects, has_heat: bool, lanes: int, parts: int,
    is_short: bool, is_wide: bool,
) -> Any:
    vec2, vec3 = (wp.types.vector(n, real) for n in (2, 3))
    kernel = smoothing_kernel(kernel_name, real)
    norm, excess = kernel.norm, kernel.excess
    shape_factor, slope_factor = kernel.factors
    sums_around, sums_with_heat = (
        wide_sums_function(kernel.wide_terms, heat)
        if is_wide and kernel.wide_terms
        else sums_function(real, kernel, lanes, parts, heat)
        for heat in (False, True)
    )
    gradient_at = terrain_functions(real).gradient_at
    cells_around = cell_functions(real).cells_around
    load, _ = access(real, 4)
    balance = _balance_function(real, kernel.stiffness, effects)
    mean_temperature = _mean_temperature_function(real)
    total = sum_over(real, lanes)

    @quick_kernel(bounds=FEW_THREADS if is_short else None)
    def thickness_and_velocity(thread: int, m: arguments_type(real), fills_flow: bool):
        i = thread // lanes
        lane = thread % lanes
        if i >= m.counts[at.PARTICLES]:
            return
        p = load(m.ordered, i)
        radius = m.constants.radius
        inverse = real(1.0) / radius
        box = cells_around(m.cells, p[0], p[1], radius)
        sums = vec3()
        mean = p[3]
        warmer = real(0.0)
        if wp.static(has_heat):
            # in the course of a step it stays with the particle
            if m.counts[at.STAGE] == 0:
                more = sums_with_heat(lane, m.ordered, m.cells, box, p, inverse)
                sums = vec3(more[0], more[1], more[2])
                warmer = total(more[3])
            else:
                sums = sums_around(lane, m.ordered, m.cells, box, p, inverse)
        else:
            sums = sums_around(lane, m.ordered, m.cells, box, p, inverse)
        height = total(sums[0]) * real(shape_factor)
        rise_x = total(sums[1]) * inverse * real(slope_factor)
        rise_y = total(sums[2]) * inverse * real(slope_factor)
        warmer *= real(shape_factor) / height
        if lane > 0:
            return
        scale = real(wp.static(norm)) * inverse * inverse
        height *= scale
        height *= real(1.0) - excess(p[2] * inverse * inverse / height)
        ground = gradient_at(m.ground, p[0], p[1])
        rise = vec2(rise_x, rise_y) * (scale * inverse)
        if wp.static(has_heat):
            if m.counts[at.STAGE] == 0:
                mean = mean_temperature(p[3], warmer, rise, height, radius)
                m.ordered_mean_temperature[i] = mean
            else:
                mean = m.ordered_mean_temperature[i]
        balance(i, p, mean, height, rise + ground, ground, m, fills_flow)

    return thickness_and_velocity


@lru_cache
def _elevation_kernel(real: Any, kernel_name: str, lanes: int, parts: int) -> Any:
    vec2, vec3, vec4 = (wp.types.vector(n, real) for n in (2, 3, 4))
    kernel = smoothing_kernel(kernel_name, real)
    norm, shape, excess = kernel.norm, kernel.shape, kernel.excess
    height_at = terrain_functions(real).height_at
    cells_around = cell_functions(real).cells_around
    load, _ = access(real, 4)
    total = sum_over(real, lanes)

    @wp.func
    def add_height(
        height: real, j: int, ordered: wp.array(dtype=vec4), p: vec4, inverse: real
    ) -> real:
        other = load(ordered, j)
        dx = p[0] - other[0]
        dy = p[1] - other[1]
        return height + other[2] * shape(wp.sqrt(dx * dx + dy * dy) * inverse)

    height_around = sum_neighbors(real, add_height, lanes, parts)

    @quick_kernel()
    def elevate(thread: int, m: arguments_type(real)):
        """Compute thickness, surface elevation and area V / h of each particle."""
        i = thread // lanes
        lane = thread % lanes
        if i >= m.counts[at.PARTICLES]:
            return
        p = load(m.ordered, i)
        radius = m.constants.radius
        inverse = real(1.0) / radius
        box = cells_around(m.cells, p[0], p[1], radius)
        height = height_around(lane, m.ordered, m.cells, box, p, inverse)
        height = total(height) * real(wp.static(norm)) * inverse * inverse
        if lane > 0:
            return
        height *= real(1.0) - excess(p[2] * inverse * inverse / height)
        m.surface[i] = vec2(height + height_at(m.ground, p[0], p[1]), p[2] / height)
        m.flow[i] = vec3(height, real(0.0), real(0.0))

    return elevate


@lru_cache
def _balanced_kernel(
    real: Any, kernel_name: str, effects: Effects, has_heat: bool, lanes: int, parts: int
) -> Any:
    vec2, vec4 = (wp.types.vector(n, real) for n in (2, 4))
    vec10 = wp.types.vector(10, real)
    mat22 = wp.types.matrix((2, 2), real)
    kernel = smoothing_kernel(kernel_name, real)
    norm, shape, slope = kernel.norm, kernel.shape, kernel.slope
    gradient_at = terrain_functions(real).gradient_at
    cells_around = cell_functions(real).cells_around
    (load, _), (load_pair, _) = access(real, 4), access(real, 2)
    balance = _balance_function(real, kernel.stiffness, effects)
    mean_temperature = _mean_temperature_function(real)
    total = sum_over(real, lanes)

    @wp.func
    def add_differences(
        sums: vec10, j: int, ordered: wp.array(dtype=vec4), surface: wp.array(dtype=vec2),
        p: vec4, own: real, inverse: real,
    ) -> vec10:
        """Add differences, their second moments, and V grad W of a neighbour.

        The last two values are the sums of the thickness, and of the thickness times the excess
        temperature.
        """
        other = load(ordered, j)
        d = vec2(p[0] - other[0], p[1] - other[1]) * inverse
        there = load_pair(surface, j)
        pull = slope(wp.length(d)) * d
        rise = there[1] * (there[0] - own) * pull
        moment = there[1] * wp.outer(d, pull)
        push = vec2(sums[6], sums[7]) + other[2] * pull
        weight = sums[8]
        warmth = sums[9]
        if wp.static(has_heat):
            held = other[2] * shape(wp.length(d))
            weight += held
            warmth += held * (other[3] - p[3])
        return vec10(
            sums[0] + rise.x, sums[1] + rise.y, sums[2] - moment[0, 0], sums[3] - moment[0, 1],
            sums[4] - moment[1, 0], sums[5] - moment[1, 1], push.x, push.y, weight, warmth,
        )

    differences_around = sum_neighbors(real, add_differences, lanes, parts)

    @quick_kernel()
    def balanced_velocity(thread: int, m: arguments_type(real), fills_flow: bool):
        i = thread // lanes
        lane = thread % lanes
        if i >= m.counts[at.PARTICLES]:
            return
        p = load(m.ordered, i)
        radius = m.constants.radius
        inverse = real(1.0) / radius
        own = m.surface[i][0]
        box = cells_around(m.cells, p[0], p[1], radius)
        sums = differences_around(lane, m.ordered, m.surface, m.cells, box, p, own, inverse)
        rise = vec2(total(sums[0]), total(sums[1]))
        moment = mat22(total(sums[2]), total(sums[3]), total(sums[4]), total(sums[5]))
        push = vec2(total(sums[6]), total(sums[7]))
        mean = p[3]
        if wp.static(has_heat):
            warmer = total(sums[9]) / total(sums[8])
        if lane > 0:
            return
        scale = real(wp.static(norm)) * inverse * inverse
        moment *= scale
        rise *= scale * inverse
        # a lone row of particles does not define the slope across it
        if wp.determinant(moment) > real(0.05):
            rise = wp.inverse(moment) * rise
        ground = gradient_at(m.ground, p[0], p[1])
        rest = push * (scale * inverse) + ground - rise
        size = wp.length(rest)
        limit = wp.length(rise)
        if size > limit:
            rest *= limit / size
        rise += rest
        height = m.flow[i][0]
        if wp.static(has_heat):
            mean = mean_temperature(p[3], warmer, push * (scale * inverse), height, radius)
        balance(i, p, mean, height, rise, ground, m, fills_flow)

    return balanced_velocity
