# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What the file of an effect declares: constants, the number that decides, arrays, exclusions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.errors import LavaError

if TYPE_CHECKING:
    import numpy as np

    from lava_ros.effects.scales import Scales
    from lava_ros.scene import Lava, Scene


def number(default: float | None, text: str, least: float, most: float, unit: str = '') -> Any:
    """A field that is a number within limits, or its default of None."""
    return field(
        default=default, metadata={'text': text, 'limits': (least, most), 'unit': unit}
    )


def choice(default: str, text: str, choices: Iterable[str]) -> Any:
    """A field that is one of some texts."""
    choices = tuple(choices)
    metadata = {'text': f'{text}: {", ".join(choices)}', 'choices': choices}
    return field(default=default, metadata=metadata)


def flag(default: bool, text: str) -> Any:
    """A field that is true or false."""
    return field(default=default, metadata={'text': text})


def check_fields(label: str, item: Any) -> None:
    """Validate the fields of a dataclass that ``number``, ``choice`` and ``flag`` describe.

    Args:
        label: What messages call the whole.
        item: The dataclass; its numbers become floats.

    Raises:
        LavaError: A field is not usable.
    """
    for one in fields(item):
        name, value = f'{label}.{one.name}', getattr(item, one.name)
        if value is None and one.default is None:
            continue
        if 'limits' in one.metadata:
            least, most = one.metadata['limits']
            value = validation.number(
                name, value, at_least=least, at_most=most, unit=one.metadata['unit']
            )
            object.__setattr__(item, one.name, value)
        elif 'choices' in one.metadata:
            validation.choice(name, value, one.metadata['choices'])
        elif 'text' in one.metadata:
            validation.flag(name, value)


def with_fields(
    more: Callable[[Iterable[str]], Mapping[str, Any]]
) -> Callable[[type], type]:
    """Return a decorator that gives a class more fields before it becomes a dataclass.

    Args:
        more: Returns the fields by name, given the names that the class has.
    """

    def extended(kind: type) -> type:
        for name, value in more(tuple(kind.__annotations__)).items():
            kind.__annotations__[name] = type(value.default)
            setattr(kind, name, value)
        return kind

    return extended


def join_names(
    part: str, effects: Mapping[str, Effect], core: Iterable[str] = ()
) -> dict[str, Any]:
    """Join what effects declare as a part of theirs.

    Args:
        part: An attribute of ``Effect`` that is a mapping, such as ``law``.
        effects: The effects, by name.
        core: Names that are there without any effect.

    Returns:
        What each name stands for, by name.

    Raises:
        LavaError: A name is there already, and the effect does not state that it adds to it.
    """
    owners = dict.fromkeys(core, 'lava_ros itself')
    joined: dict[str, Any] = {}
    for name, effect in effects.items():
        for key, item in getattr(effect, part).items():
            if key in owners and key not in effect.adds_to:
                right = f'a name that {owners[key]} does not declare'
                raise LavaError(f'effects.{name}.{part}', key, right)
            owners.setdefault(key, f'effects.{name}')
            joined[key] = item
    return joined


def footprint_change(speed: float) -> float:
    """Return the largest fraction of a footprint that a change of the speed by a fraction changes.

    Down a valley whose sides rise evenly lava is as long as the root of its mobility k and as wide
    as k^(-1/4): one footprint is longer by a half of the fraction, the other is wider by a
    quarter. On a plane, and between walls, it is less (docs/MODEL.md).
    """
    return 0.75 * speed


@dataclass(frozen=True)
class Array:
    """An array that an effect keeps on the device.

    Attributes:
        dtype: ``real``, ``vec2`` or ``vec4`` of the state's precision, ``int32`` or ``float64``.
        count: Items, None for one of each particle.
        is_carried: Whether particles take it along from step to step.
        is_total: Whether it is a sum that goes on when effects are chosen anew.
        is_saved: Whether a checkpoint has it; what is carried and totals always are in it.
    """

    dtype: str
    count: int | None = None
    is_carried: bool = False
    is_total: bool = False
    is_saved: bool = False


@dataclass(frozen=True, kw_only=True)
class Effect:
    """An effect, as its file declares it; the equations are in the file itself.

    Attributes:
        rank: Where it stands among the others: in tables, in sums and in passes.
        title: What it is, in a few words.
        symbol: The number that decides, as a formula.
        number: Computes it for each column of lava, or for all of them; above ``threshold`` the
            effect is on. None: only when asked for.
        fraction: Fraction of the lava's volume whose number decides: that fraction has no larger
            one.
        needs_extent: Whether the number says nothing of lava that has not left its vent yet.
        threshold: Where the effect begins to matter; infinite if it is only on when asked for.
        admits: What leaving the effect out costs where the number is at the threshold.
        cost: The same as the largest fraction of the footprint that changes, the cells that lava
            covers with or without the effect, not both. It is proportional to the number.
        source: Where threshold and cost are from.
        exists: Whether a lava has such a thing at all. One with an ``environment`` needs a number
            of it that is not 0 besides.
        is_default: Whether ``Effects()`` has it.
        constants: Fields of ``Lava`` that are its own, by name.
        environment: Fields of ``Scene`` that are its own, by name.
        check: Refuses constants that do not go together.
        excludes: Effects beside which it cannot be on, and why, by name.
        replaces: Effects whose part it takes over.
        law: What the laws of flow need on the device beside the constants of all lavas, by name.
        heat: What the heat balance needs on the device, by name.
        adds_to: Names in ``heat`` that others declare too; their values are added up.
        is_surface: Whether its heat goes from a bare surface to the air at any age.
        stiffens: Whether it makes the speed of lava depend on its temperature.
        needs_age: Whether its terms depend on the age of a column.
        needs_speed: Whether they depend on its speed.
        arrays: What it keeps on the device, by name.
        leaves_empty: Whether particles lose all their volume to it, and are dropped then.
        benchmark: Constants of lava, or of the scene, with which it matters, by name.
    """

    rank: int
    title: str
    symbol: str = ''
    number: Callable[[Scales], np.ndarray | float] | None = None
    fraction: float = 0.9
    needs_extent: bool = False
    threshold: float = 0.0
    admits: str = ''
    cost: float = 0.0
    source: str = ''
    exists: Callable[[Lava], bool] = lambda lava: True
    is_default: bool = False
    constants: Mapping[str, Any] = field(default_factory=dict)
    environment: Mapping[str, Any] = field(default_factory=dict)
    check: Callable[[Lava], None] = lambda lava: None
    excludes: Mapping[str, str] = field(default_factory=dict)
    replaces: tuple[str, ...] = ()
    law: Mapping[str, Callable[[Lava], float]] = field(default_factory=dict)
    heat: Mapping[str, Callable[[Scene], float]] = field(default_factory=dict)
    adds_to: tuple[str, ...] = ()
    is_surface: bool = False
    stiffens: bool = False
    needs_age: bool = False
    needs_speed: bool = False
    arrays: Mapping[str, Array] = field(default_factory=dict)
    leaves_empty: bool = False
    benchmark: Mapping[str, Any] = field(default_factory=dict)
