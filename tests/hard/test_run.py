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

"""The command that plays the hard scenes, and where it writes."""

import csv
import json

import pytest

from hard import run

WORDS = ('--scene', 'no_particles', '--preset', 'draft', '--device', 'cpu', '--jobs', '1')


def test_folders_are_made_and_outcomes_added(tmp_path):
    """A folder that is missing is made; a file of outcomes keeps those it has."""
    folder, file = tmp_path / 'a/b', tmp_path / 'all.json'
    file.write_text(json.dumps([{'case': 'earlier'}]))
    assert run.main([*WORDS, '--csv', str(folder), '--json', str(file)]) == 0
    with (folder / 'hard_cpu.csv').open(encoding='utf-8', newline='') as table:
        assert [row['case'] for row in csv.DictReader(table)] == ['no_particles']
    assert [item['case'] for item in json.loads(file.read_text())] == ['earlier', 'no_particles']


@pytest.mark.parametrize(
    ('words', 'text'),
    [
        (('--csv', 'file/folder'), ''),
        (('--json', 'none/a.json'), ''),
        (('--json', '.'), ''),
        (('--json', 'file'), '{"no": "list"}'),
        (('--json', 'file'), 'no JSON'),
    ],
)
def test_what_cannot_be_written_is_refused_before_a_scene_runs(
    words, text, tmp_path, monkeypatch, capsys
):
    """One sentence that names it, at once, not a traceback after all the work."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').write_text(text)
    monkeypatch.setattr(run, 'run', lambda *_: pytest.fail('a scene has run'))
    with pytest.raises(SystemExit) as stopped:
        run.main([*WORDS, *words])
    assert stopped.value.code == 2
    assert f'{words[0]} is ' in capsys.readouterr().err
    assert (tmp_path / 'file').read_text() == text
