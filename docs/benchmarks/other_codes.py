# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write the tables of docs/accuracy/other_codes.md from the CSV files, like tables.py.

python docs/benchmarks/other_codes.py
"""

from collections.abc import Iterator
import math
from typing import NamedTuple

from tables import HERE, Line, lines_of, written

ACCURACY = HERE.parent / 'accuracy'
PAGE = ACCURACY / 'other_codes.md'

#: Name of the exact solution as means over the cells in codes.csv.
EXACT = 'exact solution'

#: Our cases on the page: names on the page by case and quantity in our CSV files.
OURS = {
    ('constant_flux', 'radius'): 'Constant flux, R',
    ('lister', 'x at 100 T'): 'Point source on 5°, x_N',
    ('dam_break', 'front'): 'Dam break, front',
    ('fixed_volume', 'edge'): 'Fixed volume, R',
}


class Run(NamedTuple):
    """A run of a case by our code or another one."""

    code: str
    size: str
    error: float
    time: float
    machine: str


def our_runs(stem: str, case: str, quantity: str) -> list[Run]:
    """Return the runs of presets for a quantity of a case, coarsest first."""
    rows = [
        row
        for row in lines_of(ACCURACY / f'{stem}.csv')
        if (row['case'], row['quantity']) == (case, quantity)
        and row['preset'] not in ('', 'as-published')
    ]
    assert rows, f'{stem}.csv has no preset with {quantity!r} of {case!r}'
    return [
        Run(
            row['preset'],
            row['particles'],
            float(row['measured']) / float(row['exact']) - 1.0,
            float(row['wall_s']),
            row['machine'],
        )
        for row in sorted(rows, key=lambda row: int(row['particles']))
    ]


def signed(error: float) -> str:
    """Format a relative error in per cent with two digits."""
    return f'{100.0 * error:+.2g} %' if math.isfinite(error) else 'none'


def seconds(time: float) -> str:
    """Format a time in seconds, with two digits below 10 s."""
    return f'{time:.0f} s' if time >= 9.95 else f'{time:.2g} s'


def grid_table(first: str, quantity: str, title: str) -> Iterator[Line]:
    """Yield the scores of codes minus those of the exact solution on the same cells."""
    rows = [row for row in lines_of('codes.csv') if row['case'].startswith(first)]
    scores = {
        (row['case'], row['code'], row['cell_m'], row['quantity']): float(row['value'])
        for row in rows
    }
    yield ('code', 'cells', title, 'profile', 'CPU time')
    for row in rows:
        case, code, cell = row['case'], row['code'], row['cell_m']
        if row['quantity'] != quantity or code == EXACT:
            continue
        score = scores[case, code, cell, quantity] - scores.get((case, EXACT, cell, quantity), 0.0)
        half = ', half of the plane' if case.endswith('_half') else ''
        yield (
            f'{code}{half}',
            f'{cell} m',
            signed(0.01 * score),
            f'{scores[case, code, cell, "profile"]:.2g} %',
            seconds(float(row['cpu_s'])),
        )


def ours_table() -> Iterator[Line]:
    """Yield the scores of the presets for the same quantities."""
    names = [run.code for run in our_runs('h200', 'fixed_volume', 'edge')]
    yield ('case', 'machine', *names)
    for (case, quantity), title in OURS.items():
        for stem in ('cpu', 'h200'):
            runs = {run.code: run for run in our_runs(stem, case, quantity)}
            cells = [
                f'{signed(runs[name].error)} in {seconds(runs[name].time)}' if name in runs else ''
                for name in names
            ]
            machine = next(iter(runs.values())).machine
            yield (title, machine, *cells)


def others_table() -> Iterator[Line]:
    """Yield published values of other codes for cases that we have not run."""
    groups: dict[tuple[str, str], list[str]] = {}
    sources: dict[tuple[str, str], str] = {}
    for row in lines_of(ACCURACY / 'other_codes.csv'):
        key = (row['case'], row['quantity'])
        size = f' with {row["cells_or_particles"]}' if row['cells_or_particles'] else ''
        unit = ' %' if row['unit'] == '%' else ''
        time = f' in {seconds(float(row["seconds"]))}' if row['seconds'] else ''
        value = f'{row["code"]}{size} {float(row["value"]):g}{unit}{time}'
        groups.setdefault(key, []).append(value)
        own = row['source'].startswith('our own run')
        sources[key] = 'our own runs, 2 CPU cores' if own else row['source'].split(',')[0]
    yield ('case', 'quantity', 'codes', 'source')
    for (case, quantity), values in groups.items():
        yield (case, quantity, ', '.join(values), sources[case, quantity])


TABLES = {
    'flux': lambda: grid_table('constant_flux', 'radius', 'R'),
    'valley': lambda: grid_table('valley', 'front', 'front'),
    'hill': lambda: grid_table('hill', 'area', 'area'),
    'ours': ours_table,
    'others': others_table,
}


if __name__ == '__main__':
    PAGE.write_text(written(PAGE.read_text(encoding='utf-8'), TABLES), encoding='utf-8')
