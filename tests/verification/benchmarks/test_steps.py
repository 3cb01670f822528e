# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks of steps and of convergence."""

import csv
import json
from pathlib import Path

import pytest

from lava_ros.cli import main as cli
from lava_ros.verification.benchmarks import steps


@pytest.fixture
def brief(monkeypatch):
    """Shorten the measurements, and start no process."""
    little = {'MIN_MEASURED_TIME': 0.0, 'SETS': ('bare', 'green'), 'FEWER_SETS': ('bare',),
              'COVERED_BY': 400, 'GRIDS': (20,),
              '_starts': lambda device, repetitions: [2.0, 1.0]}
    for name, value in little.items():
        monkeypatch.setattr(steps, name, value)


def rows_of(path):
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def test_command_writes_csv_json_and_text(tmp_path, capsys, monkeypatch, brief):
    output, text = tmp_path / 'steps.csv', tmp_path / 'steps.json'
    words = 'check speed steps --device cpu --repetitions 3 --particles 100 400'
    assert cli.main([*words.split(), '--output', str(output), '--json', str(text)]) == 0
    rows = rows_of(output)
    table = {(row['benchmark'], int(row['particles'])): row for row in rows}
    for name in steps.SETS:
        for particles in (100, 400):
            found = (table[f'{name}: {what}', particles] for what in ('step', 'rate'))
            step, rate = ([float(row[key]) for key in ('low', 'value', 'high')] for row in found)
            assert 0.0 < step[0] <= step[1] <= step[2]
            assert rate == pytest.approx([particles / time for time in reversed(step)], rel=1e-4)
    assert table['snapshot of 20 x 20 cells', 400]['unit'] == 'ms'
    columns = 'benchmark,particles,value,unit,low,high,repetitions,device,machine,command'
    assert list(rows[0]) == columns.split(',')
    assert {row['command'] for row in rows} == {f'lava {words}'}
    assert len(json.loads(text.read_text())['rows']) == len(rows)
    assert 'green: rate' in capsys.readouterr().out


def test_committed_rows_have_unit_machine_command_and_range():
    paths = list((Path(__file__).parents[3] / 'docs/benchmarks').glob('steps_*.csv'))
    assert paths
    for path in paths:
        rows = rows_of(path)
        names = {row['benchmark'] for row in rows}
        assert {'bare: rate', 'everything with green: memory'} <= names
        for row in rows:
            assert row['unit'] and row['machine']
            assert row['command'].startswith('lava check speed steps')
            assert float(row['low']) <= float(row['value']) <= float(row['high'])
