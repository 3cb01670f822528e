# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Viscosity that rises as lava cools: the Arrhenius law of 3.26.

The paper multiplies f(theta) = K_e exp(alpha (theta_e - theta)) by another constant mu, also of
100 Pa s; that counts the viscosity twice, so f alone is the viscosity here.
"""

from functools import lru_cache
import math
from typing import Any

import numpy as np

from lava_ros.effects.effect import Effect
from lava_ros.effects.scales import Scales


def _stiffening(scales: Scales) -> np.ndarray:
    """Return the logarithm of the largest viscosity ratio: by cooling, or of vent to reference."""
    lava = scales.lava
    law = scales.rheology.viscosity_at
    at_vent = abs(math.log(law(scales.vent_temperature) / lava.viscosity))
    end = scales.law(law, scales.rest_temperature) / lava.viscosity
    return np.maximum(np.abs(np.log(end)), at_vent)


EFFECT = Effect(
    rank=40,
    title='viscosity by temperature (Arrhenius)',
    symbol='ln of the viscosity ratio',
    number=_stiffening,
    threshold=0.03,
    admits='3 % of the speed',
    speed_error=0.03,
    source='speed is proportional to 1 / mu',
    exists=lambda lava: lava.arrhenius > 0.0,
    stiffens=True,
    is_default=True,
    law={'arrhenius': lambda lava: lava.arrhenius},
    benchmark={'arrhenius': 0.02},
)

#: Maximum absolute exponent of the law: a ratio of 1e26.
_LARGEST = 60.0


@lru_cache
def viscosity(wp: Any, real: Any, law_type: Any) -> Any:
    """Return the device function mu(T) [Pa s]."""

    @wp.func
    def arrhenius(law: law_type, temperature: real) -> real:
        power = real(law.arrhenius) * (real(law.reference_temperature) - temperature)
        return real(law.viscosity) * wp.exp(wp.clamp(power, real(-_LARGEST), real(_LARGEST)))

    return arrhenius
