# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cooling at the surface by radiation and convection, at the column's mean temperature.

rho c d dT/dt = -eps sigma (T^4 - Ta^4) - lambda (T - Ta), which is -s(T) (T - Ta), with the
thickness d across the flow (``column.py``).
"""

from functools import lru_cache
from typing import Any

from lava_ros.effects.effect import Effect

EFFECT = Effect(
    rank=100,
    title='radiation and convection',
    symbol='heat lost',
    number=lambda scales: scales.heat_lost,
    threshold=0.01,
    admits='1 % of the temperature or 3 % of the speed',
    speed_error=0.03,
    source='column at rest',
    exists=lambda lava: lava.radiates,
    is_default=True,
    is_surface=True,
)


@lru_cache
def terms(wp: Any, real: Any, constants_type: Any, column_type: Any) -> Any:
    """Return the device function for s [1/s] and s Ta [K/s]."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def cooling(constants: constants_type, column: column_type) -> vec2:
        ambient, temperature = real(constants.ambient), column.temperature
        square = temperature * temperature + ambient * ambient
        loss = real(constants.radiation) * square * (temperature + ambient)
        rate = (loss + real(constants.convection)) / column.normal_thickness
        return vec2(rate, rate * ambient)

    return cooling
