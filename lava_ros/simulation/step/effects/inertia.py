# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Inertia: lava has momentum and takes time to reach the speed that balances its weight.

Du/Dt = -g grad S - gamma u, gamma = 3 mu / (rho h^2) for Newtonian lava (MODEL.md, section 4).

* Drag. A layer that moves at the speed u bears the stress rho g h s of the slope s for which u is
  the speed of the local balance, u = M(s) s, for any law of flow (``laws.py``). It is evaluated at
  the end of a kick of length k: u' = M s with |u'| + k g s = |u + k a|, solved for s. This is
  u' = (u + k a) / (1 + k gamma) for Newtonian lava; any steady state is the local balance; and
  lava with a yield strength stops, exactly, where k tau_y / (rho h) >= |u + k a|.
* Time. Velocities belong to the middle of a step (leapfrog, in other words forward-backward: a
  is -g grad S at the new positions): a kick consists of half of the previous step and half of this
  one. Reported velocities are half a step later, at the time of the positions. A wave of number q
  is stable for dt^2 g h q^2 <= 4 + 2 gamma dt, and the largest q^2 W^(q) is the kernel's
  stiffness. For large gamma dt that is the explicit viscous limit: the implicit drag does not lift
  it.
* Bores. Two particles that approach at v = -u_ij . e_ij > 0 exchange momentum as over a wave
  between them, with the limiter of Zhang, Hu & Adams (2017, J. Comput. Phys. 335):
  du_i/dt = -sum_j V_j P_ij grad W_ij, P_ij = v min(``STRENGTH`` v, c) / h, c and h their means of
  wave speed and thickness. It removes energy, never momentum; it is of second order in the
  spacing where the flow is smooth, and 0 where lava spreads.
* Pressure. The energy sum V_i h_i / 2 has a gradient of sum V_j grad W_ij where h is the kernel's
  sum s; h is that without its excess e = c (V / (s l^2))^p, which multiplies each term by
  (1 + (p - 1) (e_i + e_j) / 2). Otherwise waves in thinning lava would be too slow.
* Energy. So the force is the gradient of the reported energy, and the remaining error is that of
  leapfrog: it conserves an energy that differs from it by fractions of (w dt)^2 / 8, w the
  frequency of the motion, with which the reported energy oscillates. Reported velocities omit the
  term of e for the last half of a step: they are exact where that is short.
* Steep slopes. On a map the acceleration down a slope b is g tan b cos^2 b: along a wall lava
  takes as long as in free fall. The drag is that of the layer in ``steep.py``; for lava that
  climbs a wall it is that of a layer as steep as the wall.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.column import column_type
from lava_ros.effects.laws import speed_function, viscosity_function
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.compiled import access, quick_kernel, raise_to
from lava_ros.simulation.backend.threads import launch_over, MIN_MOVES
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.cells import cell_functions
from lava_ros.simulation.particles.kernels import smoothing_kernel
from lava_ros.simulation.particles.layout import age_at, arguments_type
from lava_ros.simulation.particles.terrain import terrain_functions
from lava_ros.simulation.step.effects import DevicePart

#: Wave speed of the dissipation over the speed of approach, limited by c.
STRENGTH = 3.0

#: Relative tolerance of the slope of the drag, and maximum number of iterations.
_CHANGE, _ITERATIONS = 1e-6, 40


@lru_cache
def _column_function(real: Any, effects: Effects) -> Any:
    """Return the device function for a particle's column, without its slope.

    The temperature is the mean around a particle, once ``mean_temperature`` has been computed.
    """
    vec4, column_struct = wp.types.vector(4, real), column_type(real)

    @wp.func
    def column_of(i: int, p: vec4, m: arguments_type(real)) -> column_struct:
        column = column_struct()
        column.thickness = m.flow[i][0]
        column.normal_thickness = column.thickness
        column.temperature = p[3]
        if wp.static(effects.any('stiffens')):
            column.temperature = m.ordered_mean_temperature[i]
        if wp.static(effects.any('needs_age')):
            column.age = real(age_at(m.clock[at.TIME], m.ordered_emission_time[i]))
        return column

    return column_of


@lru_cache
def _drag_function(real: Any, effects: Effects) -> Any:
    """Return the device function that slows a velocity down over a time."""
    vec2, vec3 = wp.types.vector(2, real), wp.types.vector(3, real)
    column_struct = column_type(real)
    viscosity = viscosity_function(wp, real, effects)
    speed = speed_function(wp, real, effects)
    along = effects.function('along', real)
    up = effects.function('along', real, climbs=True)

    @wp.func
    def slowed(
        velocity: vec2, fall: real, column: column_struct, ground: vec2, m: arguments_type(real),
    ) -> vec2:
        """Return the velocity after a time in which a slope of 1 changes it by ``fall`` [m/s]."""
        pace = wp.length(velocity)
        weight = m.constants.weight
        if pace == real(0.0) or fall == real(0.0):
            return velocity
        layer = vec3(column.thickness, real(1.0), real(1.0))
        if wp.static(along is not None):
            layer = along(column.thickness, velocity / pace, ground)
            if wp.dot(velocity, ground) > real(0.0):
                layer = up(column.thickness, velocity / pace, ground)
        if wp.static(speed is None):
            mobility = layer[2] * weight * layer[0] * layer[0]
            mobility /= real(3.0) * viscosity(m.law, column.temperature)
        else:
            # Newton's method from above: the bound of du/ds keeps it above
            slope = pace / fall
            column.normal_thickness = layer[0]
            column.slope = layer[1] * slope
            response = layer[2] * speed(m.law, weight, column)
            for _ in range(_ITERATIONS):
                change = (slope * (response[0] + fall) - pace) / (response[1] + fall)
                slope -= change
                column.slope = layer[1] * slope
                response = layer[2] * speed(m.law, weight, column)
                if change <= real(_CHANGE) * slope:
                    break
            mobility = response[0]
        return velocity * (mobility / (mobility + fall))

    return slowed


@lru_cache
def _kernels(real: Any, kernel_name: str, effects: Effects) -> tuple[Any, ...]:
    vec2, vec3 = (wp.types.vector(n, real) for n in (2, 3))
    kernel = smoothing_kernel(kernel_name, real)
    norm, derivative, excess, power = (
        kernel.norm, kernel.slope, kernel.excess, kernel.excess_power
    )
    gradient_at, curvature_at, height_at, *_ = terrain_functions(real)
    _, _, cells_around, range_in = cell_functions(real)
    raised = raise_to(real)
    load, _ = access(real, 4)
    column_of = _column_function(real, effects)
    viscosity = viscosity_function(wp, real, effects)
    is_newtonian = speed_function(wp, real, effects) is None
    slowed = _drag_function(real, effects)
    steep, heats = effects.function('along', real) is not None, effects.any('needs_drop')

    @wp.func
    def of_sum(e: real) -> real:
        """Return the excess at the sum s, from that at h = s (1 - e_s): e_s = e (1 - e_s)^p."""
        rest = real(1.0) - e / (real(1.0) + real(power) * e)
        if wp.static(power == 2.5):
            return e * rest * rest * wp.sqrt(rest)
        if wp.static(power == 1.5):
            return e * rest * wp.sqrt(rest)
        return e

    @wp.func
    def part_of_gravity(ground: vec2) -> real:
        """Return the fraction of g that acts on a map, cos^2 b."""
        if wp.static(steep):
            return real(1.0) / (real(1.0) + wp.dot(ground, ground))
        return real(1.0)

    @quick_kernel()
    def synchronize(i: int, m: arguments_type(real), number: real):
        """Compute the acceleration, the velocity half a step after the stored one, and limits."""
        if i >= m.counts[at.PARTICLES]:
            return
        p = load(m.ordered, i)
        height = m.flow[i][0]
        column = column_of(i, p, m)
        ground = gradient_at(m.ground, p[0], p[1])
        g = m.constants.gravity * part_of_gravity(ground)
        fall = -g * vec2(m.flow[i][1], m.flow[i][2])
        m.kick[i] = fall
        half = real(wp.float64(0.5) * m.clock[at.STEP])
        u = slowed(m.ordered_velocity[i] + half * fall, half * g, column, ground, m)
        m.flow[i] = vec3(height, u[0], u[1])
        # dt^2 w^2 <= d^2 + d gamma dt: d is 2 at the limit of stability
        square = g * height * m.constants.stiffness
        square += g * curvature_at(m.ground, p[0], p[1]) * m.constants.inverse_diffusion_number
        mobility = real(1.0)
        drag = real(0.0)
        if wp.static(is_newtonian):
            mobility = m.constants.weight * height * height
            mobility /= real(3.0) * viscosity(m.law, column.temperature)
            drag = g
        root = wp.sqrt(drag * drag + real(4.0) * number * square * mobility * mobility)
        advection = wp.length(u) / m.constants.reach
        raised(m.rates, at.DIFFUSION, real(2.0) * square * mobility / (drag + root) + advection)
        raised(m.rates, at.ADVECTION, advection)

    @quick_kernel()
    def accelerate(i: int, m: arguments_type(real)):
        if i >= m.counts[at.PARTICLES]:
            return
        if m.counts[at.CURRENT] == 0:
            # past the target; the next step starts from the velocity in the middle of this one
            m.velocity[i] = m.ordered_velocity[i]
            return
        p = load(m.ordered, i)
        f = m.flow[i]
        inverse = real(1.0) / m.constants.radius
        g = m.constants.gravity
        push = vec2()
        lift = vec2()
        own = of_sum(excess(p[2] * inverse * inverse / f[0]))
        box = cells_around(m.cells, p[0], p[1], m.constants.radius)
        for r in range(box[0], box[1]):
            near = range_in(m.cells, r, box)
            for j in range(near[0], near[1]):
                other = load(m.ordered, j)
                d = vec2(p[0] - other[0], p[1] - other[1]) * inverse
                square = wp.dot(d, d)
                if square < real(1.0) and square > real(0.0):
                    there = m.flow[j]
                    q = wp.sqrt(square)
                    pull = other[2] * derivative(q)
                    both = own + of_sum(excess(other[2] * inverse * inverse / there[0]))
                    lift += pull * both * d
                    approach = -(d[0] * (f[1] - there[1]) + d[1] * (f[2] - there[2])) / q
                    if approach > real(0.0):
                        height = real(0.5) * (f[0] + there[0])
                        pace = wp.min(real(STRENGTH) * approach, wp.sqrt(g * height))
                        push -= pull * approach * pace / height * d
        scale = real(wp.static(norm)) * inverse * inverse * inverse
        # 1/2 (power - 1) (e_i + e_j) of g V_j grad W_ij
        lift *= -g * scale * real(wp.static(0.5 * (power - 1.0)))
        ground = gradient_at(m.ground, p[0], p[1])
        step = real(m.clock[at.STEP])
        time = real(0.5) * (real(m.clock[at.FORMER_STEP]) + step)
        old = m.ordered_velocity[i]
        free = old + time * (m.kick[i] + lift) + step * scale * push
        fall = time * g * part_of_gravity(ground)
        column = column_of(i, p, m)
        new = slowed(free, fall, column, ground, m)
        m.velocity[i] = new
        if wp.static(heats):
            # the slope that balances the drag: its work is the heat, not that of the weight
            m.slope[i] = vec2()
            if fall > real(0.0):
                m.slope[i] = (new - free) / fall
                # limited by the energy from weight and motion: speeds on the map do not account
                # for the turn of lava that runs from level ground into a wall
                displacement = step * new
                surface = -m.kick[i] / (g * part_of_gravity(ground))
                given = height_at(m.ground, p[0], p[1])
                given -= height_at(m.ground, p[0] + displacement.x, p[1] + displacement.y)
                given += wp.dot(ground - surface, displacement)
                given += real(0.5) * (wp.dot(old, old) - wp.dot(new, new)) / g
                given = wp.max(given, real(0.0))
                work = -wp.dot(m.slope[i], displacement)
                if work > given:
                    m.slope[i] = m.slope[i] * (given / work)

    @quick_kernel()
    def adopt(i: int, m: arguments_type(real)):
        if i < m.counts[at.PARTICLES]:
            m.flow[i] = vec3(m.flow[i][0], m.velocity[i][0], m.velocity[i][1])

    return synchronize, accelerate, adopt


class Part(DevicePart):
    """The momentum of the particles, by leapfrog."""

    @staticmethod
    def step_limit(scene: Scene, accuracy: Accuracy, reach: float) -> float:
        """Return the step [s] in which lava with the velocity of its vent moves by the reach."""
        fastest = max((math.hypot(*vent.velocity) for vent in scene.vents), default=0.0)
        return reach / max(fastest, 1e-9)

    def compute_velocity(self, arguments: Any) -> None:
        """Turn the slopes in ``flow`` into velocities at the particles' time.

        It stores the accelerations in ``kick`` and raises ``rates``.
        """
        synchronize, *_ = self._kernels
        # 2 at the limit of stability
        number = self.accuracy.diffusion_number
        launch_over(self.state, synchronize, [arguments, number], min_items=MIN_MOVES)

    def accelerate(self, arguments: Any) -> None:
        """Advance the velocities to the middle of the chosen step."""
        _, kick, adopt = self._kernels
        launch_over(self.state, kick, [arguments])
        launch_over(self.state, adopt, [arguments], min_items=MIN_MOVES)

    @property
    def _kernels(self) -> tuple[Any, Any, Any]:
        return _kernels(self.state.real, self.accuracy.kernel, self.state.effects)
