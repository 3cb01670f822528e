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


"""The tables of a case: where the vents are, and what came out of them when."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
import math
from pathlib import Path

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.csv import read_table
from lava_ros.scene import MAX_DISCHARGE

#: Columns of ``effusion_rate.csv``.
RATE_COLUMNS = ('start_s', 'end_s', 'discharge_m3_per_s')

#: Columns of ``vent.csv``: those it needs, and those it may have.
VENT_COLUMNS = ('x', 'y')
MORE_VENT_COLUMNS = ('name', 'x_end', 'y_end', 'start_s', 'end_s', 'share')

#: Share of an interval that two of them may overlap by, for rounding.
_OVERLAP = 1e-6


@dataclass(frozen=True)
class Interval:
    """A time [s] with one discharge of all vents together [m3/s]."""

    start: float
    end: float
    discharge: float


@dataclass(frozen=True)
class VentRow:
    """A vent, in the coordinates of the elevation, and when it opens and closes [s].

    Attributes:
        place: Its centre, or one end of a fissure (x, y) [m].
        other_end: The other end of a fissure (x, y) [m], None for a point.
        share: Its part of the discharge, over the shares of all that are open.
        discharge: Its own [m3/s] as long as it is open, in place of a share; None: the share.
    """

    name: str
    place: tuple[float, float]
    other_end: tuple[float, float] | None = None
    start: float = -math.inf
    end: float = math.inf
    share: float = 1.0
    discharge: float | None = None

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """Its centre, or both ends of a fissure (x, y) [m]."""
        return (self.place,) if self.other_end is None else (self.place, self.other_end)


def read_rates(path: Path) -> tuple[Interval, ...]:
    """Read ``effusion_rate.csv``.

    Raises:
        LavaError: It is missing or empty, a number is not usable, or times are not in order.
    """
    intervals: list[Interval] = []
    for where, row in read_table('case', path, RATE_COLUMNS, ()):
        start, end, discharge = (_number(where, row, name) for name in RATE_COLUMNS)
        if end <= start:
            raise LavaError(f'{where}, end_s', end, f'a time after its start, {start:g} s')
        if intervals and start < intervals[-1].end - _OVERLAP * (end - start):
            right = f'at least {intervals[-1].end:g} s, where the row before ends'
            raise LavaError(f'{where}, start_s', start, right)
        if not 0.0 <= discharge <= MAX_DISCHARGE:
            right = f'0 to {MAX_DISCHARGE:g} m3/s'
            raise LavaError(f'{where}, discharge_m3_per_s', discharge, right)
        intervals.append(Interval(start, end, discharge))
    if not any(item.discharge > 0.0 for item in intervals):
        raise LavaError(str(path), 'a table without discharge', 'a discharge above 0 at some time')
    return tuple(intervals)


def read_vents(path: Path) -> tuple[VentRow, ...]:
    """Read ``vent.csv``.

    Raises:
        LavaError: It is missing or empty, or a value is not usable.
    """
    vents = []
    rows = read_table('case', path, VENT_COLUMNS, MORE_VENT_COLUMNS)
    for index, (where, row) in enumerate(rows):
        end_x, end_y = row.get('x_end', ''), row.get('y_end', '')
        if bool(end_x) != bool(end_y):
            raise LavaError(f'{where}, x_end and y_end', (end_x, end_y), 'both or neither')
        opens = _number(where, row, 'start_s') if row.get('start_s') else -math.inf
        closes = _number(where, row, 'end_s') if row.get('end_s') else math.inf
        if closes <= opens:
            raise LavaError(f'{where}, end_s', closes, f'a time after its start, {opens:g} s')
        share = _number(where, row, 'share') if row.get('share') else 1.0
        vents.append(
            VentRow(
                row.get('name') or f'vent {index}',
                (_number(where, row, 'x'), _number(where, row, 'y')),
                (_number(where, row, 'x_end'), _number(where, row, 'y_end')) if end_x else None,
                opens,
                closes,
                validation.number(f'{where}, share', share, above=0.0),
            )
        )
    return tuple(vents)


def series_of(
    vents: tuple[VentRow, ...], rates: tuple[Interval, ...]
) -> list[tuple[tuple[float, float], ...]]:
    """Divide the discharge among the vents that are open.

    Returns:
        For each vent (time [s], flux [m3/s]) pairs of increasing time; each flux holds until the
        next.

    Raises:
        LavaError: No vent is open while lava comes out.
    """
    times = {time for item in rates for time in (item.start, item.end)}
    times |= {time for vent in vents for time in (vent.start, vent.end) if math.isfinite(time)}
    result: list[list[tuple[float, float]]] = [[] for _ in vents]
    row = 0
    has_shares = any(vent.discharge is None for vent in vents)
    for time in sorted(times):
        # rows end one after the other
        while row < len(rates) and rates[row].end <= time:
            row += 1
        is_on = row < len(rates) and rates[row].start <= time
        discharge = rates[row].discharge if is_on else 0.0
        is_open = [
            vent.start <= time < vent.end and rates[0].start <= time < rates[-1].end
            for vent in vents
        ]
        shares = [
            vent.share if vent.discharge is None and now else 0.0
            for vent, now in zip(vents, is_open, strict=True)
        ]
        if discharge > 0.0 and has_shares and not any(shares):
            right = 'at least one row of vent.csv with start_s <= t < end_s: lava comes out then'
            raise LavaError(f'vents open at {time:g} s', 0, right)
        for series, share, vent, now in zip(result, shares, vents, is_open, strict=True):
            flux = discharge * share / sum(shares) if share else 0.0
            if vent.discharge is not None:
                flux = vent.discharge if now else 0.0
            if not series or flux != series[-1][1]:
                series.append((time, flux))
    return [tuple(series) for series in result]


def volume_of(vents: Sequence[Sequence[tuple[float, float]]]) -> float:
    """Volume [m3] of all that ``series_of`` gives; each series ends with 0."""
    return sum(
        flux * (end - start) for series in vents for (start, flux), (end, _) in pairwise(series)
    )


def _number(where: str, row: dict[str, str], name: str) -> float:
    return validation.number(f'{where}, {name}', row[name])
