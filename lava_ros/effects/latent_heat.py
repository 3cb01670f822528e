# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Latent heat, released by crystals that form between liquidus and solidus.

Crystallisation is linear in temperature, so the heat content over rho c d is
T + (L / c) F with the melt fraction F = (T - solidus) / (liquidus - solidus) between 0 and 1, and
within the interval temperature changes 1 + L / (c (liquidus - solidus)) times more slowly. A step
is solved piece by piece: up to the end of the interval, across it, and beyond. So the heat
content changes by exactly the heat lost, for any step.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from lava_ros.effects.effect import Effect, number
from lava_ros.effects.protocols import Lava
from lava_ros.effects.scales import footprint_change, Scales, thickness_change
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
    cost=footprint_change(0.03),
    thickness_cost=thickness_change(0.03),
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


#: Pieces of the heat content: above the liquidus, between liquidus and solidus, below.
_PIECES = 3


@lru_cache
def relaxed(
    wp: Any, real: Any, constants_type: Any, relaxation: Any, *, is_straight: bool = False
) -> Any:
    """Return the device function for the change of temperature in a step at constant s and f.

    ``relaxation`` is that of lava without latent heat. If ``is_straight``, all pieces are
    computed, without a loop.
    """
    vec3 = wp.types.vector(3, real)

    @wp.func
    def piece(
        constants: constants_type, temperature: real, rate: real, source: real, so_far: vec3
    ) -> vec3:
        """Return the change so far, the temperature and the time that remains after a piece."""
        total, result, remaining = so_far[0], so_far[1], so_far[2]
        solidus = real(constants.solidus)
        liquidus = real(constants.liquidus)
        slower = real(1.0) + real(constants.latent) / (liquidus - solidus)
        falls = source < rate * temperature
        end = real(0.0)
        factor = real(1.0)
        if falls:
            if result > liquidus:
                end = liquidus
            elif result > solidus:
                end = solidus
                factor = slower
        else:
            end = real(1.0e9)
            if result < solidus:
                end = solidus
            elif result < liquidus:
                end = liquidus
                factor = slower
        change = relaxation(result, rate / factor, source / factor, remaining)
        room = end - result
        passed = change > room
        if falls:
            passed = change < room
        if passed:
            # fraction of the time until the end of the piece
            share = room / change
            x = rate * remaining / factor
            if x > real(1.0e-6):
                equilibrium = source / rate
                share = wp.log((result - equilibrium) / (end - equilibrium)) / x
            remaining *= wp.clamp(real(1.0) - share, real(0.0), real(1.0))
            result = end
            total = end - temperature
        else:
            total += change
            remaining = real(0.0)
        return vec3(total, result, remaining)

    @wp.func
    def straight(
        constants: constants_type, temperature: real, rate: real, source: real, step: real
    ) -> real:
        state = vec3(real(0.0), temperature, step)
        for _ in range(_PIECES):
            state = piece(constants, temperature, rate, source, state)
        return state[0]

    @wp.func
    def relaxed(
        constants: constants_type, temperature: real, rate: real, source: real, step: real
    ) -> real:
        state = vec3(real(0.0), temperature, step)
        pieces = wp.int32(0)
        while state[2] > real(0.0) and pieces < _PIECES:
            pieces += 1
            state = piece(constants, temperature, rate, source, state)
        return state[0]

    return straight if is_straight else relaxed


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
