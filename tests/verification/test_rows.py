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

"""The files of rows: CSV there and back, JSON."""

from dataclasses import replace
import json
import math

import pytest

from lava_ros.errors import LavaError
from lava_ros.verification.rows import read_csv, write_csv, write_json


def test_csv_round_trip(tmp_path, fake_case, measured):
    """What was written is read back, to six digits."""
    rows = measured([fake_case()])
    path = tmp_path / 'a.csv'
    write_csv(rows, path)
    again = read_csv(path)
    assert len(again) == len(rows)
    for old, new in zip(rows, again, strict=True):
        assert new.error == pytest.approx(old.error, rel=1e-5)
        assert new.wall_s == pytest.approx(old.wall_s, rel=1e-5)
        assert replace(new, error=0, wall_s=0, low=0, high=0, wall_s_per_simulated_hour=0) == (
            replace(old, error=0, wall_s=0, low=0, high=0, wall_s_per_simulated_hour=0)
        )
    header = path.read_text().splitlines()[0]
    assert header == (
        'case,setting,preset,quantity,error,measured,exact,unit,particles,steps,evaluations,'
        'simulated_s,wall_s,wall_s_per_simulated_hour,device,machine,command,repetitions,low,high'
    )


@pytest.mark.parametrize('text', ['', 'case,error\na,1\n'])
def test_other_files_are_refused(tmp_path, text):
    """A file with other columns is named in the error."""
    (tmp_path / 'a.csv').write_text(text)
    with pytest.raises(LavaError, match='columns'):
        read_csv(tmp_path / 'a.csv')


def test_json(tmp_path, row):
    """The JSON holds the same rows, and null for what is not a number."""
    write_json([row(wall_s=0.123456789), row(error=math.nan)], tmp_path / 'a.json')
    data = json.loads((tmp_path / 'a.json').read_text())
    assert data[0]['wall_s'] == 0.123456789
    assert [item['error'] for item in data] == [0.01, None]
