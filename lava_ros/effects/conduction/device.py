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


"""Lateral conduction of heat, rho c h DT/Dt = div(k h grad T).

Over a step that is the screened Poisson equation (1 - kappa dt lap) T = T*, whose Green's
function is K0(r / sqrt(kappa dt)). A mean weighted by K0, as green.py takes for the velocity,
fails here: in a step heat comes some millimetres far, and where neighbours are metres apart K0 is
0 between them. So the equation is taken on the particles, where in almost every scene one Jacobi
sweep solves it: kappa dt is a millionth of the squared spacing. With the SPH Laplacian of
Brookshaw (1985), F = -2 W'(r) / r,

    V_i dT_i/dt = kappa sum_j A_i h_ij A_j F_ij (T_j - T_i),
    A_i h_ij A_j = 2 V_i V_j / (h_i + h_j),

h_ij the harmonic mean. It is the same for j and i, so what one gains the other loses. A step is
cut into as many sweeps as the longest one calls for; where the sum of a particle's rates r_i is
larger still, each pair's part is divided by the largest of 1, dt r_i and dt r_j. So a particle's
new temperature is a mean of its own and its neighbours', for any step.

In most scenes nothing is exchanged in a step that a float would keep: steps are put together until
a particle would exchange ``LEAST_SHARE`` of its heat, and only then are the neighbours visited.
"""

from functools import lru_cache, partial
import math
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects import load as load_effect
from lava_ros.effects.laws import heat_of, heat_type
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.compiled import load4, quick_kernel
from lava_ros.simulation.cells import cell_frame, cell_functions
from lava_ros.simulation.kernels import smoothing_kernel
from lava_ros.simulation.neighbors import NeighborGrid
from lava_ros.simulation.state import IS_LAST, PARTICLES, State, STEP
from lava_ros.simulation.terrain import StaggeredTerrain

#: Exchange rate of a particle over kappa / l^2 up to which sweeps are counted: an even layer has
#: 28 with Wendland C2, the integral of F.
LARGEST_RATE = 60.0

#: Share of its heat that a particle would exchange from which it does.
LEAST_SHARE = 0.01

#: Most sweeps in a step; beyond, the exchange is less than the step asks for.
MOST_SWEEPS = 64


@lru_cache
def _kernels(
    real: Any, kernel_name: str, ratio: float, effects: Effects, threads: int
) -> tuple[Any, ...]:
    vec3 = wp.types.vector(3, real)
    vec4 = wp.types.vector(4, real)
    kernel = smoothing_kernel(kernel_name, real, ratio)
    norm, slope = kernel.norm, kernel.slope
    _, _, cells_around, range_in = cell_functions(real)
    load = load4(real)
    latent = 'latent_heat' in effects
    warmed = load_effect('latent_heat').warmed(wp, real, heat_type(real)) if latent else None

    @wp.func
    def scale(radius: wp.float64, diffusivity: wp.float64) -> real:
        """Factor of V_j slope / (h_i + h_j) in the exchange rate with j."""
        square = radius * radius
        return -real(wp.float64(wp.static(4.0 * norm)) * diffusivity / (square * square))

    @quick_kernel
    def wait(
        thread: int,
        counts: wp.array(dtype=wp.int32),
        clock: wp.array(dtype=wp.float64),
        rate: wp.float64,
        waited: wp.array(dtype=wp.float64),
    ):
        """Add a step to what has been waited; when that is enough it is the time to exchange."""
        waited[1] = wp.float64(0.0)
        if counts[IS_LAST] == 1:
            waited[0] = waited[0] + clock[STEP]
            if waited[0] * rate >= wp.float64(wp.static(LEAST_SHARE)):
                waited[1] = waited[0]
                waited[0] = wp.float64(0.0)

    @quick_kernel
    def add_rates(
        thread: int,
        ordered: wp.array(dtype=vec4),
        flow: wp.array(dtype=vec3),
        particle: wp.array(dtype=vec4),
        counts: wp.array(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        cells: cell_frame(real),
        radius: wp.float64,
        diffusivity: wp.float64,
        waited: wp.array(dtype=wp.float64),
        exchange: wp.array(dtype=real),
        warmth: wp.array(dtype=real),
    ):
        """Sum a particle's exchange rates with its neighbours [1/s]."""
        if waited[1] == wp.float64(0.0):
            return
        for i in range(thread, counts[PARTICLES], threads):
            p = load(ordered, i)
            height = flow[i][0]
            inverse = real(1.0) / real(radius)
            total = real(0.0)
            box = cells_around(cells, p[0], p[1], real(radius))
            for r in range(box[0], box[1]):
                near = range_in(cells, starts, r, box)
                for j in range(near[0], near[1]):
                    other = load(ordered, j)
                    dx = (p[0] - other[0]) * inverse
                    dy = (p[1] - other[1]) * inverse
                    square = dx * dx + dy * dy
                    if j != i and square < real(1.0):
                        total += other[2] * slope(wp.sqrt(square)) / (height + flow[j][0])
            exchange[i] = scale(radius, diffusivity) * total
            warmth[i] = particle[i][3]

    @quick_kernel
    def exchange_heat(
        thread: int,
        ordered: wp.array(dtype=vec4),
        flow: wp.array(dtype=vec3),
        counts: wp.array(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        cells: cell_frame(real),
        radius: wp.float64,
        diffusivity: wp.float64,
        waited: wp.array(dtype=wp.float64),
        share: wp.float64,
        constants: heat_type(real),
        exchange: wp.array(dtype=real),
        warmth: wp.array(dtype=real),
        particle: wp.array(dtype=vec4),
    ):
        """Exchange heat over a share of the step."""
        if waited[1] == wp.float64(0.0):
            return
        for i in range(thread, counts[PARTICLES], threads):
            p = load(ordered, i)
            height = flow[i][0]
            own = warmth[i]
            inverse = real(1.0) / real(radius)
            step = real(waited[1] * share)
            most = wp.max(real(1.0), step * exchange[i])
            rise = real(0.0)
            box = cells_around(cells, p[0], p[1], real(radius))
            for r in range(box[0], box[1]):
                near = range_in(cells, starts, r, box)
                for j in range(near[0], near[1]):
                    other = load(ordered, j)
                    dx = (p[0] - other[0]) * inverse
                    dy = (p[1] - other[1]) * inverse
                    square = dx * dx + dy * dy
                    if j != i and square < real(1.0):
                        weight = other[2] * slope(wp.sqrt(square)) / (height + flow[j][0])
                        rise += weight / wp.max(most, step * exchange[j]) * (warmth[j] - own)
            rise *= step * scale(radius, diffusivity)
            now = particle[i]
            if wp.static(latent):
                particle[i] = vec4(now[0], now[1], now[2], warmed(constants, own, rise))
            else:
                particle[i] = vec4(now[0], now[1], now[2], own + rise)

    @quick_kernel
    def keep(
        thread: int,
        counts: wp.array(dtype=wp.int32),
        particle: wp.array(dtype=vec4),
        waited: wp.array(dtype=wp.float64),
        warmth: wp.array(dtype=real),
    ):
        if waited[1] > wp.float64(0.0):
            for i in range(thread, counts[PARTICLES], threads):
                warmth[i] = particle[i][3]

    return wait, add_rates, exchange_heat, keep


class AfterStep:
    """The exchange of heat between columns at the end of a step.

    Attributes:
        sweeps: Parts that a step is cut into.
    """

    def __init__(
        self, scene: Scene, accuracy: Accuracy, terrain: StaggeredTerrain, state: State
    ) -> None:
        """Prepare for the scene's conductivity and the longest step there can be."""
        assert accuracy.spacing is not None
        lava = scene.lava
        self._radius = accuracy.ratio * accuracy.spacing
        self._diffusivity = lava.conductivity / (lava.density * lava.specific_heat)
        self._constants = heat_of(scene, state.effects, state.real)
        self._kernels = partial(
            _kernels, state.real, accuracy.kernel, accuracy.ratio, state.effects
        )
        longest = accuracy.fixed_step or accuracy.longest_step
        self._rate = LARGEST_RATE * self._diffusivity / self._radius**2
        self.sweeps = min(MOST_SWEEPS, max(1, math.ceil(longest * self._rate)))
        self._share = 1.0 / self.sweeps

    def apply(self, state: State, neighbors: NeighborGrid) -> None:
        """Let neighbours exchange heat at the end of a step, if enough time has passed."""
        wait, add_rates, exchange_heat, keep = self._kernels(state.rare_threads)
        state.launches(
            wait,
            dim=1,
            inputs=[state.counts, state.clock, self._rate],
            outputs=[state.waited],
        )
        grid = [neighbors.starts, neighbors.frame, self._radius, self._diffusivity, state.waited]
        state.launches(
            add_rates,
            dim=state.rare_threads,
            inputs=[state.ordered, state.flow, state.particle, state.counts, *grid],
            outputs=[state.exchange, state.warmth],
        )
        for sweep in range(self.sweeps):
            if sweep:
                state.launches(
                    keep,
                    dim=state.rare_threads,
                    inputs=[state.counts, state.particle, state.waited],
                    outputs=[state.warmth],
                )
            state.launches(
                exchange_heat,
                dim=state.rare_threads,
                inputs=[
                    state.ordered,
                    state.flow,
                    state.counts,
                    *grid,
                    self._share,
                    self._constants,
                    state.exchange,
                    state.warmth,
                ],
                outputs=[state.particle],
            )
