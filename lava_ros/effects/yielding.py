# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Yield strength of the core, which rises as the lava cools (speed: ``bingham.py``).

tau_y(T) = yield_strength exp(yield_rate (reference_temperature - T)): its logarithm is linear, in
agreement with measurements.
"""

from functools import lru_cache
from operator import attrgetter
from typing import Any

import numpy as np

from lava_ros.effects.bingham import speed  # noqa: F401, the speed function of this effect
from lava_ros.effects.effect import Effect, number
from lava_ros.effects.scales import Scales


def _bingham(scales: Scales) -> np.ndarray:
    """Return the yield strength of each column over the stress at its base."""
    strength = scales.law(scales.rheology.strength_at, scales.columns.temperature)
    return strength / scales.stress


EFFECT = Effect(
    rank=20,
    title='yield strength',
    symbol='Bingham number',
    number=_bingham,
    threshold=0.01,
    admits='1.5 % of the speed: 3/2 of the number',
    speed_error=0.015,
    source='exact sheet, verification/exact/rheology.py',
    exists=lambda lava: lava.yield_strength > 0.0,
    stiffens=True,
    constants={
        'yield_strength': number(
            0.0, 'Yield strength at reference_temperature; 0: none', 0.0, 1e9, 'Pa'
        ),
        'yield_rate': number(
            0.0, 'Rate at which yield strength rises as lava cools', 0.0, 1.0, '1/K'
        ),
    },
    law={name: attrgetter(name) for name in ('yield_strength', 'yield_rate')},
    benchmark={'yield_strength': 500.0, 'yield_rate': 0.01},
)

#: Maximum exponent of the law: stronger lava never moves, and float32 can represent it.
_LARGEST_EXPONENT = 60.0


@lru_cache
def strength(wp: Any, real: Any, law_type: Any, column_type: Any) -> Any:
    """Return the device function for tau_y [Pa] of a column."""

    @wp.func
    def yield_strength(law: law_type, column: column_type) -> real:
        value = real(law.yield_strength)
        if real(law.yield_rate) > real(0.0):
            colder = real(law.reference_temperature) - column.temperature
            exponent = real(law.yield_rate) * colder
            value *= wp.exp(wp.min(exponent, real(_LARGEST_EXPONENT)))
        return value

    return yield_strength
