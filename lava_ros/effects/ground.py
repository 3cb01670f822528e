# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Conduction into the ground, a half-space at air temperature before lava reaches it.

Ground at Tg in contact with lava of constant temperature T for a time t takes up
kg (T - Tg) / sqrt(pi a t) [W/m2], with its diffusivity a (Carslaw & Jaeger 1959, section 2.4).
That is a rate of b / sqrt(pi t), b = kg / (sqrt(a) rho c d), of the column's own cooling. Cooling
lava meets ground that it has warmed: the exact temperature of a mixed column that loses heat to
the ground alone is

    (T - Tg) / (T0 - Tg) = exp(x^2) erfc(x), x = b sqrt(t),

whose rate is the previous one times 1 / (exp(x^2) erfc(x)) - sqrt(pi) x. The bounds
2 / sqrt(pi) / (x + sqrt(x^2 + c)) of exp(x^2) erfc(x), c = 4 / pi for small x and 2 for large x
(Abramowitz & Stegun 7.1.13), give that factor as sqrt(pi) / 2 (sqrt(x^2 + c) - x). With a c that
varies between the two, the heat lost is exact to 0.7 %, the temperature to 0.5 % of T0 - Tg.
Without the factor the heat lost is 8 % too large when a quarter of it has gone, 18 % at x = 1.

The contact time is the column's age, as if it had stayed where it was emitted. Lava moving over
ground that earlier lava has warmed loses less, a front advancing over cold ground more.
"""

from functools import lru_cache
import math
from typing import Any

import numpy as np

from lava_ros.effects.effect import Effect, number
from lava_ros.effects.protocols import Scene
from lava_ros.effects.scales import Scales


def _heat_taken(scales: Scales) -> np.ndarray:
    """Return the effect of the heat that a half-space takes from each column up to the horizon."""
    lava = scales.lava
    taken = 2.0 * lava.ground_conductivity * math.sqrt(
        scales.duration / (math.pi * lava.ground_diffusivity)
    )
    return scales.matters(np.minimum(taken / scales.heat_capacity, 1.0))


def _contact(scene: Scene) -> float:
    """Return kg / (rho c sqrt(a)) with the ground's diffusivity a [m/s^0.5]."""
    lava = scene.lava
    capacity = lava.density * lava.specific_heat
    return float(lava.ground_conductivity / (capacity * math.sqrt(lava.ground_diffusivity)))


EFFECT = Effect(
    rank=130,
    title='heat into the ground',
    symbol='heat taken',
    number=_heat_taken,
    threshold=0.01,
    admits='1 % of the temperature or 3 % of the speed',
    speed_error=0.03,
    source='half-space, verification/exact/heat.py',
    exists=lambda lava: lava.ground_conductivity > 0.0,
    constants={
        'ground_conductivity': number(
            0.0, 'Thermal conductivity of the ground; 0: no heat goes there', 0.0, 1e3, 'W/(m K)'
        ),
        'ground_diffusivity': number(
            7e-7, 'Thermal diffusivity of the ground', 1e-9, 1e-3, 'm2/s'
        ),
    },
    heat={'contact': _contact},
    needs_age=True,
    benchmark={'ground_conductivity': 2.0},
)


@lru_cache
def terms(wp: Any, real: Any, constants_type: Any, column_type: Any) -> Any:
    """Return the device function for s [1/s] and s Tg [K/s]."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def ground(constants: constants_type, column: column_type) -> vec2:
        b = real(constants.contact) / column.normal_thickness
        root = wp.sqrt(column.age)
        x = b * root
        c = real(wp.static(4.0 / math.pi)) + real(wp.static(2.0 - 4.0 / math.pi)) * x / (
            x + real(0.85)
        )
        # sqrt(x^2 + c) - x without its cancellation
        rate = real(0.5) * b / root * c / (wp.sqrt(x * x + c) + x)
        return vec2(rate, rate * real(constants.ambient))

    return ground
