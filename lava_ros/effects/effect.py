# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Declaration of an effect: constants, dimensionless number, arrays, exclusions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from lava_ros import validation
from lava_ros.effects.protocols import Lava, Scene
from lava_ros.effects.scales import footprint_change, Scales, thickness_change
from lava_ros.errors import LavaError


def number(default: float | None, text: str, lower: float, upper: float, unit: str = '') -> Any:
    """Return a dataclass field that is a number within limits, or its default of None."""
    return field(default=default, metadata={'text': text, 'limits': (lower, upper), 'unit': unit})


def choice(default: str, text: str, choices: Iterable[str]) -> Any:
    """Return a dataclass field that is one of several strings."""
    choices = tuple(choices)
    metadata = {'text': f'{text}: {", ".join(choices)}', 'choices': choices}
    return field(default=default, metadata=metadata)


def flag(default: bool, text: str) -> Any:
    """Return a dataclass field that is true or false."""
    return field(default=default, metadata={'text': text})


def check_fields(label: str, item: Any) -> None:
    """Validate the fields of a dataclass that ``number``, ``choice`` and ``flag`` describe.

    Args:
        label: Name of the dataclass in messages.
        item: The dataclass; its numbers become floats.

    Raises:
        LavaError: If a field is not valid.
    """
    for one in fields(item):
        name, value = f'{label}.{one.name}', getattr(item, one.name)
        if value is None and one.default is None:
            continue
        if 'limits' in one.metadata:
            lower, upper = one.metadata['limits']
            value = validation.number(
                name, value, at_least=lower, at_most=upper, unit=one.metadata['unit']
            )
            object.__setattr__(item, one.name, value)
        elif 'choices' in one.metadata:
            validation.choice(name, value, one.metadata['choices'])
        elif 'text' in one.metadata:
            validation.flag(name, value)


def with_fields(more: Callable[[Iterable[str]], Mapping[str, Any]]) -> Callable[[type], type]:
    """Return a decorator that gives a class more fields before it becomes a dataclass.

    Args:
        more: Function that returns the fields by name, given the names that the class has.
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
    """Merge a mapping that all effects declare, and check for name conflicts.

    Args:
        part: An attribute of ``Effect`` that is a mapping, such as ``law``.
        effects: The effects, by name.
        core: Names that exist without any effect.

    Returns:
        The merged mapping, by name.

    Raises:
        LavaError: If a name exists already and the effect does not declare that it adds to it.
    """
    owners = dict.fromkeys(core, 'lava_ros itself')
    joined: dict[str, Any] = {}
    for name, effect in effects.items():
        for key, item in getattr(effect, part).items():
            if key in owners and key not in effect.adds_to:
                expected = f'a name that {owners[key]} does not declare'
                raise LavaError(f'effects.{name}.{part}', key, expected)
            owners.setdefault(key, f'effects.{name}')
            joined[key] = item
    return joined


class Array(NamedTuple):
    """An array on the device.

    Attributes:
        dtype: ``real`` or a vector of it (``vec2``, ``vec3``, ``vec4``) of the state's precision,
            ``int32``, ``float32`` or ``float64``.
        shape: Dimensions: ``particle`` (the capacity), ``row`` and ``column`` of the terrain's
            cells, or a number of items.
        only_if: Property of ``layout.Form`` without which the array is not allocated.
        is_carried: True if particles carry it from step to step, or with ``is_of_step`` from stage
            to stage. Such an array has a twin in the order of the cells (``ordered``), named
            ``ordered_`` and its name.
        is_of_step: True if it is meaningless between two steps.
        is_saved: True if checkpoints contain it; they always contain carried arrays.
    """

    dtype: str
    shape: tuple[int | str, ...] = ('particle',)
    only_if: str = ''
    is_carried: bool = False
    is_of_step: bool = False
    is_saved: bool = False


@dataclass(frozen=True, kw_only=True)
class Effect:
    """An effect, as its file declares it; the equations are in the file itself.

    Attributes:
        rank: Position among the effects: in tables, in sums and in passes.
        title: Short description.
        symbol: Formula of the number that decides.
        number: Function that computes it for each column of lava, or one for all; above
            ``threshold`` the effect is on. None: only by request.
        fraction: Quantile of the number over the lava's volume that decides.
        needs_extent: True if the number is meaningless before the lava has left its vent.
        threshold: Number above which the effect is on; infinite if it is on only by request.
        admits: Error of omitting the effect where the number is at the threshold.
        speed_error: That error as a fraction of the speed.
        extent_error: That error as a fraction of the length or width of the flow.
        source: Source of threshold and cost.
        no_case: Why no case of ``lava check solver`` has it; empty if one does.
        exists: Function that returns True if a lava has the effect. An effect with an
            ``environment`` also needs one of its values to differ from 0.
        is_default: True if ``Effects()`` contains it.
        constants: Fields that it adds to ``Lava``, by name.
        environment: Fields that it adds to ``Scene``, by name.
        check: Function that raises if constants are incompatible.
        excludes: Effects that cannot be on at the same time, and the reason, by name.
        replaces: Effects that it replaces.
        kind: Kind of the flow (``simulation/flow_kind.py``) to which it is limited: estimates
            include it in such a flow only, and there it wins over the effects that it excludes.
            Empty: all kinds.
        law: Values that it adds to the device constants of the laws of flow, by name.
        heat: Values that it adds to the device constants of the heat balance, by name.
        adds_to: Names in ``heat`` that other effects declare too; the values are summed.
        is_surface: True if it transfers heat from a bare surface to the air at any age.
        stiffens: True if it makes the speed of lava depend on its temperature.
        needs_age: True if its terms depend on the age of a column.
        ages_in_place: True if the age in the heat balance is the time since lava reached the cell
            in which a column is, in place of the time since emission.
        needs_speed: True if its terms depend on the speed of a column.
        needs_drop: True if its terms depend on the height that a column falls.
        needs_velocity: True if lava has momentum: particles carry their velocity from step to
            step, and a step has one stage.
        is_lateral: True if it is lateral stress: the local velocity is the force that drives it.
        freezes: True if columns colder than the solidus become ground.
        work_power: Power of the number of particles in the time of an evaluation.
        arrays: Arrays that it keeps on the device, by name.
        removes_particles: True if particles may lose all their volume to it, and are then dropped.
        needs_particles: True if columns on cells (``method: cells``) do not have the effect.
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
    speed_error: float = 0.0
    extent_error: float = 0.0
    source: str = ''
    no_case: str = ''
    exists: Callable[[Lava], bool] = lambda lava: True
    is_default: bool = False
    constants: Mapping[str, Any] = field(default_factory=dict)
    environment: Mapping[str, Any] = field(default_factory=dict)
    check: Callable[[Lava], None] = lambda lava: None
    excludes: Mapping[str, str] = field(default_factory=dict)
    replaces: tuple[str, ...] = ()
    kind: str = ''
    law: Mapping[str, Callable[[Lava], float]] = field(default_factory=dict)
    heat: Mapping[str, Callable[[Scene], float]] = field(default_factory=dict)
    adds_to: tuple[str, ...] = ()
    is_surface: bool = False
    stiffens: bool = False
    needs_age: bool = False
    ages_in_place: bool = False
    needs_speed: bool = False
    needs_drop: bool = False
    needs_velocity: bool = False
    is_lateral: bool = False
    freezes: bool = False
    work_power: float = 1.0
    arrays: Mapping[str, Array] = field(default_factory=dict)
    removes_particles: bool = False
    needs_particles: bool = False
    benchmark: Mapping[str, Any] = field(default_factory=dict)

    @property
    def cost(self) -> float:
        """Largest fraction of the inundated area that changes, for a number at the threshold.

        Cells change that lava covers either with or without the effect.
        """
        return self.extent_error + footprint_change(self.speed_error)

    @property
    def thickness_cost(self) -> float:
        """Largest fraction of the mean thickness that changes, such as the height of a dome."""
        return self.extent_error + thickness_change(self.speed_error)
