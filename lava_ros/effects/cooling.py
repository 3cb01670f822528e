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

"""Cooling at the surface by radiation and convection, at the column's mean temperature.

rho c h dT/dt = -eps sigma (T^4 - Ta^4) - lambda (T - Ta), which is -s(T) (T - Ta).
"""

from functools import lru_cache
from typing import Any

from lava_ros.effects.effect import Effect, footprint_change

EFFECT = Effect(
    rank=100,
    title='radiation and convection',
    symbol='heat lost',
    number=lambda scales: scales.heat_lost,
    threshold=0.01,
    admits='1 % of the temperature or 3 % of the speed',
    cost=footprint_change(0.03),
    source='column at rest',
    exists=lambda lava: lava.radiates,
    is_default=True,
    is_surface=True,
)


@lru_cache
def terms(wp: Any, real: Any, constants_type: Any) -> Any:
    """Return the device function that gives s [1/s] and s Ta [K/s]."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def cooling(
        constants: constants_type,
        thickness: real,
        temperature: real,
        age: real,
        drop: real,
        speed: real,
    ) -> vec2:
        ambient = real(constants.ambient)
        square = temperature * temperature + ambient * ambient
        loss = real(constants.radiation) * square * (temperature + ambient)
        rate = (loss + real(constants.convection)) / thickness
        return vec2(rate, rate * ambient)

    return cooling
