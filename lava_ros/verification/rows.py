# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rows of measurements, their files, points of error and cost, and Pareto fronts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields
import math
from pathlib import Path
from statistics import median
from typing import Any

from lava_ros.errors import refusing
from lava_ros.files import write_output
from lava_ros.files.csv import format_table, read_table
from lava_ros.simulation.presets import PRESETS

#: Called with the name of the next measurement and the completed fraction of the work, 0 to 1.
OnProgress = Callable[[str, float], None]


@dataclass(frozen=True)
class Row:
    """One quantity of one case at one setting: a line of the CSV file.

    ``error`` is relative; ``measured`` and ``exact`` are in ``unit``. ``particles`` is the number
    of particles at the end, ``evaluations`` that of velocity evaluations. Times are in seconds:
    ``wall_s`` is the median of the repetitions, ``low`` and ``high`` are their range. ``preset``
    is empty if the setting is not a preset.
    """

    case: str
    setting: str
    preset: str
    quantity: str
    error: float
    measured: float
    exact: float
    unit: str
    particles: int
    steps: int
    evaluations: int
    simulated_s: float
    wall_s: float
    wall_s_per_simulated_hour: float
    device: str
    machine: str
    command: str
    repetitions: int
    low: float
    high: float


def row_of(
    benchmark: str, particles: int, values: Sequence[float], unit: str
) -> dict[str, Any]:
    """Return the row of a benchmark: median, minimum and maximum of its repeated ``values``."""
    low, middle, high = min(values), median(values), max(values)
    row = {'benchmark': benchmark, 'particles': particles, 'value': middle, 'unit': unit}
    return {**row, 'low': low, 'high': high, 'repetitions': len(values)}


def write_csv(rows: Sequence[Any], path: Path) -> None:
    """Write at least one row as CSV, with numbers to six digits; all rows have the same columns.

    Raises:
        LavaError: If the file cannot be written.
    """
    texts = [
        {
            name: f'{value:.6g}' if isinstance(value, float) else value
            for name, value in _columns(row).items()
        }
        for row in rows
    ]
    write_output('output', path, format_table(list(texts[0]), texts))


def _columns(row: Any) -> dict[str, Any]:
    """Return the values of a row, a dataclass or a mapping, by column."""
    return row if isinstance(row, dict) else asdict(row)


def read_csv(path: Path, field: str = 'report') -> list[Row]:
    """Read a file of ``write_csv``; errors name the ``field``.

    Raises:
        LavaError: If the file cannot be read, or is not such a file.
    """
    types: dict[str, Callable[[str], Any]] = {'str': str, 'float': float, 'int': int}
    columns = {item.name: types[str(item.type)] for item in fields(Row)}
    lines = list(read_table(field, path, list(columns)))
    with refusing(field, str(path), 'a CSV of measurements', ValueError):
        return [
            Row(*(kind(line[name]) for name, kind in columns.items())) for _, line in lines
        ]


def as_plain(rows: Sequence[Any]) -> list[dict[str, Any]]:
    """Convert rows to mappings for JSON, with the columns of the CSV and None for NaN."""
    return [
        {
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in _columns(row).items()
        }
        for row in rows
    ]


@dataclass(frozen=True)
class Point:
    """A setting in a case with its largest relative error, infinite if any error is NaN.

    ``cost`` is the wall time per simulated hour [s]. ``least`` is the largest error that is a
    number. ``preset`` is the name of the preset, empty if the setting is not a preset.
    """

    case: str
    setting: str
    preset: str
    error: float
    cost: float
    particles: int
    least: float


def points(rows: Iterable[Row]) -> list[Point]:
    """Reduce rows to one point for each case and setting, in their order."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.case, row.setting), []).append(row)
    found = []
    for (case, setting), group in groups.items():
        one, errors = group[0], [row.error for row in group]
        # NaN, a missing result, counts as the worst
        worst = max(math.inf if math.isnan(error) else error for error in errors)
        least = max(filter(math.isfinite, errors), default=1.0)
        cost = one.wall_s_per_simulated_hour
        found.append(Point(case, setting, one.preset, worst, cost, one.particles, least))
    return found


def presets_of(found: Iterable[Point]) -> list[str]:
    """Return the names of the presets among points, from fast to slow."""
    names = {point.preset for point in found}
    return [name for name in PRESETS if name in names]


def pareto_front(candidates: Iterable[Point]) -> list[Point]:
    """Return the points that no other point beats in both error and cost, from fast to slow."""
    front: list[Point] = []
    candidates = [item for item in candidates if math.isfinite(item.error + item.cost)]
    for point in sorted(candidates, key=lambda item: (item.cost, item.error)):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front
