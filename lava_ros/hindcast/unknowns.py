# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.


"""What a calibration may change, and how far: the ranges are those that have been published."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import math

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.hindcast.case import Case

#: Factor on the discharge either way where the case does not say how well it is known.
DISCHARGE = 1.25


@dataclass(frozen=True)
class Unknown:
    """A number that is not known well.

    Attributes:
        name: What it is called.
        unit: Its unit.
        low: Its smallest value.
        high: Its largest value.
        usual: Its value without calibration.
        source: Who has published the range.
        is_log: Whether it is searched by its logarithm.
    """

    name: str
    unit: str
    low: float
    high: float
    usual: float
    source: str
    is_log: bool = False

    def value_at(self, share: float) -> float:
        """The value at a share of the range, from 0 to 1."""
        if self.is_log:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share

    def share_of(self, value: float) -> float:
        """The share of the range at which a value is."""
        if self.is_log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def _temperature(case: Case, value: float) -> Case:
    return case.with_lava({}, temperature=value)


def _viscosity(case: Case, value: float) -> Case:
    """Shift the law so that lava has this viscosity at the temperature of its constants."""
    lava = case.scene.lava
    if lava.is_vft:
        now = lava.viscosity_at(_hottest(case))
        return case.with_lava({'vft_a': lava.vft_a + math.log10(value / now)})
    return case.with_lava({'viscosity': value})


def _constant(name: str) -> Callable[[Case, float], Case]:
    return lambda case, value: case.with_lava({name: value})


def _discharge(case: Case, value: float) -> Case:
    return case.with_lava({}, discharge=value)


#: How each unknown is put into a case, in this order.
CHANGES: Mapping[str, Callable[[Case, float], Case]] = {
    'viscosity': _viscosity,
    'yield_strength': _constant('yield_strength'),
    'emissivity': _constant('emissivity'),
    'solidus': _constant('solidus'),
    'discharge': _discharge,
    'vent_temperature': _temperature,
}

#: What is searched when nothing is said, where its range has been published.
USUAL = ('viscosity', 'yield_strength', 'emissivity', 'vent_temperature')

_UNITS = {
    'viscosity': 'Pa s',
    'yield_strength': 'Pa',
    'emissivity': '',
    'solidus': 'K',
    'discharge': '',
    'vent_temperature': 'K',
}

_LOGARITHMIC = ('viscosity', 'yield_strength')


def unknowns_of(
    case: Case,
    names: tuple[str, ...] = (),
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Unknown, ...]:
    """The unknowns of a case.

    Args:
        case: The case.
        names: Which; those of ``USUAL`` with a published range when there are none.
        ranges: Ranges in place of the published ones, by name.

    Raises:
        LavaError: A name is unknown, or an unknown has no range.
    """
    ranges = dict(ranges or {})
    chosen = tuple(dict.fromkeys((*names, *ranges)))
    for name in chosen:
        validation.choice('--unknown', name, CHANGES)
    if not names:
        known = [name for name in USUAL if name in ranges or _published(case, name)]
        chosen = tuple(dict.fromkeys((*known, *chosen)))
    if not chosen:
        raise LavaError('--unknown', [], 'at least one: the material has no published ranges')
    return tuple(_unknown(case, name, ranges) for name in chosen)


def changed(case: Case, values: Mapping[str, float]) -> Case:
    """A case with values for unknowns."""
    for name, change in CHANGES.items():
        if name in values:
            case = change(case, values[name])
    return case


def _unknown(
    case: Case, name: str, ranges: Mapping[str, tuple[float, float]]
) -> Unknown:
    published = _published(case, name)
    if name in ranges:
        (low, high), source = ranges[name], 'given by the user'
    elif published is not None:
        (low, high), source = published
    else:
        right = f'a range ({name}=LOW:HIGH): none has been published for this material'
        raise LavaError('--unknown', name, right)
    low = validation.number(f'{name}, lowest', low, at_least=0.0)
    high = validation.number(f'{name}, highest', high, above=low)
    is_log = name in _LOGARITHMIC
    if is_log:
        validation.number(f'{name}, lowest', low, above=0.0)
    return Unknown(name, _UNITS[name], low, high, _usual(case, name), source, is_log)


def _published(case: Case, name: str) -> tuple[tuple[float, float], str] | None:
    if name == 'discharge':
        return (1.0 / DISCHARGE, DISCHARGE), 'a quarter either way'
    material = case.material
    assert material is not None
    known = material.constants.get(name)
    if name == 'vent_temperature':
        known = material.vent_temperature
    if known is None or known.range is None:
        return None
    return known.range, known.range_source


def _usual(case: Case, name: str) -> float:
    if name == 'discharge':
        return 1.0
    if name == 'vent_temperature':
        return _hottest(case)
    lava = case.scene.lava
    if name == 'viscosity':
        return lava.viscosity_at(_hottest(case)) if lava.is_vft else lava.viscosity
    return float(getattr(lava, name))


def _hottest(case: Case) -> float:
    return max(vent.temperature for vent in case.scene.vents)
