# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Distributions: of a number, of the displacement of vents, and of the errors of a terrain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
import math
from statistics import NormalDist

from lava_ros import validation
from lava_ros.effects.effect import check_fields, number
from lava_ros.errors import LavaError
from lava_ros.files.keys import any_of, Key, Keys, same_keys, Schema

#: Parameters of each kind of distribution.
KINDS: Mapping[str, tuple[str, ...]] = {
    'normal': ('mean', 'deviation'),
    'lognormal': ('median', 'factor'),
    'uniform': ('low', 'high'),
    'loguniform': ('low', 'high'),
    'triangular': ('low', 'mode', 'high'),
}

#: Maximum deviation, radius and correlation [m].
MAX_LENGTH = 1e6

#: Check of the numbers of ``Roughness``.
ROUGHNESS_CHECK = partial(validation.number, above=0.0, at_most=MAX_LENGTH, unit='m')

#: Fields of a distribution that are text.
WORDS = ('source', 'follows')

#: Kinds with infinite support, which may have limits.
WITH_LIMITS = ('normal', 'lognormal')

_STANDARD = NormalDist()


def check_of(kind: str, name: str) -> partial[float]:
    """Return the check of a parameter of a kind of distribution."""
    is_log = kind in ('lognormal', 'loguniform')
    # a factor of 1 or a deviation of 0 leaves no spread
    above = {'deviation': 0.0, 'factor': 1.0}.get(name, 0.0 if is_log else None)
    return partial(validation.number, above=above, at_most=1e9)


#: Reference of a distribution in a file.
SOURCE = Key(validation.text, 'Reference, for people')


def keys_of(kind: str) -> Keys:
    """Return the keys of a kind of distribution in a file."""
    limits = Key(partial(validation.pair, unit='', most=1e9), 'Ends at which it is truncated')
    return Keys({
        'distribution': Key(None, is_required=True, schema={'const': kind}),
        **{name: Key(check_of(kind, name), is_required=True) for name in KINDS[kind]},
        **({'limits': limits} if kind in WITH_LIMITS else {}),
        'source': SOURCE,
        'follows': Key(validation.text, schema={'$ref': '#/definitions/leader'}),
    })


def distribution_schema() -> Schema:
    """Return the schema of a distribution of any kind."""
    return any_of(*(keys_of(kind).as_schema() for kind in KINDS))


@dataclass(frozen=True)
class Distribution:
    """A probability distribution.

    Attributes:
        kind: One of ``KINDS``.
        numbers: Parameters in the order of ``KINDS``. The factor of a lognormal distribution is
            its geometric standard deviation: 68 % lie between median / factor and median * factor.
        limits: Minimum and maximum at which a normal or lognormal distribution is truncated. None:
            no limits.
        source: Reference, for people; may be empty.
        follows: Name of a quantity that determines this one: both have the same cumulative
            probability in a member, or with a minus sign before the name the opposite one. Empty:
            drawn independently.
    """

    kind: str
    numbers: tuple[float, ...]
    limits: tuple[float, float] | None = None
    source: str = ''
    follows: str = ''

    def __post_init__(self) -> None:
        """Validate every field; LavaError names one that is not usable."""
        names = KINDS[validation.choice('distribution.kind', self.kind, KINDS)]
        validation.text('distribution.source', self.source)
        validation.text('distribution.follows', self.follows)
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

    def text(self, unit: str = '') -> str:
        """Describe the distribution for people."""
        unit, numbers = f' {unit}' if unit else '', [f'{value:.4g}' for value in self.numbers]
        if self.kind == 'lognormal':
            words = f'{numbers[0]}{unit} x/ {numbers[1]}'
        elif self.kind == 'normal':
            words = f'{numbers[0]} +- {numbers[1]}{unit}'
        else:
            words = f'{numbers[0]} to {numbers[-1]}{unit}'
        if self.limits is not None:
            words += ', from {:.4g} to {:.4g}'.format(*self.limits)
        return f'{words} ({self.kind})'

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
    that of a disc with uniform probability density [m]; the other is 0. ``source`` is the
    reference.
    """

    deviation: float = number(0.0, 'Deviation', 0.0, MAX_LENGTH, 'm')
    radius: float = number(0.0, 'Radius', 0.0, MAX_LENGTH, 'm')
    source: str = ''

    def __post_init__(self) -> None:
        """Validate all fields; raise LavaError unless exactly one of them is above 0."""
        check_fields('displacement', self)
        if bool(self.deviation) == bool(self.radius):
            values = (self.deviation, self.radius)
            raise LavaError('displacement', values, 'either deviation or radius above 0 m')
        validation.text('displacement.source', self.source)

    def text(self) -> str:
        """Describe the displacement for people."""
        if self.deviation:
            return f'+- {self.deviation:.3g} m in x and y (normal)'
        return f'within {self.radius:.3g} m'

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
    which the correlation is 1/e [m], and ``source`` the reference.
    """

    deviation: float
    correlation: float
    source: str = ''

    def __post_init__(self) -> None:
        """Validate every field; LavaError names one that is not usable."""
        for name, value in ROUGHNESS_KEYS.values('roughness', vars(self)).items():
            object.__setattr__(self, name, value)

    def text(self) -> str:
        """Describe the errors for people."""
        return f'+- {self.deviation:.3g} m, correlated over {self.correlation:.3g} m'


#: Keys of the displacement of vents, and of the errors of a terrain, in a file.
DISPLACEMENT_KEYS = Keys({
    **{item.name: Key.of_field(item) for item in fields(Displacement) if item.metadata},
    'source': SOURCE,
})
ROUGHNESS_KEYS = Keys({
    **same_keys(('deviation', 'correlation'), ROUGHNESS_CHECK, is_required=True),
    'source': SOURCE,
})
