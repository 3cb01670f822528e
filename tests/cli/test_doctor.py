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

"""`lava doctor`: what it prints and writes, and what it ends with."""

import json
from pathlib import Path
import subprocess
import sys

import pytest

from lava_ros.cli import main as cli
from lava_ros.doctor import FAIL, Finding, OK, WARN

ROOT = Path(__file__).parents[2]


@pytest.fixture
def findings(monkeypatch):
    """What the doctor finds, to be filled."""
    found: list[Finding] = []
    monkeypatch.setattr('lava_ros.cli.doctor._findings', lambda args: iter(found))
    return found


@pytest.mark.parametrize('has_rich', [True, False])
def test_findings_are_lines(has_rich, findings, monkeypatch, capsys):
    """Level, check and text in columns, the way out below; no colours in a pipe, rich or not."""
    if not has_rich:
        monkeypatch.setitem(sys.modules, 'rich.console', None)
    findings += [Finding('python', OK, '3.11'), Finding('gpu', WARN, 'none [x]', 'buy one')]
    assert cli.main(['doctor']) == 0
    assert capsys.readouterr().out.splitlines() == [
        'OK    python        3.11',
        'WARN  gpu           none [x]',
        '                    -> buy one',
    ]


def test_what_does_not_work_is_the_exit_status(findings, capsys):
    """1 when something fails, 0 when there are only warnings."""
    findings += [Finding('dds', FAIL, 'nothing came back', 'see the firewall')]
    assert cli.main(['doctor']) == 1
    assert 'FAIL' in capsys.readouterr().out


def test_json(findings, tmp_path, capsys):
    """The same as data, to a file or to stdout, and nothing besides."""
    findings += [Finding('disk', WARN, '2.0 GB', 'make room')]
    expected = [{'check': 'disk', 'level': 'WARN', 'text': '2.0 GB', 'way_out': 'make room'}]
    path = tmp_path / 'doctor.json'
    assert cli.main(['doctor', '--json', str(path)]) == 0
    assert json.loads(path.read_text()) == expected
    assert capsys.readouterr().out == ''
    assert cli.main(['doctor', '--json', '-']) == 0
    assert json.loads(capsys.readouterr().out) == expected
    assert cli.main(['doctor', '--json', str(tmp_path / 'no/such')]) == 2
    assert '--json' in capsys.readouterr().err


def test_every_check_is_made_without_ros_and_gpu(tmp_path):
    """On a machine without rclpy it runs to the end and says what is missing."""
    code = (
        'import importlib.util, sys\n'
        'find = importlib.util.find_spec\n'
        "hidden = ('rclpy', 'nav_msgs', 'diagnostic_msgs')\n"
        'importlib.util.find_spec = lambda name, *rest: None if name in hidden else find(name)\n'
        'for name in hidden: sys.modules[name] = None\n'
        'from lava_ros.cli.main import main\n'
        "sys.exit(main(['doctor', '--json', '-', '--msg-config', 'none.yaml']))\n"
    )
    ended = subprocess.run(
        [sys.executable, '-c', code],
        cwd=ROOT,
        env={'PATH': '/usr/bin', 'HOME': str(tmp_path), 'CUDA_VISIBLE_DEVICES': ''},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 1, ended.stderr
    levels = {item['check']: item for item in json.loads(ended.stdout)}
    names = 'python packages ros discovery dds sros2 qos gpu kernel_cache disk clock'
    assert set(levels) == {name.replace('_', ' ') for name in names.split()}
    assert levels['ros']['level'] == levels['dds']['level'] == FAIL
    assert 'none.yaml' in levels['qos']['text']
    assert all(item['way_out'] for item in levels.values() if item['level'] != OK)
