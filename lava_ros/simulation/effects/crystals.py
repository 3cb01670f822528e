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

"""Crystals that form as lava cools: mu is multiplied by (1 - phi / phi_m)^-e.

e = 2.5 by Einstein and Roscoe (Roscoe 1952, Br. J. Appl. Phys. 3; Marsh 1981, Contrib. Mineral.
Petrol. 78), e = 2 by Maron and Pierce (1956, J. Colloid Sci. 11). The volume fraction of crystals
phi(T) rises linearly from 0 at the liquidus to ``crystals`` at the solidus. Where they jam,
phi = phi_m, the law is infinite: 1 - phi / phi_m is never taken below ``LEAST_ROOM``.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.rheology import rheology_type

#: Smallest 1 - phi / phi_m: a factor of 3e7 (Einstein-Roscoe) or 1e6 (Maron-Pierce).
LEAST_ROOM = 1e-3


@lru_cache
def stiffening(real: Any, viscosity: Any) -> Any:
    """Return the device function mu(T) [Pa s] of lava with crystals.

    Args:
        real: Warp scalar type to compute in.
        viscosity: Device function mu(T) of the melt.
    """

    @wp.func
    def stiffened(law: rheology_type(real), temperature: real) -> real:
        share = (real(law.liquidus) - temperature) / real(law.liquidus - law.solidus)
        share = wp.clamp(share, real(0.0), real(1.0))
        room = wp.max(real(1.0) - share * real(law.crystals_over_packing), real(LEAST_ROOM))
        return viscosity(law, temperature) * wp.pow(room, -real(law.crystal_exponent))

    return stiffened
