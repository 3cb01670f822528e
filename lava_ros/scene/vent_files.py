# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Vents in the files of other programs: vector files, and tables as of DOWNFLOWGO and Lava2d."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, pairwise
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.columns import Column, understood
from lava_ros.scene.effusion_rates import instants_to_series
from lava_ros.scene.features import Feature, load_features
from lava_ros.scene.projection import is_degrees, projected
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.vents import Discharge

_LOG = logging.getLogger(__name__)

#: Attributes of a vent.
COLUMNS = (
    'name', 'effusion_rate', 'temperature', 'radius', 'width', 'share', 'start', 'end', 'time',
)


@dataclass(frozen=True)
class VentRow:
    """A vent, in the coordinates of the elevation, and when it opens and closes [s].

    Attributes:
        place: Its centre, or one end of a fissure (x, y) [m].
        other_end: The other end of a fissure (x, y) [m], None for a point.
        share: Its part of the effusion rate, over those of all that are open.
        discharge: Its own effusion rate [m3/s] as long as it is open, in place of a part, or a
            series of (time [s], rate [m3/s]) pairs; None: the part.
        radius: Its radius, or half the width of a fissure [m]; None: the usual one.
        temperature: Temperature of its lava [K]; None: the usual one.
        part: Fraction of a feature of several parts; ``share`` and ``discharge`` include it.
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

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """Its centre, or both ends of a fissure (x, y) [m]."""
        return (self.place,) if self.other_end is None else (self.place, self.other_end)


def read_vents(field: str, path: str | Path, terrain: Terrain) -> tuple[VentRow, ...]:
    """Read the vents of a file: its points, and the straight parts of its lines.

    The parts of a feature divide its effusion rate by their length. Rows of a table with a
    ``time`` are instants of one vent, between which its rate changes linearly. Attributes that
    are not understood are named in a warning.

    Raises:
        LavaError: The file cannot be read, has an area, or an attribute is not usable.
    """
    features = load_features(field, path)
    rows: list[VentRow] = []
    unknown: dict[str, None] = {}
    instants: dict[VentRow, list[tuple[float, float]]] = defaultdict(list)
    for index, (where, group) in enumerate(groupby(features, key=lambda item: item.where)):
        parts = [_placed(part, terrain) for part in group]
        properties = dict(parts[0].properties)
        columns, others = understood(str(path), properties, COLUMNS)
        unknown |= dict.fromkeys(others)
        number = partial(_number, where, columns, properties)
        rate = number('effusion_rate', at_least=0.0, unit='m3/s')
        if rate is not None and columns['effusion_rate'].kind == 'dense-rock':
            right = 'a bulk effusion rate: 1 / (1 - porosity) times the dense-rock one'
            raise LavaError(f'{where}, {columns["effusion_rate"].header}', rate, right)
        time = number('time')
        width = number('width', above=0.0)
        if width is not None and 'radius' in columns:
            right = f'no {columns["radius"].header} as well'
            raise LavaError(where, columns['width'].header, right)
        opens, closes, share = (
            usual if (value := number(name)) is None else value
            for name, usual in (('start', -math.inf), ('end', math.inf), ('share', 1.0))
        )
        if closes <= opens:
            right = f'a time after its start, {opens:g} s'
            raise LavaError(f'{where}, {columns["end"].header}', closes, right)
        whole = VentRow(
            # rows of a time are one vent
            str(properties[columns['name'].header]) if 'name' in columns
            else f'vent {index if time is None else 0}',
            (0.0, 0.0),
            start=opens,
            end=closes,
            share=validation.number(f'{where}, share', share, above=0.0),
            discharge=rate,
            radius=number('radius', above=0.0) if width is None else 0.5 * width,
            temperature=number('temperature', above=0.0),
        )
        lines = _lines(parts)
        if time is None:
            rows += _divided(whole, lines)
        elif len(lines) != 1 or rate is None:
            right = 'an effusion rate, and a point or a straight line'
            raise LavaError(f'{where}, {columns["time"].header}', time, right)
        else:
            (vent,) = _divided(replace(whole, discharge=None), lines)
            instants[vent].append((time, rate))
    if unknown:
        known = ', '.join(COLUMNS)
        _LOG.warning(
            f'{path}: attributes that are not understood are ignored: {", ".join(unknown)} '
            f'(of a vent: {known})'
        )
    rows += [
        replace(vent, discharge=instants_to_series(str(path), series))
        for vent, series in instants.items()
    ]
    return tuple(rows)


def _number(
    where: str, columns: Mapping[str, Column], properties: Mapping[str, Any], name: str,
    **limits: Any,
) -> float | None:
    """Return an attribute in SI units, None if it is absent."""
    column = columns.get(name)
    if column is None:
        return None
    value = column.number(where, properties[column.header])
    validation.number(f'{where}, {column.header}', value, **limits)
    return value


def _placed(part: Feature, terrain: Terrain) -> Feature:
    """Transform a feature to the terrain's system; without a system it may be in degrees."""
    if part.system is not None or not terrain.has_system:
        return part.on(terrain)

    def place(point: np.ndarray) -> tuple[float, float]:
        x, y = map(float, point)
        if terrain.covers(*terrain.to_map(x, y)) or not is_degrees((x, y)):
            return x, y
        there = projected(terrain, x, y)
        return (x, y) if terrain.cell_at(*terrain.to_map(*there)) is None else there

    return replace(part, rings=tuple(np.array([place(p) for p in ring]) for ring in part.rings))


def _lines(parts: Sequence[Feature]) -> list[tuple[Any, Any, float]]:
    """Return start, end (None: a point) and weight of the straight parts of a feature."""
    if any(part.kind == 'Polygon' for part in parts):
        raise LavaError(parts[0].where, 'an area', 'a point or a line')
    if len({part.kind for part in parts}) > 1:
        raise LavaError(parts[0].where, 'points and lines', 'either points or lines')
    found: list[tuple[Any, Any, float]] = []
    for part in parts:
        places = [(float(x), float(y)) for x, y in part.rings[0]]
        if part.kind == 'Point':
            found.append((places[0], None, 1.0))
            continue
        for start, end in pairwise(places):
            if start == end:
                raise LavaError(part.where, 'a line of no length', 'a point or a longer line')
            found.append((start, end, math.dist(start, end)))
    return found


def _divided(vent: VentRow, lines: Sequence[tuple[Any, Any, float]]) -> list[VentRow]:
    """Return a vent for each part of a feature; they divide its effusion rate by weight."""
    whole = sum(weight for *_, weight in lines)
    return [
        replace(
            vent,
            place=start,
            other_end=end,
            share=vent.share * weight / whole,
            part=weight / whole,
            discharge=None if vent.discharge is None else vent.discharge * weight / whole,  # type: ignore[operator]
        )
        for start, end, weight in lines
    ]
