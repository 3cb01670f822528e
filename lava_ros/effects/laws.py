# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Laws of flow, from the effects' files, for the device and the host.

Each law is written once. On the host, Python runs the same lines, with ``HOST`` in place of Warp
and ``float`` in place of its scalars.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial, reduce
import math
from types import SimpleNamespace
from typing import Any

from lava_ros.effects import compatible, drop_superseded, EFFECTS, Effects, possible
from lava_ros.effects.column import column_type, structure, summed
from lava_ros.effects.effect import join_names
from lava_ros.effects.protocols import Lava

#: Drag of the bed over lateral stress, (k h)^2, for the profile f(z) = 3 z/h - 1.5 (z/h)^2: the
#: means of (h df/dz)^2 and of f^2 are 3 and 6/5. It is the limit of Stokes flow for long waves
#: across the flow (docs/MODEL.md derives it; the method's authors use it too, SCA 2024).
LATERAL_DRAG = 2.5

#: Factor by which the sweeps that solve for it reduce the error of the local velocity, and their
#: maximum number; beyond that they reduce the error less.
REDUCTION, MAX_SWEEPS = 1e-4, 1024

#: Constants of the laws of flow of every lava.
_FLOW = ('viscosity', 'reference_temperature', 'liquidus', 'solidus')

#: Constants that effects add to them, by name.
_MORE_FLOW = join_names('law', EFFECTS, _FLOW)


class _Vector(tuple[float, ...]):
    """A vector of Warp on the host, as far as laws use it."""

    def __add__(self, other: Any) -> '_Vector':
        return _Vector(one + two for one, two in zip(self, other, strict=True))

    def __mul__(self, factor: Any) -> '_Vector':
        return _Vector(factor * one for one in self)

    __rmul__ = __mul__


class _Host:
    """Python implementation of the parts of Warp that laws use."""

    exp, log, sqrt, pow = math.exp, math.log, math.sqrt, math.pow
    min, max, float64, int32 = min, max, float, int
    types = SimpleNamespace(
        vector=lambda length, real: lambda *items: _Vector(items or (0.0,) * length)
    )
    func = staticmethod(lambda function: function)
    clamp = staticmethod(lambda value, lower, upper: min(max(value, lower), upper))
    static = staticmethod(lambda value: value)


HOST = _Host()


def law_values(lava: Lava) -> dict[str, float]:
    """Return the constants of the laws of flow, by name."""
    values: dict[str, float] = {name: getattr(lava, name) for name in _FLOW}
    return values | {name: value(lava) for name, value in _MORE_FLOW.items()}


@lru_cache
def law_type(real: Any) -> Any:
    """Return the type of the constants of the laws of flow."""
    names = (*_FLOW, *_MORE_FLOW)
    return SimpleNamespace if real is float else structure('Rheology', names, real)


def law_of(lava: Lava, real: Any) -> Any:
    """Return the constants of the laws of flow for the device, or for the host (``float``)."""
    return filled(law_type(real)(), law_values(lava))


@lru_cache
def viscosity_function(wp: Any, real: Any, effects: Effects) -> Any:
    """Return the function mu(T) [Pa s]: an effect's law, or a constant; with crystals."""
    law = law_type(real)

    @wp.func
    def constant(law: law, temperature: real) -> real:
        return real(law.viscosity)

    viscosity = effects.function('viscosity', wp, real, law) or constant
    for module in effects.having('stiffening').values():
        viscosity = module.stiffening(wp, real, law, viscosity)
    return viscosity


@lru_cache
def strength_function(wp: Any, real: Any, effects: Effects) -> Any:
    """Return the function of a column's total yield strength [Pa]; None if lava has none."""
    types = law_type(real), column_type(real)
    parts = [one.strength(wp, real, *types) for one in effects.having('strength').values()]
    return reduce(partial(summed, wp, real, *types), parts) if parts else None


@lru_cache
def speed_function(wp: Any, real: Any, effects: Effects) -> Any:
    """Return the speed function of lava whose speed is not proportional to the slope.

    From rho g and a column it returns the mobility u / s and a bound of u / s and du/ds [m/s]:
    times the thickness they are diffusivities across and along the slope.
    None if lava is Newtonian: both are then rho g d^2 / (3 mu).
    """
    viscosity = viscosity_function(wp, real, effects)
    strength = strength_function(wp, real, effects)
    types = law_type(real), column_type(real)
    return effects.function('speed', wp, real, *types, viscosity, strength)


@dataclass(frozen=True)
class Rheology:
    """The laws of flow of a lava on the host, with some effects on."""

    lava: Lava
    effects: Effects

    def viscosity_at(self, temperature: float) -> float:
        """Return the viscosity [Pa s] at a temperature [K], including crystals."""
        values, viscosity, _ = _on_host(self)
        return float(viscosity(values, temperature))

    def strength_at(self, temperature: float, thickness: float = 1.0, age: float = 0.0) -> float:
        """Return the yield strength [Pa] of a column.

        Args:
            temperature: Temperature [K].
            thickness: Thickness across the flow [m].
            age: Age [s]; at 0 no crust has grown.
        """
        values, _, strength = _on_host(self)
        if strength is None:
            return 0.0
        column = SimpleNamespace(temperature=temperature, normal_thickness=thickness, age=age)
        return float(strength(values, column))


@lru_cache
def _on_host(laws: Rheology) -> tuple[Any, Callable[..., float], Callable[..., float] | None]:
    """Return the constants, mu(T) and the yield strength of a lava."""
    functions = (
        one(HOST, float, laws.effects) for one in (viscosity_function, strength_function)
    )
    return law_of(laws.lava, float), *functions


@lru_cache
def rheology_of(lava: Lava) -> Rheology:
    """Return the laws of flow of a lava with all effects that its constants call for."""
    laws = drop_superseded(name for name in possible(lava) if EFFECTS[name].law)
    return Rheology(lava, compatible(laws))


def filled(target: Any, values: dict[str, float]) -> Any:
    """Set attributes of an object, and return it."""
    for name, value in values.items():
        setattr(target, name, value)
    return target
