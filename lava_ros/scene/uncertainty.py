# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Distributions of the uncertain input of a scene.

A member of an ensemble is the scene with one value drawn from each distribution. ``ranges`` adds
the usual distributions of the quantities that a scene does not mention.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.keys import any_of, either, Key, Keys, list_of, same_keys, Schema
from lava_ros.scene.distributions import (
    Displacement,
    DISPLACEMENT_KEYS,
    Distribution,
    distribution_schema,
    keys_of,
    KINDS,
    Roughness,
    ROUGHNESS_KEYS,
    WITH_LIMITS,
    WORDS,
)
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import materials
from lava_ros.scene.measurements import contour_errors, RATE_ERRORS, SURVEYS

#: Quantities that are factors, above 0.
FACTORS = ('discharge', 'viscosity', 'yield_strength')

#: Constants of the lava whose values are drawn; the others have a factor.
CONSTANTS = tuple(
    item.name for item in fields(Lava) if 'limits' in item.metadata and item.name not in FACTORS
)

#: Quantities that a scene can take as exact.
QUANTITIES = (
    'effusion_rate', 'temperature', 'viscosity', 'yield_strength', 'position', 'terrain',
    *CONSTANTS,
)

#: Word for all quantities without a distribution in the scene.
ALL = 'all'

#: Check of the probability of an eruption class.
PROBABILITY_CHECK = partial(validation.number, above=0.0, at_most=1e9)


@dataclass(frozen=True)
class EruptionClass:
    """A class of eruptions: duration [s] and total volume of all vents [m3].

    ``probability``, above 0, is relative to those of the other classes.
    """

    probability: float
    duration: Distribution
    volume: Distribution
    name: str = ''

    def __post_init__(self) -> None:
        """Validate every field; LavaError names one that is not usable."""
        where = 'eruptionclass'
        value = PROBABILITY_CHECK(f'{where}.probability', self.probability)
        object.__setattr__(self, 'probability', value)
        for name in ('duration', 'volume'):
            item = getattr(self, name)
            if not isinstance(item, Distribution):
                raise LavaError(f'{where}.{name}', item, 'a Distribution')
            _check_above_0(f'{where}.{name}', item, 'values')
        validation.text(f'{where}.name', self.name)


@dataclass(frozen=True)
class Uncertainty:
    """Distributions from which the members of an ensemble draw; None: not given.

    Attributes:
        discharge: Factor on the discharge of all vents.
        temperature: Offset of the temperature of all vents [K].
        viscosity: Factor on the lava's viscosity.
        yield_strength: Factor on the lava's yield strength.
        position: Displacement of the vents.
        terrain: Errors of the terrain.
        constants: Values of other constants, by the field of ``Lava``.
        eruption: Classes of eruptions. Each member draws one class: the discharge of the scene is
            stretched to its duration and scaled to its volume.
        exact: Quantities of ``QUANTITIES`` that are not drawn, or ``ALL``.
        material: Name of the material whose published ranges are those of quantities that are
            neither given nor exact (``ranges.with_ranges``); empty: nothing else is drawn.
    """

    discharge: Distribution | None = None
    temperature: Distribution | None = None
    viscosity: Distribution | None = None
    yield_strength: Distribution | None = None
    position: Displacement | None = None
    terrain: Roughness | None = None
    constants: Mapping[str, Distribution] = field(default_factory=dict)
    eruption: tuple[EruptionClass, ...] = ()
    exact: tuple[str, ...] = ()
    material: str = ''

    def __post_init__(self) -> None:
        """Validate all fields; raise LavaError for a wrong type or a negative factor."""
        kinds: dict[str, type] = {
            'position': Displacement, 'terrain': Roughness, 'constants': Mapping,
            'eruption': tuple, 'exact': tuple, 'material': str,
        }
        validation.keys('uncertainty.constants', self.constants, allowed=CONSTANTS)
        for item in fields(self):
            value, label = getattr(self, item.name), f'uncertainty.{item.name}'
            kind = kinds.get(item.name, Distribution)
            if value is not None and not isinstance(value, kind):
                raise LavaError(label, value, f'a {kind.__name__} or None')
            if isinstance(value, Distribution) and item.name in FACTORS:
                _check_above_0(label, value, 'factors')
        for name, one in self.drawn.items():
            leader = getattr(one, 'follows', '').removeprefix('-')
            if leader and not self.is_followed(leader, name):
                others = [other for other in self.drawn if self.is_followed(other, name)]
                expected = f'a quantity with its own distribution: {", ".join(others)}'
                raise LavaError(f'uncertainty.{name}.follows', leader, expected)
        for index, name in enumerate(self.exact):
            where = f'uncertainty.exact[{index}]'
            validation.choice(where, name, (ALL, *QUANTITIES))
            if self.distribution_of(name) is not None:
                expected = f'a quantity without a distribution in uncertainty.{name}'
                raise LavaError(where, name, expected)

    def distribution_of(self, name: str) -> Distribution | Displacement | Roughness | None:
        """Return the distribution of one of ``QUANTITIES``, None without one."""
        field_name = 'discharge' if name == 'effusion_rate' else name
        found = getattr(self, field_name, None) or self.constants.get(name)
        return found if isinstance(found, (Distribution, Displacement, Roughness)) else None

    @property
    def drawn(self) -> dict[str, Distribution | Displacement | Roughness]:
        """The distributions by name, in the order of ``QUANTITIES``; without classes."""
        found = ((name, self.distribution_of(name)) for name in QUANTITIES)
        return {name: item for name, item in found if item is not None}

    def fixing(self, names: Iterable[str]) -> Uncertainty:
        """Return the uncertainty with some of ``QUANTITIES`` exact, without their distributions.

        ``ALL`` leaves those that have distributions.

        Raises:
            LavaError: If a name is not valid.
        """
        names = tuple(names)
        kept = {name: item for name, item in self.drawn.items() if name not in names}
        for name, item in kept.items():
            if isinstance(item, Distribution) and item.follows.removeprefix('-') in names:
                kept[name] = replace(item, follows='')
        constants = {name: kept[name] for name in self.constants if name in kept}
        others = {
            'discharge' if name == 'effusion_rate' else name: kept.get(name)
            for name in QUANTITIES if name not in CONSTANTS
        }
        exact = tuple(dict.fromkeys((*self.exact, *names)))
        return replace(self, constants=constants, exact=exact, **others)  # type: ignore[arg-type]

    def is_followed(self, name: str, by: str) -> bool:
        """Return True if another quantity may have the cumulative probability of this one."""
        item = self.distribution_of(name)
        return name != by and isinstance(item, Distribution) and not item.follows

    def is_exact(self, name: str) -> bool:
        """Return True if the scene fixes a quantity."""
        return name in self.exact or (ALL in self.exact and self.distribution_of(name) is None)


def _distribution(where: str, data: object) -> Distribution:
    if not isinstance(data, Mapping) or 'distribution' not in data:
        raise LavaError(where, data, f'a mapping with distribution: {", ".join(KINDS)}')
    kind = validation.choice(f'{where}.distribution', data['distribution'], KINDS)
    values = keys_of(kind).names(where, data)
    numbers = [values[name] for name in KINDS[kind]]
    parts = {'kind': kind, 'numbers': numbers, 'limits': values.get('limits')}
    return validation.build(Distribution, where, parts | _words(values))


def _check_above_0(where: str, found: Distribution, of: str) -> None:
    """Raise LavaError, with the number or the word at fault, for values that may be below 0."""
    if found.support[0] >= 0.0:
        return
    shown: dict[str, object] = {'distribution': found.kind}
    if found.limits:
        shown = {'limits': found.limits}
    elif found.kind not in WITH_LIMITS:
        shown = {'low': found.support[0]}
    (name, value), = shown.items()
    expected = f'a distribution of {of} above 0: lognormal, loguniform or with limits'
    raise LavaError(f'{where}.{name}', value, expected)


def _rate(where: str, data: object) -> Distribution:
    if isinstance(data, Mapping) and 'measured' in data:
        return RATE_ERRORS[MEASURED_KEYS(where, data)['measured']]
    found = _distribution(where, data)
    _check_above_0(where, found, 'factors')
    return found


def _terrain(where: str, data: object) -> Roughness:
    if isinstance(data, Mapping) and 'survey' in data:
        return SURVEYS[SURVEY_KEYS(where, data)['survey']].roughness
    if isinstance(data, Mapping) and 'contours' in data:
        return contour_errors(CONTOUR_KEYS(where, data)['contours'])
    return validation.build(Roughness, where, data)


def _words(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: values[name] for name in WORDS if name in values}


def _exact(where: str, data: object) -> tuple[str, ...]:
    if data == ALL:
        return (ALL,)
    expected = f'{ALL}, or a list of quantities, such as [viscosity]'
    return tuple(item for _, item in validation.items(where, data, expected))


def _eruption_classes(where: str, data: object) -> tuple[EruptionClass, ...]:
    items = validation.items(where, data, 'a list of classes of eruptions')
    return tuple(
        validation.build(EruptionClass, label, CLASS_KEYS(label, item)) for label, item in items
    )


#: Reference to the schema of a distribution.
_ONE: Schema = {'$ref': '#/definitions/distribution'}

#: Keys of a class of eruptions, of errors by their origin, and of constants, in a file.
CLASS_KEYS = Keys({
    'probability': Key(PROBABILITY_CHECK, 'Relative to those of the other classes', True),
    'duration': Key(_distribution, 'Duration [s]', True, {'allOf': [_ONE]}),
    'volume': Key(_distribution, 'Volume of all vents together [m3]', True, {'allOf': [_ONE]}),
    'name': Key(validation.text, 'Name in logs, messages and tables'),
})
MEASURED_KEYS = Keys({
    'measured': Key(partial(validation.choice, allowed=RATE_ERRORS), is_required=True)
})
SURVEY_KEYS = Keys({'survey': Key(partial(validation.choice, allowed=SURVEYS), is_required=True)})
CONTOUR_KEYS = Keys({
    'contours': Key(
        partial(validation.number, at_least=0.01, at_most=1000.0, unit='m'),
        'Interval of the contours from which the terrain was interpolated [m]', True,
    ),
})
CONSTANT_KEYS = Keys(same_keys(CONSTANTS, _distribution, schema=_ONE))

_RATE_KEY = Key(
    _rate, 'Factor on all effusion rates',
    schema={'allOf': [any_of(_ONE, MEASURED_KEYS.as_schema())]},
)

#: Keys of uncertain quantities in a file.
UNCERTAINTY_KEYS = Keys({
    'discharge': _RATE_KEY,
    **{
        name: Key(_distribution, text, schema={'allOf': [_ONE]}) for name, text in {
            'temperature': 'Offset of the temperature of all vents [K]',
            'viscosity': 'Factor on the viscosity',
            'yield_strength': 'Factor on the yield strength',
        }.items()
    },
    'position': Key(
        partial(validation.build, Displacement), 'Displacement of all vents',
        schema=DISPLACEMENT_KEYS.as_schema,
    ),
    'terrain': Key(
        _terrain, 'Errors of the terrain',
        schema=any_of(
            ROUGHNESS_KEYS.as_schema(), SURVEY_KEYS.as_schema(), CONTOUR_KEYS.as_schema()
        ),
    ),
    'constants': Key(CONSTANT_KEYS, 'Values of other constants of the lava'),
    'eruption': Key(
        _eruption_classes, 'Classes of eruptions, of which each member draws one',
        schema=list_of(CLASS_KEYS.as_schema()),
    ),
    'exact': Key(
        _exact, 'Quantities that are not drawn',
        schema=any_of({'const': ALL}, list_of({'enum': list(QUANTITIES)})),
    ),
    'material': Key(
        validation.text,
        'Material whose published ranges are drawn; that of the lava if left out',
        schema=lambda: {'enum': list(materials())},
    ),
    'effusion_rate': _RATE_KEY,
}, (either('discharge', 'effusion_rate', optional=True),))


def definitions() -> Schema:
    """Return the schemas to which those of uncertain quantities refer."""
    names = [sign + name for sign in ('', '-') for name in QUANTITIES]
    meaning = 'Quantity with the same, or after a minus sign the opposite, rank'
    return {
        'distribution': distribution_schema(),
        'leader': {'description': meaning, 'enum': ['', *names]},
    }


def uncertainty_from_dict(data: object) -> Uncertainty:
    """Build an uncertainty from the plain data of a scene file; raise LavaError for bad data."""
    values = UNCERTAINTY_KEYS('uncertainty', data)
    if 'effusion_rate' in values:
        if 'discharge' in values:
            raise validation.conflict('uncertainty.effusion_rate', 'discharge')
        values['discharge'] = values.pop('effusion_rate')
    return Uncertainty(**values)


def uncertainty_to_dict(uncertainty: Uncertainty) -> dict[str, Any]:
    """Return plain data, the inverse of ``uncertainty_from_dict``."""
    known = vars(uncertainty).items()
    return {name: _as_plain(value) for name, value in known if value not in (None, (), {}, '')}


def _as_plain(value: Any) -> Any:
    if isinstance(value, Distribution):
        numbers = dict(zip(KINDS[value.kind], value.numbers, strict=True))
        limits = {} if value.limits is None else {'limits': list(value.limits)}
        words = {name: getattr(value, name) for name in WORDS if getattr(value, name)}
        return {'distribution': value.kind, **numbers, **limits, **words}
    if isinstance(value, (Displacement, Roughness)):
        return {name: number for name, number in vars(value).items() if number}
    if isinstance(value, tuple):
        return [_as_plain(item) for item in value]
    if isinstance(value, EruptionClass):
        value = vars(value)
    return {key: _as_plain(value[key]) for key in value} if isinstance(value, Mapping) else value
