# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of effusion rates: mean rates, rates at instants, or erupted volumes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from itertools import pairwise
import logging
import math
from pathlib import Path
from typing import NamedTuple

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError, Typed
from lava_ros.files import warn_of_unknown
from lava_ros.files.columns import Column, understood
from lava_ros.files.csv import read_table
from lava_ros.files.keys import DATE, Key, Keys, TEXT
from lava_ros.scene.distributions import Distribution
from lava_ros.scene.measurements import RATE_ERRORS
from lava_ros.scene.plausibility import check_date
from lava_ros.scene.vent_keys import MAX_DISCHARGE

_LOG = logging.getLogger(__name__)

#: Effusion rate in a time without data: 0, or interpolated linearly.
GAPS = ('zero', 'interpolate')

#: All columns, and those of which a table has one set; it may have errors as well.
COLUMNS = ('start', 'end', 'time', 'effusion_rate', 'volume', 'cumulative_volume', 'error')
_SETS = (
    ('start', 'end', 'effusion_rate'), ('start', 'end', 'volume'), ('time', 'effusion_rate'),
    ('time', 'cumulative_volume'),
)


@dataclass(frozen=True)
class Interval:
    """An interval of time [s] with the mean effusion rate of all vents together [m3/s].

    ``error`` is the standard error of the rate [m3/s], None if the table has none.
    """

    start: float
    end: float
    discharge: float
    error: float | None = None

    @property
    def volume(self) -> float:
        """Volume of the interval [m3]."""
        return self.discharge * (self.end - self.start)


class RateTable(NamedTuple):
    """The intervals of a table, of increasing time, and the date of time 0; None without one."""

    intervals: tuple[Interval, ...]
    origin: datetime | None = None


def _porosity(label: str, value: object) -> float:
    fraction = validation.number(label, value, at_least=0.0)
    if fraction >= 1.0:
        raise LavaError(label, value, 'at least 0 and below 1')
    return fraction


#: Keys of the choices for reading a table, in a file, and checks of ``Options``.
RATE_KEYS = Keys({
    'start': Key(
        validation.date,
        'Date of the start of the eruption, which is time 0, in UTC unless it has a time zone',
        schema=DATE,
    ),
    'gaps': Key(
        partial(validation.choice, allowed=GAPS), 'Effusion rate in a time without data'
    ),
    'measured': Key(
        partial(validation.choice, allowed=tuple(RATE_ERRORS)),
        'Method of measurement, for the error of rates without errors',
    ),
    'porosity': Key(
        _porosity, 'Fraction of bubbles: rates are dense-rock equivalents',
        schema={'type': 'number', 'minimum': 0.0, 'exclusiveMaximum': 1.0},
    ),
})

#: Keys of a table and of the choices for reading it.
TABLE_KEYS = Keys({
    'file': Key(TEXT, 'File, relative to this one', True), **RATE_KEYS.keys,
})


@dataclass(frozen=True)
class Options:
    """Choices for reading a table of effusion rates.

    Attributes:
        start: Date of the start of the eruption (ISO 8601), which is time 0; None: the first date
            in the table.
        gaps: One of ``GAPS``; None: times between intervals have no lava, with a warning, and a
            cell without a number is an error.
        porosity: Volume fraction of bubbles, which converts the dense-rock equivalents of the
            table to bulk rates by the factor 1 / (1 - porosity). None: the rates are bulk.
        measured: Method by which the rates were measured, one of ``measurements.RATE_ERRORS``,
            which states their error if the table has none; None: not stated.
    """

    start: str | None = None
    gaps: str | None = None
    porosity: float | None = None
    measured: str | None = None

    def __post_init__(self) -> None:
        """Validate all fields; raise LavaError for an invalid one."""
        given = {name: value for name, value in vars(self).items() if value is not None}
        valid = RATE_KEYS.values('effusion_rate', given)
        if self.porosity is not None:
            object.__setattr__(self, 'porosity', valid['porosity'])

    @property
    def origin(self) -> datetime | None:
        """Date of time 0, in UTC unless it has a time zone; None if it is not given."""
        return None if self.start is None else validation.date('effusion_rate.start', self.start)


def read_effusion_rates(
    field: str, path: str | Path, options: Options | None = None
) -> RateTable:
    """Read a table of effusion rates, and log its interpretation.

    The columns are ``start`` and ``end`` with mean rates or volumes, or ``time`` with the
    cumulative volume or with rates at instants, between which the rate changes linearly. Names,
    units and synonyms are those of ``columns.COLUMNS``. Times are in seconds, in the unit of the
    header, or dates (ISO 8601, UTC unless they have a time zone).

    Returns:
        Intervals that do not overlap, and the date of time 0: that of the options or, without
        it, the first date in the table.

    Raises:
        LavaError: If the table cannot be read, or a value is not usable.
    """
    options = Options() if options is None else options
    path = Path(path)
    rows = read_table(field, path)
    columns, others = understood(str(path), rows[0][1], COLUMNS)
    if 'volume' in columns and 'time' in columns:
        # a volume at an instant is cumulative
        columns['cumulative_volume'] = columns.pop('volume')
    known = tuple(name for name in COLUMNS[:-1] if name in columns)
    if known not in _SETS:
        expected = 'the columns start, end and effusion_rate or volume, or time and effusion_rate '
        expected += 'or cumulative_volume'
        raise LavaError(f'{path}, first line', ','.join(rows[0][1]), expected)
    *times, amount = known
    warn_of_unknown(path, 'columns', others)
    if amount == 'cumulative_volume' and 'error' in columns:
        _LOG.warning(f'{path}: errors of a cumulative volume are not used')
    factor = _bulk_factor(path, columns[amount], options)
    clock = _Clock(options.origin)
    read = []
    for where, row in rows:
        when = [clock.seconds(where, columns[name], row) for name in times]
        rate = _number(where, columns[amount], row, options.gaps is not None)
        error = _number(where, columns['error'], row, True) if 'error' in columns else math.nan
        if 'error' in columns and columns['error'].unit in ('%', 'percent'):
            error *= rate
        if math.isnan(rate) and options.gaps == 'interpolate' and times == ['time']:
            _LOG.warning(f'{where}: no {columns[amount].header}, interpolated in time')
        else:
            typed = tuple(row[columns[name].header] for name in times)
            text = row[columns[amount].header]
            read.append(_Row(where, when[0], when[-1], rate, error, typed, text))
    result = []
    for item in _mean_rates(str(path), read, columns, amount, options.gaps):
        rate, error = item.value * factor, item.error * factor
        if rate > MAX_DISCHARGE:
            expected = f'a rate of 0 to {MAX_DISCHARGE:g} m3/s'
            columns[amount].refuse(item.where, item.typed_value or rate, expected)
        known_error = None if math.isnan(error) else error
        result.append(Interval(item.start, item.end, rate, known_error))
    if not any(interval.discharge > 0.0 for interval in result):
        problem = f'{path} contains no effusion rate above 0'
        raise RefusalError(str(path), problem, 'Check its columns')
    kind = 'cumulative volumes' if amount == 'cumulative_volume' else (
        'means between rates of instants' if times == ['time'] else 'mean rates'
    )
    origin = f', time 0 is {clock.origin.isoformat()}' if clock.origin else ''
    plural = 's' * (len(result) > 1)
    _LOG.info(
        f'{path}: {len(result)} interval{plural} of {kind}, '
        f'{result[0].start:g} to {result[-1].end:g} s, '
        f'{sum(interval.volume for interval in result):.3g} m3 in all{origin}'
    )
    return RateTable(tuple(result), clock.origin)


def check_start(field: str, intervals: Sequence[Interval]) -> None:
    """Warn of lava before time 0, which a simulation leaves out.

    Raises:
        LavaError: If all lava comes out before time 0. The error names ``field``.
    """
    whole = sum(item.volume for item in intervals)
    lost = sum(item.discharge * (min(item.end, 0.0) - min(item.start, 0.0)) for item in intervals)
    if lost == 0.0:
        return
    shown = f'{lost:.3g} of {whole:.3g} m3 before the start of the eruption'
    if lost >= whole:
        problem = f'All lava of {field} comes out before the start of the eruption'
        remedy = 'Check the dates; dates without a time zone are in UTC'
        raise RefusalError(field, problem, remedy)
    _LOG.warning(f'{field}: {shown} are left out; dates without a time zone are in UTC')


def series_of_rates(intervals: Sequence[Interval]) -> tuple[tuple[float, float], ...]:
    """Return (time [s], rate [m3/s]) pairs; each rate holds until the next, and the last is 0."""
    series: list[tuple[float, float]] = []
    for item in intervals:
        if series and series[-1][0] == item.start:
            series.pop()
        series += [(item.start, item.discharge), (item.end, 0.0)]
    return tuple(series)


def error_of_rates(
    intervals: Sequence[Interval], measured: str | None = None
) -> Distribution | None:
    """Return the distribution of a common factor on all rates.

    The errors of a method are fully correlated in time, so that they add up: the relative standard
    deviation of the factor is the relative error of the volume, and its median is 1. Rates without
    errors have those of the method ``measured``; None without both.
    """
    known = [item for item in intervals if item.error is not None]
    volume = sum(item.volume for item in known)
    error = sum((item.error or 0.0) * (item.end - item.start) for item in known)
    if not volume or not error:
        return None if measured is None else RATE_ERRORS[measured]
    factor = math.exp(math.sqrt(math.log1p((error / volume) ** 2)))
    return Distribution('lognormal', (1.0, factor), source='errors in the table of effusion rates')


def instants_to_series(
    where: str, instants: Sequence[tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Return a series of rates [m3/s], the means of linear changes between instants [s]."""
    rows = [_Row(where, time, time, rate) for time, rate in instants]
    found = _mean_rates(where, rows, {'time': Column('time')}, '', None)
    return series_of_rates([Interval(row.start, row.end, row.value) for row in found])


class _Row(NamedTuple):
    """A row: label in errors, times [s], and rate [m3/s] or volume [m3], NaN if missing.

    ``typed`` are the texts of its times in the table, and ``typed_value`` that of its value, if
    any.
    """

    where: str
    start: float
    end: float
    value: float
    error: float = math.nan
    typed: tuple[str, ...] = ()
    typed_value: str = ''

    def time(self, number: int) -> str | float:
        """Return its first (0) or last (-1) time as in the table, or in seconds if that is it."""
        seconds = self.start if number == 0 else self.end
        are_seconds = isinstance(seconds, Typed) and not seconds.has_unit
        return seconds if are_seconds or not self.typed else self.typed[number]

    def words(self, number: int) -> str:
        """Return a time as ``time``, with its unit if it is in seconds."""
        time = self.time(number)
        return f'{time:g} s' if isinstance(time, float) else time


class _Clock:
    """Converter of times in a table to seconds since the start, or since the first date."""

    def __init__(self, origin: datetime | None) -> None:
        self.origin = origin
        if origin is not None:
            check_date('effusion_rate.start', origin)
        self._is_date: bool | None = None

    def seconds(self, where: str, column: Column, row: Mapping[str, str]) -> float:
        """Return the time [s] in a row."""
        text, date, time = row[column.header], None, 0.0
        try:
            time = column.number(where, text)
        except LavaError:
            other = '' if column.is_date else 'a finite number, or '
            date = validation.date(f'{where}, {column.header}', text, other)
        if self._is_date not in (None, date is not None):
            column.refuse(where, text, 'dates in all rows, or numbers in all')
        self._is_date = date is not None
        if date is None:
            return time
        if self.origin is None:
            self.origin = date
            check_date(f'{where}, {column.header}', date)
            _LOG.warning(f'{where}: the eruption is taken to start with the first date, {text}')
        return (date - self.origin).total_seconds()


def _bulk_factor(path: Path, column: Column, options: Options) -> float:
    """Return the ratio of the bulk volume to the volume in a table."""
    if column.kind == 'dense-rock' and options.porosity is None:
        expected = 'a porosity, which converts dense-rock to bulk rates'
        column.refuse(str(path), 'dense-rock', expected)
    if column.kind == 'bulk' and options.porosity:
        reason = f'because {path} has bulk rates'
        raise validation.surplus('effusion_rate.porosity', reason)
    return 1.0 / (1.0 - (options.porosity or 0.0))


def _number(
    where: str, column: Column, row: Mapping[str, str], may_be_missing: bool
) -> float:
    """Return a number of a row, at least 0; NaN for a missing number that may be missing."""
    text = row[column.header]
    is_missing = text.lower() in ('', '-', '--', 'na', 'n/a', 'nan', 'nodata', 'no data')
    if is_missing and may_be_missing:
        return math.nan
    if is_missing:
        column.refuse(where, text, 'a finite number, or gaps: zero or interpolate')
    return column.number(where, text, at_least=0.0)


def _mean_rates(
    table: str, rows: list[_Row], columns: Mapping[str, Column], amount: str, gaps: str | None
) -> Iterator[_Row]:
    """Yield the mean rate of each interval, and warn of filled gaps."""
    is_instant, cumulative = 'time' in columns, columns.get('cumulative_volume')
    if is_instant and len(rows) < 2:
        problem = f'{rows[0].where} is the only row' if rows else f'{table} has no value'
        raise RefusalError(table, problem, 'Give the rates at two or more times')
    if is_instant:
        instants = rows if cumulative else list(_with_start(rows))
        rows = [_between(*pair, cumulative) for pair in pairwise(instants)]
    filled: list[_Row] = []
    for row in rows:
        span = row.end - row.start
        if span <= 0.0:
            name = 'the row before' if is_instant else 'its start'
            expected = f'a time after {name}, {row.words(0)}'
            columns['time' if is_instant else 'end'].refuse(row.where, row.time(-1), expected)
        before = filled[-1].end if filled else row.start
        # rounded times may overlap
        if row.start < before - 1e-6 * span:
            expected = f'at least {filled[-1].words(-1)}, where the row before ends'
            columns['start'].refuse(row.where, row.time(0), expected)
        if filled and row.start > before * (1.0 + 1e-12) + 1e-9:
            filled.append(_Row(row.where, before, row.start, math.nan))
        unit = span if 'volume' in amount else 1.0
        filled.append(row._replace(value=row.value / unit, error=row.error / unit))
    last = 0.0
    for index, row in enumerate(filled):
        if math.isnan(row.value):
            known = (item.value for item in filled[index:] if item.value >= 0.0)
            last = 0.5 * (last + next(known, 0.0)) if gaps == 'interpolate' else 0.0
            choice = '' if gaps else ' (gaps: zero or interpolate chooses)'
            _LOG.warning(
                f'{row.where}: no effusion rate from {row.start:g} to {row.end:g} s, taken to be '
                f'{last:.4g} m3/s{choice}'
            )
            row = row._replace(value=last, error=math.nan)
        last = row.value
        yield row


def _with_start(rows: Sequence[_Row]) -> Iterator[_Row]:
    """Yield rates at instants, and that at time 0, before which lava is left out."""
    yield rows[0]
    for before, row in pairwise(rows):
        if before.start < 0.0 < row.start and math.isfinite(before.value + row.value):
            part = before.start / (before.start - row.start)
            rate, error = (
                (1.0 - part) * one + part * other
                for one, other in ((before.value, row.value), (before.error, row.error))
            )
            yield before._replace(start=0.0, end=0.0, value=rate, error=error, typed=())
        yield row


def _between(first: _Row, last: _Row, volume: Column | None) -> _Row:
    """Return the interval between two instants, with its mean rate or erupted volume."""
    value, error = 0.5 * (first.value + last.value), math.nan
    errors = [row.error for row in (first, last) if not math.isnan(row.error)]
    if volume is not None:
        value = last.value - first.value
        if value < 0.0:
            expected = f'at least that of the row before, {first.typed_value}'
            volume.refuse(last.where, last.typed_value, expected)
    elif errors:
        error = sum(errors) / len(errors)
    typed = (*first.typed[:1], *last.typed[:1])
    return _Row(last.where, first.start, last.start, value, error, typed, last.typed_value)
