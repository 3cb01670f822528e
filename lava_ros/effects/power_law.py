# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Stress as a power of the strain rate: Herschel-Bulkley, tau = tau_y + K (du/dz)^n.

With tau_b = rho g h s at the base, s = |grad S|, and y = 1 - tau_y / tau_b the sheared part of the
thickness, the strain rate at the base is G = ((tau_b - tau_y) / K)^(1/n) and the depth average

    u = G h F(y),   F = n / (n + 1) y (1 - n / (2 n + 1) y),

which is 0 for y <= 0. n = 1 is Bingham flow; tau_y = 0 gives y = 1 and u = n / (2 n + 1) G h. As
d(y^(1/n) F)/dy = y^(1/n) (1 - n / (n + 1) y),

    du/ds = (G h / s) (F / n + (1 - y) (1 - n / (n + 1) y)),   u / s = (G h / s) F

are the diffusivities along and across the slope over h. With max(1, 1/n) in place of 1/n the first
is never below either of the two. K(T) is the viscosity of its law, tau_y(T) that of yielding.

Lava with n > 1 has no viscosity at rest: on a level surface u / s is infinite. Below
``MIN_SLOPE`` K is therefore evaluated at the strain rate of that slope.
"""

from functools import lru_cache
from typing import Any

from lava_ros.effects.effect import Effect, number

EFFECT = Effect(
    rank=30,
    title='strain rate as a power of stress',
    symbol='|n - 1|',
    number=lambda scales: abs(scales.lava.flow_index - 1.0),
    admits='nothing',
    source='identity at n = 1',
    exists=lambda lava: lava.flow_index != 1.0,
    constants={
        'flow_index': number(
            1.0, 'Exponent n of Herschel-Bulkley flow; 1: Newtonian or Bingham', 0.1, 5.0
        ),
    },
    law={'flow_index': lambda lava: lava.flow_index},
    benchmark={'flow_index': 0.8},
)

#: Slope below which the mobility of lava with n > 1 is constant.
MIN_SLOPE = 1e-3

#: Minimum slope for n <= 1, where nothing becomes infinite: it only avoids 0 / 0.
_NO_SLOPE = 1e-12

#: Minimum stress [Pa], for the same reason; float32 can represent its logarithm over a viscosity.
_NO_STRESS = 1e-18


@lru_cache
def speed(
    wp: Any, real: Any, law_type: Any, column_type: Any, viscosity: Any, strength: Any
) -> Any:
    """Return the device function for u / s and a bound of u / s and du/ds [m/s].

    ``viscosity`` is K(T), ``strength`` tau_y(T) or None without yielding.
    """
    vec2 = wp.types.vector(2, real)
    has_strength = strength is not None

    @wp.func
    def herschel_bulkley(law: law_type, weight: real, column: column_type) -> vec2:
        one = real(1.0)
        thickness, slope = column.normal_thickness, column.slope
        n = real(law.flow_index)
        min_slope = real(_NO_SLOPE)
        if n > one:
            min_slope = real(MIN_SLOPE)
        fall = wp.max(slope, min_slope)
        sheared = one
        # no branch, which would keep a CPU from vectorising a loop over columns
        if wp.static(has_strength):
            stress = wp.max(weight * thickness * slope, real(_NO_STRESS))
            sheared = wp.max(stress - strength(law, column), real(0.0)) / stress
        excess = wp.max(weight * thickness * fall * sheared, real(_NO_STRESS))
        rate = wp.pow(excess / viscosity(law, column.temperature), one / n) * thickness / fall
        if sheared == real(0.0):
            rate = real(0.0)
        across = n / (n + one) * sheared * (one - n / (n + n + one) * sheared)
        along = wp.max(one, one / n) * across
        if wp.static(has_strength):
            along += (one - sheared) * (one - n / (n + one) * sheared)
        return rate * vec2(across, along)

    return herschel_bulkley
