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

"""How easily lava flows: viscosity as a function of temperature, speed as one of the slope."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.scene import Lava
from lava_ros.simulation.effects import load

#: Effects that are a law of viscosity; at most one is on.
VISCOSITY_LAWS = ('arrhenius', 'vft')

#: The exponent of each law of crystals (``effects/crystals.py``).
CRYSTAL_EXPONENTS = {'none': 0.0, 'einstein-roscoe': 2.5, 'maron-pierce': 2.0}


@lru_cache
def rheology_type(real: Any) -> Any:
    """Constants of the laws of flow: the fields of ``Lava``, and the crystals' law as numbers."""

    @wp.struct
    class Rheology:
        viscosity: real
        reference_temperature: real
        arrhenius: real
        vft_a: real
        vft_b: real
        vft_c: real
        liquidus: real
        solidus: real
        crystals_over_packing: real
        crystal_exponent: real
        yield_strength: real
        yield_rate: real
        flow_index: real

    return Rheology


def rheology_of(lava: Lava, real: Any = wp.float64) -> Any:
    """Collect the constants the laws need."""
    constants = rheology_type(real)()
    constants.viscosity = lava.viscosity
    constants.reference_temperature = lava.reference_temperature
    constants.arrhenius = lava.arrhenius
    constants.vft_a = lava.vft_a
    constants.vft_b = lava.vft_b
    constants.vft_c = lava.vft_c
    constants.liquidus = lava.liquidus
    constants.solidus = lava.solidus
    constants.crystals_over_packing = lava.crystals / lava.packing
    constants.crystal_exponent = CRYSTAL_EXPONENTS[lava.crystal_law]
    constants.yield_strength = lava.yield_strength
    constants.yield_rate = lava.yield_rate
    constants.flow_index = lava.flow_index
    return constants


@lru_cache
def viscosity_function(real: Any, effects: Effects) -> Any:
    """Return the device function mu(T) [Pa s]: an effect's law, or a constant; with crystals."""

    @wp.func
    def constant(law: rheology_type(real), temperature: real) -> real:
        return real(law.viscosity)

    viscosity = constant
    for name in VISCOSITY_LAWS:
        if getattr(effects, name):
            viscosity = load(name).viscosity(real)
    return load('crystals').stiffening(real, viscosity) if effects.crystals else viscosity


@lru_cache
def speed_function(real: Any, effects: Effects) -> Any:
    """Return the device function of lava whose speed is not proportional to the slope.

    Of rho g, thickness, slope s and temperature it gives the mobility u / s and a bound of u / s
    and du/ds [m/s]: times the thickness they are diffusivities across and along the slope. None
    when lava is Newtonian: both are then rho g h^2 / (3 mu).
    """
    viscosity = viscosity_function(real, effects)
    if effects.power_law:
        strength = load('yielding').strength(real) if effects.yielding else None
        return load('power_law').speed(real, viscosity, strength)
    return load('yielding').speed(real, viscosity) if effects.yielding else None
