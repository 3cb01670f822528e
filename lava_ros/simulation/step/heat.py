# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0


"""The temperature of a column: the sum of all effects that transport heat.

Each effect contributes -s T + f to the balance, with s >= 0. Two exponential stages (s and f at
the start give the midpoint, those at the midpoint the whole step) are of second order, and stay
between the temperature and the equilibrium f / s for any step.

A loss that depends on a column's age t falls as 1 / sqrt(t). Over a span from t0 to t1 it is
evaluated at the age ((sqrt(t0) + sqrt(t1)) / 2)^2, the midpoint in sqrt(t), which integrates
1 / sqrt(t) exactly, even from an age of 0.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import drop_superseded, Effects
from lava_ros.effects.laws import column_type, heat_type


@lru_cache
def temperature_function(real: Any, effects: Effects) -> Any:
    """Return the device function for the temperature after a step, None if it is constant.

    Its arguments: the constants, thickness [m], temperature [K], age at the start of the step [s],
    drop of the surface under the column along its way [m], its speed [m/s], and the step [s].
    """
    constants_type, column_struct = heat_type(real), column_type(real)
    modules = effects.having('terms')
    names = drop_superseded(modules)
    if not names:
        return None
    balance, *others = (
        modules[name].terms(wp, real, constants_type, column_struct) for name in names
    )
    for other in others:
        balance = _sum(real, balance, other)

    @wp.func
    def relaxation(temperature: real, rate: real, source: real, step: real) -> real:
        """Solve T' = -rate T + source, both constant."""
        x = rate * step
        if x < real(1.0e-6):
            return temperature + step * (source - rate * temperature)
        equilibrium = source / rate
        return equilibrium + (temperature - equilibrium) * wp.exp(-x)

    @wp.func
    def plain(
        constants: constants_type, temperature: real, rate: real, source: real, step: real
    ) -> real:
        return relaxation(temperature, rate, source, step)

    relaxed = effects.function('relaxed', wp, real, constants_type, relaxation) or plain

    @wp.func
    def mean_age(age: real, span: real) -> real:
        """Age at which to evaluate a loss over a span; never 0."""
        root = wp.sqrt(age) + wp.sqrt(age + span)
        return wp.max(real(0.25) * root * root, real(1.0e-9))

    @wp.func
    def temperature_after(
        constants: heat_type(real), thickness: real, temperature: real, age: real, drop: real,
        speed: real, step: real,
    ) -> real:
        if step <= real(0.0):
            return temperature
        half = real(0.5) * step
        column = column_struct()
        column.thickness = thickness
        column.temperature = temperature
        column.age = mean_age(age, half)
        column.drop = drop / step
        column.speed = speed
        start = balance(constants, column)
        column.temperature = relaxed(constants, temperature, start[0], start[1], half)
        column.age = mean_age(age, step)
        half_way = balance(constants, column)
        return relaxed(constants, temperature, half_way[0], half_way[1], step)

    return temperature_after


def _sum(real: Any, first: Any, second: Any) -> Any:
    vec2 = wp.types.vector(2, real)

    @wp.func
    def both(constants: heat_type(real), column: column_type(real)) -> vec2:
        return first(constants, column) + second(constants, column)

    return both
