# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A crust: lava radiates from a surface that becomes colder with time since emission.

The temperature of the surface follows from the balance of heat fluxes,

    eps sigma (Ts^4 - Ta^4) + lambda (Ts - Ta) = (T - Ts) / R,

R the resistance of lava that has cooled from above for the column's age t, w = sqrt(kappa t):

    R = [w / C - w^2 / (h (m + 1/2))] / k, C = Gamma(1 + m) / Gamma(1/2 + m).

* For m = 0, R = sqrt(pi) w / k is a half-space whose surface was cold from the start. A real
  surface cools over time: where T - Ts is proportional to t^m, the flux is sqrt(pi) C times as
  large (Duhamel's integral), and m = 1 / (2 (1 + R dq/dTs)), from 1/2 when radiation controls the
  flux to 0 when the crust does, keeps both sides of the balance consistent. Without it the heat
  lost is 14 % too small.
* T is the column's mean. The second term is the heat that the crust itself lacks compared with the
  core, and w stops where R is largest: there the crust has reached the base, and R is that of a
  whole slab, 0.393 h / k for a cold surface (exact 4 / pi^2 = 0.405). The base is insulated.

Compared with one-dimensional conduction in a slab, 1 to 5 m thick, with radiation and convection,
the heat lost is accurate to 2 % at any age (4 % with convection alone), the surface to 8 K (20 K).
"""

from functools import lru_cache
from typing import Any

from lava_ros.effects.effect import Effect, flag
from lava_ros.effects.protocols import Lava
from lava_ros.errors import LavaError

#: Minimum conductivity of a crust [W/(m K)]; lower ones are replaced by it.
MIN_CONDUCTIVITY = 1e-9


def _check(lava: Lava) -> None:
    if lava.crust and not lava.conductivity:
        raise LavaError('lava.conductivity', lava.conductivity, 'above 0 with lava.crust')
    cover = getattr(lava, 'crust_cover', 0.0)
    if lava.crust and cover:
        raise LavaError('lava.crust_cover', cover, '0 with lava.crust')


EFFECT = Effect(
    rank=120,
    title='radiation from a crust',
    symbol='heat lost by a bare surface',
    number=lambda scales: scales.heat_lost,
    threshold=0.01,
    admits='1 % of the temperature or 3 % of the speed',
    speed_error=0.03,
    source='column at rest',
    exists=lambda lava: lava.radiates and lava.crust,
    replaces=('cooling',),
    constants={
        'crust': flag(False, 'Radiate from a crust that is colder the older it is, not the core'),
    },
    check=_check,
    heat={
        # without conductivity the crust passes no heat: a finite value in place of 0 / 0
        'diffusivity': lambda scene: max(scene.lava.conductivity, MIN_CONDUCTIVITY)
        / (scene.lava.density * scene.lava.specific_heat),
    },
    needs_age=True,
    benchmark={'crust': True, 'conductivity': 2.0},
)

#: Newton steps for the surface temperature: it then changes by less than 1e-4 of the flux.
NEWTON_STEPS = 4


@lru_cache
def terms(wp: Any, real: Any, constants_type: Any, column_type: Any) -> Any:
    """Return the device function for s [1/s] and s Ta [K/s]."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def resistance(constants: constants_type, thickness: real, age: real, power: real) -> real:
        """R times rho c [s/m], for a surface that cools as a power of time."""
        # Gamma(1 + m) / Gamma(1/2 + m), to 1e-3 for m from 0 to 1/2
        c = real(0.5642) + power * (real(0.76) - real(0.232) * power)
        shift = thickness * (power + real(0.5))
        diffusivity = real(constants.diffusivity)
        w = wp.min(wp.sqrt(diffusivity * age), real(0.5) * shift / c)
        return (w / c - w * w / shift) / diffusivity

    @wp.func
    def crust(constants: constants_type, column: column_type) -> vec2:
        thickness, temperature, age = (
            column.normal_thickness, column.temperature, column.age
        )
        radiation = real(constants.radiation)
        convection = real(constants.convection)
        ambient = real(constants.ambient)
        fourth = ambient * ambient * ambient * ambient
        r = resistance(constants, thickness, age, real(0.5))
        # start from above: the minimum of the core's temperature and the limit by radiation alone
        excess = wp.max(temperature - ambient, real(0.0))
        hottest = wp.sqrt(wp.sqrt(fourth + excess / wp.max(r * radiation, real(1.0e-30))))
        surface = wp.max(ambient, wp.min(temperature, hottest))
        for _ in range(NEWTON_STEPS):
            cube = surface * surface * surface
            flux = radiation * (cube * surface - fourth) + convection * (surface - ambient)
            steepness = real(4.0) * radiation * cube + convection
            r = resistance(constants, thickness, age, real(0.5) / (real(1.0) + r * steepness))
            surface -= (r * flux + surface - temperature) / (r * steepness + real(1.0))
        # two conductances in series
        square = surface * surface + ambient * ambient
        outer = radiation * square * (surface + ambient) + convection
        rate = outer / ((real(1.0) + outer * r) * thickness)
        return vec2(rate, rate * ambient)

    return crust
