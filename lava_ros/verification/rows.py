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

"""A measurement as a row, and the files of rows: CSV and JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import csv
from dataclasses import asdict, dataclass, fields
import json
import math
from pathlib import Path
from typing import Any

from lava_ros.errors import LavaError


@dataclass(frozen=True)
class Row:
    """One quantity of one case at one setting: a line of the CSV.

    Attributes:
        case: Name of the case.
        setting: Name of the setting.
        preset: Name of the preset that the setting is, or empty.
        quantity: What was measured.
        error: Relative error.
        measured: What the solver says.
        exact: What it should say.
        unit: Unit of both.
        particles: Particles at the end.
        steps: Time steps.
        evaluations: Velocity evaluations.
        simulated_s: Simulated time [s].
        wall_s: Median time of the repetitions [s].
        wall_s_per_simulated_hour: The same for an hour of the flow [s].
        device: Warp device.
        machine: What it is.
        command: What made the row.
        repetitions: How many times it was run.
        low: Shortest time of the repetitions [s].
        high: Longest [s].
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


def write_csv(rows: Sequence[Any], path: Path) -> None:
    """Write rows, dataclasses of one kind and at least one, as CSV with numbers to six digits.

    Raises:
        LavaError: The file cannot be written.
    """
    try:
        with path.open('w', newline='', encoding='utf-8') as file:
            writer = csv.DictWriter(
                file, [item.name for item in fields(rows[0])], lineterminator='\n'
            )
            writer.writeheader()
            for row in rows:
                values = asdict(row).items()
                writer.writerow(
                    {
                        name: f'{value:.6g}' if isinstance(value, float) else value
                        for name, value in values
                    }
                )
    except OSError as error:
        raise LavaError('output', str(path), f'a file that can be written ({error})') from error


def read_csv(path: Path) -> list[Row]:
    """Read what ``write_csv`` wrote.

    Raises:
        LavaError: The file cannot be read, or is no such file.
    """
    names = [item.name for item in fields(Row)]
    try:
        with path.open(newline='', encoding='utf-8') as file:
            reader = csv.DictReader(file)
            if reader.fieldnames != names:
                raise LavaError('columns', reader.fieldnames, f'{", ".join(names)} in {path}')
            types: list[Callable[[str], Any]] = [_TYPES[str(item.type)] for item in fields(Row)]
            return [
                Row(*(convert(line[name]) for convert, name in zip(types, names, strict=True)))
                for line in reader
            ]
    except (OSError, ValueError) as error:
        raise LavaError('report', str(path), f'a CSV of measurements ({error})') from error


_TYPES: dict[str, Callable[[str], Any]] = {'str': str, 'float': float, 'int': int}


def write_json(rows: Sequence[Any], path: Path) -> None:
    """Write rows, dataclasses, as a JSON list of objects with the CSV's columns, null for NaN.

    Raises:
        LavaError: The file cannot be written.
    """
    data = [
        {
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in asdict(row).items()
        }
        for row in rows
    ]
    text = json.dumps(data, indent=1, allow_nan=False) + '\n'
    try:
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise LavaError('json', str(path), f'a file that can be written ({error})') from error
