# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of effusion rates -> intervals with one rate: means, instants or erupted volumes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from datetime import datetime, timezone
from itertools import pairwise
import logging
import math
from pathlib import Path
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError
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
    rows = read_table(field, path, (), None)
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
    if others:
        _LOG.warning(f'{path}: columns that are not understood are ignored: {", ".join(others)}')
    if amount == 'cumulative_volume' and 'error' in columns:
        _LOG.warning(f'{path}: errors of a cumulative volume are not used')
    factor = _bulk_factor(path, columns[amount], options)
    times = _Times(options.start)
    read = []
    for where, row in rows:
        names = ('start', 'end') if has_spans else ('time',)
        when = [times.seconds(where, columns[name], row[columns[name].header]) for name in names]
        value = _amount(where, columns[amount], row, options)
        error = _error(where, columns, row, value) if value is not None else None
        read.append((where, when, value, error))
    if options.gaps == 'interpolate' and not has_spans:
        for where, _, value, _ in read:
            if value is None:
                _LOG.warning(f'{where}: no {columns[amount].header}, interpolated in time')
        read = [row for row in read if row[2] is not None]
    if has_spans:
        found = _of_spans(read, columns, is_volume=amount == 'volume')
    else:
        found = _of_instants(read, columns, is_cumulative=amount == 'cumulative_volume')
    wheres, intervals = _without_gaps(found, options)
    result = tuple(
        replace(
            item, discharge=item.discharge * factor,
            error=None if item.error is None else item.error * factor,
        )
        for item in intervals
    )
    for where, item in zip(wheres, result, strict=True):
        label = f'{where}, {columns[amount].header}'
        if not 0.0 <= item.discharge <= MAX_DISCHARGE:
            raise LavaError(label, item.discharge, f'0 to {MAX_DISCHARGE:g} m3/s')
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
    return result


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
    rows = [(where, [time], rate, None) for time, rate in instants]
    columns = {'time': Column('time'), 'effusion_rate': Column('effusion_rate')}
    found = _of_instants(rows, columns, is_cumulative=False)
    return series_of_rates(_without_gaps(found, Options())[1])


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


def _amount(where: str, column: Column, row: dict[str, str], options: Options) -> float | None:
    """Return the rate or volume of a row, None if it is missing and the options fill gaps."""
    text = row[column.header]
    if text.lower() in _MISSING and options.gaps is not None:
        return None
    label = f'{where}, {column.header}'
    try:
        value = column.number(where, text)
    except LavaError:
        right = 'a finite number'
        if text.lower() in _MISSING:
            right += ', or gaps: zero or interpolate'
        raise LavaError(label, text, right) from None
    if value < 0.0:
        raise LavaError(label, text, 'at least 0')
    return value


def _error(
    where: str, columns: dict[str, Column], row: dict[str, str], value: float
) -> float | None:
    """Return the standard error of a row in the unit of its value, None if it has none."""
    column = columns.get('error')
    if column is None or row[column.header].lower() in _MISSING:
        return None
    error = column.number(where, row[column.header])
    if error < 0.0:
        raise LavaError(f'{where}, {column.header}', row[column.header], 'at least 0')
    return error * value if column.unit in ('%', 'percent') else error


# where a row is, its start and end [s], rate (None: missing) and error [m3/s]
_Row = tuple[str, float, float, float | None, float | None]


def _of_spans(
    read: Sequence[Any], columns: Mapping[str, Column], *, is_volume: bool
) -> list[_Row]:
    """Return mean rates of intervals from rates or volumes."""
    rows: list[_Row] = []
    for where, (start, end), value, error in read:
        if end <= start:
            label = f'{where}, {columns["end"].header}'
            raise LavaError(label, end, f'a time after its start, {start:g} s')
        if rows and start < rows[-1][2] - _OVERLAP * (end - start):
            right = f'at least {rows[-1][2]:g} s, where the row before ends'
            raise LavaError(f'{where}, {columns["start"].header}', start, right)
        if is_volume and value is not None:
            value /= end - start
            error = None if error is None else error / (end - start)
        rows.append((where, start, end, value, error))
    return rows


def _of_instants(
    read: Sequence[Any], columns: Mapping[str, Column], *, is_cumulative: bool
) -> list[_Row]:
    """Return mean rates between instants from rates that are linear there, or from volumes."""
    if len(read) < 2:
        raise LavaError(read[0][0], 'the only row', 'at least two instants')
    rows: list[_Row] = []
    for (_, (start,), before, first), (where, (end,), after, last) in pairwise(read):
        if end <= start:
            right = f'a time after the row before, {start:g} s'
            raise LavaError(f'{where}, {columns["time"].header}', end, right)
        rate = None
        if before is not None and after is not None:
            if is_cumulative and after < before:
                label = f'{where}, {columns["cumulative_volume"].header}'
                raise LavaError(label, after, f'at least that of the row before, {before:g} m3')
            rate = (after - before) / (end - start) if is_cumulative else 0.5 * (before + after)
        errors = [error for error in (first, last) if error is not None]
        error = sum(errors) / len(errors) if errors and not is_cumulative else None
        rows.append((where, start, end, rate, error))
    return rows


def _without_gaps(
    rows: Sequence[_Row], options: Options
) -> tuple[list[str], list[Interval]]:
    """Fill times without a rate as the options say, and log each choice.

    Returns:
        What errors call each interval, and the intervals.
    """
    filled: list[_Row] = []
    for row in rows:
        if filled and row[1] > filled[-1][2] * (1.0 + 1e-12) + 1e-9:
            filled.append((row[0], filled[-1][2], row[1], None, None))
        filled.append(row)
    result: list[Interval] = []
    for index, (where, start, end, rate, error) in enumerate(filled):
        if rate is None:
            before = result[-1].discharge if result else 0.0
            later = [item[3] for item in filled[index:] if item[3] is not None]
            rate = 0.5 * (before + (later or [0.0])[0]) if options.gaps == 'interpolate' else 0.0
            choice = '' if options.gaps else ' (gaps: zero or interpolate chooses)'
            _LOG.warning(
                f'{where}: no effusion rate from {start:g} to {end:g} s, taken to be {rate:.4g} '
                f'm3/s{choice}'
            )
        result.append(Interval(start, end, rate, error))
    return [row[0] for row in filled], result
