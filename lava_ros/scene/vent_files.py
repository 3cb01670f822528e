# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Vents from vector files and from tables such as those of DOWNFLOWGO and Lava2d."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
import logging
import math
from pathlib import Path
from typing import Any, NoReturn

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError
from lava_ros.files import warn_of_unknown
from lava_ros.files.columns import understood
from lava_ros.scene.effusion_rates import instants_to_series, Interval
from lava_ros.scene.features import Feature, load_features
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.typed_places import likely_place
from lava_ros.scene.vent_keys import Discharge

_LOG = logging.getLogger(__name__)

#: A discharge as (time [s], flux [m3/s]) pairs of increasing time; each holds until the next.
Series = tuple[tuple[float, float], ...]

#: Attributes of a vent.
COLUMNS = (
    'name', 'effusion_rate', 'temperature', 'radius', 'width', 'share', 'start', 'end', 'time',
)


@dataclass(frozen=True)
class VentRow:
    """A vent in projected coordinates, and the times at which it opens and closes [s].

    Attributes:
        place: Centre, or one end of a fissure (x, y) [m].
        other_end: Other end of a fissure (x, y) [m], None for a point.
        share: Weight by which open vents divide the total effusion rate.
        discharge: Effusion rate [m3/s] while the vent is open, or a series of (time [s], rate
            [m3/s]) pairs; None: a fraction of the total by ``share``.
        radius: Radius, or half the width of a fissure [m]; None: the default.
        temperature: Temperature of the lava [K]; None: the default.
        part: Fraction of a multipart feature; ``share`` and ``discharge`` include it.
        typed: Coordinates of ``places`` in the file.
        system: Coordinate system of these that the file states, None without.
    """

    name: str
    place: tuple[float, float]
    other_end: tuple[float, float] | None = None
    start: float = -math.inf
    end: float = math.inf
    share: float = 1.0
    discharge: Discharge | None = None
    radius: float | None = None
    temperature: float | None = None
    part: float = 1.0
    typed: tuple[tuple[float, float], ...] = ()
    system: str | None = None

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """Centre, or both ends of a fissure (x, y) [m]."""
        return (self.place,) if self.other_end is None else (self.place, self.other_end)


def read_vents(field: str, path: str | Path, terrain: Terrain) -> tuple[VentRow, ...]:
    """Read the vents of a file: its points and the segments of its lines.

    The segments of a feature divide its effusion rate in proportion to their length. Rows of a
    table with a ``time`` are instants of one vent, between which its rate changes linearly. A
    warning lists unknown attributes.

    Raises:
        LavaError: If the file cannot be read or has a polygon, or if an attribute is not usable.
    """
    features = load_features(field, path)
    rows: list[VentRow] = []
    unknown: list[str] = []
    instants: dict[VentRow, list[tuple[float, float]]] = defaultdict(list)

    def number(name: str, usual: float | None = None, **limits: Any) -> Any:
        if name not in columns:
            return usual
        return columns[name].number(where, properties[columns[name].header], **limits)

    def refuse(name: str, expected: str) -> NoReturn:
        columns[name].refuse(where, properties[columns[name].header], expected)

    for index, (where, group) in enumerate(groupby(features, key=lambda item: item.where)):
        given = list(group)
        parts = [part.on(terrain) for part in given]
        properties = parts[0].properties
        columns, others = understood(str(path), properties, COLUMNS)
        unknown += others
        rate = number('effusion_rate', at_least=0.0, unit='m3/s')
        if rate is not None and columns['effusion_rate'].kind == 'dense-rock':
            expected = 'a bulk effusion rate: 1 / (1 - porosity) times the dense-rock one'
            refuse('effusion_rate', expected)
        time, width = number('time'), number('width', above=0.0)
        if width is not None and 'radius' in columns:
            names = (columns[name].header for name in ('width', 'radius'))
            raise validation.conflict(*(f'{where}, {name}' for name in names))
        opens, closes = number('start', -math.inf), number('end', math.inf)
        if closes <= opens:
            refuse('end', f'a time after its start, {opens:g} s')
        whole = VentRow(
            # all rows with a time belong to one vent
            parts[0].name or f'vent {index if time is None else 0}',
            (0.0, 0.0),
            start=opens,
            end=closes,
            share=number('share', 1.0, above=0.0),
            discharge=rate,
            radius=number('radius', above=0.0) if width is None else 0.5 * width,
            temperature=number('temperature', above=0.0),
            system=given[0].system,
        )
        segments = _segments(parts)
        if time is None:
            rows += _divide(whole, segments)
        elif len(segments) != 1 or rate is None:
            expected = 'an effusion rate, and a point or a straight line'
            refuse('time', expected)
        else:
            (vent,) = _divide(replace(whole, discharge=None), segments)
            instants[vent].append((time, rate))
    warn_of_unknown(path, 'attributes', unknown, f' (of a vent: {", ".join(COLUMNS)})')
    rows += [
        replace(vent, discharge=instants_to_series(str(path), series))
        for vent, series in instants.items()
    ]
    return tuple(rows)


def _segments(parts: Sequence[Feature]) -> list[tuple[Any, Any, float, Any]]:
    """Return start, end (None: a point), weight and places in the file of each segment.

    ``parts`` are the parts of a feature, in the system of the terrain.
    """
    if any(part.kind == 'Polygon' for part in parts):
        raise LavaError(parts[0].where, 'an area', 'a point or a line')
    if len({part.kind for part in parts}) > 1:
        raise LavaError(parts[0].where, 'points and lines', 'either points or lines')
    found: list[tuple[Any, Any, float, Any]] = []
    for part in parts:
        places = [(x, y) for x, y in part.rings[0].tolist()]
        typed = [(x, y) for x, y, *_ in part.given]
        if part.kind == 'Point':
            found.append((places[0], None, 1.0, (typed[0],)))
            continue
        for (start, end), ends in zip(pairwise(places), pairwise(typed), strict=True):
            if start == end:
                raise LavaError(part.where, 'a line of length 0', 'a point or a longer line')
            found.append((start, end, math.dist(start, end), ends))
    return found


def _divide(vent: VentRow, segments: Sequence[tuple[Any, Any, float, Any]]) -> list[VentRow]:
    """Return a vent for each segment; the weights divide the effusion rate."""
    whole = sum(weight for *_, weight, _ in segments)
    return [
        replace(
            vent,
            place=start,
            other_end=end,
            typed=typed,
            share=vent.share * weight / whole,
            part=weight / whole,
            discharge=None if vent.discharge is None else vent.discharge * weight / whole,  # type: ignore[operator]
        )
        for start, end, weight, typed in segments
    ]


def series_of(vents: Sequence[VentRow], rates: Sequence[Interval]) -> list[Series]:
    """Divide a total effusion rate among the open vents.

    A vent with an effusion rate of its own emits this, in addition to the total, while it is open.

    Raises:
        LavaError: If lava is emitted while no vent is open.
    """
    spans = [(item.start, item.end) for item in rates]
    spans += [(vent.start, vent.end) for vent in vents]
    for vent in vents:
        if vent.discharge is not None and not isinstance(vent.discharge, float):
            problem = f'The effusion rate of {vent.name} changes with time'
            remedy = 'Move the series to the table of effusion rates'
            raise RefusalError(vent.name, problem, remedy)
    result: list[list[tuple[float, float]]] = [[] for _ in vents]
    row = 0
    has_shares = any(vent.discharge is None for vent in vents)
    for time in sorted({time for span in spans for time in span if math.isfinite(time)}):
        # rows end at different times
        while row < len(rates) and rates[row].end <= time:
            row += 1
        is_on = row < len(rates) and rates[row].start <= time
        discharge = rates[row].discharge if is_on else 0.0
        is_erupting = rates[0].start <= time < rates[-1].end
        is_open = [is_erupting and vent.start <= time < vent.end for vent in vents]
        shares = [
            vent.share if vent.discharge is None and now else 0.0
            for vent, now in zip(vents, is_open, strict=True)
        ]
        if discharge > 0.0 and has_shares and not any(shares):
            expected = 'at least one vent with start <= t < end: lava erupts then'
            raise LavaError(f'vents open at {time:g} s', 0, expected)
        for series, share, vent, now in zip(result, shares, vents, is_open, strict=True):
            flux = discharge * share / sum(shares) if share else 0.0
            if isinstance(vent.discharge, float):
                flux = vent.discharge if now else 0.0
            if not series or flux != series[-1][1]:
                series.append((time, flux))
    return [tuple(series) for series in result]


def check_places(vents: Sequence[VentRow], terrain: Terrain, source: str) -> None:
    """Raise LavaError, which names the file ``source``, for a vent that is not on the ground."""
    for vent, place, typed in (
        (row, place, typed) for row in vents
        for place, typed in zip(row.places, row.typed or row.places, strict=True)
    ):
        there = terrain.to_map(*place)
        if terrain.covers(*there):
            continue
        expected = f'a place {terrain.bounds(projected=True)}'
        if typed != place:
            expected += '; this is easting {:.0f}, northing {:.0f}'.format(*place)
        expected += likely_place(terrain, *typed, vent.system)
        cell = terrain.cell_at(*there)
        if cell is not None and math.isnan(terrain.elevation[cell]):
            expected = 'a place where the elevation has data: this cell has none'
        raise LavaError(f'{vent.name!r} of {source}', typed, expected)
