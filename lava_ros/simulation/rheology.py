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

"""How easily lava flows: viscosity as a function of temperature."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.scene import Lava
from lava_ros.simulation.effects import load

#: Effects that are a law of viscosity; at most one is on.
VISCOSITY_LAWS = ('arrhenius',)


@wp.struct
class Rheology:
    """Constants of the laws of flow."""

    viscosity: wp.float64
    reference_temperature: wp.float64
    arrhenius: wp.float64


def rheology_of(lava: Lava) -> Rheology:
    """Collect the constants the laws need."""
    constants = Rheology()
    constants.viscosity = lava.viscosity
    constants.reference_temperature = lava.reference_temperature
    constants.arrhenius = lava.arrhenius
    return constants


@lru_cache
def viscosity_function(real: Any, effects: Effects) -> Any:
    """Return the device function mu(T) [Pa s]: an effect's law, or a constant."""
    for name in VISCOSITY_LAWS:
        if getattr(effects, name):
            return load(name).viscosity(real)

    @wp.func
    def constant(law: Rheology, temperature: real) -> real:
        return real(law.viscosity)

    return constant
