# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Viscosity that rises as lava cools: log10 mu = A + B / (T - C), Vogel, Fulcher and Tammann.

Giordano, Russell & Dingwell (2008, Earth Planet. Sci. Lett. 271) give A = -4.55 and B and C from
the composition. The law is that of the melt, and infinite at C: temperatures below C +
``MIN_TEMPERATURE_ABOVE_C`` are raised to that value, and mu never exceeds 10^``LARGEST`` Pa s.
"""

from functools import lru_cache
import math
from operator import attrgetter
from typing import Any

from lava_ros.effects.effect import Effect, number

EFFECT = Effect(
    rank=50,
    title='viscosity by temperature (VFT)',
    symbol='B',
    number=lambda scales: float(scales.lava.vft_b),
    admits='nothing: it is the viscosity',
    source='Giordano et al. 2008',
    exists=lambda lava: lava.vft_b > 0.0,
    stiffens=True,
    excludes={'arrhenius': 'they are one effect'},
    replaces=('arrhenius',),
    constants={
        'vft_a': number(-4.55, 'Constant A of the VFT law: log10 Pa s', -20.0, 20.0),
        'vft_b': number(
            0.0, 'Constant B of the VFT law, which replaces viscosity; 0: not used', 0.0, 1e5, 'K'
        ),
        'vft_c': number(0.0, 'Constant C of the VFT law', 0.0, 2000.0, 'K'),
    },
    law={name: attrgetter(name) for name in ('vft_a', 'vft_b', 'vft_c')},
    benchmark={'vft_b': 9000.0, 'vft_c': 600.0},
)

#: Decimal logarithm of the maximum viscosity [Pa s].
LARGEST = 15.0

#: Minimum temperature above C [K] for evaluating the law.
MIN_TEMPERATURE_ABOVE_C = 1.0

_LOG_10 = math.log(10.0)


@lru_cache
def viscosity(wp: Any, real: Any, law_type: Any) -> Any:
    """Return the device function mu(T) [Pa s]."""

    @wp.func
    def vft(law: law_type, temperature: real) -> real:
        distance = wp.max(temperature - real(law.vft_c), real(MIN_TEMPERATURE_ABOVE_C))
        power = wp.min(real(law.vft_a) + real(law.vft_b) / distance, real(LARGEST))
        return wp.exp(real(_LOG_10) * power)

    return vft
