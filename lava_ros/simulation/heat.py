# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.


"""The temperature of a column: what every effect that moves heat adds up to.

Each effect's part of the balance is -s T + f, with s >= 0. Two exponential stages (s and f at the
start give the midpoint, those at the midpoint the whole step) are of second order, and stay
between the temperature and the equilibrium f / s for any step.

A loss that depends on a column's age t falls as 1 / sqrt(t). Over a span from t0 to t1 it is taken
at the age ((sqrt(t0) + sqrt(t1)) / 2)^2, the midpoint in sqrt(t): that integrates 1 / sqrt(t)
exactly, from an age of 0 too.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.lava import STEFAN_BOLTZMANN
from lava_ros.scene import Scene
from lava_ros.simulation.effects import load

#: Effects that are part of the balance; a crust loses what ``cooling`` would, from its surface.
HEAT_EFFECTS = ('cooling', 'crust', 'ground', 'viscous_heating')


@lru_cache
def heat_constants_of(real: Any) -> Any:
    """Constants of the heat balance.

    ``radiation`` is eps sigma / (rho c), ``convection`` lambda / (rho c), ``ambient`` Ta [K],
    ``diffusivity`` that of lava [m2/s], ``contact`` kg / (rho c sqrt(a)) with the ground's
    diffusivity a [m/s^0.5], ``fall`` g / c [K/m], ``latent`` L / c [K], ``solidus`` and
    ``liquidus`` [K].
    """

    @wp.struct
    class HeatConstants:
        radiation: real
        convection: real
        ambient: real
        diffusivity: real
        contact: real
        fall: real
        latent: real
        solidus: real
        liquidus: real

    return HeatConstants


#: Steps in which lava freezes at the soonest: a column freezes at the end of a step, on average
#: half a step late, and goes as much too far.
_FREEZING_STEPS = 16

#: What lava is taken to be above its solidus at least [K]: what is nearer freezes at its vent.
_LEAST_ABOVE = 10.0


def freezing_step(scene: Scene, thickness: float) -> float:
    """Longest step that resolves how lava of a thickness [m] freezes after it has come out [s]."""
    constants = heat_constants(scene)
    soonest = math.inf
    for vent in scene.vents:
        hot, air = vent.temperature, constants.ambient
        rate = constants.radiation * (hot**4 - air**4) + constants.convection * (hot - air)
        if rate > 0.0 and hot > constants.solidus:
            above = max(hot - constants.solidus, _LEAST_ABOVE)
            soonest = min(soonest, thickness * above / rate)
    return soonest / _FREEZING_STEPS


def heat_constants(scene: Scene, real: Any = wp.float64) -> Any:
    """Collect the constants from a scene."""
    lava = scene.lava
    capacity = lava.density * lava.specific_heat
    constants = heat_constants_of(real)()
    constants.radiation = lava.emissivity * STEFAN_BOLTZMANN / capacity
    constants.convection = lava.convection / capacity
    constants.ambient = scene.ambient_temperature
    constants.diffusivity = lava.conductivity / capacity
    constants.contact = lava.ground_conductivity / (
        capacity * math.sqrt(lava.ground_diffusivity)
    )
    constants.fall = scene.gravity / lava.specific_heat
    constants.latent = lava.latent_heat / lava.specific_heat
    constants.solidus = lava.solidus
    constants.liquidus = lava.liquidus
    return constants


@lru_cache
def temperature_function(real: Any, effects: Effects) -> Any:
    """Return the device function that gives the temperature after a step.

    Its arguments: the constants, thickness [m], temperature [K], age at the start of the step [s],
    height that the surface under the column has fallen by along its way [m], and the step [s].

    None when no effect moves heat: temperatures then stay.
    """
    names = [name for name in HEAT_EFFECTS if getattr(effects, name)]
    if effects.crust and effects.cooling:
        names.remove('cooling')
    if not names:
        return None
    balance = load(names[0]).terms(real)
    for name in names[1:]:
        balance = _sum(real, balance, load(name).terms(real))
    relaxed = load('latent_heat').relaxed(real) if effects.latent_heat else _relaxed(real)

    @wp.func
    def mean_age(age: real, span: real) -> real:
        """Age at which to take a loss over a span; never 0."""
        root = wp.sqrt(age) + wp.sqrt(age + span)
        return wp.max(real(0.25) * root * root, real(1.0e-9))

    @wp.func
    def temperature_after(
        constants: heat_constants_of(real),
        thickness: real,
        temperature: real,
        age: real,
        drop: real,
        step: real,
    ) -> real:
        if step <= real(0.0):
            return temperature
        rate = drop / step
        half = real(0.5) * step
        start = balance(constants, thickness, temperature, mean_age(age, half), rate)
        middle = relaxed(constants, temperature, start[0], start[1], half)
        half_way = balance(constants, thickness, middle, mean_age(age, step), rate)
        return relaxed(constants, temperature, half_way[0], half_way[1], step)

    return temperature_after


def _sum(real: Any, first: Any, second: Any) -> Any:
    vec2 = wp.types.vector(2, real)

    @wp.func
    def both(
        constants: heat_constants_of(real),
        thickness: real,
        temperature: real,
        age: real,
        drop: real,
    ) -> vec2:
        return first(constants, thickness, temperature, age, drop) + second(
            constants, thickness, temperature, age, drop
        )

    return both


@lru_cache
def _relaxed(real: Any) -> Any:
    relaxation = relaxation_function(real)

    @wp.func
    def relaxed(
        constants: heat_constants_of(real), temperature: real, rate: real, source: real, step: real
    ) -> real:
        return relaxation(temperature, rate, source, step)

    return relaxed


@lru_cache
def relaxation_function(real: Any) -> Any:
    """Return the device function that solves T' = -rate T + source, both constant."""

    @wp.func
    def relaxation(temperature: real, rate: real, source: real, step: real) -> real:
        x = rate * step
        if x < real(1.0e-6):
            return temperature + step * (source - rate * temperature)
        equilibrium = source / rate
        return equilibrium + (temperature - equilibrium) * wp.exp(-x)

    return relaxation
