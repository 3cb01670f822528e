# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Yield strength: lava flows only where the stress at its base exceeds it (Bingham).

The stress at the base of a layer of thickness h is tau_b = rho g h s, s = |grad S|, and falls
linearly to 0 at the surface. Above h_s = h (1 - B), B = tau_y / tau_b, it is below the strength
tau_y: a plug rides on a sheared layer. With mu du/dz = tau - tau_y there and no slip below, the
depth average is

    u = (rho g h^2 s / 3 mu) (1 - 3 B / 2 + B^3 / 2),   exactly 0 for B >= 1,

and the derivative of the flux, d(h u)/ds = (rho g h^3 / 3 mu) (1 - B^3), is the diffusivity along
the slope: between u h / s, that across it, and that of lava without strength.

tau_y(T) = yield_strength exp(yield_rate (reference_temperature - T)): its logarithm is linear, as
measurements have it.
"""

from functools import lru_cache
from typing import Any, TYPE_CHECKING

import numpy as np

from lava_ros.effects.effect import Effect, footprint_change, number

if TYPE_CHECKING:
    from lava_ros.effects.scales import Scales


def _bingham(scales: 'Scales') -> np.ndarray:
    """Yield strength of each column over the stress at its base."""
    strength = scales.law(scales.lava.yield_strength_at, scales.columns.temperature)
    return strength / scales.stress


EFFECT = Effect(
    rank=20,
    title='yield strength',
    symbol='Bingham number',
    number=_bingham,
    threshold=0.01,
    admits='1.5 % of the speed: 3/2 of the number',
    cost=footprint_change(0.015),
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
    law={
        'yield_strength': lambda lava: lava.yield_strength,
        'yield_rate': lambda lava: lava.yield_rate,
    },
    benchmark={'yield_strength': 500.0, 'yield_rate': 0.01},
)

#: Largest exponent of the strength's law: what is stronger never moves, and a float32 holds it.
_LARGEST_EXPONENT = 60.0


@lru_cache
def strength(wp: Any, real: Any, law_type: Any) -> Any:
    """Return the device function tau_y(T) [Pa]."""

    @wp.func
    def yield_strength(law: law_type, temperature: real) -> real:
        value = real(law.yield_strength)
        if real(law.yield_rate) > real(0.0):
            exponent = real(law.yield_rate) * (real(law.reference_temperature) - temperature)
            value *= wp.exp(wp.min(exponent, real(_LARGEST_EXPONENT)))
        return value

    return yield_strength


@lru_cache
def speed(wp: Any, real: Any, law_type: Any, viscosity: Any, yield_strength: Any) -> Any:
    """Return the device function that gives u / s and the largest derivative du/ds [m/s]."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def bingham(
        law: law_type, weight: real, depth: real, slope: real, temperature: real
    ) -> vec2:
        stress = weight * depth * slope
        resisted = yield_strength(law, temperature)
        if stress <= resisted:
            return vec2()
        b = resisted / stress
        # 1 - b without the digits that the quotient loses
        free = (stress - resisted) / stress
        newtonian = weight * depth * depth / (real(3.0) * viscosity(law, temperature))
        return newtonian * free * vec2(
            free * (real(1.0) + real(0.5) * b), real(1.0) + b + b * b
        )

    return bingham
