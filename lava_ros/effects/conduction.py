# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral conduction of heat (equations: simulation/step/effects/conduction.py)."""

import math

import numpy as np

from lava_ros.effects.effect import Array, Effect
from lava_ros.effects.scales import Scales


def _reach(scales: Scales) -> np.ndarray:
    """Return the distance that heat diffuses up to the horizon over half of the flow's width.

    It counts as far as the coldest lava differs from the hottest: in viscosity, at most wholly.
    """
    lava = scales.lava
    diffusivity = lava.conductivity / (lava.density * lava.specific_heat)
    reach = scales.over_half_width(math.sqrt(diffusivity * scales.duration))
    cooled = scales.columns.temperature if scales.is_measured else scales.rest_temperature
    coldest = min([float(cooled.min()), *(vent.temperature for vent in scales.scene.vents)])
    contrast = scales.matters((scales.vent_temperature - coldest) / scales.warmth)
    return reach * np.minimum(contrast, 1.0)


EFFECT = Effect(
    rank=160,
    title='heat from column to column',
    symbol='reach of heat over half-width',
    number=_reach,
    fraction=0.5,
    threshold=0.05,
    admits='3 % of the width: heat of hot lava reaches that far into cold lava',
    extent_error=0.03,
    source='two half-spaces: heat exchanged, sqrt(a t / pi) of the heat of one',
    exists=lambda lava: lava.conductivity > 0.0,
    arrays={
        # rate at which each ordered particle exchanges heat [1/s], its temperature before [K]
        'exchange': Array('real'),
        'warmth': Array('real'),
        # time since the last exchange, and duration of the current one, 0 for none [s]
        'waited': Array('float64', (2,), is_saved=True),
    },
    benchmark={'conductivity': 2.0},
)
