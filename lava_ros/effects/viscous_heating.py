# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Viscous heating: the work of gravity turns into heat.

Without acceleration, shear dissipates the work of gravity: rho g h |grad S| |u| per area, equal to
3 mu u^2 / h for Newtonian lava. Over a step a column falls by -grad S . dx, which warms it by g /
c times that: 8.5 K in 1000 m. The sum over all columns is the potential energy that the flow
loses. Under lateral stress or inertia a column's heat appears where gravity does the work; the sum
is the same, except for the kinetic energy.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from lava_ros.effects.effect import Effect
from lava_ros.effects.scales import Scales


def _warming(scales: Scales) -> np.ndarray:
    """Return the effect of the warming by the fall of the flow."""
    warming = scales.scene.gravity * scales.fall / scales.lava.specific_heat
    return scales.matters(warming / scales.warmth)


EFFECT = Effect(
    rank=140,
    title='viscous heating',
    symbol='heat of the fall',
    number=_warming,
    threshold=0.01,
    admits='1 % of the temperature or 3 % of the speed',
    speed_error=0.03,
    source='energy of the fall',
    # g / c [K/m]
    heat={'fall': lambda scene: scene.gravity / scene.lava.specific_heat},
    needs_drop=True,
)


@lru_cache
def terms(wp: Any, real: Any, constants_type: Any, column_type: Any) -> Any:
    """Return the device function for s = 0 and the warming [K/s]."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def heating(constants: constants_type, column: column_type) -> vec2:
        return vec2(real(0.0), real(constants.fall) * column.drop)

    return heating
