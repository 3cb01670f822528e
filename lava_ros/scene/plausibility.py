# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Numbers that are valid but not to be believed, and the slips that explain them.

``RANGES`` is the table: a value outside of ``believed`` gives a warning, and one outside of
``possible`` an error unless the user insists. Both name the units in which the value is credible.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from datetime import datetime, timedelta, timezone
import logging
import math
from typing import Any, NamedTuple

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene.terrain import Terrain

_LOG = logging.getLogger(__name__)

#: Advice in errors.
INSIST = 'insist: true in the scene file or --insist accepts it'


class Slip(NamedTuple):
    """Another unit in which people write a quantity: SI = factor value + shift."""

    unit: str
    factor: float = 1.0
    shift: float = 0.0

    def convert(self, value: float) -> float:
        """Return a value in this unit in SI units."""
        return self.factor * value + self.shift


class Range(NamedTuple):
    """Values of a quantity.

    Attributes:
        unit: SI unit.
        believed: Minimum and maximum that a person would believe.
        possible: Minimum and maximum that can be.
        known: Known extremes, for people.
        slips: Units in which the quantity is given by mistake.
        is_largest: True if ``known`` explains only why a value is too large.
    """

    unit: str
    believed: tuple[float, float]
    possible: tuple[float, float]
    known: str
    slips: tuple[Slip, ...]
    is_largest: bool = False


#: 0 Celsius [K].
KELVIN = 273.15

_ANY = (-math.inf, math.inf)
_DAY = 86400.0

#: Units of effusion rates.
_RATES = (
    Slip('m3 a day', 1.0 / _DAY), Slip('m3 an hour', 1.0 / 3600.0),
    Slip('m3 a minute', 1.0 / 60.0), Slip('litres a second', 1e-3),
    Slip('km3 a day', 1e9 / _DAY),
)

#: Elevation below that of all land, the shore of the Dead Sea [m].
LOWEST_LAND = -450.0

#: Minimum and maximum fraction of cells at 0 m in an elevation with a sea.
MIN_SEA, MAX_SEA = 0.01, 0.95

#: Viscosity at the vent at or above which lava is silicic [Pa s].
SILICIC = 1e8

#: Ranges by quantity.
RANGES: Mapping[str, Range] = {
    'effusion rate': Range(
        'm3/s', (1e-3, 2e4), (0.0, 1e6),
        'the largest known are about 9,000 m3/s, in Laki 1783 (Thordarson and Self 1993)', _RATES,
        is_largest=True,
    ),
    'effusion rate of silicic lava': Range(
        'm3/s', (1e-4, 500.0), (0.0, 1e5),
        'the largest known are below 100 m3/s, in Chaiten 2008 and Cordon Caulle 2011', _RATES,
        is_largest=True,
    ),
    'vent radius': Range(
        'm', (0.02, 1000.0), (0.0, 1e5), 'lava lakes have radii of up to some 100 m',
        (Slip('cm', 0.01), Slip('mm', 1e-3), Slip('km', 1000.0)), is_largest=True,
    ),
    'temperature above the usual': Range(
        'K', (-300.0, 300.0), _ANY, 'lava of this material erupts near the usual',
        (Slip('Fahrenheit', 5.0 / 9.0, 255.372),),
    ),
    'viscosity at the vent': Range(
        'Pa s', (1e-2, 1e12), _ANY, 'from carbonatite to crystal-rich rhyolite',
        (Slip('poise', 0.1), Slip('kPa s', 1e3), Slip('MPa s', 1e6)),
    ),
    'density': Range(
        'kg/m3', (500.0, 3500.0), _ANY, 'from pumice to komatiite',
        (Slip('g/cm3', 1e3), Slip('lb/ft3', 16.0185)),
    ),
    'yield_strength': Range(
        'Pa', (1e-2, 1e6), _ANY, 'measured in lava',
        (Slip('kPa', 1e3), Slip('MPa', 1e6), Slip('hPa', 1e2), Slip('dyn/cm2', 0.1)),
    ),
    'conductivity': Range(
        'W/(m K)', (0.1, 10.0), _ANY, 'measured in rock', (Slip('mW/(m K)', 1e-3),),
    ),
    'specific_heat': Range(
        'J/(kg K)', (500.0, 2500.0), _ANY, 'measured in melts and rock',
        (Slip('kJ/(kg K)', 1e3), Slip('cal/(g K)', 4184.0)),
    ),
    'latent_heat': Range(
        'J/kg', (5e4, 1e6), _ANY, 'measured in melts', (Slip('kJ/kg', 1e3), Slip('cal/g', 4184.0)),
    ),
    'gravity': Range(
        'm/s2', (0.5, 30.0), _ANY, 'from a small moon to Jupiter',
        (Slip('cm/s2', 0.01), Slip('mm/s2', 1e-3), Slip('g', 9.81)),
    ),
    'time': Range(
        's', (0.0, 3.2e9), _ANY, 'a century',
        (Slip('ms', 1e-3), Slip('microseconds', 1e-6), Slip('nanoseconds', 1e-9)),
    ),
    'relief over extent': Range(
        '', (1e-3, 1.5), _ANY, '', (Slip('kilometres', 1000.0), Slip('feet', 0.3048),
                                   Slip('decimetres', 0.1), Slip('centimetres', 0.01),
                                   Slip('millimetres', 1e-3)),
    ),
    'cell size': Range(
        'm', (0.02, 500.0), _ANY, 'elevation models for lava have cells of up to 90 m',
        (Slip('centimetres', 0.01), Slip('millimetres', 1e-3)), is_largest=True,
    ),
}


#: Constants of a lava in ``RANGES``.
_CONSTANTS = ('density', 'conductivity', 'specific_heat', 'latent_heat', 'yield_strength')


class Doubt(NamedTuple):
    """A value that is hard to believe.

    Attributes:
        text: Warning: the name, the value, and the likely slips.
        error: The error if the value cannot be, None if it can.
    """

    text: str
    error: LavaError | None = None


def doubt_about(field: str, value: float, quantity: str, *, usual: float = 0.0) -> list[Doubt]:
    """Return the doubt about a value, none if a person would believe it.

    Args:
        field: Name of the field as the user knows it.
        value: Value in SI units.
        quantity: Key of ``RANGES``.
        usual: Value from which the range of the quantity counts.
    """
    item = RANGES[quantity]
    low, high = (usual + end for end in item.believed)
    if low <= value <= high:
        return []
    meant = [
        f'{value:g} {slip.unit} would be {slip.convert(value):.3g} {item.unit}'
        for slip in item.slips if low <= slip.convert(value) <= high
    ]
    reasons = '; '.join(meant if item.is_largest and value < low else [item.known, *meant])
    limit = f'above {high:g}' if value > high else f'below {low:g}'
    text = f'{field} is {value:g} {item.unit}, {limit} {item.unit}'
    text += f': {reasons}' if reasons else ''
    least, most = (usual + end for end in item.possible)
    if least <= value <= most:
        return [Doubt(text)]
    expected = f'{least:g} to {most:g} {item.unit}: {reasons} ({INSIST})'
    return [Doubt(text, LavaError(field, value, expected))]


def report(doubts: Iterable[Doubt], *, insist: bool = False) -> None:
    """Log doubts as warnings.

    Raises:
        LavaError: If a value cannot be, unless the user insists.
    """
    for doubt in doubts:
        if doubt.error is not None and not insist:
            raise doubt.error
        _LOG.warning(doubt.text)


def doubts_of_scene(scene: Any) -> Iterator[Doubt]:
    """Yield the doubts about the vents, the lava and the surroundings of a scene."""
    lava = scene.lava
    usual = lava.liquidus if lava.is_vft else lava.reference_temperature
    for index, vent in enumerate(scene.vents):
        label = f'vents[{index}]'
        viscosity = lava.viscosity_at(vent.temperature)
        kind = 'effusion rate' + ' of silicic lava' * (viscosity >= SILICIC)
        # lava of a laboratory is on a terrain with small cells
        if vent.peak > 0.0 and (vent.peak > 1.0 or scene.terrain.resolution >= 1.0):
            yield from doubt_about(f'{label}.effusion_rate', vent.peak, kind)
        if scene.terrain.resolution >= 1.0 or vent.radius > 1.0:
            yield from doubt_about(f'{label}.radius', vent.radius, 'vent radius')
        # another check finds Celsius
        if abs(vent.temperature + KELVIN - usual) >= abs(vent.temperature - usual):
            name, above = f'{label}.temperature', 'temperature above the usual'
            yield from doubt_about(name, vent.temperature, above, usual=usual)
        last = vent.series[-1][0]
        if math.isfinite(last):
            yield from doubt_about(f'{label}.effusion_rate, time', max(last, 0.0), 'time')
        if index == 0:
            name = 'viscosity at the vent'
            yield from doubt_about(f'lava, {name}', viscosity, name)
    for vent, count in Counter(replace(vent, name='') for vent in scene.vents).items():
        if count > 1 and vent.peak > 0.0:
            ends = [vent.position] if vent.end is None else [vent.position, vent.end]
            east_north = np.add(ends, scene.terrain.offset).tolist()
            place = ' to '.join(f'{x:.10g}, {y:.10g}' for x, y in east_north)
            yield Doubt(
                f'{count} vents at {place} are alike, and each emits {vent.peak:g} m3/s at most'
            )
    # 0 switches a constant off; those of an effect that was deleted are missing
    for name in _CONSTANTS:
        if value := getattr(lava, name, 0.0):
            yield from doubt_about(f'lava.{name}', value, name)
    yield from doubt_about('gravity', scene.gravity, 'gravity')


def doubts_of_terrain(terrain: Terrain, name: str) -> Iterator[Doubt]:
    """Yield the doubts about the units of an elevation and of its cells.

    The relief is compared with the extent: a volcano is neither flat nor a needle.
    """
    low, high = float(np.nanmin(terrain.elevation)), float(np.nanmax(terrain.elevation))
    extent, relief = max(terrain.shape) * terrain.resolution, high - low
    item = RANGES['relief over extent']
    yield from doubt_about(f'cell size of {name}', terrain.resolution, 'cell size')
    least, most = item.believed
    is_flat = 0.0 < relief < least * extent and max(abs(low), abs(high)) <= 9.0
    # a few boxes on the floor of a laboratory, and cliffs in a small window, are steep
    if is_flat or (relief > most * extent and relief > 1000.0):
        meant = [
            f'in {slip.unit} it would be {slip.convert(relief):.3g} m'
            for slip in item.slips if 3.0 * least <= slip.convert(relief) / extent <= most
        ]
        if not is_flat and least <= relief / (1000.0 * extent) <= most:
            meant.append(f'with cells in kilometres the extent would be {1000.0 * extent:.3g} m')
        text = f'{name}: the relief is {relief:.3g} m over {extent:.4g} m, '
        text += 'unusually flat' if is_flat else 'unusually steep'
        yield Doubt(f'{text}: {"; ".join(meant)}')


def doubts_of_sea(
    elevation: np.ndarray, name: str, *, is_on_earth: bool = True
) -> Iterator[Doubt]:
    """Yield a doubt about cells that are probably the sea: at exactly 0 m, or below all land."""
    known = elevation[np.isfinite(elevation)]
    if not known.size:
        return
    is_deep = is_on_earth and known.min() < LOWEST_LAND
    part = float((known <= 0.0 if is_deep else known == 0.0).mean())
    is_level = known.min() == 0.0 and MIN_SEA <= part <= MAX_SEA and known.max() > 10.0
    if is_deep or is_level:
        where = f'below 0 m, down to {known.min():.6g} m' if is_deep else 'at 0 m'
        yield Doubt(
            f'{name}: {100.0 * part:.2g} % of the cells are {where}, and lava flows over them as '
            'over ground: if they are the sea, --sea-level 0 or terrain.sea_level: 0 in a scene '
            'file ends the flow at the coast; --nodata none keeps them without this warning'
        )


def check_date(field: str, date: datetime, now: datetime | None = None) -> None:
    """Log a warning for a date of an eruption in the future, or more than 500 years ago."""
    now = now or datetime.now(timezone.utc)
    if date > now + timedelta(days=1):
        text = f'{field} is {date:%Y-%m-%d}, after the date of the clock, {now:%Y-%m-%d}'
    elif date.year < now.year - 500:
        text = f'{field} is {date:%Y-%m-%d}, more than 500 years ago'
    else:
        return
    swapped = []
    if date.day <= 12 and date.day != date.month:
        other = date.replace(month=date.day, day=date.month)
        if other <= now and now.year - other.year < 500:
            swapped.append(f'with day and month swapped it would be {other:%Y-%m-%d}')
    # 2121 for 2021, 1021 for 2021
    years = [date.year + step for step in (-100, -1000, 1000, -10, 10)]
    swapped += [f'a digit of the year may be wrong ({year})' for year in years
                if now.year - 30 <= year <= now.year][:1]
    _LOG.warning('; '.join((text, *swapped)))
