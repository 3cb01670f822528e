# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Laws of flow and of heat loss, from the effects' files, for the device and the host.

Each law is written once. On the host, Python runs the same lines, with ``HOST`` in place of Warp
and floats in place of its scalars.
"""

from collections.abc import Callable
from functools import lru_cache
import math
from types import SimpleNamespace
from typing import Any

from lava_ros.effects import compatible, drop_superseded, EFFECTS, Effects, existing, possible
from lava_ros.effects.effect import join_names
from lava_ros.effects.protocols import Lava, Scene

#: Stefan-Boltzmann constant [W/(m2 K4)] (CODATA 2018).
STEFAN_BOLTZMANN = 5.670374419e-8

#: Drag of the bed over lateral stress, (k h)^2, for the profile f(z) = 3 z/h - 1.5 (z/h)^2: the
#: means of (h df/dz)^2 and of f^2 are 3 and 6/5. It is the limit of Stokes flow for long waves
#: across the flow (docs/MODEL.md derives it; the method's authors use it too, SCA 2024).
LATERAL_DRAG = 2.5

#: Constants of the laws of flow of every lava, and of its heat balance.
_FLOW = ('viscosity', 'reference_temperature', 'liquidus', 'solidus')
_HEAT = ('radiation', 'convection', 'ambient', 'solidus', 'liquidus')

#: Constants that effects add to them, by name.
_MORE_FLOW = join_names('law', EFFECTS, _FLOW)
_MORE_HEAT = join_names('heat', EFFECTS, _HEAT)


class _Host:
    """Python implementation of the parts of Warp that laws use."""

    exp, log, sqrt, pow = math.exp, math.log, math.sqrt, math.pow
    min, max, float64 = min, max, float
    types = SimpleNamespace(vector=lambda length, real: lambda *items: items or (0.0,) * length)
    func = staticmethod(lambda function: function)
    clamp = staticmethod(lambda value, least, most: min(max(value, least), most))
    static = staticmethod(lambda value: value)


HOST = _Host()


@lru_cache
def structure(name: str, names: tuple[str, ...], real: Any) -> Any:
    """Return a Warp struct of scalars of these names."""
    import warp as wp

    body = {'__annotations__': dict.fromkeys(names, real), '__module__': __name__}
    return wp.struct(type(name, (), body))


def law_values(lava: Lava) -> dict[str, float]:
    """Return the constants of the laws of flow, by name."""
    values: dict[str, float] = {name: getattr(lava, name) for name in _FLOW}
    return values | {name: value(lava) for name, value in _MORE_FLOW.items()}


@lru_cache
def law_type(real: Any) -> Any:
    """Return the struct of the constants of the laws of flow."""
    return structure('Rheology', (*_FLOW, *_MORE_FLOW), real)


def law_of(lava: Lava, real: Any) -> Any:
    """Return the struct of the constants of the laws of flow for the device."""
    return _filled(law_type(real)(), law_values(lava))


@lru_cache
def viscosity_function(wp: Any, real: Any, law_type: Any, effects: Effects) -> Any:
    """Return the function mu(T) [Pa s]: an effect's law, or a constant; with crystals."""

    @wp.func
    def constant(law: law_type, temperature: real) -> real:
        return real(law.viscosity)

    viscosity = effects.function('viscosity', wp, real, law_type) or constant
    for module in effects.having('stiffening').values():
        viscosity = module.stiffening(wp, real, law_type, viscosity)
    return viscosity


@lru_cache
def _strength_function(wp: Any, real: Any, law_type: Any, effects: Effects) -> Any:
    """Return the function of the total yield strength [Pa]; None if lava has none."""
    strength = None
    for module in effects.having('strength').values():
        one = module.strength(wp, real, law_type)
        strength = one if strength is None else _sum_of(wp, real, law_type, strength, one)
    return strength


def _sum_of(wp: Any, real: Any, law_type: Any, one: Any, other: Any) -> Any:
    @wp.func
    def both(law: law_type, temperature: real, depth: real, age: real) -> real:
        return one(law, temperature, depth, age) + other(law, temperature, depth, age)

    return both


@lru_cache
def speed_function(wp: Any, real: Any, law_type: Any, effects: Effects) -> Any:
    """Return the speed function of lava whose speed is not proportional to the slope.

    From rho g, thickness, slope s, temperature and age it returns the mobility u / s and a bound
    of u / s and du/ds [m/s]: times the thickness they are diffusivities across and along the
    slope.
    None if lava is Newtonian: both are then rho g h^2 / (3 mu).
    """
    viscosity = viscosity_function(wp, real, law_type, effects)
    strength = _strength_function(wp, real, law_type, effects)
    return effects.function('speed', wp, real, law_type, viscosity, strength)


@lru_cache
def _on_host(lava: Lava) -> tuple[Any, Any, Any]:
    """Return the constants, mu(T) and the yield strength of a lava."""
    laws = drop_superseded(name for name in possible(lava) if EFFECTS[name].law)
    effects = compatible(laws)
    functions = (
        one(HOST, float, object, effects) for one in (viscosity_function, _strength_function)
    )
    return SimpleNamespace(**law_values(lava)), *functions


def viscosity_at(lava: Lava, temperature: float) -> float:
    """Return the viscosity [Pa s] at a temperature [K], including crystals."""
    values, viscosity, _ = _on_host(lava)
    return float(viscosity(values, temperature))


def strength_at(lava: Lava, temperature: float) -> float:
    """Return the yield strength [Pa] at a temperature [K], before a crust has grown."""
    values, _, strength = _on_host(lava)
    return 0.0 if strength is None else float(strength(values, temperature, 1.0, 0.0))


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
    """Return the struct of the constants of the heat balance."""
    return structure('HeatConstants', tuple(dict.fromkeys((*_HEAT, *_MORE_HEAT))), real)


@lru_cache
def column_type(real: Any) -> Any:
    """Return the struct of the inputs of a term of the heat balance.

    Thickness [m], temperature [K], age [s], height that the column falls [m/s], speed [m/s].
    """
    return structure('Column', ('thickness', 'temperature', 'age', 'drop', 'speed'), real)


def heat_of(scene: Scene, effects: Effects, real: Any) -> Any:
    """Return the struct of the constants of the heat balance for the device."""
    return _filled(heat_type(real)(), heat_values(scene, tuple(effects)))


def heat_balance(scene: Scene) -> Callable[[float, float, float, float], tuple[float, float]]:
    """Return the heat balance of a column on the host, with every effect that the scene has.

    Returns:
        Function of thickness [m], temperature [K], age [s] and speed [m/s] that returns s [1/s]
        and f [K/s] of dT/dt = f - s T.
    """
    terms = _heat_terms(scene, compatible(existing(scene)))

    def balance(
        thickness: float, temperature: float, age: float, speed: float
    ) -> tuple[float, float]:
        found = terms(thickness, temperature, age, speed)
        return sum(rate for rate, _ in found), sum(source for _, source in found)

    return balance


def heat_loss(scene: Scene) -> Callable[[float], float]:
    """Return the heat flux [W/m2] from bare lava at rest to the air, by temperature [K]."""
    surfaces = drop_superseded(name for name in possible(scene.lava) if EFFECTS[name].is_surface)
    terms = _heat_terms(scene, compatible(surfaces))
    capacity = scene.lava.density * scene.lava.specific_heat

    def loss(temperature: float) -> float:
        balances = terms(1.0, temperature, math.inf, 0.0)
        return float(sum(capacity * (rate * temperature - source) for rate, source in balances))

    return loss


def _heat_terms(
    scene: Scene, effects: Effects
) -> Callable[[float, float, float, float], list[tuple[float, float]]]:
    """Return the terms of each effect by thickness [m], temperature [K], age [s], speed [m/s]."""
    values = SimpleNamespace(**heat_values(scene, tuple(effects)))
    every = [one.terms(HOST, float, object, object) for one in effects.having('terms').values()]

    def terms(
        thickness: float, temperature: float, age: float, speed: float
    ) -> list[tuple[float, float]]:
        column = SimpleNamespace(
            thickness=thickness, temperature=temperature, age=age, drop=0.0, speed=speed
        )
        return [one(values, column) for one in every]

    return terms


def _filled(target: Any, values: dict[str, float]) -> Any:
    for name, value in values.items():
        setattr(target, name, value)
    return target
