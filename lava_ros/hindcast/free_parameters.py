# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters that a calibration may change, with published ranges."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
import math

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError
from lava_ros.hindcast.case import Case
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import Constant
from lava_ros.scene.measurements import RATE_ERRORS, USUAL_RATE
from lava_ros.scene.ranges import LOGARITHMIC

_RATE = RATE_ERRORS[USUAL_RATE]

#: Factor on the discharge.
DISCHARGE = Constant(1.0, 'effusion_rate.csv', _RATE.support, _RATE.source)

#: Units of the constants of ``Lava`` and of other possible parameters, in the order in which they
#: are set in a case.
UNITS = {
    **{item.name: item.metadata['unit'] for item in fields(Lava) if 'limits' in item.metadata},
    'discharge': '',
    'vent_temperature': 'K',
}

_LOWEST = {item.name: item.metadata['limits'][0] for item in fields(Lava) if item.name in UNITS}


@dataclass(frozen=True)
class FreeParameter:
    """An uncertain number, with its published range and its value without calibration.

    With ``is_log``, its logarithm is searched.
    """

    name: str
    unit: str
    low: float
    high: float
    usual: float
    source: str
    is_log: bool = False

    def value_at(self, share: float) -> float:
        """Return the value at a fraction of the range, from 0 to 1."""
        if self.is_log:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share

    def share_of(self, value: float) -> float:
        """Return the position of a value in the range as a fraction, 0 or 1 outside of it."""
        value = min(max(value, self.low), self.high)
        if self.is_log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def free_parameters_of(
    case: Case,
    names: tuple[str, ...] = (),
    ranges: Mapping[str, tuple[float, float]] | None = None,
    *,
    stated: Collection[str] = (),
) -> tuple[FreeParameter, ...]:
    """Return the parameters of a case: those in ``names``, or all with a published range.

    ``ranges`` adds parameters by name, and replaces published ranges. Constants that are
    ``stated`` are parameters only if they are named.

    Raises:
        LavaError: If a name is not valid, a parameter has no range, or there are no parameters.
    """
    ranges, published, result = ranges or {}, _published(case), []
    chosen = [*names, *ranges]
    for name in chosen:
        validation.choice('--unknown', name, UNITS)
    if not names:
        # the uncertainty of the discharge does not belong to a material
        kept = {'discharge', *stated}
        chosen = [*(name for name in published if name not in kept), *chosen]
    if not chosen:
        problem = 'The material has no published ranges'
        if published.keys() - {'discharge'}:
            problem = 'The case states all constants that have a published range'
        raise RefusalError('--unknown', problem, 'Name at least one constant with --unknown')
    for name in dict.fromkeys(chosen):
        span, source = ranges.get(name), 'given by the user'
        if span is None and name in published:
            span, source = published[name].range, published[name].range_source
        if span is None:
            expected = f'a range, {name}=LOW:HIGH; none has been published for this material'
            raise LavaError('--unknown', name, expected)
        is_log = name in LOGARITHMIC
        lowest, highest = (f'--unknown {name}, {end}' for end in ('lowest', 'highest'))
        low = validation.number(lowest, span[0], at_least=_LOWEST.get(name, 0.0))
        high = validation.number(highest, span[1], above=low)
        if is_log:
            validation.number(lowest, low, above=0.0)
        usual = _usual(case, name)
        result.append(FreeParameter(name, UNITS[name], low, high, usual, source, is_log))
    return tuple(result)


def changed(case: Case, values: Mapping[str, float]) -> Case:
    """Return a copy of a case with values for parameters."""
    for name in filter(values.__contains__, UNITS):
        value, lava = values[name], case.scene.lava
        if name == 'discharge':
            case = case.with_lava({}, discharge=value)
        elif name == 'vent_temperature':
            case = case.with_lava({}, temperature=value)
        elif name == 'viscosity' and lava.is_vft:
            # shift the law so that lava has this viscosity at the vent
            case = case.with_lava({'vft_a': lava.vft_a + math.log10(value / _usual(case, name))})
        else:
            case = case.with_lava({name: value})
    return case


def _published(case: Case) -> dict[str, Constant]:
    known = {**case.material.constants, 'vent_temperature': case.material.vent_temperature}
    known['discharge'] = DISCHARGE
    return {name: known[name] for name in UNITS if name in known and known[name].range}


def _usual(case: Case, name: str) -> float:
    lava, hottest = case.scene.lava, max(vent.temperature for vent in case.scene.vents)
    known = {'discharge': 1.0, 'vent_temperature': hottest}
    if lava.is_vft:
        known['viscosity'] = lava.viscosity_at(hottest)
    return known[name] if name in known else float(getattr(lava, name))
