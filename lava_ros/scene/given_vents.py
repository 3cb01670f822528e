# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Vents and effusion rates that a user gives in place of those of a scene or case."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.scene.effusion_rates import (
    check_start,
    Interval,
    Options,
    RateTable,
    read_effusion_rates,
    series_of_rates,
)
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.typed_places import place_as_typed
from lava_ros.scene.vent_files import check_places, read_vents, series_of, VentRow
from lava_ros.scene.vent_keys import RATE_CHECK

#: Default effusion rate [m3/s] and maximum default radius [m] of a vent.
SUMMIT_DISCHARGE, SUMMIT_RADIUS = 50.0, 20.0


@dataclass(frozen=True)
class GivenVents:
    """Vents and effusion rates as given; see ``SceneSource`` for the fields.

    Attributes:
        choices: Choices that are given for reading a table of effusion rates, by name.
        word: Function that returns the name of a field as the user writes it.
    """

    vent: Sequence[str | Sequence[float]]
    vents: str | Path | None
    effusion_rate: float | str | Path | None
    choices: Mapping[str, Any]
    word: Callable[[str], str]

    @property
    def rate(self) -> float | None:
        """Effusion rate of each vent [m3/s]; None without one, or with a table."""
        given = self.effusion_rate
        if given is None or isinstance(given, str | Path):
            return None
        return RATE_CHECK(self.word('effusion_rate'), given)

    def rows(self, terrain: Terrain) -> tuple[VentRow, ...]:
        """Return the vents that are given, if any, with the effusion rate that is given.

        Raises:
            LavaError: If a place or the file cannot be used.
        """
        if self.vent and self.vents:
            raise validation.conflict(self.word('vent'), self.word('vents'))
        if not self.vents:
            word = self.word('vent')
            texts = [
                item if isinstance(item, str) else ','.join(map(str, item)) for item in self.vent
            ]
            places = [place_as_typed(word, text, terrain, must_be_covered=True) for text in texts]
            return tuple(
                VentRow(f'vent {index}', place, discharge=self.rate)
                for index, place in enumerate(places)
            )
        rows = read_vents(self.word('vents'), self.vents, terrain)
        if self.effusion_rate is not None and any(row.discharge is not None for row in rows):
            other = f'the effusion rates in {self.vents}'
            raise validation.conflict(self.word('effusion_rate'), other)
        check_places(rows, terrain, Path(self.vents).name)
        return self.with_rate(rows)

    def with_rate(self, rows: tuple[VentRow, ...]) -> tuple[VentRow, ...]:
        """Return vents with the effusion rate that is given for each, if one is."""
        if (rate := self.rate) is None:
            return rows
        return tuple(replace(row, discharge=rate * row.part) for row in rows)

    def table(self, choices: Options | None = None) -> RateTable:
        """Read the table of effusion rates; without one, the result has no intervals.

        Args:
            choices: Choices of a case for reading the table, in place of those given.

        Raises:
            LavaError: If the table cannot be read, or a choice has no effect without one.
        """
        word = self.word('effusion_rate')
        if isinstance(self.effusion_rate, str | Path):
            name = str(self.effusion_rate)
            if not Path(name).exists() and name[:1] in '+-0123456789':
                validation.number(word, name, unit='m3/s')
            table = read_effusion_rates(word, name, choices or Options(**self.choices))
            if choices is None:
                check_start(word, table.intervals)
            return table
        for name in self.choices if choices is None else ():
            # a constant rate has a start, too
            if name != 'start':
                other = f'a table of effusion rates ({word} FILE)'
                raise validation.dependence(self.word(name), other)
        return RateTable(())

    def of_rows(
        self, rows: Sequence[VentRow], rates: Sequence[Interval], terrain: Terrain
    ) -> list[dict[str, Any]]:
        """Return vents as plain data, each with its effusion rate or its part of a table's rates.

        Raises:
            LavaError: If a vent has a share, but there is nothing to divide.
        """
        usual = usual_vent(terrain)
        if rates:
            series = series_of(rows, rates)
            return [described(row, own, usual) for row, own in zip(rows, series, strict=True)]
        for row in rows:
            is_own = self.effusion_rate is None and row.discharge is not None
            if not is_own and not math.isclose(row.share, row.part):
                table = f'a table of effusion rates ({self.word("effusion_rate")} FILE)'
                raise validation.dependence(f'the share of {row.name!r}', table)
        return [described(row, _discharge(row), usual) for row in rows]

    def of_scene(self, vents: object, rates: Sequence[Interval]) -> list[Any]:
        """Return the vents of a scene as plain data, with the given rates in place of theirs.

        Raises:
            LavaError: If the scene has no vents.
        """
        items = validation.items('vents', vents, 'a list of vents')
        if not items:
            other = f'a vent in the scene, or {self.word("vent")}'
            raise validation.dependence(self.word('effusion_rate'), other)
        rate: Any = self.rate
        if rates:
            rate = [(time, q / len(items)) for time, q in series_of_rates(rates)]
        return [
            {key: value for key, value in vent.items() if key != 'effusion_rate'}
            | {'discharge': rate} if isinstance(vent, Mapping) else vent
            for _, vent in items
        ]


def usual_vent(terrain: Terrain) -> dict[str, Any]:
    """Return the plain data of a vent of which only the place is known."""
    radius = min(2.0 * terrain.resolution, SUMMIT_RADIUS)
    return {'discharge': SUMMIT_DISCHARGE, 'radius': radius}


def described(row: VentRow, discharge: Any, usual: Mapping[str, Any]) -> dict[str, Any]:
    """Return a vent as plain data, with usual values in place of those that it does not have."""
    known = {
        'radius': row.radius, 'temperature': row.temperature, 'projected_end': row.other_end,
    }
    given = {name: value for name, value in known.items() if value is not None}
    own = {'name': row.name, 'projected': row.place, 'discharge': discharge}
    return {**usual, **own, **given}


def _discharge(row: VentRow) -> Any:
    """Return the effusion rate of a vent that divides none with others [m3/s]."""
    flux = SUMMIT_DISCHARGE * row.part if row.discharge is None else row.discharge
    if isinstance(flux, float) and math.isfinite(row.end):
        return ((max(row.start, min(0.0, row.end - 1.0)), flux), (row.end, 0.0))
    if isinstance(flux, float) and math.isfinite(row.start):
        return ((row.start, flux),)
    return flux


def summit(terrain: Terrain) -> tuple[float, float]:
    """Return the highest place (x, y) [m] of a terrain away from its borders."""
    ground = np.where(terrain.has_data, terrain.elevation, -np.inf)
    rows, columns = terrain.shape
    inner = np.full_like(ground, -np.inf)
    here = np.s_[rows // 8 : rows - rows // 8, columns // 8 : columns - columns // 8]
    inner[here] = ground[here]
    highest = np.argmax(inner if np.isfinite(inner).any() else ground)
    row, column = np.unravel_index(int(highest), terrain.shape)
    x, y = terrain.centres
    return float(x[column]), float(y[row])
