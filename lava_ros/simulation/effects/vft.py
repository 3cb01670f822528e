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

"""Viscosity that rises as lava cools: log10 mu = A + B / (T - C), Vogel, Fulcher and Tammann.

Giordano, Russell & Dingwell (2008, Earth Planet. Sci. Lett. 271) give A = -4.55 and B and C from
the composition. The law is of the melt, and infinite at C: temperatures within ``LEAST_DISTANCE``
of C or below count as if they were that far above it, and mu never exceeds 10^``LARGEST`` Pa s.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.simulation.rheology import rheology_type

#: Decimal logarithm of the largest viscosity [Pa s].
LARGEST = 15.0

#: Smallest temperature above C [K] that the law is evaluated at.
LEAST_DISTANCE = 1.0

_LOG_10 = math.log(10.0)


@lru_cache
def viscosity(real: Any) -> Any:
    """Return the device function mu(T) [Pa s]."""

    @wp.func
    def vft(law: rheology_type(real), temperature: real) -> real:
        distance = wp.max(temperature - real(law.vft_c), real(LEAST_DISTANCE))
        power = wp.min(real(law.vft_a) + real(law.vft_b) / distance, real(LARGEST))
        return wp.exp(real(_LOG_10) * power)

    return vft
