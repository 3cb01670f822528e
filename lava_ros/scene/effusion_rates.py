# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of effusion rates -> intervals with one rate: means, instants or erupted volumes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from datetime import datetime, timezone
from itertools import pairwise
import logging
import math
from pathlib import Path
from typing import Any, NamedTuple

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files import warn_of_others
from lava_ros.files.columns import Column, understood
from lava_ros.files.csv import read_table
from lava_ros.scene.uncertainty import Distribution
from lava_ros.scene.vents import MAX_DISCHARGE

_LOG = logging.getLogger(__name__)

#: Effusion rate in a time without data: none, or on a line between its neighbours.
GAPS = ('zero', 'interpolate')

#: Columns of a table: one for what came out, and the others.
AMOUNTS = ('effusion_rate', 'volume', 'cumulative_volume')
COLUMNS = ('start', 'end', 'time', *AMOUNTS, 'error')

#: Cells without a rate.
_MISSING = ('', '-', '--', 'na', 'n/a', 'nan', 'nodata', 'no data')

#: Fraction of an interval that two of them may overlap by, for rounding.
_OVERLAP = 1e-6


@dataclass(frozen=True)
class Interval:
    """A time [s] with one effusion rate of all vents together [m3/s], the mean over it.

    ``error`` is the standard error of the rate [m3/s], None if the table has none.
    """

    start: float
    end: float
    discharge: float
    error: float | None = None


@dataclass(frozen=True)
class Options:
    """Choices for reading a table of effusion rates.

    Attributes:
        start: Date at which the eruption starts (ISO 8601), which is time 0; None: the first date
            of the table.
        gaps: One of ``GAPS``; None: times between intervals have no lava, with a warning, and
            cells without a number are refused.
        porosity: Fraction of the erupted lava that is bubbles: rates are dense-rock equivalents,
            and bulk rates are larger by 1 / (1 - porosity). None: rates are bulk.
    """

    start: str | None = None
    gaps: str | None = None
    porosity: float | None = None

    def __post_init__(self) -> None:
        """Validate every field; LavaError names one that is not usable."""
        if self.start is not None:
            _date('effusion_rate.start', self.start)
        if self.gaps is not None:
            validation.choice('effusion_rate.gaps', self.gaps, GAPS)
        if self.porosity is not None:
            value = validation.number('effusion_rate.porosity', self.porosity, at_least=0.0)
            if value >= 1.0:
                raise LavaError('effusion_rate.porosity', self.porosity, 'at least 0 and below 1')
            object.__setattr__(self, 'porosity', value)


def options_from_dict(label: str, data: object) -> Options:
    """Build options from the plain data of a YAML file; LavaError names what is wrong."""
    names = [item.name for item in fields(Options)]
    values: dict[str, Any] = validation.keys(label, data, allowed=names)
    try:
        return Options(**values)
    except LavaError as error:
        field = label + error.field.removeprefix('effusion_rate')
        raise LavaError(field, error.value, error.expected) from None


def read_effusion_rates(
    field: str, path: str | Path, options: Options | None = None
) -> tuple[Interval, ...]:
    """Read a table of effusion rates, and log how it was read.

    The columns are ``start`` and ``end`` with mean rates or volumes of intervals, or ``time`` with
    rates of instants, which change linearly between them, or with the cumulative volume. Names,
    units and synonyms are those of ``columns.COLUMNS``; times are seconds, another unit that the
    header names, or dates (ISO 8601, UTC unless they say another zone).

    Returns:
        Intervals of increasing time, which do not overlap.

    Raises:
        LavaError: The table cannot be read or has values that are not usable.
    """
    options = Options() if options is None else options
    path = Path(path)
    rows = read_table(field, path)
    columns, others = understood(str(path), rows[0][1], COLUMNS)
    if 'volume' in columns and 'time' in columns:
        # of instants a volume is what has come out by then
        columns['cumulative_volume'] = columns.pop('volume')
    amounts = [name for name in AMOUNTS if name in columns]
    has_spans = 'start' in columns
    if len(amounts) != 1 or has_spans == ('time' in columns) or has_spans != ('end' in columns):
        right = 'start, end and effusion_rate or volume, or time and effusion_rate or '
        right += 'cumulative_volume'
        raise LavaError(f'{path}, first line', ','.join(rows[0][1]), f'the columns {right}')
    amount = amounts[0]
    if amount == 'cumulative_volume' and has_spans:
        right = 'time in place of start and end'
        raise LavaError(f'{path}, first line', ','.join(rows[0][1]), right)
    warn_of_others(path, 'columns', others)
    if amount == 'cumulative_volume' and 'error' in columns:
        _LOG.warning(f'{path}: errors of a cumulative volume are not used')
    factor = _bulk_factor(path, columns[amount], options)
    times = _Times(options.start)
    read = []
    for where, row in rows:
        when = [times.seconds(where, columns[name], row[columns[name].header])
                for name in (('start', 'end') if has_spans else ('time',))]
        value, error = _number(where, columns[amount], row, options.gaps is not None), None
        if value is not None and 'error' in columns:
            error = _number(where, columns['error'], row, True)
            if error is not None and columns['error'].unit in ('%', 'percent'):
                error *= value
        if value is None and options.gaps == 'interpolate' and not has_spans:
            _LOG.warning(f'{where}: no {columns[amount].header}, interpolated in time')
        else:
            read.append(_Row(where, when[0], when[-1], value, error))
    result = []
    for where, item in _intervals(str(path), read, columns, amount, options.gaps):
        rate = item.discharge * factor
        if not 0.0 <= rate <= MAX_DISCHARGE:
            label = f'{where}, {columns[amount].header}'
            raise LavaError(label, rate, f'0 to {MAX_DISCHARGE:g} m3/s')
        error = None if item.error is None else item.error * factor
        result.append(replace(item, discharge=rate, error=error))
    if not any(item.discharge > 0.0 for item in result):
        raise LavaError(str(path), 'a table without lava', 'an effusion rate above 0 at some time')
    volume = sum(item.discharge * (item.end - item.start) for item in result)
    kind = 'mean rates' if has_spans else 'cumulative volumes' if amount != 'effusion_rate' else (
        'rates of instants, linear between them'
    )
    origin = f', time 0 is {times.origin.isoformat()}' if times.origin else ''
    _LOG.info(
        f'{path}: {len(result)} intervals of {kind}, {result[0].start:g} to {result[-1].end:g} s, '
        f'{volume:.3g} m3 in all{origin}'
    )
    return tuple(result)


def series_of_rates(intervals: Sequence[Interval]) -> tuple[tuple[float, float], ...]:
    """Return (time [s], rate [m3/s]) pairs, each until the next; the last is 0."""
    series: list[tuple[float, float]] = []
    for item in intervals:
        if series and series[-1][0] == item.start:
            series.pop()
        series += [(item.start, item.discharge), (item.end, 0.0)]
    return tuple(series)


def error_of_rates(intervals: Sequence[Interval]) -> Distribution | None:
    """Return the factor on all rates that their errors amount to, None without any.

    The errors of a method are the same at all times, so that they add up: the factor has the
    relative error of the volume as its relative standard deviation, and the median 1.
    """
    known = [item for item in intervals if item.error is not None]
    volume = sum(item.discharge * (item.end - item.start) for item in known)
    error = sum(item.error * (item.end - item.start) for item in known if item.error)
    if not volume or not error:
        return None
    return Distribution('lognormal', (1.0, math.exp(math.sqrt(math.log1p((error / volume) ** 2)))))


def instants_to_series(
    where: str, instants: Sequence[tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Return the series of rates [m3/s] that change linearly between instants [s]."""
    rows = [_Row(where, time, time, rate, None) for time, rate in instants]
    found = _intervals(where, rows, {'time': Column('time')}, 'effusion_rate', None)
    return series_of_rates([item for _, item in found])


class _Times:
    """Converter of the times of a table to seconds after the start, or after the first date."""

    def __init__(self, start: str | None) -> None:
        self.origin = None if start is None else _date('effusion_rate.start', start)
        self._is_date: bool | None = None

    def seconds(self, where: str, column: Column, text: str) -> float:
        """Return the time [s] of a cell."""
        label, date = f'{where}, {column.header}', None
        try:
            number = column.number(where, text)
        except LavaError:
            try:
                date = _date(label, text)
            except LavaError:
                right = 'a finite number, or a date such as 2021-09-19T14:10:00Z'
                raise LavaError(label, text, right) from None
        if self._is_date not in (None, date is not None):
            raise LavaError(label, text, 'dates in all rows, or numbers in all')
        self._is_date = date is not None
        if date is None:
            return number
        if self.origin is None:
            self.origin = date
            _LOG.warning(f'{where}: the eruption is taken to start with the first date, {text}')
        return (date - self.origin).total_seconds()


def _date(label: str, text: object) -> datetime:
    """Read a date; UTC unless it names another zone."""
    try:
        if not isinstance(text, str):
            raise ValueError
        # Python 3.10 does not read the Z
        date = datetime.fromisoformat(text.strip().replace('Z', '+00:00').replace('z', '+00:00'))
    except ValueError:
        raise LavaError(label, text, 'a date such as 2021-09-19T14:10:00Z') from None
    return date if date.tzinfo else date.replace(tzinfo=timezone.utc)


def _bulk_factor(path: Path, column: Column, options: Options) -> float:
    """Return the bulk volume over the volume in a table."""
    if column.kind == 'dense-rock' and options.porosity is None:
        right = 'a porosity, with which dense-rock rates become bulk rates'
        raise LavaError(f'{path}, {column.header}', 'dense-rock', right)
    if column.kind == 'bulk' and options.porosity:
        right = f'absent: {path} has bulk rates'
        raise LavaError('effusion_rate.porosity', options.porosity, right)
    return 1.0 / (1.0 - (options.porosity or 0.0))


def _number(
    where: str, column: Column, row: Mapping[str, str], may_be_missing: bool
) -> float | None:
    """Return the number of a row, at least 0; None if it is missing and may be."""
    text = row[column.header]
    is_missing = text.lower() in _MISSING
    if is_missing and may_be_missing:
        return None
    right = 'a finite number' + ', or gaps: zero or interpolate' * is_missing
    try:
        value = column.number(where, text)
    except LavaError:
        raise LavaError(f'{where}, {column.header}', text, right) from None
    if value < 0.0:
        raise LavaError(f'{where}, {column.header}', text, 'at least 0')
    return value


class _Row(NamedTuple):
    """A row: what errors call it, its times [s], and its rate [m3/s] or volume [m3], if known."""

    where: str
    start: float
    end: float
    value: float | None
    error: float | None


def _intervals(
    table: str, rows: list[_Row], columns: Mapping[str, Column], amount: str, gaps: str | None
) -> Iterator[tuple[str, Interval]]:
    """Yield mean rates of intervals, and what errors call each.

    Between instants rates change linearly. Times without a rate are filled as ``gaps`` says, and
    each choice is logged.
    """
    is_volume, is_instant = 'volume' in amount, 'time' in columns
    if is_instant and len(rows) < 2:
        where, shown = (rows[0].where, 'the only row') if rows else (table, 'no value')
        raise LavaError(where, shown, 'at least two instants')
    if is_instant:
        rows = [_between(*pair, columns.get('cumulative_volume')) for pair in pairwise(rows)]
    filled: list[_Row] = []
    for row in rows:
        where, start, end, value, error = row
        if end <= start:
            right = f'a time after {"the row before" if is_instant else "its start"}, {start:g} s'
            header = columns['time' if is_instant else 'end'].header
            raise LavaError(f'{where}, {header}', end, right)
        before = filled[-1].end if filled else start
        if start < before - _OVERLAP * (end - start):
            right = f'at least {before:g} s, where the row before ends'
            raise LavaError(f'{where}, {columns["start"].header}', start, right)
        if filled and start > before * (1.0 + 1e-12) + 1e-9:
            filled.append(_Row(where, before, start, None, None))
        if is_volume and value is not None:
            value, error = value / (end - start), error and error / (end - start)
        filled.append(_Row(where, start, end, value, error))
    last = 0.0
    for index, (where, start, end, rate, error) in enumerate(filled):
        if rate is None:
            later = next((row.value for row in filled[index:] if row.value is not None), 0.0)
            rate = 0.5 * (last + later) if gaps == 'interpolate' else 0.0
            choice = '' if gaps else ' (gaps: zero or interpolate chooses)'
            _LOG.warning(
                f'{where}: no effusion rate from {start:g} to {end:g} s, taken to be {rate:.4g} '
                f'm3/s{choice}'
            )
        last = rate
        yield where, Interval(start, end, rate, error)


def _between(first: _Row, last: _Row, volume: Column | None) -> _Row:
    """Return the time between two instants, with the mean rate or the volume that came out."""
    value = error = None
    if first.value is not None and last.value is not None:
        value = last.value - first.value if volume else 0.5 * (first.value + last.value)
        if volume and value < 0.0:
            right = f'at least that of the row before, {first.value:g} m3'
            raise LavaError(f'{last.where}, {volume.header}', last.value, right)
    errors = [row.error for row in (first, last) if row.error is not None]
    if errors and not volume:
        error = sum(errors) / len(errors)
    return _Row(last.where, first.start, last.start, value, error)
