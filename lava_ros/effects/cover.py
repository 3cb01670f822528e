# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A crust that covers a part of the surface, which shrinks as the lava flows faster (FLOWGO).

A fraction f = f0 exp(-a u) of the surface is crust at a constant temperature Tc, the rest is as
hot as the column (Harris & Rowland 2001, Bulletin of Volcanology 63, 20-44: f0 = 0.9, a = 0.16 s/m
for poorly insulated flows, f0 = 1, a = 0.00756 s/m for well crusted flows):

    rho c d dT/dt = -f q(Tc) - (1 - f) q(T), q(T) = eps sigma (T^4 - Ta^4) + lambda (T - Ta).

Their convection uses one temperature for the whole surface, a mean to the power of 4/3; here each
part loses its own heat. Lava colder than Tc is as cold as its crust. The crust is renewed as the
lava moves, so its temperature does not depend on age: for lava at rest, ``crust`` is the right
effect.
"""

from functools import lru_cache
from typing import Any

from lava_ros.effects.effect import Effect, number

EFFECT = Effect(
    rank=110,
    title='radiation from a surface that a crust covers in part',
    symbol='heat lost',
    number=lambda scales: scales.heat_lost,
    threshold=0.01,
    admits='1 % of the temperature or 3 % of the speed',
    speed_error=0.03,
    source='column at rest',
    no_case='no closed solution; its test integrates the balance',
    exists=lambda lava: lava.radiates and lava.crust_cover > 0.0,
    excludes={'crust': 'they are one effect'},
    replaces=('cooling',),
    constants={
        'crust_cover': number(
            0.0, 'Fraction of the surface of lava at rest under a crust; 0: no crust', 0.0, 1.0
        ),
        'crust_cover_decay': number(
            0.0, 'Rate at which that fraction falls with the speed of the lava', 0.0, 1e3, 's/m'
        ),
        'crust_temperature': number(
            773.15, 'Temperature of the surface of that crust', 1.0, 5000.0, 'K'
        ),
    },
    heat={
        'cover': lambda scene: scene.lava.crust_cover,
        'cover_decay': lambda scene: scene.lava.crust_cover_decay,
        'crust': lambda scene: scene.lava.crust_temperature,
    },
    is_surface=True,
    needs_speed=True,
)


@lru_cache
def terms(wp: Any, real: Any, constants_type: Any, column_type: Any) -> Any:
    """Return the device function for s [1/s] and s Ta [K/s]."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def transfer(constants: constants_type, surface: real) -> real:
        """Heat loss of a surface over its excess temperature and rho c [m/s]."""
        ambient = real(constants.ambient)
        square = surface * surface + ambient * ambient
        radiation = real(constants.radiation) * square * (surface + ambient)
        return radiation + real(constants.convection)

    @wp.func
    def cover(constants: constants_type, column: column_type) -> vec2:
        ambient, temperature = real(constants.ambient), column.temperature
        covered = real(constants.cover) * wp.exp(-real(constants.cover_decay) * column.speed)
        bare = transfer(constants, temperature)
        crusted = bare
        crust = wp.max(real(constants.crust), ambient)
        if temperature > crust:
            crusted = transfer(constants, crust) * (crust - ambient) / (temperature - ambient)
        rate = (covered * crusted + (real(1.0) - covered) * bare) / column.normal_thickness
        return vec2(rate, rate * ambient)

    return cover
