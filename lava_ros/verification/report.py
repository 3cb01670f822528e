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

"""What accuracy costs in time: cases by settings, measured, as CSV, JSON and Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import csv
from dataclasses import asdict, dataclass, fields, replace
import json
import math
import os
from pathlib import Path
import platform
import re
from statistics import median
from typing import Any, TYPE_CHECKING

import warp as wp

from lava_ros.accuracy import Accuracy
from lava_ros.errors import LavaError
from lava_ros.presets import PRESETS

if TYPE_CHECKING:
    from lava_ros.verification.cases import Case, Run

#: Refinements of the grid: 500, 2,000, 8,000 and 32,000 particles in the fixed volume's case.
REFINEMENTS = (0.25, 0.5, 1.0, 2.0)

#: Ratios of the grid: 20, 28, 38 and 64 neighbours.
RATIOS = (2.5, 3.0, 3.5, 4.5)

#: The same for a quick report, and its presets.
QUICK_REFINEMENTS, QUICK_RATIOS, QUICK_PRESETS = (0.25, 0.5), (2.5, 3.5), ('draft', 'standard')

#: Cases in which single knobs are turned, and the paper's step of 0.01 s is taken: its 200 s are
#: 20,000 of them.
KNOB_CASES = ('fixed_volume',)

#: Cases of even layers: the resolution hardly enters, and only the presets are run.
EVEN_CASES = ('sheet', 'green', 'radiating_sheet')

#: Runs shorter than this altogether are repeated [s].
REPEATED_BELOW = 3.0

#: Longest run that is tried [s], and the same in a quick report.
LONGEST, QUICK_LONGEST = 30.0, 4.0

#: How much longer a preset may take.
PRESET_PATIENCE = 4.0


@dataclass(frozen=True)
class Setting:
    """One column of the experiment.

    Attributes:
        name: What differs from the default accuracy, in words.
        accuracy: The knobs.
        preset: Name of the preset it is, if any.
        cases: Names of the cases it is run on; None for all.
    """

    name: str
    accuracy: Accuracy
    preset: str = ''
    cases: tuple[str, ...] | None = None


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


@dataclass(frozen=True)
class Point:
    """A setting in a case: the largest error of its quantities, and the time it took.

    Attributes:
        case: Name of the case.
        setting: Name of the setting.
        preset: Name of the preset that the setting is, or empty.
        error: Largest relative error.
        cost: Wall time for a simulated hour [s].
        particles: Particles at the end.
    """

    case: str
    setting: str
    preset: str
    error: float
    cost: float
    particles: int


def all_settings(*, quick: bool = False) -> list[Setting]:
    """The settings of a report, from cheap to dear.

    They are a grid of resolutions, the presets, and, in the case of ``KNOB_CASES``, one knob at a
    time and what each departure from the paper buys.

    Args:
        quick: Only what takes less than two minutes on two cores.
    """
    refinements, ratios = (QUICK_REFINEMENTS, QUICK_RATIOS) if quick else (REFINEMENTS, RATIOS)
    grid = [Accuracy(refinement=n, ratio=ratio) for n in refinements for ratio in ratios]
    chosen = {name: PRESETS[name].accuracy for name in (QUICK_PRESETS if quick else PRESETS)}
    settings = [Setting(_name(item), item) for item in grid if item not in chosen.values()]
    settings += [
        Setting(_name(item), item, name, None if item.formulation == 'corrected' else KNOB_CASES)
        for name, item in chosen.items()
    ]
    knobs: list[dict[str, object]] = [{'integrator': 'euler'}, {'kernel': 'poly6'}]
    if not quick:
        knobs += [
            {'kernel': 'spiky'},
            {'precision': 'float64'},
            {'diffusion_number': 1.0},
            {'diffusion_number': 2.0},
            {'courant_number': 0.25},
            {'courant_number': 0.125},
        ]
    standard = PRESETS['standard'].accuracy
    others = [replace(standard, **knob) for knob in knobs]  # type: ignore[arg-type]
    if not quick:
        others += _corrections()
    settings += [Setting(_name(item), item, cases=KNOB_CASES) for item in others]
    return sorted(settings, key=lambda item: expected_cost(item.accuracy))


def _corrections() -> list[Accuracy]:
    """The paper's accuracy with one correction after another."""
    paper = PRESETS['as-published'].accuracy
    corrected = replace(paper, formulation='corrected')
    wendland = replace(corrected, kernel='wendland', ratio=2.5)
    return [corrected, wendland, replace(wendland, fixed_step=None)]


def _name(accuracy: Accuracy) -> str:
    """Say the resolution, and every other knob that is not at its default."""
    usual = Accuracy()
    words = [f'refinement {accuracy.refinement:g}', f'ratio {accuracy.ratio:g}']
    for item in fields(Accuracy):
        value = getattr(accuracy, item.name)
        if item.name in ('refinement', 'ratio') or value == getattr(usual, item.name):
            continue
        label = '' if isinstance(value, str) else item.name.replace('_', ' ') + ' '
        words.append(f'{label}{value:g}' if isinstance(value, float) else f'{label}{value}')
    return ', '.join(words)


def measure(
    cases: Sequence[Case],
    settings: Sequence[Setting],
    *,
    device: str,
    command: str,
    repetitions: int = 3,
    longest: float = LONGEST,
    on_progress: Callable[[str, float], None] = lambda what, share: None,
) -> list[Row]:
    """Run every case at every setting that does not take too long.

    Args:
        cases: The cases.
        settings: The settings, from cheap to dear.
        device: Warp device.
        command: What the rows say made them.
        repetitions: How many times a run shorter than ``REPEATED_BELOW`` is timed.
        longest: Runs that are expected to take longer than this are left out [s]; presets may
            take ``PRESET_PATIENCE`` times as long.
        on_progress: Told what begins, and the share of the work that is done, from 0 to 1.
    """
    machine = machine_name(device)
    rows: list[Row] = []
    for index, case in enumerate(cases):
        own = [item for item in settings if _is_run(item, case.name)]
        # seconds per unit of cost, from the dearest run so far: short ones say little, and fixed
        # steps nothing
        pace, known = 0.0, 0.0
        for number, item in enumerate(own):
            share = (index + number / len(own)) / len(cases)
            on_progress(f'{case.name}: {item.preset or item.name}', share)
            cost = expected_cost(item.accuracy)
            if pace * cost > longest * (PRESET_PATIENCE if item.preset else 1.0):
                continue
            runs = [case.run(item.accuracy, device)]
            if cost > known and item.accuracy.fixed_step is None:
                pace, known = runs[0].wall_time / cost, cost
            while len(runs) < repetitions and _total(runs) < REPEATED_BELOW:
                runs.append(case.run(item.accuracy, device))
            rows += _rows(runs, item, device=device, machine=machine, command=command)
    on_progress('done', 1.0)
    return rows


def _is_run(setting: Setting, case: str) -> bool:
    if setting.cases is not None:
        return case in setting.cases
    return bool(setting.preset) or case not in EVEN_CASES


def _total(runs: Sequence[Run]) -> float:
    return sum(run.wall_time for run in runs)


def expected_cost(accuracy: Accuracy) -> float:
    """How long a run takes over one at the default accuracy, roughly.

    Particles, times the stages of a step, which grow with the refinement for RKL2 and with its
    square for Euler.
    """
    if accuracy.fixed_step is not None:
        return 0.2 / accuracy.fixed_step * accuracy.refinement**2 * 8.0
    stages = accuracy.refinement if accuracy.integrator == 'rkl2' else 4.0 * accuracy.refinement**2
    return stages * accuracy.refinement**2 * (0.5 / accuracy.courant_number) ** 0.5


def _rows(
    runs: Sequence[Run], setting: Setting, *, device: str, machine: str, command: str
) -> list[Row]:
    run = runs[0]
    times = [item.wall_time for item in runs]
    wall = median(times)
    return [
        Row(
            case=run.case,
            setting=setting.name,
            preset=setting.preset,
            quantity=item.quantity,
            error=float(item.error),
            measured=float(item.measured),
            exact=float(item.exact),
            unit=item.unit,
            particles=run.particles,
            steps=run.steps,
            evaluations=run.evaluations,
            simulated_s=float(run.simulated_time),
            wall_s=wall,
            wall_s_per_simulated_hour=_per_hour(wall, run.simulated_time),
            device=device,
            machine=machine,
            command=command,
            repetitions=len(times),
            low=min(times),
            high=max(times),
        )
        for item in run.measurements
    ]


def _per_hour(wall: float, simulated: float) -> float:
    """Wall time for an hour [s]; NaN for a case that takes a look without letting time pass."""
    return wall * 3600.0 / simulated if simulated > 0.0 else math.nan


def machine_name(device: str) -> str:
    """What a device is, in words that name no host."""
    found = wp.get_device(device)
    if found.is_cuda:
        return str(found.name)
    return f'{_processor()}, 1 core used of {os.cpu_count()}'


def _processor() -> str:
    """Model of the processor without its marks, its architecture where that is not known."""
    try:
        text = Path('/proc/cpuinfo').read_text(encoding='utf-8')
    except OSError:
        text = ''
    match = re.search(r'^model name\s*:\s*(.+)$', text, flags=re.MULTILINE)
    name = match.group(1) if match else platform.machine()
    name = re.sub(r'\((R|TM|C)\)|\bCPU\b|\bProcessor\b|@.*$', ' ', name, flags=re.IGNORECASE)
    return ' '.join(name.split())


def file_stem(device: str) -> str:
    """Name of the report's files for a device: ``cpu``, or the GPU's, as ``h200``."""
    found = wp.get_device(device)
    if not found.is_cuda:
        return 'cpu'
    words = str(found.name).lower().removeprefix('nvidia').strip()
    return re.sub(r'[^a-z0-9]+', '-', words).strip('-') or 'cuda'


def points(rows: Iterable[Row]) -> list[Point]:
    """Reduce rows to one point for each case and setting, in their order."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.case, row.setting), []).append(row)
    return [
        Point(
            case=case,
            setting=setting,
            preset=group[0].preset,
            # NaN, no result at all, is the worst
            error=max(math.inf if math.isnan(row.error) else row.error for row in group),
            cost=group[0].wall_s_per_simulated_hour,
            particles=group[0].particles,
        )
        for (case, setting), group in groups.items()
    ]


def presets_of(found: Iterable[Point]) -> list[str]:
    """Names of the presets among points, from the cheapest to the dearest."""
    names = {point.preset for point in found}
    return [name for name in PRESETS if name in names]


def pareto_front(candidates: Iterable[Point]) -> list[Point]:
    """The points that no other beats in both error and cost, from cheap to dear."""
    front: list[Point] = []
    candidates = [item for item in candidates if math.isfinite(item.error + item.cost)]
    for point in sorted(candidates, key=lambda item: (item.cost, item.error)):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """Write rows as CSV, numbers to six digits.

    Raises:
        LavaError: The file cannot be written.
    """
    try:
        with path.open('w', newline='', encoding='utf-8') as file:
            writer = csv.DictWriter(
                file, [item.name for item in fields(Row)], lineterminator='\n'
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


def write_json(rows: Sequence[Row], path: Path) -> None:
    """Write rows as JSON: the columns of the CSV, as a list of objects, null for NaN.

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


def markdown(rows: Sequence[Row], titles: dict[str, str], *, stem: str) -> str:
    """The report as Markdown: presets first, then every setting.

    Args:
        rows: The measurements.
        titles: Title of each case by name.
        stem: Name of the CSV and the chart, without suffix.
    """
    first = rows[0]
    everything = points(rows)
    names = list(dict.fromkeys(point.case for point in everything))
    lines = [
        f'# Accuracy against time: {first.machine}',
        '',
        f'Made by `{first.command}`; every measurement is in [{stem}.csv]({stem}.csv). The error '
        'of a case is the largest relative error of its quantities; the cost is wall time for an '
        'hour of the flow, kernels compiled, median of the repetitions. What would have taken too '
        'long was left out. Settings on the front are bold: nothing is both faster and better.',
        '',
        f'![Error against cost]({stem}.png)',
        '',
        '## Presets',
        '',
    ]
    presets = presets_of(everything)
    lines += _table(
        ['case', *presets],
        [
            [titles.get(name, name)]
            + [
                next(
                    (
                        f'{percent(point.error)} in {seconds(point.cost)}'
                        for point in everything
                        if point.case == name and point.preset == preset
                    ),
                    '',
                )
                for preset in presets
            ]
            for name in names
        ],
    )
    for name in names:
        lines += ['', f'## {titles.get(name, name)}', '']
        lines += _case_table([row for row in rows if row.case == name])
    return '\n'.join(lines) + '\n'


def _case_table(rows: Sequence[Row]) -> list[str]:
    """Every setting of a case, from cheap to dear; those on the front are bold."""
    quantities = list(dict.fromkeys(row.quantity for row in rows))
    front = {point.setting for point in pareto_front(points(rows))}
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.setting, []).append(row)
    body = []
    for setting, group in sorted(groups.items(), key=lambda item: item[1][0].wall_s):
        one = group[0]
        label = f'{one.preset}: {setting}' if one.preset else setting
        errors = {row.quantity: percent(row.error) for row in group}
        body.append(
            [
                f'**{label}**' if setting in front else label,
                *(errors.get(quantity, '') for quantity in quantities),
                f'{one.particles:,}',
                f'{one.steps:,}',
                f'{one.evaluations:,}',
                seconds(one.wall_s_per_simulated_hour),
                f'{seconds(one.low)} to {seconds(one.high)}'
                if one.repetitions > 1
                else seconds(one.wall_s),
            ]
        )
    head = ['setting', *quantities, 'particles', 'steps', 'evaluations', 'cost', 'a run took']
    return _table(head, body)


def _table(head: Sequence[str], body: Iterable[Sequence[str]]) -> list[str]:
    lines = ['| ' + ' | '.join(head) + ' |', '|---' * len(head) + '|']
    return lines + ['| ' + ' | '.join(line) + ' |' for line in body]


def percent(value: float) -> str:
    """A share in per cent, to two digits."""
    if not math.isfinite(value):
        return 'none'
    if value < 1e-5:
        return f'{value:.0e}'
    return f'{100.0 * value:.2g} %' if value < 0.0995 else f'{100.0 * value:.0f} %'


def seconds(value: float) -> str:
    """A time [s] to two digits, in the unit that suits it."""
    if math.isnan(value):
        return '-'
    if value < 0.1:
        return f'{1e3 * value:.2g} ms'
    if value < 9.95:
        return f'{value:.2g} s'
    if value < 600.0:
        return f'{value:.0f} s'
    return f'{value / 60.0:.0f} min' if value < 7200.0 else f'{value / 3600.0:.1f} h'
