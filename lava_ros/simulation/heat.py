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

"""Heat lost at the surface: radiation and convection of a column at its mean temperature.

rho c h dT/dt = -eps sigma (T^4 - Ta^4) - lambda (T - Ta).
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.scene import Scene

#: Stefan-Boltzmann constant [W/(m2 K4)] (CODATA 2018).
STEFAN_BOLTZMANN = 5.670374419e-8


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
def cooled_function(real: Any) -> Any:
    """Return the device function that gives the temperature after a time step.

    The balance is T' = -s(T) (T - Ta). Two exponential stages (the rate s at the start gives the
    midpoint, the rate there the whole step) are of second order and stay between Ta and T for any
    step.
    """

    @wp.func
    def rate(constants: HeatConstants, thickness: real, temperature: real) -> real:
        ambient = real(constants.ambient)
        square = temperature * temperature + ambient * ambient
        loss = real(constants.radiation) * square * (temperature + ambient)
        return (loss + real(constants.convection)) / thickness

    @wp.func
    def cooled(
        constants: HeatConstants, thickness: real, temperature: real, step: real
    ) -> real:
        ambient = real(constants.ambient)
        excess = temperature - ambient
        half = rate(constants, thickness, temperature) * real(0.5) * step
        middle = ambient + excess * wp.exp(-half)
        return ambient + excess * wp.exp(-rate(constants, thickness, middle) * step)

    return cooled
