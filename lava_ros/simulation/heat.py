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

"""The temperature of a column: what every effect that moves heat adds up to.

Each effect's part of the balance is -s(T) T + f(T), with s >= 0. Two exponential stages (s and f
at the start give the midpoint, those at the midpoint the whole step) are of second order, and stay
between the temperature and the equilibrium f / s for any step.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.scene import Scene
from lava_ros.simulation.effects import load

#: Stefan-Boltzmann constant [W/(m2 K4)] (CODATA 2018).
STEFAN_BOLTZMANN = 5.670374419e-8

#: Effects that are part of the balance.
HEAT_EFFECTS = ('cooling',)


@wp.struct
class HeatConstants:
    """Constants of the heat balance.

    ``radiation`` is eps sigma / (rho c), ``convection`` lambda / (rho c), ``ambient`` Ta [K].
    """

    radiation: wp.float64
    convection: wp.float64
    ambient: wp.float64


def heat_constants(scene: Scene) -> HeatConstants:
    """Collect the constants from a scene."""
    lava = scene.lava
    capacity = lava.density * lava.specific_heat
    constants = HeatConstants()
    constants.radiation = lava.emissivity * STEFAN_BOLTZMANN / capacity
    constants.convection = lava.convection / capacity
    constants.ambient = scene.ambient_temperature
    return constants


@lru_cache
def temperature_function(real: Any, effects: Effects) -> Any:
    """Return the device function that gives the temperature after a step.

    None when no effect moves heat: temperatures then stay.
    """
    names = [name for name in HEAT_EFFECTS if getattr(effects, name)]
    if not names:
        return None
    balance = load(names[0]).terms(real)
    for name in names[1:]:
        balance = _sum(real, balance, load(name).terms(real))

    @wp.func
    def temperature_after(
        constants: HeatConstants, thickness: real, temperature: real, step: real
    ) -> real:
        start = balance(constants, thickness, temperature)
        middle = relaxed(temperature, start[0], start[1], real(0.5) * step)
        half_way = balance(constants, thickness, middle)
        return relaxed(temperature, half_way[0], half_way[1], step)

    relaxed = _relaxed(real)
    return temperature_after


def _sum(real: Any, first: Any, second: Any) -> Any:
    vec2 = wp.types.vector(2, real)

    @wp.func
    def both(constants: HeatConstants, thickness: real, temperature: real) -> vec2:
        return first(constants, thickness, temperature) + second(
            constants, thickness, temperature
        )

    return both


@lru_cache
def _relaxed(real: Any) -> Any:
    @wp.func
    def relaxed(temperature: real, rate: real, source: real, step: real) -> real:
        """Solve T' = -rate T + source with constant rate and source."""
        x = rate * step
        if x < real(1.0e-6):
            return temperature + step * (source - rate * temperature)
        equilibrium = source / rate
        return equilibrium + (temperature - equilibrium) * wp.exp(-x)

    return relaxed
