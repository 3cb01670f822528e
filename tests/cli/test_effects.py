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

"""`lava effects` and `lava bench`: the tables they print and write."""

import csv
from dataclasses import fields
import json
from pathlib import Path

from lava_ros.cli import main as cli
from lava_ros.cli.effects import step_costs
from lava_ros.effects import EFFECTS, Effects

ROOT = Path(__file__).parents[2]


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
