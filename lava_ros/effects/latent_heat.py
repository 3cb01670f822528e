# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Latent heat, released by crystals that form between liquidus and solidus.

Crystallisation is linear in temperature, so the heat content over rho c d is
T + (L / c) F with the melt fraction F = (T - solidus) / (liquidus - solidus) between 0 and 1, and
within the interval temperature changes 1 + L / (c (liquidus - solidus)) times more slowly. The
time that lava spends within it is that between both ends without latent heat, times this factor.
So the heat content changes by exactly the heat lost, for any step.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from lava_ros.effects.effect import Effect, number
from lava_ros.effects.protocols import Lava
from lava_ros.effects.scales import Scales
from lava_ros.errors import LavaError


def _kept_warm(scales: Scales) -> np.ndarray:
    """Return the effect of the latent heat that each column releases up to the horizon.

    It warms by no more than the column has cooled below the liquidus.
    """
    lava = scales.lava
    below = np.maximum(lava.liquidus - scales.rest_temperature, 0.0)
    frozen = np.minimum(below / (lava.liquidus - lava.solidus), 1.0)
    warming = np.minimum(frozen * lava.latent_heat / lava.specific_heat, below)
    return scales.matters(warming / scales.warmth)


def _check(lava: Lava) -> None:
    if lava.latent_heat > 0.0 and not lava.solidus:
        raise LavaError('lava.solidus', lava.solidus, 'above 0 K with lava.latent_heat')


EFFECT = Effect(
    rank=150,
    title='latent heat',
    symbol='latent heat given',
    number=_kept_warm,
    threshold=0.01,
    admits='1 % of the temperature or 3 % of the speed',
    speed_error=0.03,
    source='heat balance',
    exists=lambda lava: lava.latent_heat > 0.0,
    constants={
        'latent_heat': number(
            0.0, 'Latent heat between liquidus and solidus; 0: none', 0.0, 1e7, 'J/kg'
        ),
    },
    check=_check,
    # L / c [K]
    heat={'latent': lambda scene: scene.lava.latent_heat / scene.lava.specific_heat},
    benchmark={'latent_heat': 3e5, 'solidus': 1100.0},
)


#: A time longer than any other [s], in float32.
_FOREVER = 1e30


@lru_cache
def relaxed(wp: Any, real: Any, constants_type: Any, relaxation: Any) -> Any:
    """Return the device function for the change of temperature in a step at constant s and f.

    ``relaxation`` is that of lava without latent heat. No branch and no loop keeps a CPU from
    vectorising a loop over columns.
    """

    @wp.func
    def time_to(end: real, temperature: real, rate: real, source: real) -> real:
        """Return the time to another temperature without latent heat; 0 if T moves away [s]."""
        room = end - temperature
        # the pace falls towards equilibrium
        pace = source - rate * end
        time = real(_FOREVER)
        if pace * room > real(0.0):
            time = room / pace
            x = rate * time
            # ln(1 + x) / x to 1e-8, without a logarithm
            mean = real(1.0) - x * (real(1.0 / 2.0) - x * (real(1.0 / 3.0) - x * real(0.25)))
            if x > real(1.0e-2):
                mean = wp.log(real(1.0) + x) / x
            time *= mean
        if (source - rate * temperature) * room <= real(0.0):
            time = real(0.0)
        return time

    @wp.func
    def relaxed(
        constants: constants_type, temperature: real, rate: real, source: real, step: real
    ) -> real:
        solidus = real(constants.solidus)
        liquidus = real(constants.liquidus)
        slower = real(1.0) + real(constants.latent) / (liquidus - solidus)
        # ends of the interval in the order in which lava reaches them
        first = solidus
        last = liquidus
        begun = wp.max(temperature, solidus)
        if source < rate * temperature:
            first = liquidus
            last = solidus
            begun = wp.min(temperature, liquidus)
        before = wp.min(step, time_to(first, temperature, rate, source))
        within = wp.min(step - before, slower * time_to(last, begun, rate, source))
        return relaxation(temperature, rate, source, step - within + within / slower)

    return relaxed


@lru_cache
def warmed(wp: Any, real: Any, constants_type: Any) -> Any:
    """Return the device function for the temperature after adding heat worth a rise."""

    @wp.func
    def warmed(constants: constants_type, temperature: real, rise: real) -> real:
        solidus = real(constants.solidus)
        latent = real(constants.latent)
        width = real(constants.liquidus) - solidus
        melt = wp.clamp((temperature - solidus) / width, real(0.0), real(1.0))
        # heat content above the solidus
        heat = temperature - solidus + latent * melt + rise
        if heat <= real(0.0):
            return solidus + heat
        if heat >= width + latent:
            return solidus + heat - latent
        return solidus + heat * width / (width + latent)

    return warmed
