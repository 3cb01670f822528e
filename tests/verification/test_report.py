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

"""The report: settings, measuring, fronts, and the files it writes."""

from dataclasses import dataclass, replace
import json
import math

from matplotlib.image import imread
import numpy as np
import pytest

from lava_ros.accuracy import Accuracy
from lava_ros.errors import LavaError
from lava_ros.presets import PRESETS
from lava_ros.verification import report
from lava_ros.verification.cases import CASES
from lava_ros.verification.chart import draw
from lava_ros.verification.report import Point, Setting


@dataclass(frozen=True)
class FakeMeasurement:
    """A measured number with the error it is given."""

    quantity: str
    error: float
    measured: float = 1.0
    exact: float = 1.0
    unit: str = 'm'


@dataclass(frozen=True)
class FakeRun:
    """A run that took the time it is given."""

    case: str
    measurements: tuple
    wall_time: float
    particles: int = 100
    steps: int = 3
    evaluations: int = 9
    simulated_time: float = 1800.0


class FakeCase:
    """A case whose error falls and whose time grows with the refinement."""

    def __init__(self, name='fake', time=0.01):
        self.name, self.title, self.source = name, f'The {name} case', 'nowhere'
        self.time = time
        self.accuracies = []

    def run(self, accuracy, device):
        """Count the runs; each takes a little longer than the one before."""
        self.accuracies.append(accuracy)
        scale = accuracy.refinement * accuracy.ratio
        return FakeRun(
            self.name,
            (FakeMeasurement('radius', 1e-3 / scale), FakeMeasurement('profile', 1e-2 / scale)),
            self.time * scale + 1e-4 * len(self.accuracies),
        )


def measured(cases, settings=None, **options):
    """Rows of cases, at three refinements unless told."""
    settings = settings or [
        Setting(f'refinement {n:g}', Accuracy(refinement=n)) for n in (0.5, 1.0, 2.0)
    ]
    return report.measure(cases, settings, device='cpu', command='lava accuracy', **options)


def test_rows_hold_the_median_and_the_range():
    """A short run is timed as often as asked."""
    case = FakeCase()
    rows = measured([case], [Setting('a', Accuracy(refinement=2.0))], repetitions=3)
    assert [item.refinement for item in case.accuracies] == [2.0, 2.0, 2.0]
    assert [row.quantity for row in rows] == ['radius', 'profile']
    for row in rows:
        assert row.repetitions == 3
        assert row.wall_s == pytest.approx(0.0602)
        assert (row.low, row.high) == (pytest.approx(0.0601), pytest.approx(0.0603))
        assert row.wall_s_per_simulated_hour == pytest.approx(2.0 * row.wall_s)
    assert rows[1].error == pytest.approx(10.0 * rows[0].error)


def test_long_runs_are_not_repeated():
    """A run longer than the limit is timed once."""
    case = FakeCase(time=report.REPEATED_BELOW)
    rows = measured([case], [Setting('a', Accuracy())], repetitions=3)
    assert len(case.accuracies) == 1
    assert {row.repetitions for row in rows} == {1}


def test_a_setting_may_be_for_some_cases_only():
    """What costs hours elsewhere is run where it is told to."""
    settings = [Setting('a', Accuracy()), Setting('b', Accuracy(), cases=('two',))]
    rows = measured([FakeCase('one'), FakeCase('two')], settings)
    assert {(row.case, row.setting) for row in rows} == {('one', 'a'), ('two', 'a'), ('two', 'b')}


def test_what_takes_too_long_is_left_out():
    """A run eight times as dear as one of 10 s is not tried within 60 s, a preset is."""
    settings = [
        Setting('coarse', Accuracy(refinement=0.5)),
        Setting('fine', Accuracy(refinement=1.0)),
        Setting('chosen', Accuracy(refinement=1.0, ratio=4.0), preset='standard'),
    ]
    case = FakeCase(time=10.0 / 1.5)
    rows = measured([case], settings, longest=60.0)
    assert [item.ratio for item in case.accuracies] == [3.0, 4.0]
    assert {row.setting for row in rows} == {'coarse', 'chosen'}


def test_even_layers_are_run_at_presets_only():
    """Where the resolution hardly enters there is no front to look for."""
    settings = [Setting('a', Accuracy()), Setting('b', Accuracy(ratio=4.0), preset='standard')]
    rows = measured([FakeCase('sheet'), FakeCase('else')], settings)
    assert {(row.case, row.setting) for row in rows} == {
        ('sheet', 'b'), ('else', 'a'), ('else', 'b')
    }


def test_no_result_is_the_worst(tmp_path):
    """NaN is neither on the front nor in the chart, and null in JSON."""
    rows = measured([FakeCase()])
    broken = [replace(rows[0], setting='broken', error=math.nan), *rows]
    first, *others = report.points(broken)
    assert first.error == math.inf
    assert report.pareto_front([first, *others]) == report.pareto_front(others)
    draw(broken, {}, tmp_path / 'a.png')
    report.write_json(broken, tmp_path / 'a.json')
    assert json.loads((tmp_path / 'a.json').read_text())[0]['error'] is None
    assert '| none |' in report.markdown(broken, {}, stem='cpu')


def test_a_case_without_time_has_no_cost():
    """A look at the velocity alone simulates nothing: no cost for an hour, and no front."""
    case = FakeCase()
    run = case.run
    case.run = lambda accuracy, device: replace(run(accuracy, device), simulated_time=0.0)
    rows = measured([case])
    assert all(math.isnan(row.wall_s_per_simulated_hour) for row in rows)
    assert report.pareto_front(report.points(rows)) == []


def test_progress_goes_from_nothing_to_all():
    """The share of the work that is done grows from 0 to 1."""
    shares = []
    measured([FakeCase('a'), FakeCase('b')], on_progress=lambda _, share: shares.append(share))
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert sorted(shares) == shares


@pytest.mark.parametrize('quick', [False, True])
def test_settings_are_distinct(quick):
    """No two settings share a name or an accuracy, and the presets are among them."""
    settings = report.all_settings(quick=quick)
    assert len({item.name for item in settings}) == len(settings)
    assert len({item.accuracy for item in settings}) == len(settings)
    presets = [item.preset for item in settings if item.preset]
    assert set(presets) == ({'draft', 'standard'} if quick else set(PRESETS))
    costs = [report.expected_cost(item.accuracy) for item in settings]
    assert costs == sorted(costs)


def test_settings_of_some_cases_name_cases_there_are():
    """A misspelt case would silently never run, or always."""
    assert set(report.EVEN_CASES) <= set(CASES)
    for item in report.all_settings():
        assert set(item.cases or ()) <= set(CASES)


def test_front_is_what_nothing_beats():
    """A point is on the front unless another is both cheaper and better."""
    random = np.random.default_rng(3)
    candidates = [
        Point('case', str(index), '', *random.uniform(0.1, 1.0, 2), particles=1)
        for index in range(200)
    ]
    expected = {
        own.setting
        for own in candidates
        if not any(o.error < own.error and o.cost < own.cost for o in candidates)
    }
    front = report.pareto_front(candidates)
    assert {item.setting for item in front} == expected
    assert [item.cost for item in front] == sorted(item.cost for item in front)


def test_a_point_has_the_worst_error_of_its_quantities():
    """What is good in one quantity only is not good."""
    found = report.points(measured([FakeCase()]))
    assert [item.error for item in found] == pytest.approx([1e-2 / 1.5, 1e-2 / 3.0, 1e-2 / 6.0])


def test_csv_round_trip(tmp_path):
    """What was written is read back, to six digits."""
    rows = measured([FakeCase()])
    path = tmp_path / 'a.csv'
    report.write_csv(rows, path)
    again = report.read_csv(path)
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
        report.read_csv(tmp_path / 'a.csv')


def test_json(tmp_path):
    """The JSON holds the same rows."""
    rows = measured([FakeCase()])
    report.write_json(rows, tmp_path / 'a.json')
    data = json.loads((tmp_path / 'a.json').read_text())
    assert [item['wall_s'] for item in data] == [row.wall_s for row in rows]


def test_markdown_names_presets_and_front():
    """The table of presets has their error and cost; settings on the front are bold."""
    settings = [
        Setting('coarse', Accuracy(refinement=0.5)),
        Setting('chosen', Accuracy(refinement=1.0), preset='standard'),
    ]
    text = report.markdown(measured([FakeCase()], settings), {'fake': 'A title'}, stem='cpu')
    assert '| case | standard |' in text
    assert '| A title | 0.33 % in 61 ms |' in text
    assert '**standard: chosen**' in text
    assert '![' in text
    assert 'cpu.csv' in text


@pytest.mark.parametrize('count', [1, 2, 7])
def test_chart_is_drawn(tmp_path, count):
    """A picture with as many panels as cases, which is not blank."""
    settings = report.all_settings(quick=True)
    cases = [FakeCase(f'case{index}') for index in range(count)]
    rows = measured(cases, settings)
    draw(rows, {case.name: case.title for case in cases}, tmp_path / 'a.png')
    picture = imread(tmp_path / 'a.png')
    assert picture.shape[0] > 400
    assert (picture[..., :3].min(axis=2) < 0.5).mean() > 0.005


def test_a_picture_that_cannot_be_written(tmp_path):
    """A folder that is not there is an error that names the file."""
    with pytest.raises(LavaError, match=r'none/a\.png'):
        draw(measured([FakeCase()]), {}, tmp_path / 'none/a.png')


def test_machine_names_no_host():
    """The CPU is named by its model and the cores that are used."""
    import platform

    name = report.machine_name('cpu')
    assert '1 core used of' in name
    assert platform.node() not in name
    assert report.file_stem('cpu') == 'cpu'


@pytest.mark.parametrize(
    ('value', 'text'),
    [(0.0123, '12 ms'), (3.21, '3.2 s'), (59.6, '60 s'), (1800.0, '30 min'), (9000.0, '2.5 h')],
)
def test_seconds(value, text):
    """Times have two digits and the unit that suits them."""
    assert report.seconds(value) == text


@pytest.mark.parametrize(
    ('value', 'text'), [(0.0345, '3.5 %'), (0.25, '25 %'), (1.0, '100 %'), (2e-7, '2e-07')]
)
def test_percent(value, text):
    """Shares have two digits; rounding errors are powers of ten."""
    assert report.percent(value) == text


def test_a_real_case_is_measured():
    """The solver itself: more particles, less error, more time."""
    settings = [Setting(f'{n:g}', Accuracy(refinement=n)) for n in (0.25, 0.5)]
    rows = measured([CASES['fixed_volume']], settings, repetitions=1)
    coarse, fine = report.points(rows)
    assert fine.particles > 2 * coarse.particles
    assert fine.error < coarse.error < 0.1
    assert fine.cost > coarse.cost
