# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The effects: a file or a folder each, which owns everything of its own, and the registry.

Each declares ``EFFECT`` (``effect.py``) and defines, as far as the effect has such a part, what is
in this list. What needs much of the solver is a folder, whose ``device.py`` is loaded when the
effect is on. ``wp`` is Warp, or what stands for it on the host (``laws.HOST``), ``real`` the
scalar type to compute in, ``law`` and ``constants`` the structs of constants of ``laws.py``:

    viscosity(wp, real, law)                  mu(T)                          laws.py
    stiffening(wp, real, law, viscosity)      mu(T) with more in the lava    laws.py
    strength(wp, real, law)                   tau_y(T)                       laws.py
    speed(wp, real, law, viscosity, strength) u of thickness and slope       laws.py
    terms(wp, real, constants)                heat gained and lost           simulation/heat.py
    relaxed(wp, real, constants, relaxation)  what a step makes of them      simulation/heat.py
    factor(real)                              what scales the mobility       simulation/flow.py
    AfterStep                                 a pass at the step's end       simulation/stage.py

``AfterStep(scene, accuracy, terrain, state)`` has a method ``apply(state, neighbors)``, called
after the motion in every stage: its kernels return at once unless ``counts[IS_LAST]`` is 1, and
the step is ``clock[STEP]``. ``state.ordered`` holds the particles before the motion, and
``state.particle`` the same ones in the same order after it. One with arrays of its own has
``save() -> arrays by name`` and ``load(arrays)`` for checkpoints.

To add an effect is to add its file; to delete one is to delete its file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType, ModuleType
from typing import Any, TYPE_CHECKING

from lava_ros.effects.effect import Array, Effect, flag, join_names, with_fields
from lava_ros.errors import LavaError

if TYPE_CHECKING:
    from lava_ros.scene import Lava, Scene

#: Files in this folder that are no effect.
_OTHERS = ('effect', 'laws', 'scales')


def _read() -> dict[str, ModuleType]:
    names = [item.name for item in iter_modules(__path__) if item.name not in _OTHERS]
    modules = {name: import_module(f'{__name__}.{name}') for name in names}
    return dict(sorted(modules.items(), key=lambda item: item[1].EFFECT.rank))


_MODULES = _read()

#: What each effect declares, by name, in the order of their ranks.
EFFECTS: MappingProxyType[str, Effect] = MappingProxyType(
    {name: module.EFFECT for name, module in _MODULES.items()}
)

# a name that two of them declare is refused here, one of lava_ros itself where it is used
for _part in ('constants', 'environment', 'law', 'heat', 'arrays'):
    join_names(_part, EFFECTS)


@dataclass(frozen=True)
@with_fields(lambda _: {name: flag(one.is_default, one.title) for name, one in EFFECTS.items()})
class Effects:
    """The physics that is on beside slope, spreading and viscosity: a bool for each effect.

    It is the key of the compiled step: what it leaves out is in no kernel. ``'inertia' in
    effects`` says whether an effect is on; one that does not exist is not.
    """

    if TYPE_CHECKING:

        def __init__(self, **switches: bool) -> None: ...  # noqa: D107

        def __getattr__(self, name: str) -> bool: ...  # noqa: D105

    def __post_init__(self) -> None:
        """Refuse anything but booleans.

        Raises:
            LavaError: A field is not true or false, or two do not go together.
        """
        for item in fields(self):
            if not isinstance(getattr(self, item.name), bool):
                raise LavaError(f'effects.{item.name}', getattr(self, item.name), 'true or false')
        for name in self:
            for other, why in EFFECTS[name].excludes.items():
                if other in self:
                    raise LavaError(f'effects.{name}', True, f'false beside {other}: {why}')

    def __contains__(self, name: object) -> bool:
        """Say whether an effect is on."""
        return isinstance(name, str) and getattr(self, name, False) is True

    def __iter__(self) -> Iterator[str]:
        """Names of the effects that are on, in the order of their ranks."""
        return (name for name in EFFECTS if name in self)

    def any(self, what: str) -> bool:
        """Whether one that is on declares something, such as ``needs_age``."""
        return any(getattr(EFFECTS[name], what) for name in self)

    @property
    def arrays(self) -> dict[str, Array]:
        """The arrays that those which are on keep on the device, by name."""
        return {key: item for name in self for key, item in EFFECTS[name].arrays.items()}

    def having(self, part: str) -> dict[str, ModuleType]:
        """The files of the effects that are on which define a part, such as ``terms``, by name."""
        return {name: file for name in self if hasattr(file := load(name), part)}


def load(name: str) -> Any:
    """The file of an effect, of a folder what is for the device."""
    module = _MODULES[name]
    return import_module(f'{module.__name__}.device') if hasattr(module, '__path__') else module


def excluded_by(one: str, other: str) -> bool:
    """Whether two effects cannot be on at once."""
    return other in EFFECTS[one].excludes or one in EFFECTS[other].excludes


def possible(lava: Lava) -> tuple[str, ...]:
    """Names of the effects that a lava has by its constants, whether they matter or not."""
    return tuple(name for name, item in EFFECTS.items() if item.exists(lava))


def existing(scene: Scene) -> tuple[str, ...]:
    """Names of the effects that a scene has by its numbers and whose part no other takes over."""
    return without_replaced(
        name
        for name in possible(scene.lava)
        if not (around := EFFECTS[name].environment) or any(getattr(scene, key) for key in around)
    )


def without_replaced(names: Iterable[str]) -> tuple[str, ...]:
    """The effects of these names whose part no other of them takes over."""
    names = tuple(names)
    replaced = {other for name in names for other in EFFECTS[name].replaces}
    return tuple(name for name in names if name not in replaced)
