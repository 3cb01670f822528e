# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings of a report, their measurement, and the resulting rows."""

from dataclasses import replace
import json
import math
import platform
import re

import numpy as np
import pytest

from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import PRESETS
from lava_ros.verification import measure as measuring
from lava_ros.verification.measure import all_settings, Setting
from lava_ros.verification.rows import as_plain, pareto_front, Point, points, read_csv, write_csv


def test_rows_have_the_median_and_range_of_repetitions(fake_case, measured):
    case = fake_case()
    rows = measured([case], [Setting('a', Accuracy(refinement=2.0))], repetitions=3)
    assert [item.refinement for item in case.accuracies] == [2.0, 2.0, 2.0]
    assert [row.quantity for row in rows] == ['radius', 'profile']
    for row in rows:
        assert row.repetitions == 3
        assert (row.wall_s, row.low, row.high) == pytest.approx((0.0602, 0.0601, 0.0603))
        assert row.wall_s_per_simulated_hour == pytest.approx(2.0 * row.wall_s)
    assert rows[1].error == pytest.approx(10.0 * rows[0].error)
    case = fake_case(time=measuring.REPEATED_BELOW)
    rows = measured([case], [Setting('a', Accuracy())], repetitions=3)
    assert len(case.accuracies) == 1
    assert {row.repetitions for row in rows} == {1}


def test_settings_that_would_take_too_long_are_omitted_except_presets(fake_case, measured):
    settings = [
        Setting('coarse', Accuracy(refinement=0.5)),
        Setting('fine', Accuracy(refinement=1.0)),
        Setting('chosen', Accuracy(refinement=1.0, ratio=4.0), preset='standard'),
    ]
    case = fake_case(time=10.0 / 1.5)
    rows = measured([case], settings, longest=60.0)
    assert [item.ratio for item in case.accuracies] == [3.0, 4.0]
    assert {row.setting for row in rows} == {'coarse', 'chosen'}


def test_case_without_simulated_time_has_no_cost(fake_case, measured):
    case = fake_case()
    run = case.run
    case.run = lambda accuracy, device: replace(run(accuracy, device), simulated_time=0.0)
    rows = measured([case])
    assert all(math.isnan(row.wall_s_per_simulated_hour) for row in rows)
    assert pareto_front(points(rows)) == []


def test_machine_name_has_cores_but_no_host():
    name = measuring.machine_name('cpu')
    assert re.search(r'\d+ cores? used of \d+$', name)
    assert platform.node() not in name
    assert measuring.file_stem('cpu') == 'cpu'


@pytest.mark.parametrize('quick', [False, True])
def test_settings_are_distinct_and_include_the_presets(quick):
    found = all_settings(quick=quick)
    assert len({item.name for item in found}) == len(found)
    assert len({item.accuracy for item in found}) == len(found)
    presets = {item.preset: item.accuracy for item in found if item.preset}
    assert set(presets) == ({'draft', 'standard'} if quick else set(PRESETS))
    assert all(accuracy == PRESETS[name].accuracy for name, accuracy in presets.items())
    costs = [measuring.expected_cost(item.accuracy) for item in found]
    assert costs == sorted(costs)


def test_csv_round_trip(tmp_path, fake_case, measured):
    rows = measured([fake_case()])
    path = tmp_path / 'a.csv'
    write_csv(rows, path)
    again = read_csv(path)
    rounded = ('error', 'measured', 'wall_s', 'low', 'high', 'wall_s_per_simulated_hour')
    for old, new in zip(rows, again, strict=True):
        for name in rounded:
            assert getattr(new, name) == pytest.approx(getattr(old, name), rel=1e-5)
        same = {name: getattr(old, name) for name in rounded}
        assert replace(new, **same) == old
    header = path.read_text().splitlines()[0]
    assert header == (
        'case,setting,preset,quantity,error,measured,exact,unit,particles,steps,evaluations,'
        'simulated_s,wall_s,wall_s_per_simulated_hour,device,machine,command,repetitions,low,high'
    )


def test_json_has_null_for_nan(row):
    data = as_plain([row(wall_s=0.123456789), row(error=math.nan)])
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert data[0]['wall_s'] == 0.123456789
    assert [item['error'] for item in data] == [0.01, None]


def test_pareto_front_has_no_dominated_point():
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


def test_point_has_the_largest_error_of_its_quantities(fake_case, measured, row):
    found = points(measured([fake_case()]))
    assert [item.error for item in found] == pytest.approx([1e-2 / 1.5, 1e-2 / 3.0, 1e-2 / 6.0])
    assert [item.least for item in found] == [item.error for item in found]
    rows = [row(), row(quantity='edge', error=math.nan), row(setting='b', wall_s=9.0, error=0.5)]
    broken, whole = points(rows)
    assert (broken.error, broken.least) == (math.inf, 0.01)
    assert pareto_front([broken, whole]) == [whole]
