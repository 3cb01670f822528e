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

"""Rows and their files; points of error and cost, and the front that nothing beats."""

from dataclasses import replace
import json
import math

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.verification.rows import (
    as_plain,
    pareto_front,
    Point,
    points,
    presets_of,
    read_csv,
    write_csv,
)


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
        rounded = dict.fromkeys(
            ('error', 'measured', 'wall_s', 'low', 'high', 'wall_s_per_simulated_hour'), 0
        )
        assert replace(new, **rounded) == replace(old, **rounded)
    header = path.read_text().splitlines()[0]
    assert header == (
        'case,setting,preset,quantity,error,measured,exact,unit,particles,steps,evaluations,'
        'simulated_s,wall_s,wall_s_per_simulated_hour,device,machine,command,repetitions,low,high'
    )


@pytest.mark.parametrize('text', ['case,error\n', 'case,error\na,1\n'])
def test_other_files_are_refused(tmp_path, text):
    """A file with other columns is named in the error."""
    (tmp_path / 'a.csv').write_text(text)
    with pytest.raises(LavaError, match='case,setting,preset'):
        read_csv(tmp_path / 'a.csv')


def test_json(row):
    """The JSON holds the same rows, and null for what is not a number."""
    data = as_plain([row(wall_s=0.123456789), row(error=math.nan)])
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert data[0]['wall_s'] == 0.123456789
    assert [item['error'] for item in data] == [0.01, None]


def test_front_is_what_nothing_beats():
    """A point is on the front unless another is both cheaper and better."""
    random = np.random.default_rng(3)
    candidates = [
        Point('case', str(index), '', *random.uniform(0.1, 1.0, 2), particles=1, least=1.0)
        for index in range(200)
    ]
    expected = {
        own.setting
        for own in candidates
        if not any(o.error < own.error and o.cost < own.cost for o in candidates)
    }
    front = pareto_front(candidates)
    assert {item.setting for item in front} == expected
    assert [item.cost for item in front] == sorted(item.cost for item in front)


def test_a_point_has_the_worst_error_of_its_quantities(fake_case, measured):
    """What is good in one quantity only is not good."""
    found = points(measured([fake_case()]))
    assert [item.error for item in found] == pytest.approx([1e-2 / 1.5, 1e-2 / 3.0, 1e-2 / 6.0])
    assert [item.least for item in found] == [item.error for item in found]


def test_no_result_is_the_worst(row):
    """NaN is on no front, whatever it costs; what is known of the error is kept."""
    rows = [row(), row(quantity='edge', error=math.nan), row(setting='b', wall_s=9.0, error=0.5)]
    broken, whole = points(rows)
    assert (broken.error, broken.least) == (math.inf, 0.01)
    assert pareto_front([broken, whole]) == [whole]


def test_presets_come_from_cheap_to_dear(row):
    """Their order is that of the ladder, whatever the rows' is."""
    rows = [row(setting=name, preset=name) for name in ('fine', '', 'draft')]
    assert presets_of(points(rows)) == ['draft', 'fine']
