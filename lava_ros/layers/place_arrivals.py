# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrival of lava at places, from maps of arrival times.

Lava has arrived at a place when it has touched any of the cells that the place touches.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any, TYPE_CHECKING

import numpy as np

from lava_ros.files.csv import format_table
from lava_ros.layers.forecast import (
    EnsembleForecast,
    Forecast,
    probability_words,
    QUANTILES,
)
from lava_ros.layers.numbers import area_words, duration
from lava_ros.layers.places import front_distances, Places
from lava_ros.scene import Terrain
from lava_ros.scene.onset import Onset
from lava_ros.simulation.output.inundation import reached_cells

if TYPE_CHECKING:
    # importing the solver loads Warp, which is not needed here
    from lava_ros.simulation.output.snapshot import Snapshot

#: Measure of a kind of place, and its unit.
_MEASURES = {'line': ('length', 'm'), 'area': ('area', 'm2')}


@dataclass(frozen=True)
class PlaceArrival:
    """Arrival of lava at a place; values are None if unknown, or if lava does not arrive.

    Attributes:
        name: Name of the place.
        kind: ``point``, ``line`` or ``area``.
        off_map: Fraction of the place outside the map.
        probability: Probability of arrival, 0 to 100; 0 or 100 for a single run. None also
            without a forecast.
        arrival: Simulated time [s] by which lava has arrived in a fraction of the members, by the
            fractions in ``QUANTILES``; all equal for a single run.
        earliest: Earliest arrival in any member [s]; for a single run, its arrival.
        members: Effective number of members; None for a single run.
        front_distance: Distance to the nearest cell inundated so far [m].
        whole: Length [m] or area [m2] of the place.
        inundated: Length [m] or area [m2] inundated in at least a fraction of the members.
    """

    name: str
    kind: str
    off_map: float
    probability: float | None
    arrival: Mapping[float, float | None]
    front_distance: float | None
    whole: float
    inundated: Mapping[float, float | None]
    earliest: float | None = None
    members: float | None = None

    @property
    def is_known(self) -> bool:
        """True if some part of the place is on the map."""
        return self.off_map < 1.0

    def record(self) -> dict[str, Any]:
        """Return the place as a row of the table, with the columns of its kind."""
        result: dict[str, Any] = {
            'name': self.name,
            'kind': self.kind,
            'off_map_percent': _rounded(100.0 * self.off_map),
            'probability_percent': self.probability,
            'probability_text': self.probability_words,
            'arrival_earliest_s': self.earliest,
            **{f'arrival_p{100 * part:.0f}_s': time for part, time in self.arrival.items()},
            'front_distance_m': _rounded(self.front_distance),
        }
        if self.kind in _MEASURES:
            measure, unit = _MEASURES[self.kind]
            result[f'{measure}_{unit}'] = _rounded(self.whole)
            for fraction, size in self.inundated.items():
                result[f'inundated_{measure}_p{100 * fraction:.0f}_{unit}'] = _rounded(size)
        return result

    @property
    def probability_words(self) -> str | None:
        """The probability for people: below or above a limit if all members agree."""
        if self.probability is None:
            return None
        if self.members is None:
            return f'{self.probability:.0f} %'
        return probability_words(self.probability, self.members)

    def size_words(self, fraction: float) -> str:
        """Format the inundated length or area in a fraction of the members; empty for a point."""
        size = self.inundated[fraction]
        if self.kind not in _MEASURES or size is None:
            return ''
        return f'{size:.0f} m' if self.kind == 'line' else area_words(size)

    def map_words(self) -> str:
        """Describe the part of the place off the map; empty if there is none."""
        if not self.is_known:
            return f'{OFF_MAP}: nothing is known'
        return f'{100.0 * self.off_map:.2g} % of it off the map' if self.off_map else ''


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


#: Text for a place outside the map.
OFF_MAP = 'off the map'

_UNKNOWN = dict.fromkeys(QUANTILES)

_MEASURED = tuple(dict.fromkeys(
    name
    for kind in _MEASURES
    for name in PlaceArrival('', kind, 0.0, None, _UNKNOWN, None, 0.0, _UNKNOWN).record()
))

#: Columns with the dates of arrival, by the column with the time.
DATES = {
    name: f'{name.removesuffix("_s")}_utc' for name in _MEASURED if name.startswith('arrival_')
}

#: Columns of the table for all kinds of places; JSON has only the columns of the place's kind.
COLUMNS = (*_MEASURED, *DATES.values())


def arrivals(
    places: Places,
    cells: Mapping[float, np.ndarray],
    parts: Mapping[float, np.ndarray],
    *,
    probability: np.ndarray | None = None,
    first: Mapping[float, np.ndarray] | None = None,
    front: np.ndarray | None = None,
    earliest: np.ndarray | None = None,
    members: float | None = None,
) -> tuple[PlaceArrival, ...]:
    """Return the arrival of lava at places.

    Args:
        places: The places.
        cells: Arrival times [s] in the cells that they touch (``Places.at``), by the fraction of
            the members; NaN where lava arrives in fewer.
        parts: Fractions of these cells that lava has covered, by the fraction of the members.
        probability: Probability that lava arrives at a place, 0 to 100, shape [places]; None for
            a single run.
        first: Times [s] by which lava has arrived at a place, by the fraction of the members, NaN
            where it arrives in fewer, shape [places]. They do not follow from ``cells``, because
            members may reach different cells of a line or area. None for a single run.
        front: Distance of each place from the lava now [m], NaN without lava, shape [places].
        earliest: Earliest arrival in any member [s], NaN without one, shape [places]; None for a
            single run.
        members: Effective number of members; None for a single run.

    Returns:
        A row for each place.
    """
    first = first or {fraction: places.first(values) for fraction, values in cells.items()}
    if probability is None:
        probability = 100.0 * np.isfinite(first[QUANTILES[0]])
    sizes = {fraction: places.inundated(part) for fraction, part in parts.items()}

    def known(values: np.ndarray | None, index: int) -> float | None:
        value = math.nan if values is None else float(values[index])
        return value if places.off_map[index] < 1.0 and math.isfinite(value) else None

    return tuple(
        PlaceArrival(
            name=name,
            kind=places.kinds[index],
            off_map=float(places.off_map[index]),
            probability=known(probability, index),
            arrival={fraction: known(times, index) for fraction, times in first.items()},
            # known even for places off the map
            front_distance=None if front is None or math.isnan(front[index])
            else float(front[index]),
            whole=float(places.whole[index]),
            inundated={fraction: known(values, index) for fraction, values in sizes.items()},
            earliest=known(first[QUANTILES[0]] if earliest is None else earliest, index),
            # lava that is present has arrived with certainty
            members=None if front is not None and front[index] <= 0.0 else members,
        )
        for index, name in enumerate(places.names)
    )


@dataclass(frozen=True)
class ArrivalTable:
    """Arrival of lava at places: a row for each place, and facts about the table.

    ``facts`` are plain data: the threshold, the end of the covered time, the number of members.
    ``onset`` is the date of simulated time 0; None if it is unknown.
    """

    rows: tuple[PlaceArrival, ...]
    facts: Mapping[str, Any]
    is_ensemble: bool
    onset: Onset | None = None

    @property
    def summary(self) -> str:
        """Definition of the times, for people."""
        facts = self.facts
        words = f'lava at least {facts["inundation_threshold_m"]:g} m thick, times from the start'
        if facts.get('time_s') is not None:
            words += f', up to {duration(facts["time_s"])}'
        if self.is_ensemble:
            words += f', within {duration(facts["horizon_s"])}, of {facts["members"]} members'
        if self.onset is not None:
            words += f'; the start is {self.onset.words()}'
        return f'{words}; {facts["note"]}' if 'note' in facts else words

    def as_dict(self) -> dict[str, Any]:
        """Return the table as plain data for JSON; unknown values are None."""
        onset = None if self.onset is None else self.onset.utc()
        return {**self.facts, 'onset_utc': onset, 'places': self._records()}

    def as_csv(self) -> str:
        """Format the table as CSV; unknown values are empty."""
        return format_table(COLUMNS, self._records())

    def _records(self) -> list[dict[str, Any]]:
        """Return the rows with the date of each arrival; None if it is unknown."""
        return [
            {
                **record,
                **{
                    date: None if record[time] is None or self.onset is None
                    else self.onset.utc(record[time])
                    for time, date in DATES.items()
                },
            }
            for record in (row.record() for row in self.rows)
        ]

    def as_texts(self) -> list[tuple[str, ...]]:
        """Format the table for people: titles, then a row for each place.

        A single run has one time of arrival and no probability.
        """
        fractions = QUANTILES if self.is_ensemble else QUANTILES[:1]
        names = [f' ({100 * part:.0f} %)' if self.is_ensemble else '' for part in fractions]
        titles = (
            'place', *['probability', 'arrival (earliest)'] * self.is_ensemble,
            *(f'arrival{name}' for name in names),
            'distance of the front', *(f'inundated{name}' for name in names), 'note',
        )
        texts = [titles, *(self._texts(row, fractions) for row in self.rows)]
        # the place, the times, and columns with a value
        kept = [
            index for index, column in enumerate(zip(*texts, strict=True))
            if index == 0 or column[0].startswith('arrival') or {*column[1:]} - {'-', ''}
        ]
        return [tuple(line[index] for index in kept) for line in texts]

    def _texts(self, row: PlaceArrival, fractions: Sequence[float]) -> tuple[str, ...]:
        never = '-' if self.is_ensemble else 'not reached'
        if not row.is_known:
            # distinguishes it from a place that lava does not reach
            never = 'unknown' if self.is_ensemble else OFF_MAP
        times = (row.arrival[fraction] for fraction in fractions)
        probability = row.probability_words or '-'
        if not row.is_known:
            probability = OFF_MAP
        earliest = never if row.earliest is None else self._moment(row.earliest)
        front = row.front_distance
        return (
            row.name, *[probability, earliest] * self.is_ensemble,
            *(never if time is None else self._moment(time) for time in times),
            '-' if front is None else f'{front:.0f} m',
            *(row.size_words(fraction) or '-' for fraction in fractions), row.map_words(),
        )

    def _moment(self, time: float) -> str:
        """Format a simulated time [s], and its date if that is known."""
        return duration(time) + ('' if self.onset is None else f', {self.onset.words(time)}')


def flow_table(
    places: Places, terrain: Terrain, arrived: np.ndarray, inundated: np.ndarray | None,
    facts: Mapping[str, Any],
) -> ArrivalTable:
    """Return the arrival of lava at places in a single run.

    Args:
        places: The places.
        terrain: The ground.
        arrived: First arrival times [s], shape [rows, columns], NaN without arrival.
        inundated: Fraction of each cell that lava has covered, same shape; None if it is unknown,
            so that cells with arrival are covered.
        facts: Facts about the table.
    """
    cells = places.at(arrived)
    part = np.isfinite(cells) if inundated is None else places.at(inundated)
    both = (dict.fromkeys(QUANTILES, values) for values in (cells, part))
    front = front_distances(places, reached_cells(arrived), terrain)
    return ArrivalTable(arrivals(places, *both, front=front), facts, is_ensemble=False)


@dataclass(frozen=True)
class LiveArrivals:
    """Arrival of lava at places in a running simulation.

    Attributes:
        time: Simulated time of the newest maps [s].
        rows: A row for each place; all times are simulated times.
        reached: True for each place at which lava has arrived.
        source: Source of future arrivals: ``ensemble``, ``forecast``, or ``none``.
        start: Simulated time at which the source starts [s]; ``time`` without a source.
        end: Simulated time at the horizon of the source [s]; ``time`` without a source.
        members: Number of members of the ensemble, None without an ensemble.
    """

    time: float
    rows: tuple[PlaceArrival, ...]
    reached: tuple[bool, ...]
    source: str
    start: float
    end: float
    members: int | None = None

    @property
    def summary(self) -> str:
        """Sentence for people if lava arrives at no place."""
        if self.source == 'none':
            return 'no lava yet at any place, and no forecast'
        return f'no lava at any place within {duration(max(self.end - self.time, 0.0))}'

    def words(self, index: int) -> str:
        """Describe in a sentence when lava arrives at a place."""
        row = self.rows[index]
        if not row.is_known:
            return row.map_words()
        off_map = f'; {row.map_words()}' if row.off_map else ''
        return self._arrival_words(row, is_reached=self.reached[index]) + off_map

    def _arrival_words(self, row: PlaceArrival, *, is_reached: bool) -> str:
        soonest = row.arrival[QUANTILES[0]]
        if is_reached and soonest is not None:
            return f'lava arrived {duration(self.time - soonest)} ago'
        far = row.front_distance
        where = '' if far is None else f'; the front is {far:.0f} m away'
        if self.source == 'none':
            return f'no lava yet, and no forecast{where}'
        if not row.probability and row.members is None:
            return f'no lava within {duration(max(self.end - self.time, 0.0))}{where}'
        times = [
            (fraction, max(time - self.time, 0.0))
            for fraction, time in row.arrival.items() if time is not None
        ]
        if self.source == 'forecast':
            return f'lava arrives in {duration(times[0][1])}{where}'
        spread = ', '.join(f'{duration(time)} ({100 * part:.0f} %)' for part, time in times)
        return (
            f'lava arrives with a probability {_of(row.probability_words)}'
            + ('' if times else f' within {duration(max(self.end - self.time, 0.0))}')
            + (f', in {spread}' if spread else '') + where
        )

    def values(self, index: int) -> dict[str, Any]:
        """Return the values of a place; keys with ``time_to_`` count from the newest maps."""
        row = self.rows[index]
        return {
            **row.record(),
            **{
                f'time_to_arrival_p{100 * fraction:.0f}_s': None if time is None
                else max(time - self.time, 0.0)
                for fraction, time in row.arrival.items()
            },
            'reached': self.reached[index] if row.is_known else None,
            'time_s': self.time,
            'forecast': self.source,
            'forecast_start_s': self.start,
            'forecast_end_s': self.end,
            'members': self.members,
        }


def live_arrivals(
    places: Places,
    snapshot: 'Snapshot',
    forecast: Forecast | None = None,
    ensemble: EnsembleForecast | None = None,
) -> LiveArrivals:
    """Return past and forecast arrivals of lava at places.

    Args:
        places: Places on the terrain of the snapshot.
        snapshot: The newest state of the simulation, with first arrival times.
        forecast: A valid forecast on the same terrain, or None.
        ensemble: A valid ensemble on the same terrain, which replaces ``forecast``, or None.
    """
    arrived = snapshot.arrived
    assert arrived is not None and snapshot.inundated is not None
    known, part = places.at(arrived).astype(np.float64), places.at(snapshot.inundated)
    first = places.first(known)
    front = front_distances(places, reached_cells(arrived), snapshot.terrain)
    reached = np.isfinite(first)
    source, start, end = 'none', snapshot.time, snapshot.time
    cells, parts = dict.fromkeys(QUANTILES, known), dict.fromkeys(QUANTILES, part)
    later = earliest = members = effective = None
    # a forecast cannot undo an arrival
    probability = np.where(reached, 100.0, np.nan)
    if ensemble is not None and ensemble.maps.places is not None:
        ahead, source = ensemble.maps.places, 'ensemble'
        start, end = ensemble.time, ensemble.time + ensemble.horizon
        members, effective = ensemble.maps.members, ensemble.maps.effective_members
        earliest = _first_of(first, ahead.earliest, ensemble.time)
        probability = np.where(reached, 100.0, ahead.probability)
        cells = {
            fraction: _first_of(known, places.at(times), ensemble.time)
            for fraction, times in ensemble.maps.arrival.items()
        }
        later = {
            fraction: _first_of(first, times, ensemble.time)
            for fraction, times in ahead.arrival.items()
        }
        parts = {
            fraction: np.fmax(part, places.at(covered))
            for fraction, covered in ensemble.maps.inundated.items()
        }
    elif forecast is not None:
        source = 'forecast'
        start, end = forecast.time, forecast.time + forecast.horizon
        come = _first_of(known, places.at(forecast.arrival), forecast.time)
        cells = dict.fromkeys(QUANTILES, come)
        parts = dict.fromkeys(QUANTILES, np.fmax(part, places.at(forecast.inundated)))
        probability = 100.0 * np.isfinite(places.first(come))
    rows = arrivals(
        places, cells, parts, probability=probability, first=later, front=front,
        earliest=earliest, members=effective,
    )
    has_arrived = tuple(map(bool, reached))
    return LiveArrivals(snapshot.time, rows, has_arrived, source, start, end, members)


def _first_of(known: np.ndarray, ahead: np.ndarray, start: float) -> np.ndarray:
    """Return known times and, where unknown, times of a forecast, which count from its start."""
    return np.where(np.isfinite(known), known, start + ahead.astype(np.float64))


def _of(words: str | None) -> str:
    """Format a probability for use after the word "probability"."""
    words = words or 'unknown'
    return words if words[0].isalpha() else f'of {words}'
