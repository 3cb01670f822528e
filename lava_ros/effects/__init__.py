# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Registry of effects; each is a file with its declaration, equations and constants.

Each declares ``EFFECT`` (``effect.py``) and defines the functions below that it needs. ``wp`` is
Warp, or its substitute on the host (``laws.HOST``), ``real`` the scalar type, ``law``,
``constants`` and ``column`` the structs of ``laws.py``, ``heat.py`` and ``column.py``:

    viscosity(wp, real, law)                  mu(T)                          laws.py
    stiffening(wp, real, law, viscosity)      mu(T) with suspended solids    laws.py
    strength(wp, real, law, column)           tau_y of a column              laws.py
    speed(wp, real, law, column, viscosity, strength)   u of a column        laws.py
    terms(wp, real, constants, column)        heat gained and lost           heat.py
    relaxed(wp, real, constants, relaxation)  change in a step               heat.py
    warmed(wp, real, constants)               temperature after given heat   step/effects
    cosine(slope), cosine_squared(real), factor(real), along(real, climbs=)   a layer on a slope

An effect that launches kernels of its own, or limits the step, also has a file of the same name
in ``simulation/step/effects``, with a subclass of ``DevicePart``.

To add an effect, add its file and its test; to delete an effect, delete its files.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType, ModuleType
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.effects.effect import Array, Effect, flag, join_names, with_fields
from lava_ros.effects.protocols import Lava, Scene
from lava_ros.errors import LavaError

#: Files in this folder that are not effects.
_OTHERS = ('bingham', 'column', 'effect', 'heat', 'laws', 'protocols', 'scales')


def _read() -> dict[str, ModuleType]:
    names = [item.name for item in iter_modules(__path__) if item.name not in _OTHERS]
    modules = {name: import_module(f'{__name__}.{name}') for name in names}
    return dict(sorted(modules.items(), key=lambda item: item[1].EFFECT.rank))


_MODULES = _read()

#: Declaration of each effect, by name, in the order of their ranks.
EFFECTS: MappingProxyType[str, Effect] = MappingProxyType(
    {name: module.EFFECT for name, module in _MODULES.items()}
)

# checks names that two effects declare; names of lava_ros itself are checked where they are used
for _part in ('constants', 'environment', 'law', 'heat', 'arrays'):
    join_names(_part, EFFECTS)


@dataclass(frozen=True)
@with_fields(lambda _: {name: flag(one.is_default, one.title) for name, one in EFFECTS.items()})
class Effects:
    """Effects that are on, in addition to slope, spreading and viscosity: one bool per effect.

    It is the key of the compiled step: kernels contain only effects that are on. ``'inertia' in
    effects`` is True if an effect is on, and False for names that are not effects.
    """

    if TYPE_CHECKING:

        def __init__(self, **switches: bool) -> None: ...  # noqa: D107

        def __getattr__(self, name: str) -> bool: ...  # noqa: D105

    def __post_init__(self) -> None:
        """Check that all fields are booleans and compatible.

        Raises:
            LavaError: If a field is not true or false, or two effects exclude each other.
        """
        for item in fields(self):
            if not isinstance(getattr(self, item.name), bool):
                raise LavaError(f'effects.{item.name}', getattr(self, item.name), 'true or false')
        for name in self:
            for other, why in EFFECTS[name].excludes.items():
                if other in self:
                    raise LavaError(f'effects.{name}', True, f'false with {other}: {why}')

    def __contains__(self, name: object) -> bool:
        """Return True if an effect is on."""
        return isinstance(name, str) and getattr(self, name, False) is True

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the effects that are on, in the order of their ranks."""
        return iter(self._on)

    @cached_property
    def _on(self) -> tuple[str, ...]:
        return tuple(name for name in EFFECTS if name in self)

    def any(self, what: str) -> bool:
        """Return True if an effect that is on declares an attribute, such as ``needs_age``."""
        return any(getattr(EFFECTS[name], what) for name in self)

    @property
    def arrays(self) -> dict[str, Array]:
        """Arrays that the effects that are on keep on the device, by name."""
        return {key: item for name in self for key, item in EFFECTS[name].arrays.items()}

    def having(self, part: str) -> dict[str, ModuleType]:
        """Return the modules of the effects that are on and define a function, by name."""
        return {name: file for name in self if hasattr(file := load(name), part)}

    def function(self, part: str, *arguments: Any, **options: Any) -> Any:
        """Return what a function of an effect that is on returns, None without such an effect.

        Of several effects the last one counts, which is the most general.
        """
        modules = [*self.having(part).values()]
        return getattr(modules[-1], part)(*arguments, **options) if modules else None


def load(name: str) -> Any:
    """Return the module of an effect."""
    return _MODULES[name]


def excluded_by(one: str, other: str) -> bool:
    """Return True if two effects cannot be on at once."""
    return other in EFFECTS[one].excludes or one in EFFECTS[other].excludes


def compatible(names: Iterable[str]) -> Effects:
    """Return ``Effects`` with the named ones on, of those that exclude each other the first."""
    return _compatible(tuple(names))


@lru_cache(maxsize=64)
def _compatible(names: tuple[str, ...]) -> Effects:
    on = dict.fromkeys(EFFECTS, False)
    for name in names:
        on[name] = not any(on[other] and excluded_by(name, other) for other in on)
    return Effects(**on)


def possible(lava: Lava) -> tuple[str, ...]:
    """Return the names of the effects that a lava has by its constants, relevant or not."""
    return tuple(name for name, item in EFFECTS.items() if item.exists(lava))


def existing(scene: Scene) -> tuple[str, ...]:
    """Return the names of the effects that a scene has and that no other effect replaces."""
    return drop_superseded(
        name for name in possible(scene.lava) if not _missing_around(name, scene)
    )


def reasons_without(scene: Scene) -> dict[str, str]:
    """Return why a scene does not have an effect, or why another one replaces it, by its name."""
    others, found = existing(scene), {}
    for name, effect in EFFECTS.items():
        if name in others:
            continue
        if not effect.exists(scene.lava):
            found[name] = 'the material has none'
        elif missing := _missing_around(name, scene):
            found[name] = ' and '.join(f'{key} is 0' for key in missing)
        else:
            rival = next(other for other in others if name in EFFECTS[other].replaces)
            found[name] = f'{rival} replaces it'
    return found


def _missing_around(name: str, scene: Scene) -> tuple[str, ...]:
    """Return the conditions around the lava of which an effect needs one, if all are 0."""
    around = tuple(EFFECTS[name].environment)
    return () if any(getattr(scene, key) for key in around) else around


def considered(scene: Scene, forced: Mapping[str, bool] = MappingProxyType({})) -> Effects:
    """Return the effects that estimates of a flow include.

    They are those that the scene has, relevant or not, without those that the user has forced off
    and with those forced on. Effects of one kind of flow are included only if forced on.

    Raises:
        LavaError: If a forced effect is unknown.
    """
    validation.keys('effects', forced, allowed=EFFECTS)
    on = [name for name, is_on in forced.items() if is_on]
    general = (name for name in existing(scene) if not EFFECTS[name].kind)
    return compatible([*on, *(name for name in general if forced.get(name, True))])


def drop_superseded(names: Iterable[str]) -> tuple[str, ...]:
    """Return those of the named effects that no other of them replaces."""
    names = tuple(names)
    replaced = {other for name in names for other in EFFECTS[name].replaces}
    return tuple(name for name in names if name not in replaced)
