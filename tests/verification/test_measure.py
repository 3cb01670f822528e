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

"""Measuring: medians, what is left out, progress, and the name of the machine."""

from dataclasses import replace
import math
import platform
import re

import pytest

from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification.cases import CASES
from lava_ros.verification.measure import file_stem, machine_name, measure, REPEATED_BELOW
from lava_ros.verification.rows import pareto_front, points
from lava_ros.verification.settings import Setting


def test_rows_hold_the_median_and_the_range(fake_case, measured):
    """A short run is timed as often as asked."""
    case = fake_case()
    rows = measured([case], [Setting('a', Accuracy(refinement=2.0))], repetitions=3)
    assert [item.refinement for item in case.accuracies] == [2.0, 2.0, 2.0]
    assert [row.quantity for row in rows] == ['radius', 'profile']
    for row in rows:
        assert row.repetitions == 3
        assert row.wall_s == pytest.approx(0.0602)
        assert (row.low, row.high) == (pytest.approx(0.0601), pytest.approx(0.0603))
        assert row.wall_s_per_simulated_hour == pytest.approx(2.0 * row.wall_s)
    assert rows[1].error == pytest.approx(10.0 * rows[0].error)


def test_long_runs_are_not_repeated(fake_case, measured):
    """A run longer than the limit is timed once."""
    case = fake_case(time=REPEATED_BELOW)
    rows = measured([case], [Setting('a', Accuracy())], repetitions=3)
    assert len(case.accuracies) == 1
    assert {row.repetitions for row in rows} == {1}


def test_what_takes_too_long_is_left_out(fake_case, measured):
    """A run eight times as dear as one of 10 s is not tried within 60 s, a preset is."""
    settings = [
        Setting('coarse', Accuracy(refinement=0.5)),
        Setting('fine', Accuracy(refinement=1.0)),
        Setting('chosen', Accuracy(refinement=1.0, ratio=4.0), preset='standard'),
    ]
    case = fake_case(time=10.0 / 1.5)
    rows = measured([case], settings, longest=60.0)
    assert [item.ratio for item in case.accuracies] == [3.0, 4.0]
    assert {row.setting for row in rows} == {'coarse', 'chosen'}


def test_a_case_without_time_has_no_cost(fake_case, measured):
    """A look at the velocity alone simulates nothing: no cost for an hour, and no front."""
    case = fake_case()
    run = case.run
    case.run = lambda accuracy, device: replace(run(accuracy, device), simulated_time=0.0)
    rows = measured([case])
    assert all(math.isnan(row.wall_s_per_simulated_hour) for row in rows)
    assert pareto_front(points(rows)) == []


def test_progress_goes_from_nothing_to_all(fake_case, measured):
    """The share of the work that is done grows from 0 to 1."""
    shares = []
    cases = [fake_case('a'), fake_case('b')]
    measured(cases, on_progress=lambda _, share: shares.append(share))
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert sorted(shares) == shares


def test_a_case_is_handed_out_before_the_next_begins(fake_case):
    """Who is interrupted in the second case has the rows of the first."""
    one, two = fake_case('one'), fake_case('two')
    pairs = [(case, Setting('a', Accuracy())) for case in (one, two)]
    found = measure(pairs, device='cpu', command='lava accuracy', repetitions=1)
    assert {row.case for row in next(found)} == {'one'}
    assert two.accuracies == []
    assert {row.case for row in next(found)} == {'two'}
    assert next(found, None) is None


def test_experiments_of_one_name_are_one_case(fake_case):
    """Cases that share a name are measured together, each at its own setting."""
    pairs = [(fake_case('same'), Setting(name, Accuracy())) for name in ('a', 'b')]
    groups = list(measure(pairs, device='cpu', command='lava accuracy', repetitions=1))
    assert [[row.setting for row in rows] for rows in groups] == [['a', 'a', 'b', 'b']]


def test_machine_names_no_host():
    """The CPU is named by its model and the cores that are used."""
    name = machine_name('cpu')
    assert re.search(r'\d+ cores? used of \d+$', name)
    assert platform.node() not in name
    assert file_stem('cpu') == 'cpu'


def test_a_real_case_is_measured(measured):
    """The solver itself: more particles, less error, more time."""
    settings = [Setting(f'{n:g}', Accuracy(refinement=n)) for n in (0.25, 0.5)]
    rows = measured([CASES['fixed_volume']], settings, repetitions=1)
    coarse, fine = points(rows)
    assert fine.particles > 2 * coarse.particles
    assert fine.error < coarse.error < 0.1
    assert fine.cost > coarse.cost
