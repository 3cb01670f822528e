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

"""`lava accuracy`, `verify`, `bench` and `effects`: tables that are printed and written."""

import csv
from dataclasses import fields, replace
import json
import math
from pathlib import Path
import subprocess
import sys

import pytest

from lava_ros.cli import main as cli
from lava_ros.cli.prepare import step_costs
from lava_ros.effects import EFFECTS, Effects
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import bounds, cases, settings
from lava_ros.verification.cases import Case, Measurement, Run
from lava_ros.verification.rows import read_csv

ROOT = Path(__file__).parents[2]

#: Runs the command where nothing but Warp, numpy, matplotlib and yaml is installed.
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
from lava_ros.verification import settings

few = [settings.Setting('a', Accuracy(refinement=0.25), 'draft')]
settings.all_settings = lambda quick: few
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def one_setting(monkeypatch):
    """Let the report have one coarse setting."""
    coarse = [settings.Setting('coarse', Accuracy(refinement=0.25), 'draft')]
    monkeypatch.setattr(settings, 'all_settings', lambda quick: coarse)


def test_report_is_written(tmp_path, one_setting, capsys):
    """CSV, table, chart and JSON lie in the folder; the rows say what made them."""
    words = ['accuracy', '--quick', '--case', 'fixed_volume', '--device', 'cpu']
    words += ['--output', str(tmp_path / 'a/b'), '--json', str(tmp_path / 'a.json')]
    assert cli.main(words) == 0
    assert {item.name for item in (tmp_path / 'a/b').iterdir()} == {'cpu.csv', 'cpu.md', 'cpu.png'}
    with (tmp_path / 'a/b/cpu.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert {row['case'] for row in rows} == {'fixed_volume'}
    expected = 'lava accuracy --quick --case fixed_volume --device cpu'
    assert {row['command'] for row in rows} == {expected}
    assert len(json.loads((tmp_path / 'a.json').read_text())) == len(rows)
    output = capsys.readouterr().out
    assert '100 %' in output
    assert 'draft' in output


def test_a_case_is_measured_again_and_the_others_stay(tmp_path, one_setting, monkeypatch):
    """The rows of a case that is named are replaced in an earlier report."""
    monkeypatch.setattr('lava_ros.cli.measure.draw', lambda *_: None)
    words = ['accuracy', '--device', 'cpu', '--repetitions', '1', '--output', str(tmp_path)]
    for names in (('fixed_volume', 'dam_break'), ('slope_fixed_area',), ('fixed_volume',)):
        assert cli.main([*words, *(word for name in names for word in ('--case', name))]) == 0
    rows = read_csv(tmp_path / 'cpu.csv')
    assert list(dict.fromkeys(row.case for row in rows)) == [
        'fixed_volume', 'dam_break', 'slope_fixed_area'
    ]
    commands = {row.case: row.command for row in rows}
    assert commands['dam_break'].count('--case') == 2
    assert commands['fixed_volume'].count('--case') == 1
    text = (tmp_path / 'cpu.md').read_text()
    assert all(command in text for command in commands.values())


def test_what_is_interrupted_keeps_what_it_has(tmp_path, one_setting, monkeypatch):
    """The rows of the first case are there when the second one fails."""
    second = cases.CASES['dam_break']

    def stop(accuracy, device):
        raise KeyboardInterrupt

    monkeypatch.setitem(settings.CASES, 'dam_break', replace(second, measure=stop))
    words = ['--quick', '--device', 'cpu', '--output', str(tmp_path)]
    words += ['--case', 'fixed_volume', '--case', 'dam_break']
    assert cli.main(['accuracy', *words]) == 130
    assert {row.case for row in read_csv(tmp_path / 'cpu.csv')} == {'fixed_volume'}
    assert 'Fixed volume' in (tmp_path / 'cpu.md').read_text()


def test_a_bare_machine_is_enough(tmp_path):
    """Neither ROS nor rich, rasterio, MCAP or scipy is needed."""
    words = ['accuracy', '--quick', '--case', 'fixed_volume', '--device', 'cpu', '--output']
    done = subprocess.run(
        [sys.executable, '-c', BARE, *words, str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / 'cpu.png').is_file()


def use(monkeypatch: pytest.MonkeyPatch, *errors: float) -> None:
    """Replace the cases by one with quantities of given errors, each with a bound of 1 %."""

    def run(accuracy: object, device: str) -> Run:
        measured = tuple(
            Measurement(f'q{index}', 1.0 + error, 1.0, 'm') for index, error in enumerate(errors)
        )
        return Run('fake', measured, 10, 2, 4, 60.0, 0.5)

    monkeypatch.setattr(cases, 'CASES', {'fake': Case('fake', 'a fake', 'nobody', run)})
    names = [f'q{index}' for index in range(len(errors))]
    limits = {'draft': 0.02, 'standard': 0.01}
    monkeypatch.setattr(bounds, 'BOUNDS', {'fake': dict.fromkeys(names, limits)})


def test_a_real_case(tmp_path, capsys):
    """A case is run, printed on one line and written with its bounds."""
    path = tmp_path / 'a.json'
    words = ['verify', '--preset', 'draft', '--case', 'sheet', '--device', 'cpu']
    assert cli.main([*words, '--json', str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert lines[0].startswith('sheet ') and lines[0].endswith(' ok')
    assert lines[1] == '3 of 3 quantities are within their bounds'
    data = json.loads(path.read_text())
    assert data['preset'] == 'draft' and data['device'] == 'cpu' and data['within_bounds']
    (run,) = data['runs']
    assert run['case'] == 'sheet' and run['particles'] == 42**2
    for item in run['measurements']:
        assert item['within'] and item['error'] <= item['bound']
        assert item['error'] == pytest.approx(abs(item['measured'] / item['exact'] - 1.0))


def test_progress_is_told_before_a_case_runs(monkeypatch, capsys):
    """Cases take minutes: which one is running, of how many, is known before it ends."""
    seen: list[str] = []

    def run(accuracy: object, device: str) -> Run:
        seen.append(capsys.readouterr().err)
        raise KeyboardInterrupt

    monkeypatch.setattr(cases, 'CASES', {'fake': Case('fake', 'a fake', 'nobody', run)})
    assert cli.main(['verify', '--device', 'cpu']) == 130
    assert seen == ['  0 %  1 of 1: a fake\n']


@pytest.mark.parametrize('errors', [(0.001, 0.02), (math.nan, 0.001)])
def test_an_error_outside_its_bound_fails(errors, monkeypatch, capsys):
    """One quantity outside its bound, or not measured at all, is shown and gives status 1."""
    use(monkeypatch, *errors)
    assert cli.main(['verify', '--device', 'cpu']) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith('OUTSIDE')
    assert lines[1] == '1 of 2 quantities are within their bounds'


def test_the_bounds_are_the_presets(monkeypatch):
    """What is outside at one preset may be within at a cheaper one."""
    use(monkeypatch, 0.015)
    assert cli.main(['verify', '--device', 'cpu', '--preset', 'draft']) == 0
    assert cli.main(['verify', '--device', 'cpu', '--preset', 'standard']) == 1


def test_json_on_stdout_is_nothing_but_json(monkeypatch, capsys):
    """`--json -` prints the report alone; the status is the same."""
    use(monkeypatch, 0.02)
    assert cli.main(['verify', '--device', 'cpu', '--json', '-']) == 1
    assert json.loads(capsys.readouterr().out)['within_bounds'] is False


def test_every_effect_has_a_line(tmp_path, capsys):
    """Effect, on or off, the number that decided, its cost, and what leaving it out would cost."""
    path = tmp_path / 'effects.json'
    assert cli.main(['effects', '--json', str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name, effect in EFFECTS.items():
        if effect.number is not None:
            (line,) = [line for line in lines if line.startswith(name + ' ')]
            assert effect.admits in line
        assert ' x ' in line or ' ? ' in line
    table = {item['effect']: item for item in json.loads(path.read_text())}
    assert table['steep']['on']
    assert table['steep']['value'] > table['steep']['threshold']
    # the paper's lava has no strength
    assert cli.main(['effects', '--material', 'kedadry2023', '--json', str(path)]) == 0
    table = {item['effect']: item for item in json.loads(path.read_text())}
    assert table['yielding']['value'] is None
    assert not table['yielding']['on']
    assert table['green']['threshold'] is None
    assert not table['green']['on']


def test_effects_can_be_forced(capsys):
    """Forced effects say so; an unknown one is an error that names it."""
    assert cli.main(['effects', '--on', 'inertia', '--off', 'steep']) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert lines['inertia'].split()[1:3] == ['on', 'forced']
    assert lines['steep'].split()[1:3] == ['-', 'forced']
    assert cli.main(['effects', '--on', 'slope']) == 2
    assert 'effects.slope' in capsys.readouterr().err


def test_the_costs_are_those_that_were_measured():
    """Effects are in the committed table, the bare step is 1, and its columns are complete."""
    # two are not measured on that GPU yet
    known = {'bare', *(item.name for item in fields(Effects))} - {'cover', 'wind'}
    assert set(step_costs()) >= known
    assert step_costs()['bare'] == 1.0
    for path in (ROOT / 'docs/benchmarks').glob('effects_*.csv'):
        with path.open(newline='') as file:
            for row in csv.DictReader(file):
                assert float(row['low']) <= float(row['value']) <= float(row['high'])
                assert row['unit'] and row['machine'] and row['command'].startswith('lava bench')


def test_bench_effects_writes_its_table(tmp_path, capsys, monkeypatch):
    """The time of a step, over the particles, for the bare step and for an effect."""
    from lava_ros.verification.benchmarks import effects

    sets = effects.effect_sets()
    monkeypatch.setattr(effects, 'LEAST', 0.01)
    monkeypatch.setattr(
        effects, 'effect_sets', lambda: {name: sets[name] for name in ('bare', 'green')}
    )
    output, text = tmp_path / 'effects.csv', tmp_path / 'effects.json'
    words = ['bench', 'effects', '--device', 'cpu', '--particles', '400', '--repetitions', '2']
    assert cli.main([*words, '--output', str(output), '--json', str(text)]) == 0
    with output.open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [row['benchmark'] for row in rows] == ['bare', 'green']
    assert float(rows[0]['ratio']) == 1.0
    assert float(rows[1]['ratio']) > 1.0
    assert rows[0]['command'] == 'lava ' + ' '.join(
        ['bench', 'effects', '--device', 'cpu', '--repetitions', '2', '--particles', '400']
    )
    assert len(json.loads(text.read_text())) == 2
    assert 'green' in capsys.readouterr().out


def test_bench_members_measures_a_batch(tmp_path, monkeypatch):
    """The rate of all members, and their memory."""
    from lava_ros.verification.benchmarks import members

    monkeypatch.setattr(members, 'MEMBERS', {'cpu': (2,)})
    monkeypatch.setattr(members, 'SETS', ('bare',))
    text = tmp_path / 'members.json'
    words = ['bench', 'members', '--device', 'cpu', '--particles', '300', '--repetitions', '2']
    assert cli.main([*words, '--json', str(text)]) == 0
    rows = json.loads(text.read_text())
    assert [row['benchmark'] for row in rows] == ['bare: 2 members', 'bare: 2 members: memory']
    assert all(row['low'] > 0.0 for row in rows)
