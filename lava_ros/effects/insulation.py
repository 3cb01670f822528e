# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava that moves under a crust, which thickens with the time since lava reached a place.

The crust stays where it is and lava flows below it, so the age t of the surface is the time since
lava first reached the cell, and new at the front, where lava breaks out. It grows by conduction
(Stefan's problem, Neumann's solution): its thickness is 2 l sqrt(kappa t), as observed on lobes
(Hon et al. 1994, Geological Society of America Bulletin 106, 351-370), with l from

    sqrt(pi) l exp(l^2) erf(l) = (Ts - Ta) / e,   e = T0 - Ts + (L / c) F(T0),

Ts the solidus, Ta the air, T0 the reference temperature and F its melt fraction. The fluid lava
gives the crust rho c e l sqrt(kappa / t), and the surface loses exp(l^2) times as much, because
the crust cools. Radiation and convection outside, h (T - Ta), are in series with the crust (as in
Neri 1998, Journal of Volcanology and Geothermal Research 81, 195-229). With h of the surface's
temperature, Ta + q / h, and R of a cold surface, the heat flux of the surface is

    q = (Ts - Ta) (1 / h^p + R^p)^(-1/p),
    R = (Ts - Ta) sqrt(t) / (rho c e l sqrt(kappa) exp(l^2)).

If h were constant and the crust had no heat capacity, p would be 2. With p = 1.25 the crust of
``etna_basalt`` is as thick as by one-dimensional conduction with all of this, to 4 % after an hour
and later, and 7 % after ten minutes. After 1, 5 and 30 days it is 10, 5 and 1 % thinner than those
that Hon et al. measured. Of q the fluid lava gives 1 / (1 + x (exp(l^2) - 1)), x
the part by which the surface has cooled from Ts to Ta.

The temperature of a column is its heat content: T0 while all of it is fluid, and the solidus when
it is solid. The core stays at T0, as in tubes, where lava cools by about 1 K in a kilometre
(Harris & Rowland 2009, in Studies in Volcanology: The Legacy of George Walker, 233-258), and is
(T - Ts) / (T0 - Ts) of the column. A column moves as fast as its core does below a crust that it
carries, times the core's part of the thickness: the viscosity of the core over that part cubed,
but never more than that of a column of one temperature.

The crust resists only because it does not flow, so ``crust_strength`` is off.
"""

from functools import lru_cache
import math
from typing import Any

from lava_ros.effects.effect import Effect
from lava_ros.effects.protocols import Lava, Scene
from lava_ros.effects.scales import CRUST_CONDUCTIVITY

#: Bisections of the constant l, and its maximum; the last is 1e-12 of the maximum.
_BISECTIONS, _MAX_SIMILARITY = 40, 4.0

#: The power p at which the resistances of the crust and of the air add up.
POWER = 1.25

#: Newton steps for the temperature of the surface: it then changes by less than 1e-3 of the flux.
NEWTON_STEPS = 4

#: Minimum part of the thickness that counts as fluid.
_MIN_CORE = 1e-3


def superheat(lava: Lava) -> float:
    """Return e [K], the heat that fluid lava has above solid lava at the solidus, over rho c."""
    hot, solidus, liquidus = lava.reference_temperature, lava.solidus, lava.liquidus
    melt = min((hot - solidus) / (liquidus - solidus), 1.0)
    return float(hot - solidus + getattr(lava, 'latent_heat', 0.0) / lava.specific_heat * melt)


def similarity(scene: Scene) -> float:
    """Return the constant l of Neumann's solution, by bisection."""
    stefan = (scene.lava.solidus - scene.ambient_temperature) / superheat(scene.lava)
    low, high = 0.0, _MAX_SIMILARITY
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        value = math.sqrt(math.pi) * middle * math.exp(middle**2) * math.erf(middle)
        low, high = (middle, high) if value < stefan else (low, middle)
    return 0.5 * (low + high)


def _resistance(scene: Scene) -> float:
    """Return R rho c / sqrt(t) [s^0.5/m]."""
    lava, constant = scene.lava, similarity(scene)
    conductivity = lava.conductivity or CRUST_CONDUCTIVITY
    growth = constant * math.sqrt(conductivity / (lava.density * lava.specific_heat))
    excess = lava.solidus - scene.ambient_temperature
    if excess <= 0.0:
        # no crust forms in air above the solidus
        return 0.0
    return excess / (superheat(lava) * growth * math.exp(constant**2))


EFFECT = Effect(
    rank=125,
    title='lava that moves under a crust',
    symbol='time to flow over time to form a crust, of tube-fed lava',
    number=lambda scales: scales.age_of_crust,
    threshold=1.0,
    admits='nothing: crusts of other kinds of flow do not stay in place',
    source='simulation/flow_kind.py',
    exists=lambda lava: lava.radiates and 0.0 < lava.solidus < lava.reference_temperature,
    kind='tube-fed',
    excludes={
        'cooling': 'a crust covers the whole surface',
        'cover': 'a crust covers the whole surface',
        'crust': 'they are one effect',
        'crust_strength': 'the crust would resist twice',
    },
    heat={
        'crust_resistance': _resistance,
        'crust_cooling': lambda scene: math.expm1(similarity(scene) ** 2),
    },
    stiffens=True,
    needs_age=True,
    ages_in_place=True,
    benchmark={'solidus': 1100.0},
)


@lru_cache
def stiffening(wp: Any, real: Any, law_type: Any, viscosity: Any) -> Any:
    """Return the device function mu(T) [Pa s] of columns whose core flows under a crust."""

    @wp.func
    def under_crust(law: law_type, temperature: real) -> real:
        mixed = viscosity(law, temperature)
        hot = real(law.reference_temperature)
        core = (temperature - real(law.solidus)) / (hot - real(law.solidus))
        core = wp.clamp(core, real(_MIN_CORE), real(1.0))
        return wp.min(mixed, viscosity(law, hot) / (core * core * core))

    return under_crust


@lru_cache
def terms(wp: Any, real: Any, constants_type: Any, column_type: Any) -> Any:
    """Return the device function for s [1/s] and s Ta [K/s]."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def insulation(constants: constants_type, column: column_type) -> vec2:
        radiation, convection = real(constants.radiation), real(constants.convection)
        ambient, solidus = real(constants.ambient), real(constants.solidus)
        excess = wp.max(solidus - ambient, real(1e-3))
        r = real(constants.crust_resistance) * wp.sqrt(column.age)
        # start from above: the surface of a crust that radiation alone cools
        fourth = ambient * ambient * ambient * ambient
        hottest = wp.sqrt(wp.sqrt(fourth + excess / wp.max(r * radiation, real(1.0e-30))))
        surface = wp.min(solidus, hottest)
        outer = real(0.0)
        for _ in range(NEWTON_STEPS):
            square = surface * surface + ambient * ambient
            outer = radiation * square * (surface + ambient) + convection
            steepness = radiation * (
                real(3.0) * surface * surface + real(2.0) * surface * ambient + ambient * ambient
            )
            ratio = wp.pow(outer * r, real(POWER))
            both = wp.pow(real(1.0) + ratio, real(wp.static(1.0 / POWER)))
            rise = ratio / (real(1.0) + ratio) * steepness / outer
            off = (surface - ambient) * both - excess
            surface -= off / (both * (real(1.0) + (surface - ambient) * rise))
        flux = outer * (surface - ambient)
        # a crust that has cooled gives heat too
        cooled = wp.clamp((solidus - surface) / excess, real(0.0), real(1.0))
        flux /= real(1.0) + real(constants.crust_cooling) * cooled
        above = wp.max(column.temperature - ambient, real(1.0))
        rate = flux / (above * column.normal_thickness)
        return vec2(rate, rate * ambient)

    return insulation
