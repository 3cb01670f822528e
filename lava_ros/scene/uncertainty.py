# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Distributions of the uncertain input of a scene.

A member of an ensemble is the scene with one value drawn from each distribution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
import math
from statistics import NormalDist
from typing import Any

from lava_ros import validation
from lava_ros.effects.effect import check_fields, number
from lava_ros.errors import LavaError
from lava_ros.scene.lava import Lava

#: Parameters of each kind of distribution.
KINDS: Mapping[str, tuple[str, ...]] = {
    'normal': ('mean', 'deviation'),
    'lognormal': ('median', 'factor'),
    'uniform': ('low', 'high'),
    'loguniform': ('low', 'high'),
    'triangular': ('low', 'mode', 'high'),
}

#: Quantities that are factors, above 0.
FACTORS = ('discharge', 'viscosity', 'yield_strength')

#: Constants of the lava whose values are drawn; the others have a factor.
CONSTANTS = tuple(
    item.name for item in fields(Lava) if 'limits' in item.metadata and item.name not in FACTORS
)

#: Maximum deviation, radius and correlation [m].
MAX_LENGTH = 1e6

#: Checks of the numbers of ``Roughness``, and of the probability of an eruption class.
ROUGHNESS_CHECK = partial(validation.number, above=0.0, at_most=MAX_LENGTH, unit='m')
PROBABILITY_CHECK = partial(validation.number, above=0.0, at_most=1e9)

#: Kinds with infinite support, which may have limits.
WITH_LIMITS = ('normal', 'lognormal')

_STANDARD = NormalDist()


def check_of(kind: str, name: str) -> partial[float]:
    """Return the check of a parameter of a kind of distribution."""
    is_log = kind in ('lognormal', 'loguniform')
    # a factor of 1 or a deviation of 0 leaves no spread
    above = {'deviation': 0.0, 'factor': 1.0}.get(name, 0.0 if is_log else None)
    return partial(validation.number, above=above, at_most=1e9)


@dataclass(frozen=True)
class Distribution:
    """A probability distribution.

    Attributes:
        kind: One of ``KINDS``.
        numbers: Parameters in the order of ``KINDS``. The factor of a lognormal distribution is
            its geometric standard deviation: 68 % lie between median / factor and median * factor.
        limits: Minimum and maximum at which a normal or lognormal distribution is truncated. None:
            no limits.
    """

    kind: str
    numbers: tuple[float, ...]
    limits: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Validate every field; LavaError names one that is not usable."""
        names = KINDS[validation.choice('distribution.kind', self.kind, KINDS)]
        if not isinstance(self.numbers, Sequence) or len(self.numbers) != len(names):
            expected = f'{len(names)}: {", ".join(names)}'
            raise LavaError('distribution.numbers', self.numbers, expected)
        clean = [
            check_of(self.kind, name)(f'distribution.{name}', value)
            for name, value in zip(names, self.numbers, strict=True)
        ]
        low, high = clean[0], clean[-1]
        if 'low' in names and not low < high:
            raise LavaError('distribution.high', high, f'above low, {low:g}')
        if self.kind == 'triangular' and not low <= clean[1] <= high:
            expected = f'from low, {low:g}, to high, {high:g}'
            raise LavaError('distribution.mode', clean[1], expected)
        object.__setattr__(self, 'numbers', tuple(clean))
        if self.limits is not None:
            self._check_limits()

    def _check_limits(self) -> None:
        where = 'distribution.limits'
        if self.kind not in WITH_LIMITS:
            raise validation.surplus(where, f'because a {self.kind} distribution has its own')
        low, high = bounds = validation.pair(where, self.limits, unit='', most=1e9)
        if self.kind == 'lognormal' and low <= 0.0:
            raise LavaError(f'{where}[0]', low, 'above 0')
        if not low < high:
            raise LavaError(f'{where}[1]', high, f'above the lower limit, {low:g}')
        object.__setattr__(self, 'limits', bounds)
        centre, width, low, high = self._as_normal()
        inside = _STANDARD.cdf((high - centre) / width) - _STANDARD.cdf((low - centre) / width)
        if inside < 1e-3:
            raise LavaError(where, bounds, 'limits with 0.1 % of the distribution between them')

    def _as_normal(self) -> tuple[float, ...]:
        """Return mean, deviation and support; for a lognormal kind, those of the logarithm."""
        values = (*self.numbers, *self.support)
        if self.kind == 'normal':
            return values
        return tuple(math.log(value) if value else -math.inf for value in values)

    @property
    def support(self) -> tuple[float, float]:
        """Minimum and maximum value, infinite without limits."""
        if self.kind in WITH_LIMITS:
            return self.limits or (-math.inf if self.kind == 'normal' else 0.0, math.inf)
        return (self.numbers[0], self.numbers[-1])

    def quantile(self, probability: float) -> float:
        """Return the value with a cumulative probability, 0 < probability < 1."""
        if self.kind in WITH_LIMITS:
            centre, width, low, high = self._as_normal()
            first, last = (_STANDARD.cdf((end - centre) / width) for end in (low, high))
            inside = min(max(first + probability * (last - first), 1e-16), 1.0 - 1e-16)
            value = min(max(centre + width * _STANDARD.inv_cdf(inside), low), high)
            return math.exp(value) if self.kind == 'lognormal' else value
        if self.kind == 'triangular':
            low, mode, high = self.numbers
            if probability < (mode - low) / (high - low):
                return low + math.sqrt(probability * (high - low) * (mode - low))
            return high - math.sqrt((1.0 - probability) * (high - low) * (high - mode))
        low, high = self.numbers
        if self.kind == 'loguniform':
            return low * math.exp(probability * math.log(high / low))
        return low + (high - low) * probability


@dataclass(frozen=True)
class Displacement:
    """A common displacement of all vents.

    Either ``deviation`` is the standard deviation of each normal coordinate [m], or ``radius`` is
    that of a disc with uniform probability density [m]; the other is 0.
    """

    deviation: float = number(0.0, 'Deviation', 0.0, MAX_LENGTH, 'm')
    radius: float = number(0.0, 'Radius', 0.0, MAX_LENGTH, 'm')

    def __post_init__(self) -> None:
        """Validate all fields; raise LavaError unless exactly one of them is above 0."""
        check_fields('displacement', self)
        if bool(self.deviation) == bool(self.radius):
            values = (self.deviation, self.radius)
            raise LavaError('displacement', values, 'either deviation or radius above 0 m')

    def quantile(self, first: float, second: float) -> tuple[float, float]:
        """Return the displacement (dx, dy) [m] of two uniform numbers between 0 and 1."""
        if self.deviation:
            x, y = _STANDARD.inv_cdf(first), _STANDARD.inv_cdf(second)
            return (self.deviation * x, self.deviation * y)
        reach, angle = self.radius * math.sqrt(first), 2.0 * math.pi * second
        return (reach * math.cos(angle), reach * math.sin(angle))


@dataclass(frozen=True)
class Roughness:
    """Errors of the terrain: a Gaussian random field with a Gaussian correlation.

    ``deviation`` is the standard deviation of the elevation [m], ``correlation`` the distance at
    which the correlation is 1/e [m].
    """

    deviation: float
    correlation: float

    def __post_init__(self) -> None:
        """Validate every field; LavaError names one that is not usable."""
        for name in ('deviation', 'correlation'):
            value = ROUGHNESS_CHECK(f'roughness.{name}', getattr(self, name))
            object.__setattr__(self, name, value)


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
            if not isinstance(item, Distribution) or item.support[0] < 0.0:
                expected = 'a distribution of values above 0: lognormal, loguniform or with limits'
                raise LavaError(f'{where}.{name}', item, expected)
        validation.text(f'{where}.name', self.name)


@dataclass(frozen=True)
class Uncertainty:
    """Distributions from which the members of an ensemble draw; None: no uncertainty.

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
    """

    discharge: Distribution | None = None
    temperature: Distribution | None = None
    viscosity: Distribution | None = None
    yield_strength: Distribution | None = None
    position: Displacement | None = None
    terrain: Roughness | None = None
    constants: Mapping[str, Distribution] = field(default_factory=dict)
    eruption: tuple[EruptionClass, ...] = ()

    def __post_init__(self) -> None:
        """Validate all fields; raise LavaError for a wrong type or a negative factor."""
        kinds: dict[str, type] = {
            'position': Displacement, 'terrain': Roughness, 'constants': Mapping,
            'eruption': tuple,
        }
        validation.keys('uncertainty.constants', self.constants, allowed=CONSTANTS)
        for item in fields(self):
            value, label = getattr(self, item.name), f'uncertainty.{item.name}'
            kind = kinds.get(item.name, Distribution)
            if value is not None and not isinstance(value, kind):
                raise LavaError(label, value, f'a {kind.__name__} or None')
            if not isinstance(value, Distribution) or item.name not in FACTORS:
                continue
            if value.support[0] < 0.0:
                expected = 'a distribution of factors, above 0: lognormal, or with limits'
                raise LavaError(label, value, expected)


def uncertainty_from_dict(data: object) -> Uncertainty:
    """Build an uncertainty from the plain data of a scene file; raise LavaError for bad data."""
    where = 'uncertainty'
    names = [item.name for item in fields(Uncertainty)]
    values: dict[str, Any] = {}
    for key, item in validation.keys(where, data, allowed=[*names, 'effusion_rate']).items():
        name = 'discharge' if key == 'effusion_rate' else key
        if name in values:
            raise LavaError(f'{where}.{key}', item, 'either effusion_rate or discharge')
        values[name] = _READERS.get(name, _distribution)(f'{where}.{key}', item)
    return Uncertainty(**values)


def uncertainty_to_dict(uncertainty: Uncertainty) -> dict[str, Any]:
    """Return plain data, the inverse of ``uncertainty_from_dict``."""
    known = vars(uncertainty).items()
    return {name: _as_plain(value) for name, value in known if value not in (None, (), {})}


def _as_plain(value: Any) -> Any:
    if isinstance(value, Distribution):
        numbers = dict(zip(KINDS[value.kind], value.numbers, strict=True))
        limits = {} if value.limits is None else {'limits': list(value.limits)}
        return {'distribution': value.kind, **numbers, **limits}
    if isinstance(value, Displacement):
        return {name: number for name, number in vars(value).items() if number}
    if isinstance(value, tuple):
        return [_as_plain(item) for item in value]
    if isinstance(value, (Roughness, EruptionClass)):
        value = vars(value)
    return {key: _as_plain(value[key]) for key in value} if isinstance(value, Mapping) else value


def _distribution(where: str, data: object) -> Distribution:
    if not isinstance(data, Mapping) or 'distribution' not in data:
        raise LavaError(where, data, f'a mapping with distribution: {", ".join(KINDS)}')
    kind = validation.choice(f'{where}.distribution', data['distribution'], KINDS)
    names = KINDS[kind]
    limits = ['limits'] if kind in WITH_LIMITS else []
    values = validation.keys(
        where, data, allowed=['distribution', *names, *limits], required=names
    )
    numbers = [values[name] for name in names]
    parts = {'kind': kind, 'numbers': numbers, 'limits': values.get('limits')}
    return validation.build(Distribution, where, parts)


def _constants(where: str, data: object) -> dict[str, Distribution]:
    known = validation.keys(where, data, allowed=CONSTANTS)
    return {name: _distribution(f'{where}.{name}', item) for name, item in known.items()}


def _eruption_classes(where: str, data: object) -> tuple[EruptionClass, ...]:
    names = [item.name for item in fields(EruptionClass)]
    result = []
    for label, item in validation.items(where, data, 'a list of classes of eruptions'):
        values = validation.keys(label, item, allowed=names, required=names[:-1])
        for name in ('duration', 'volume'):
            values[name] = _distribution(f'{label}.{name}', values[name])
        result.append(validation.build(EruptionClass, label, values))
    return tuple(result)


#: Readers of the fields of ``Uncertainty`` that are not distributions.
_READERS: Mapping[str, Callable[[str, object], Any]] = {
    'position': partial(validation.build, Displacement),
    'terrain': partial(validation.build, Roughness),
    'constants': _constants,
    'eruption': _eruption_classes,
}
