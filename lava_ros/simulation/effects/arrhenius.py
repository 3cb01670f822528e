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

"""Viscosity that rises as lava cools: the Arrhenius law of 3.26.

The paper multiplies f(theta) = K_e exp(alpha (theta_e - theta)) by another constant mu of the same
100 Pa s; that counts the viscosity twice, so f alone is the viscosity here.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.rheology import rheology_type


@lru_cache
def viscosity(real: Any) -> Any:
    """Return the device function mu(T) [Pa s]."""

    @wp.func
    def arrhenius(law: rheology_type(real), temperature: real) -> real:
        return real(law.viscosity) * wp.exp(
            real(law.arrhenius) * (real(law.reference_temperature) - temperature)
        )

    return arrhenius
