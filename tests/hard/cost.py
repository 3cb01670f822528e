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

"""Invariant cost: velocity evaluations in a frame are at most ``COST`` times what lava calls for.

A step dt of lava whose thickness relaxes at the rate r takes s evaluations, the fewest with
(s^2 + s - 2) / 4 >= r dt, and is as long as vents, speed and ``MOST_STAGES`` allow: ``pace`` is
s / dt of the lava that there is. What a frame calls for is the integral of it. Its ends show that
where r changes little between them, which power-law lava and lava held by its strength do not: r
follows the slope, and lava that breaks loose for a moment, or has run off by the frame's end, has
shown it at neither (measured: 17 evaluations by the ends, 6,887 in the frame). Nor has lava that
came out and left the map within the frame. A frame that took more than its ends call for is
therefore played again, and what the lava at the start of each of its steps calls for is what
counts (``ground.along``).
"""

from __future__ import annotations

from collections.abc import Iterator
import math

import numpy as np

from hard.ground import along, Bound, Moment
from lava_ros.simulation.kernels import smoothing_kernel
from lava_ros.simulation.state import EVALUATIONS, STEPS
from lava_ros.simulation.timestep import longest_step, MOST_STAGES

#: Evaluations over those that the lava calls for.
COST = 4.0


class Cost:
    """Counts evaluations from frame to frame.

    Attributes:
        smallest_step: Smallest mean step of a frame [s].
        highest: Most evaluations in a simulated second of a frame [1/s].
    """

    def __init__(self) -> None:
        self.smallest_step, self.highest = math.inf, 0.0

    def renew(self, moment: Moment) -> None:
        """Begin a frame."""
        self._begin(moment, pace(moment))

    def _begin(self, moment: Moment, pace: float) -> None:
        self._last, self._pace = moment, pace
        self._start = moment.simulation.checkpoint()

    def check(self, moment: Moment) -> Iterator[Bound]:
        """What the frame that ends has cost."""
        last, simulation, now = self._last, moment.simulation, pace(moment)
        span = moment.time - last.time
        evaluations, steps = (
            int(moment.counts[count] - last.counts[count]) for count in (EVALUATIONS, STEPS)
        )
        if span > 0.0 and steps > 0:
            self.smallest_step = min(self.smallest_step, span / steps)
            self.highest = max(self.highest, evaluations / span)
            if simulation.accuracy.fixed_step is None:
                # the frame's end may cut a step in two, and so does each particle that comes out
                came = (moment.given - last.given) / simulation.particle_volume
                cuts = 2.0 * (MOST_STAGES + came)
                most = COST * (max(now, self._pace) * span + cuts)
                if evaluations > most:
                    # each step's s follows the lava at its start
                    called = along(self._start, simulation, steps, pace)
                    most = COST * (sum(start * length for start, _, length in called) + cuts)
                yield 'cost', evaluations, most, 'evaluations in the frame'
        self._begin(moment, now)


def pace(moment: Moment) -> float:
    """Evaluations in a second that the lava calls for as it is, with steps at their limits."""
    simulation, sample = moment.simulation, moment.lava
    accuracy, scene = simulation.accuracy, simulation.scene
    vents, reach = simulation._vents, simulation._stage.constants.reach
    longest = longest_step(scene, accuracy, simulation.effects, vents, reach)
    if not len(sample.volume):
        return 3.0 / longest
    lava = scene.lava
    kernel = smoothing_kernel(accuracy.kernel, simulation._state.real, accuracy.ratio)
    thickness = sample.thickness.astype(np.float64)
    reach = accuracy.courant_number * min(simulation.radius, scene.terrain.resolution)
    advection = float(np.linalg.norm(sample.velocity, axis=1).max()) / reach
    bend = moment.ground.bend(sample.position)
    # how fast the shortest waves of thickness decay over the mobility, in a hollow of the ground
    stiffness = thickness * kernel.stiffness / simulation.radius**2 + bend
    stiffness /= accuracy.diffusion_number
    if simulation.effects.inertia:
        waves = scene.gravity * float(stiffness.max()) / accuracy.diffusion_number
        return max(1.0 / longest, math.sqrt(waves) + advection)
    if simulation.effects.power_law:
        explicit = float(simulation._state.rates.numpy()[0])
    else:
        viscosity = np.array([lava.viscosity_at(float(value)) for value in sample.temperature])
        if not (simulation.effects.arrhenius or simulation.effects.vft):
            viscosity[:] = lava.viscosity
        weight = lava.density * scene.gravity
        explicit = float((weight * thickness**2 / (3.0 * viscosity) * stiffness).max())
    explicit = max(explicit, 1.0 / longest)
    if accuracy.integrator == 'euler':
        return max(explicit, advection)
    most = 0.25 * (MOST_STAGES**2 + MOST_STAGES - 2)
    step = min(longest, most / explicit, 1.0 / max(advection, 1e-300))
    stages = max(2.0, math.ceil(0.5 * (math.sqrt(9.0 + 16.0 * step * explicit) - 1.0)))
    return stages / step
