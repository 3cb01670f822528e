# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral conduction of heat (equations: simulation/step/effects/conduction.py)."""

import math

from lava_ros.effects.effect import Array, Effect
from lava_ros.effects.scales import Scales


def _reach(scales: Scales) -> float:
    """Return the distance that heat diffuses up to the horizon over the particle spacing."""
    lava = scales.lava
    diffusivity = lava.conductivity / (lava.density * lava.specific_heat)
    return math.sqrt(diffusivity * scales.duration) / scales.spacing


EFFECT = Effect(
    rank=160,
    title='heat from column to column',
    symbol='reach of heat over spacing',
    number=_reach,
    threshold=0.3,
    admits='0.17 spacings that hot lava reaches into cold: 3 % of a flow 11 spacings wide',
    cost=0.03,
    source='two half-spaces: heat exchanged, sqrt(a t / pi) of the heat of one',
    exists=lambda lava: lava.conductivity > 0.0,
    arrays={
        # rate at which each ordered particle exchanges heat [1/s], its temperature before [K]
        'exchange': Array('real'),
        'warmth': Array('real'),
        # time since the last exchange, and duration of the current one, 0 for none [s]
        'waited': Array('float64', 2, is_saved=True),
    },
    benchmark={'conductivity': 2.0},
)
