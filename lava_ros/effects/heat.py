# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The temperature of a column: the sum of all effects that transport heat.

Each effect contributes -s T + f to the balance, with s >= 0. Two exponential stages (s and f at
the start give the midpoint, those at the midpoint the whole step) are of second order, and stay
between the temperature and the equilibrium f / s for any step.

A loss that depends on a column's age t falls as 1 / sqrt(t). Over a span from t0 to t1 it is
evaluated at the age ((sqrt(t0) + sqrt(t1)) / 2)^2, the midpoint in sqrt(t), which integrates
1 / sqrt(t) exactly, even from an age of 0. A new crust first loses the heat of a bare surface, and
then as 1 / sqrt(t): a step longer than the age is divided into ``PIECES``, even in sqrt(t).

The functions return changes of the temperature: in float32 a step that cools lava by less than
6e-5 K would change nothing if it were added to the temperature itself. The state carries the
rounding error of the sum to the next step (``State.temperature_remainder``).
"""

from collections.abc import Callable
from functools import lru_cache, partial, reduce
import math
from types import SimpleNamespace
from typing import Any

from lava_ros.effects import compatible, considered, drop_superseded, EFFECTS, Effects, possible
from lava_ros.effects.column import column_type, structure, summed
from lava_ros.effects.effect import join_names
from lava_ros.effects.laws import filled, HOST
from lava_ros.effects.protocols import Scene

#: Stefan-Boltzmann constant [W/(m2 K4)] (CODATA 2018).
STEFAN_BOLTZMANN = 5.670374419e-8

#: Parts of a step that is longer than the age of the lava.
PIECES = 8

#: Constants of the heat balance of every lava.
_HEAT = ('radiation', 'convection', 'ambient', 'solidus', 'liquidus')

#: Constants that effects add to them, by name.
_MORE_HEAT = join_names('heat', EFFECTS, _HEAT)


def heat_values(scene: Scene, names: tuple[str, ...]) -> dict[str, float]:
    """Return the constants of the heat balance with the named effects on, by name.

    ``radiation`` is eps sigma / (rho c), ``convection`` lambda / (rho c), ``ambient`` Ta [K];
    effects document their own constants.
    """
    lava = scene.lava
    capacity = lava.density * lava.specific_heat
    values = {
        'radiation': lava.emissivity * STEFAN_BOLTZMANN / capacity,
        'convection': lava.convection / capacity,
        'ambient': scene.ambient_temperature,
        'solidus': lava.solidus,
        'liquidus': lava.liquidus,
    }
    for name, effect in EFFECTS.items():
        for key, value in effect.heat.items():
            values[key] = values.get(key, 0.0) + (value(scene) if name in names else 0.0)
    return values


@lru_cache
def heat_type(real: Any) -> Any:
    """Return the type of the constants of the heat balance."""
    names = tuple(dict.fromkeys((*_HEAT, *_MORE_HEAT)))
    return SimpleNamespace if real is float else structure('HeatConstants', names, real)


def heat_of(scene: Scene, effects: Effects, real: Any) -> Any:
    """Return the constants of the heat balance for the device, or for the host (``float``)."""
    return filled(heat_type(real)(), heat_values(scene, tuple(effects)))


@lru_cache
def warming_function(wp: Any, real: Any, effects: Effects, *, is_straight: bool = False) -> Any:
    """Return the function for the change of temperature in a step [K], None if there is none.

    Its arguments: the constants, the column with its drop and speed during the step, its
    temperature [K] and age [s] at the start of the step, and the step [s]. If ``is_straight``, it
    has no loop, so that a CPU vectorises loops over columns; no step may be longer than the age if
    a loss depends on it.
    """
    constants_type, column_struct = heat_type(real), column_type(real)
    modules = effects.having('terms')
    names = drop_superseded(modules)
    needs_age = any(EFFECTS[name].needs_age for name in names)
    if not names:
        return None
    types = constants_type, column_struct
    terms_of = (modules[name].terms(wp, real, *types) for name in names)
    balance = reduce(partial(summed, wp, wp.types.vector(2, real), *types), terms_of)

    @wp.func
    def relaxation(temperature: real, rate: real, source: real, step: real) -> real:
        """Return the change of T by T' = -rate T + source, both constant."""
        x = rate * step
        pace = source - rate * temperature
        if x < real(1.0e-2):
            # (1 - exp(-x)) / x to 1e-10, without an exponential
            mean = real(1.0) - x / real(2.0) * (
                real(1.0) - x / real(3.0) * (real(1.0) - x / real(4.0))
            )
            return step * mean * pace
        return pace / rate * (real(1.0) - wp.exp(-x))

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
    def straight(
        constants: constants_type, column: column_struct, temperature: real, age: real, step: real
    ) -> real:
        column.temperature = temperature
        half = real(0.5) * step
        if wp.static(needs_age):
            column.age = mean_age(age, half)
        terms = balance(constants, column)
        column.temperature += relaxed(constants, temperature, terms[0], terms[1], half)
        if wp.static(needs_age):
            column.age = mean_age(age, step)
        terms = balance(constants, column)
        return relaxed(constants, temperature, terms[0], terms[1], step)

    if is_straight:
        return straight

    @wp.func
    def warming(
        constants: constants_type, column: column_struct, temperature: real, age: real, step: real
    ) -> real:
        total = real(0.0)
        root = real(0.0)
        width = real(0.0)
        part = step
        begun = age
        stages = wp.int32(2)
        if step <= real(0.0):
            stages = 0
        if wp.static(needs_age):  # noqa: SIM102, the static test decides what is compiled
            if age < step:
                stages *= PIECES
                root = wp.sqrt(age)
                width = (wp.sqrt(age + step) - root) * real(wp.static(1.0 / PIECES))
        # a loop over all stages: a law that is called at one place is compiled into the loop
        for stage in range(stages):
            span = part
            if stage % 2 == 0:
                column.temperature = temperature + total
                if width > real(0.0):
                    # the difference of the squares of root + width and root
                    begun = root * root
                    part = width * (root + root + width)
                    root += width
                span = real(0.5) * part
            if wp.static(needs_age):
                column.age = mean_age(begun, span)
            terms = balance(constants, column)
            change = relaxed(constants, temperature + total, terms[0], terms[1], span)
            if stage % 2 == 0:
                column.temperature += change
            else:
                total += change
        return total

    return warming


def host_temperature(scene: Scene, effects: Effects) -> Callable[..., float]:
    """Return the host's function for the temperature [K] of a column after a step.

    Its arguments are keywords: ``temperature`` [K] and ``age`` [s] at the start of the step, the
    attributes of the column that the terms of effects read (``column.ATTRIBUTES``), ``step`` [s].
    """
    warming, values = warming_function(HOST, float, effects), heat_of(scene, effects, float)

    def temperature_after(
        *, temperature: float, age: float, step: float, **column: float
    ) -> float:
        if warming is None:
            return temperature
        change = warming(values, SimpleNamespace(**column), temperature, age, step)
        return float(temperature + change)

    return temperature_after


def heat_loss(scene: Scene, effects: Effects | None = None) -> Callable[[float], float]:
    """Return the heat flux [W/m2] from bare lava at rest to the air, by temperature [K].

    ``effects`` are those of the scene, by default all that it has. Of an effect that depends on
    age, the effect that it replaces or excludes counts.
    """
    effects = considered(scene) if effects is None else effects
    others = (o for n in effects for o in (*EFFECTS[n].replaces, *EFFECTS[n].excludes))
    names = {*effects, *set(others).intersection(possible(scene.lava))}
    surfaces = compatible(drop_superseded(n for n in names if EFFECTS[n].is_surface))
    values = heat_of(scene, surfaces, float)
    types = heat_type(float), column_type(float)
    terms = [one.terms(HOST, float, *types) for one in surfaces.having('terms').values()]
    capacity = scene.lava.density * scene.lava.specific_heat

    def loss(temperature: float) -> float:
        column = SimpleNamespace(
            normal_thickness=1.0, temperature=temperature, age=math.inf, drop=0.0, speed=0.0
        )
        found = (one(values, column) for one in terms)
        return float(sum(capacity * (rate * temperature - source) for rate, source in found))

    return loss
