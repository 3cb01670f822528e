# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks of steps and of convergence."""

import csv
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.cli import main as cli
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.lava import Lava
from lava_ros.verification.benchmarks import steps
from scripts import load_script


@pytest.fixture
def brief(monkeypatch):
    """Shorten the measurements, and start no process."""
    little = {'MIN_MEASURED_TIME': 0.0, 'SETS': ('bare', 'green'), 'FEWER_SETS': ('bare',),
              'COVERED_BY': 400, 'GRIDS': (20,),
              '_starts': lambda device, repetitions: [2.0, 1.0]}
    for name, value in little.items():
        monkeypatch.setattr(steps, name, value)


def test_steps_have_a_row_for_every_measurement(device, brief):
    seen = []
    measured = steps.measure(
        device, particles=(100, 400), repetitions=3,
        on_progress=lambda what, share: seen.append(share),
    )
    rows = [SimpleNamespace(**row) for row in measured]
    assert seen == sorted(seen) and 0.5 < seen[-1] < 1.0
    assert all(0.0 < row.low <= row.value <= row.high for row in rows)
    table = {(row.benchmark, row.particles): row for row in rows}
    for name in steps.SETS:
        for particles in (100, 400):
            step, rate = table[f'{name}: step', particles], table[f'{name}: rate', particles]
            assert rate.value * step.value == pytest.approx(particles)
            slow, fast = particles / step.high, particles / step.low
            assert (rate.low, rate.high) == pytest.approx((slow, fast))
    assert table['snapshot of 20 x 20 cells', 400].unit == 'ms'
    assert table['start of a process to its first snapshot', 10_000].low == 1.0


def rows_of(path):
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def test_command_writes_csv_json_and_text(tmp_path, capsys, monkeypatch, brief):
    output, text = tmp_path / 'steps.csv', tmp_path / 'steps.json'
    words = 'bench steps --device cpu --repetitions 2 --particles 100 400'
    assert cli.main([*words.split(), '--output', str(output), '--json', str(text)]) == 0
    rows = rows_of(output)
    columns = 'benchmark,particles,value,unit,low,high,repetitions,device,machine,command'
    assert list(rows[0]) == columns.split(',')
    assert {row['command'] for row in rows} == {f'lava {words}'}
    assert len(json.loads(text.read_text())) == len(rows)
    assert 'green: rate' in capsys.readouterr().out


def test_committed_rows_have_unit_machine_command_and_range():
    paths = list((Path(__file__).parents[3] / 'docs/benchmarks').glob('steps_*.csv'))
    assert paths
    for path in paths:
        rows = rows_of(path)
        names = {row['benchmark'] for row in rows}
        assert {'bare: rate', 'everything with green: memory'} <= names
        for row in rows:
            assert row['unit'] and row['machine'] and row['command'].startswith('lava bench steps')
            assert float(row['low']) <= float(row['value']) <= float(row['high'])


@pytest.mark.nightly
def test_finer_presets_have_more_particles_and_smaller_errors(device):
    x = np.arange(40) * 5.0
    scene = Scene(
        Terrain(np.tile(-0.2 * x, (40, 1)), 5.0), (Vent((40.0, 100.0), 2.0),), Lava(viscosity=1e4)
    )
    convergence = load_script(Path(__file__).parents[3] / 'docs/benchmarks/convergence.py')
    case = convergence.case_of('incline', scene, 600.0)
    rows = [SimpleNamespace(**row) for row in convergence.compare(case, device=device, runs=2)]
    assert [row.preset for row in rows] == list(convergence.LADDER)
    coarse, middle, last = rows
    assert coarse.particles < middle.particles < last.particles
    assert coarse.spacing_m > middle.spacing_m > last.spacing_m
    assert (last.jaccard, last.area_ratio, last.length_ratio) == (1.0, 1.0, 1.0)
    assert 0.5 < middle.jaccard <= 1.0 and middle.across >= 15.9
    for row in rows:
        assert 0.0 < row.expected_particles < 1.0 and 0.0 < row.predicted_particles < 1.0
        assert 0.0 <= row.actual < 0.5 and 0.0 <= row.chance < 0.5 and row.expected_cells > 0.0
    assert coarse.actual > last.actual
