# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Strength of a crust that thickens with age and stops lava at margins and fronts.

A crust of strength sigma is delta = sqrt(kappa t) thick at the age t of a column, at most as thick
as the column. It resists as a stress sigma delta / d at the base of a column of thickness d across
the flow (Castruccio, Rust & Sparks 2013, Bulletin of Volcanology 75, 681; Lyman & Kerr 2006,
Journal of Geophysical Research 111, B05206): lava on a slope b stops where

    rho g d sin b = sigma delta / d,   that is d = sqrt(sigma delta / (rho g sin b)).

This stress adds to the yield strength of the core (``bingham.py``). It is small for young lava in
a channel. It holds old, thin lava at margins and fronts, which builds levees. In the ten eruptions
of Castruccio et al. sigma is within an order of magnitude of 1e5 Pa.

If the effect is switched on during a run, ages count from that time.
"""

from functools import lru_cache
from operator import attrgetter
from typing import Any

import numpy as np

from lava_ros.effects.bingham import speed  # noqa: F401, the speed function of this effect
from lava_ros.effects.effect import Effect, number
from lava_ros.effects.scales import Scales


def _resistance(scales: Scales) -> np.ndarray:
    """Return the stress of the crust at the horizon over that at the base of each column."""
    lava, thickness = scales.lava, scales.columns.normal_thickness
    crust = np.minimum(np.sqrt(lava.crust_diffusivity * scales.duration), thickness)
    return lava.crust_strength * crust / thickness / scales.stress


EFFECT = Effect(
    rank=25,
    title='strength of the crust',
    symbol='stress of the crust over that at the base',
    number=_resistance,
    threshold=0.01,
    admits='1.5 % of the speed: 3/2 of the number',
    speed_error=0.015,
    source='exact sheet, verification/exact/rheology.py',
    exists=lambda lava: lava.crust_strength > 0.0,
    constants={
        'crust_strength': number(0.0, 'Strength of the crust; 0: none', 0.0, 1e9, 'Pa'),
        'crust_diffusivity': number(
            5e-7, 'Thermal diffusivity of the crust, by which it thickens', 0.0, 1e-3, 'm2/s'
        ),
    },
    law={name: attrgetter(name) for name in ('crust_strength', 'crust_diffusivity')},
    needs_age=True,
    benchmark={'crust_strength': 1e5},
)


@lru_cache
def strength(wp: Any, real: Any, law_type: Any, column_type: Any) -> Any:
    """Return the device function for the stress of the crust [Pa]."""

    @wp.func
    def crust_stress(law: law_type, column: column_type) -> real:
        thickness = column.normal_thickness
        crust = wp.min(wp.sqrt(real(law.crust_diffusivity) * column.age), thickness)
        return real(law.crust_strength) * crust / thickness

    return crust_stress
