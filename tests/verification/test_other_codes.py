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

"""The page that puts other lava codes beside this one says what the CSV files say.

Run as a script it writes the tables of the page again.
"""

import csv
import importlib
import math
from pathlib import Path
import re
import shutil
from typing import NamedTuple

import pytest

ACCURACY = Path(__file__).parents[2] / 'docs/accuracy'
PAGE = ACCURACY / 'other_codes.md'
BENCHMARKS = ACCURACY.parent / 'benchmarks'
COLUMNS = (
    'case',
    'code',
    'quantity',
    'value',
    'unit',
    'cells_or_particles',
    'seconds',
    'machine',
    'source',
)

#: What codes.csv calls the exact solution as means over the cells.
EXACT = 'exact solution'

#: What the page shows of ours: case and quantity of our CSV files, and what it calls them.
OURS = {
    ('constant_flux', 'radius'): 'Constant flux, R',
    ('lister', 'x at 100 T'): 'Point source on 5°, x_N',
    ('dam_break', 'front'): 'Dam break, front',
    ('fixed_volume', 'edge'): 'Fixed volume, R',
}


class Run(NamedTuple):
    """A run of a case, ours or not."""

    code: str
    size: str
    error: float
    time: float
    machine: str


def lines_of(name: str | Path) -> list[dict[str, str]]:
    """The lines of a CSV file, beside the page where its folder is not given."""
    with (ACCURACY / name).open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))


def our_runs(stem: str, case: str, quantity: str) -> list[Run]:
    """What the presets score on a quantity of a case, the coarsest first."""
    rows = [
        row
        for row in lines_of(f'{stem}.csv')
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
    """A relative error in per cent, to two digits."""
    return f'{100.0 * error:+.2g} %' if math.isfinite(error) else 'none'


def seconds(time: float) -> str:
    """A time in seconds, to two digits below a minute."""
    return f'{time:.0f} s' if time >= 9.95 else f'{time:.2g} s'


def table(head: str, lines: list[str]) -> str:
    """A Markdown table."""
    return '\n'.join([head, re.sub(r'[^|]+', '---', head), *lines])


def grid_table(first: str, quantity: str, title: str) -> str:
    """What codes score on the same cells, less what the exact solution scores on them."""
    rows = [row for row in lines_of(BENCHMARKS / 'codes.csv') if row['case'].startswith(first)]
    scores = {
        (row['case'], row['code'], row['cell_m'], row['quantity']): float(row['value'])
        for row in rows
    }
    lines = []
    for row in rows:
        case, code, cell = row['case'], row['code'], row['cell_m']
        if row['quantity'] != quantity or code == EXACT:
            continue
        score = scores[case, code, cell, quantity] - scores.get((case, EXACT, cell, quantity), 0.0)
        half = ', half of the plane' if case.endswith('_half') else ''
        lines.append(
            f'| {code}{half} | {cell} m | {signed(0.01 * score)} '
            f'| {scores[case, code, cell, "profile"]:.2g} % | {seconds(float(row["cpu_s"]))} |'
        )
    return table(f'| code | cells | {title} | profile | CPU time |', lines)


def ours_table() -> str:
    """The presets on the same quantities."""
    names = [run.code for run in our_runs('h200', 'fixed_volume', 'edge')]
    lines = []
    for (case, quantity), title in OURS.items():
        for stem in ('cpu', 'h200'):
            runs = {run.code: run for run in our_runs(stem, case, quantity)}
            cells = [
                f'{signed(runs[name].error)} in {seconds(runs[name].time)}' if name in runs else ''
                for name in names
            ]
            machine = next(iter(runs.values())).machine
            lines.append(f'| {title} | {machine} | {" | ".join(cells)} |')
    return table(f'| case | machine | {" | ".join(names)} |', lines)


def others_table() -> str:
    """Numbers of other codes on cases that we have not run."""
    groups: dict[tuple[str, str], list[str]] = {}
    sources: dict[tuple[str, str], str] = {}
    for row in lines_of('other_codes.csv'):
        key = (row['case'], row['quantity'])
        size = f' with {row["cells_or_particles"]}' if row['cells_or_particles'] else ''
        unit = ' %' if row['unit'] == '%' else ''
        time = f' in {seconds(float(row["seconds"]))}' if row['seconds'] else ''
        value = f'{row["code"]}{size} {float(row["value"]):g}{unit}{time}'
        groups.setdefault(key, []).append(value)
        own = row['source'].startswith('our own run')
        sources[key] = 'our own runs, 2 CPU cores' if own else row['source'].split(',')[0]
    lines = [
        f'| {case} | {quantity} | {", ".join(values)} | {sources[case, quantity]} |'
        for (case, quantity), values in groups.items()
    ]
    return table('| case | quantity | codes | source |', lines)


TABLES = {
    'flux': lambda: grid_table('constant_flux', 'radius', 'R'),
    'valley': lambda: grid_table('valley', 'front', 'front'),
    'hill': lambda: grid_table('hill', 'area', 'area'),
    'ours': ours_table,
    'others': others_table,
}


def marked(name: str) -> re.Pattern[str]:
    """The table that follows its mark in the page."""
    return re.compile(rf'(?<=<!-- {name} -->\n)\|.*(?:\n\|.*)*')


def test_rows_of_other_codes_are_complete():
    """Every line names case, code, quantity, unit and source; its numbers are numbers."""
    rows = lines_of('other_codes.csv')
    assert rows
    for row in rows:
        assert tuple(row) == COLUMNS
        assert all(row[name] for name in ('case', 'code', 'quantity', 'unit', 'source')), row
        assert math.isfinite(float(row['value'])), row
        assert not row['seconds'] or float(row['seconds']) > 0.0, row
        assert re.fullmatch(r'(cells of \d+ m|\d+)?', row['cells_or_particles']), row
        assert row['unit'] in ('%', '1'), row


def test_own_runs_name_their_machine():
    """A run of our own says what it ran on, a published one a DOI; a timed one how fine it was."""
    for row in lines_of('other_codes.csv'):
        assert row['source'].startswith('our own run') == (row['machine'] == '2 CPU cores'), row
        assert bool(row['machine']) != ('doi:10.' in row['source']), row
        assert not row['seconds'] or row['cells_or_particles'], row


@pytest.mark.parametrize('name', TABLES)
def test_page_says_what_the_measurements_say(name):
    """The tables of the page are those that the CSV files give now."""
    again = 'write them again: python tests/verification/test_other_codes.py'
    assert marked(name).findall(PAGE.read_text(encoding='utf-8')) == [TABLES[name]()], again


@pytest.mark.skipif(shutil.which('cc') is None, reason='no C compiler')
@pytest.mark.parametrize('case', ['constant_flux', 'valley'])
def test_the_plain_scheme_scores_what_its_rows_say(case, monkeypatch):
    """codes.csv is of the finite_volumes.c and the scores that are there now."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    codes = importlib.import_module('codes')
    flow = codes.FLOWS[case]
    thickness = codes.plain(flow, 10.0, 1).thickness
    assert thickness.sum() * 100.0 == pytest.approx(codes.DISCHARGE * flow.end)
    rows = {
        row['quantity']: float(row['value'])
        for row in lines_of(BENCHMARKS / 'codes.csv')
        if (row['case'], row['code'], row['cell_m']) == (case, 'plain scheme', '10')
    }
    found = {quantity: value for quantity, value, _ in flow.scores(flow, thickness, 10.0)}
    assert found == pytest.approx(rows, rel=1e-3)


def test_the_plain_scheme_is_closer_than_the_presets():
    """What the page says below its three tables."""
    rows = [row for row in lines_of(BENCHMARKS / 'codes.csv') if row['quantity'] == 'profile']
    for case in ('constant_flux', 'valley', 'hill'):
        runs = {row['code']: row for row in rows if (row['case'], row['cell_m']) == (case, '5')}
        plain = runs['plain scheme']
        assert float(plain['cpu_s']) < float(runs['standard']['cpu_s'])
        for preset in ('draft', 'standard', 'fine'):
            assert float(plain['value']) < float(runs[preset]['value'])


def write() -> None:
    """Write the tables of the page again."""
    text = PAGE.read_text(encoding='utf-8')
    for name, make in TABLES.items():
        text = marked(name).sub(make(), text)
    PAGE.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    write()
