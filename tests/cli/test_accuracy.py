# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava check accuracy`, `verify`, `bench` and `effects`: printed and written tables."""

import csv
from dataclasses import replace
from functools import partial
import json
import math
from pathlib import Path
import subprocess
import sys
from unittest.mock import Mock

import pytest

from command_line import done, lava, refused
from lava_ros.effects import EFFECTS
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import bounds, cases, measure
from lava_ros.verification.benchmarks import effects, members
from lava_ros.verification.cases import Case, Measurement, Run
from lava_ros.verification.rows import read_csv

ROOT = Path(__file__).parents[2]

#: Runs the command as if only Warp, numpy, matplotlib and yaml were installed.
BARE = """
import sys

ABSENT = ('rclpy', 'rich', 'rasterio', 'mcap', 'zstandard', 'scipy', 'rosbags', 'tifffile')


class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in ABSENT:
            raise ImportError(f'{name} is not installed here')


sys.meta_path.insert(0, Absent())
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.cli.main import main
from lava_ros.verification import measure

few = [measure.Setting('a', Accuracy(refinement=0.25), 'draft')]
measure.all_settings = lambda quick: few
sys.exit(main(sys.argv[1:]))
"""


def measured(case: str, *errors: float) -> Run:
    """Return a run with the quantities q and r, which have relative errors."""
    quantities = tuple(
        Measurement(name, 1.0 + error, 1.0, 'm') for name, error in zip('qr', errors, strict=True)
    )
    return Run(case, quantities, 10, 2, 4, 60.0, 0.5)


@pytest.fixture
def one_setting(monkeypatch):
    """Measure one setting, and replace the runs of all cases by known errors."""
    coarse = [measure.Setting('coarse', Accuracy(refinement=0.25), 'draft')]
    monkeypatch.setattr(measure, 'all_settings', lambda quick: coarse)
    for name, case in measure.CASES.items():
        run = partial(measured, name, 0.01, 0.02)
        known = replace(case, measure=lambda accuracy, device, run=run: run())
        monkeypatch.setitem(measure.CASES, name, known)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))


@pytest.mark.nightly
def test_accuracy_writes_its_report_without_optional_packages(tmp_path):
    words = ['check', 'accuracy', '--quick', '--case', 'fixed_volume', '--device', 'cpu']
    places = ['--output', str(tmp_path / 'a/b'), '--json', str(tmp_path / 'a.json')]
    ended = subprocess.run(
        [sys.executable, '-c', BARE, *words, *places],
        cwd=ROOT, capture_output=True, text=True, timeout=100,
    )
    assert ended.returncode == 0, ended.stderr
    assert {item.name for item in (tmp_path / 'a/b').iterdir()} == {'cpu.csv', 'cpu.png'}
    rows = table(tmp_path / 'a/b/cpu.csv')
    assert {row['case'] for row in rows} == {'fixed_volume'}
    assert {row['command'] for row in rows} == {f'lava {" ".join(words)}'}
    assert len(json.loads((tmp_path / 'a.json').read_text())['rows']) == len(rows)
    assert '100 %' in ended.stdout and 'draft' in ended.stdout


def test_accuracy_replaces_only_the_rows_of_named_cases(tmp_path, one_setting, monkeypatch):
    monkeypatch.setattr('lava_ros.verification.chart.draw', lambda *_: None)
    words = ['check accuracy', '--device', 'cpu', '--repetitions', '1', '--output', tmp_path]
    for names in (('fixed_volume', 'dam_break'), ('slope_fixed_area',), ('fixed_volume',)):
        done(*words, *(word for name in names for word in ('--case', name)))
    rows = read_csv(tmp_path / 'cpu.csv')
    assert list(dict.fromkeys(row.case for row in rows)) == [
        'fixed_volume', 'dam_break', 'slope_fixed_area'
    ]
    commands = {row.case: row.command for row in rows}
    assert commands['dam_break'].count('--case') == 2
    assert commands['fixed_volume'].count('--case') == 1


def test_interrupted_accuracy_keeps_finished_cases(tmp_path, one_setting, monkeypatch):
    stopped = replace(cases.CASES['dam_break'], measure=Mock(side_effect=KeyboardInterrupt))
    monkeypatch.setitem(measure.CASES, 'dam_break', stopped)
    words = ['--quick', '--device', 'cpu', '--output', tmp_path]
    words += ['--case', 'fixed_volume', '--case', 'dam_break']
    assert lava('check', 'accuracy', *words)[0] == 130
    assert {row.case for row in read_csv(tmp_path / 'cpu.csv')} == {'fixed_volume'}


def test_verify_reports_a_case_with_its_bounds(tmp_path):
    path = tmp_path / 'a.json'
    words = ['check solver', '--preset', 'draft', '--case', 'sheet', '--device', 'cpu']
    line, last = done(*words, '--json', path).splitlines()
    assert line.startswith('sheet ') and line.endswith(' ok')
    assert last == '3 of 3 quantities are within their bounds'
    data = json.loads(path.read_text())
    assert data['preset'] == 'draft' and data['device'] == 'cpu' and data['within_bounds']
    (run,) = data['runs']
    assert run['case'] == 'sheet' and run['particles'] == 42**2
    for item in run['measurements']:
        assert item['within'] and item['error'] <= item['bound']
        assert item['error'] == pytest.approx(abs(item['measured'] / item['exact'] - 1.0))


def test_verify_shows_progress_before_a_case_runs(monkeypatch):
    stopped = Case('fake', 'a fake', 'nobody', Mock(side_effect=KeyboardInterrupt))
    monkeypatch.setattr(cases, 'CASES', {'fake': stopped})
    status, _, printed = lava('check', 'solver', '--device', 'cpu')
    assert (status, printed) == (130, '  0 %  1 of 1: a fake\n')


@pytest.mark.parametrize(('errors', 'words', 'status'), [
    # outside, or not measured
    ((0.001, 0.02), (), 1),
    ((math.nan, 0.001), (), 1),
    # a cheaper preset has a wider bound
    ((0.015, 0.001), ('--preset', 'draft'), 0),
    ((0.015, 0.001), ('--preset', 'standard'), 1),
    ((0.001, 0.02), ('--json', '-'), 1),
])
def test_verify_fails_when_an_error_exceeds_its_bound(errors, words, status, monkeypatch):
    known = Case('fake', 'a fake', 'nobody', lambda *_: measured('fake', *errors))
    monkeypatch.setattr(cases, 'CASES', {'fake': known})
    limits = (0.02, 0.01)  # draft, other presets
    monkeypatch.setattr(bounds, 'BOUNDS', {'fake': {'q': limits, 'r': limits}})
    ended, out, _ = lava('check', 'solver', '--device', 'cpu', *words)
    assert ended == status
    if '--json' in words:
        assert json.loads(out)['within_bounds'] is False
        return
    line, last = out.splitlines()
    assert line.endswith('OUTSIDE' if status else 'ok')
    assert last == f'{2 - status} of 2 quantities are within their bounds'


def test_effects_lists_every_effect(tmp_path):
    path = tmp_path / 'effects.json'
    lines = done('effects', '--json', path).splitlines()
    for name, effect in EFFECTS.items():
        if effect.number is not None:
            (line,) = [line for line in lines if line.startswith(name + ' ')]
            assert effect.admits in line
        assert ' x ' in line or ' ? ' in line
    report = {item['effect']: item for item in json.loads(path.read_text())['effects']}
    assert report['steep']['on']
    assert report['steep']['value'] > report['steep']['threshold']
    # the lava of this paper has no yield strength
    done('effects', '--material', 'kedadry2023', '--json', path)
    report = {item['effect']: item for item in json.loads(path.read_text())['effects']}
    assert report['yielding']['value'] is None and not report['yielding']['on']
    assert report['green']['threshold'] is None and not report['green']['on']


def test_effects_can_be_forced():
    printed = done('effects', '--on', 'inertia', '--off', 'steep')
    lines = {line.split()[0]: line.split()[1:3] for line in printed.splitlines()}
    assert lines['inertia'] == ['on', 'forced']
    assert lines['steep'] == ['-', 'forced']
    assert "--on is 'slope', expected one of steep" in refused('effects', '--on', 'slope')


def test_bench_effects_writes_its_table(tmp_path, monkeypatch):
    sets = effects.effect_sets()
    monkeypatch.setattr(effects, 'MIN_MEASURED_TIME', 0.01)
    monkeypatch.setattr(
        effects, 'effect_sets', lambda: {name: sets[name] for name in ('bare', 'green')}
    )
    output, text = tmp_path / 'effects.csv', tmp_path / 'effects.json'
    words = 'check speed effects --device cpu --repetitions 2 --particles 400'
    assert 'green' in done(*words.split(), '--output', output, '--json', text)
    rows = table(output)
    assert [row['benchmark'] for row in rows] == ['bare', 'green']
    assert float(rows[0]['ratio']) == 1.0
    # which of the two is slower is random on a busy machine
    bare, green = (float(row['value']) for row in rows)
    assert float(rows[1]['ratio']) == pytest.approx(green / bare, rel=1e-4)
    assert rows[0]['command'] == f'lava {words}'
    assert len(json.loads(text.read_text())['rows']) == 2


def test_bench_members_measures_a_batch(tmp_path, monkeypatch):
    monkeypatch.setattr(members, 'MEMBERS', {'cpu': (2,)})
    monkeypatch.setattr(members, 'SETS', ('bare',))
    words = 'check speed members --device cpu --particles 300 --repetitions 2 --json'
    done(*words.split(), tmp_path / 'members.json')
    rows = json.loads((tmp_path / 'members.json').read_text())['rows']
    assert [row['benchmark'] for row in rows] == ['bare: 2 members']
    assert all(row['low'] > 0.0 for row in rows)
