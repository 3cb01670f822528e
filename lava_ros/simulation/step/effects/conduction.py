# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0


"""Lateral conduction of heat, rho c h DT/Dt = div(k h grad T).

Over a step this is the screened Poisson equation (1 - kappa dt lap) T = T*, whose Green's function
is K0(r / sqrt(kappa dt)). A mean weighted by K0, as green.py uses for the velocity, fails here: in
a step heat diffuses some millimetres, and where neighbours are metres apart K0 is 0 between them.
So the equation is discretized on the particles, where in almost every scene one Jacobi sweep
solves it: kappa dt is a millionth of the squared spacing. With the SPH Laplacian of Brookshaw
(1985), F = -2 W'(r) / r,

    V_i dT_i/dt = kappa sum_j A_i h_ij A_j F_ij (T_j - T_i),
    A_i h_ij A_j = 2 V_i V_j / (h_i + h_j),

h_ij the harmonic mean. It is symmetric in i and j, so heat is conserved. A step is divided into
the number of sweeps that the longest step requires; where the sum of a particle's rates r_i is
larger still, each pair's exchange is divided by the largest of 1, dt r_i and dt r_j. So a
particle's new temperature is a mean of its own and its neighbours', for any step.

In most scenes the exchange in one step is below rounding: steps are combined until a particle
would exchange ``MIN_HEAT_FRACTION`` of its heat, and only then are the neighbours visited.
"""

from functools import lru_cache, partial
import math
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.heat import heat_type
from lava_ros.scene import Scene
from lava_ros.simulation.backend.compiled import access, quick_kernel
from lava_ros.simulation.particles.cells import cell_functions
from lava_ros.simulation.particles.kernels import smoothing_kernel
from lava_ros.simulation.particles.layout import arguments_type, IS_LAST, PARTICLES, STEP
from lava_ros.simulation.step.effects import DevicePart

#: Maximum exchange rate of a particle, over kappa / l^2, for the number of sweeps: an even layer
#: has 28 with Wendland C2, the integral of F.
LARGEST_RATE = 60.0

#: Minimum fraction of its heat that a particle must exchange for an exchange to take place.
MIN_HEAT_FRACTION = 0.01

#: Maximum number of sweeps in a step; beyond it, less heat is exchanged than the step requires.
MAX_SWEEPS = 64


@lru_cache
def _kernels(real: Any, kernel_name: str, effects: Effects, threads: int) -> tuple[Any, ...]:
    vec4 = wp.types.vector(4, real)
    slope = smoothing_kernel(kernel_name, real).slope
    _, _, cells_around, range_in = cell_functions(real)
    load, _ = access(real, 4)
    warmed = effects.function('warmed', wp, real, heat_type(real))

    @quick_kernel()
    def wait(thread: int, m: arguments_type(real), rate: wp.float64):
        """Accumulate time; when it suffices, it becomes the duration of an exchange."""
        m.waited[1] = wp.float64(0.0)
        if m.counts[IS_LAST] == 1:
            m.waited[0] = m.waited[0] + m.clock[STEP]
            if m.waited[0] * rate >= wp.float64(wp.static(MIN_HEAT_FRACTION)):
                m.waited[1] = m.waited[0]
                m.waited[0] = wp.float64(0.0)

    @quick_kernel()
    def add_rates(thread: int, m: arguments_type(real), factor: real):
        """Sum a particle's exchange rates with its neighbours [1/s]."""
        if m.waited[1] == wp.float64(0.0):
            return
        for i in range(thread, m.counts[PARTICLES], threads):
            p = load(m.ordered, i)
            height = m.flow[i][0]
            inverse = real(1.0) / m.constants.radius
            total = real(0.0)
            box = cells_around(m.cells, p[0], p[1], m.constants.radius)
            for r in range(box[0], box[1]):
                near = range_in(m.cells, r, box)
                for j in range(near[0], near[1]):
                    other = load(m.ordered, j)
                    dx = (p[0] - other[0]) * inverse
                    dy = (p[1] - other[1]) * inverse
                    square = dx * dx + dy * dy
                    if j != i and square < real(1.0):
                        total += other[2] * slope(wp.sqrt(square)) / (height + m.flow[j][0])
            m.exchange[i] = factor * total
            m.warmth[i] = m.particle[i][3]

    @quick_kernel()
    def exchange_heat(thread: int, m: arguments_type(real), factor: real, fraction: wp.float64):
        """Exchange heat over a fraction of the duration."""
        if m.waited[1] == wp.float64(0.0):
            return
        for i in range(thread, m.counts[PARTICLES], threads):
            p = load(m.ordered, i)
            height = m.flow[i][0]
            own = m.warmth[i]
            inverse = real(1.0) / m.constants.radius
            step = real(m.waited[1] * fraction)
            divisor = wp.max(real(1.0), step * m.exchange[i])
            rise = real(0.0)
            box = cells_around(m.cells, p[0], p[1], m.constants.radius)
            for r in range(box[0], box[1]):
                near = range_in(m.cells, r, box)
                for j in range(near[0], near[1]):
                    other = load(m.ordered, j)
                    dx = (p[0] - other[0]) * inverse
                    dy = (p[1] - other[1]) * inverse
                    square = dx * dx + dy * dy
                    if j != i and square < real(1.0):
                        weight = other[2] * slope(wp.sqrt(square)) / (height + m.flow[j][0])
                        weight /= wp.max(divisor, step * m.exchange[j])
                        rise += weight * (m.warmth[j] - own)
            rise *= step * factor
            now = m.particle[i]
            if wp.static(warmed is not None):
                m.particle[i] = vec4(now[0], now[1], now[2], warmed(m.heat, own, rise))
            else:
                m.particle[i] = vec4(now[0], now[1], now[2], own + rise)

    @quick_kernel()
    def keep(thread: int, m: arguments_type(real)):
        if m.waited[1] > wp.float64(0.0):
            for i in range(thread, m.counts[PARTICLES], threads):
                m.warmth[i] = m.particle[i][3]

    return wait, add_rates, exchange_heat, keep


class Part(DevicePart):
    """The exchange of heat between columns at the end of a step."""

    def prepare(self, scene: Scene) -> None:
        """Prepare for the scene's conductivity and the longest possible step."""
        accuracy, state, lava = self.accuracy, self.state, scene.lava
        square = accuracy.radius**2
        diffusivity = lava.conductivity / (lava.density * lava.specific_heat)
        self._kernels = partial(_kernels, state.real, accuracy.kernel, state.effects)
        norm = smoothing_kernel(accuracy.kernel, state.real).norm
        # factor of V_j slope / (h_i + h_j) in the exchange rate with j
        self._factor = -4.0 * norm * diffusivity / (square * square)
        longest = accuracy.fixed_step or accuracy.longest_step
        assert longest is not None
        self._rate = LARGEST_RATE * diffusivity / square
        self._sweeps = min(MAX_SWEEPS, max(1, math.ceil(longest * self._rate)))
        # launches are cached by their arguments: a new float would be another launch
        self._fraction = 1.0 / self._sweeps

    def finish_step(self, arguments: Any) -> None:
        """Let neighbours exchange heat at the end of a step, if enough time has passed."""
        state = self.state
        threads = state.rare_threads
        wait, add_rates, exchange_heat, keep = self._kernels(threads)
        state.launches(wait, [arguments, self._rate])
        state.launches(add_rates, [arguments, self._factor], dim=threads)
        for sweep in range(self._sweeps):
            if sweep:
                state.launches(keep, [arguments], dim=threads)
            state.launches(exchange_heat, [arguments, self._factor, self._fraction], dim=threads)
