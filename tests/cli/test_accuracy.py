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

"""`lava accuracy`: the report as a command."""

import csv
from dataclasses import replace
import json
from pathlib import Path
import subprocess
import sys

import pytest

from lava_ros.cli import main as cli
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import cases, settings
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


def test_a_case_is_measured_again_and_the_others_stay(tmp_path, one_setting):
    """The rows of a case that is named are replaced in an earlier report."""
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
    words = ['accuracy', '--case', 'fixed_volume', '--device', 'cpu', '--output', str(tmp_path)]
    done = subprocess.run(
        [sys.executable, '-c', BARE, *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / 'cpu.png').is_file()
