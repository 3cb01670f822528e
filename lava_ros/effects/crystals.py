# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Crystals that form as lava cools: mu is multiplied by (1 - phi / phi_m)^-e.

e = 2.5 by Einstein and Roscoe (Roscoe 1952, Br. J. Appl. Phys. 3; Marsh 1981, Contrib. Mineral.
Petrol. 78), e = 2 by Maron and Pierce (1956, J. Colloid Sci. 11). The volume fraction of crystals
phi(T) rises linearly from 0 at the liquidus to ``crystals`` at the solidus. At maximum packing,
phi = phi_m, the law is infinite: 1 - phi / phi_m is limited to at least ``MIN_FREE_FRACTION``.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from lava_ros.effects.effect import choice, Effect, number
from lava_ros.effects.protocols import Lava
from lava_ros.effects.scales import Scales
from lava_ros.errors import LavaError

#: The exponent e of each law.
EXPONENTS = {'none': 0.0, 'einstein-roscoe': 2.5, 'maron-pierce': 2.0}

#: Minimum of 1 - phi / phi_m: a factor of 3e7 (Einstein-Roscoe) or 1e6 (Maron-Pierce).
MIN_FREE_FRACTION = 1e-3


def fraction(lava: Lava, temperature: np.ndarray | float) -> np.ndarray | float:
    """Return the volume fraction of crystals at temperatures [K], 0 at the liquidus."""
    return np.interp(temperature, [lava.solidus, lava.liquidus], [lava.crystals, 0.0])


def _stiffening(scales: Scales) -> np.ndarray:
    """Return the logarithm of the viscosity factor of crystals at the horizon, by column."""
    lava = scales.lava
    free = 1.0 - fraction(lava, scales.rest_temperature) / lava.packing
    room = np.maximum(free, MIN_FREE_FRACTION)
    return EXPONENTS[lava.crystal_law] * np.log(1.0 / room)


def _check(lava: Lava) -> None:
    if lava.crystal_law != 'none' and not lava.solidus:
        raise LavaError('lava.solidus', lava.solidus, 'above 0 K with lava.crystal_law')


EFFECT = Effect(
    rank=60,
    title='crystals stiffen lava',
    symbol='ln of the viscosity ratio',
    number=_stiffening,
    threshold=0.03,
    admits='3 % of the speed',
    speed_error=0.03,
    source='speed is proportional to 1 / mu',
    exists=lambda lava: lava.crystal_law != 'none' and lava.crystals > 0.0,
    stiffens=True,
    constants={
        'crystal_law': choice('none', 'Law of the effect of crystals on viscosity', EXPONENTS),
        'crystals': number(
            0.0, 'Volume fraction of crystals at the solidus, linear up to the liquidus', 0.0, 1.0
        ),
        'packing': number(0.6, 'Volume fraction at which crystals jam', 0.01, 1.0),
    },
    check=_check,
    law={
        'crystals_over_packing': lambda lava: lava.crystals / lava.packing,
        'crystal_exponent': lambda lava: EXPONENTS[lava.crystal_law],
    },
    benchmark={'crystal_law': 'einstein-roscoe', 'crystals': 0.4, 'solidus': 1100.0},
)


@lru_cache
def stiffening(wp: Any, real: Any, law_type: Any, viscosity: Any) -> Any:
    """Return the device function mu(T) [Pa s] of lava with crystals, given that of the melt."""

    @wp.func
    def stiffened(law: law_type, temperature: real) -> real:
        solid = (real(law.liquidus) - temperature) / real(law.liquidus - law.solidus)
        solid = wp.clamp(solid, real(0.0), real(1.0))
        room = wp.max(real(1.0) - solid * real(law.crystals_over_packing), real(MIN_FREE_FRACTION))
        return viscosity(law, temperature) * wp.pow(room, -real(law.crystal_exponent))

    return stiffened
