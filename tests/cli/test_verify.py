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

"""`lava verify`: one line a case, JSON, and a status that tells."""

import json
import math

import pytest

from lava_ros.cli import main as cli
from lava_ros.verification import bounds, cases
from lava_ros.verification.cases import Case, Measurement, Run


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
