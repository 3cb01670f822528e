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

"""The settings of a report: distinct, and what the studies need."""

import math

import pytest

from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import DEFAULT, PRESETS
from lava_ros.verification import settings
from lava_ros.verification.cases import CASES
from lava_ros.verification.cases.sheets import EXPERIMENTS, FORMS, LATERAL
from lava_ros.verification.settings import all_pairs, all_settings, expected_cost, name_of


@pytest.mark.parametrize('quick', [False, True])
def test_settings_are_distinct(quick):
    """No two settings share a name or an accuracy, and the presets are among them."""
    found = all_settings(quick=quick)
    assert len({item.name for item in found}) == len(found)
    assert len({item.accuracy for item in found}) == len(found)
    presets = {item.preset: item.accuracy for item in found if item.preset}
    assert set(presets) == ({'draft', 'standard'} if quick else set(PRESETS))
    assert all(accuracy == PRESETS[name].accuracy for name, accuracy in presets.items())
    costs = [expected_cost(item.accuracy) for item in found]
    assert costs == sorted(costs)


def test_settings_of_some_cases_name_cases_there_are():
    """A misspelt case would silently never run, or always."""
    assert set(settings.EVEN_CASES) <= set(CASES)
    for item in all_settings():
        assert set(item.cases or ()) <= set(CASES)


@pytest.mark.parametrize(
    ('study', 'cases'),
    [
        (settings.convergence, settings.KNOB_CASES),
        (settings.stepping, settings.KNOB_CASES),
        (lambda: settings.from_paper().values(), settings.KNOB_CASES),
        (lambda: settings.gradients().values(), settings.GRADIENT_CASES),
    ],
)
def test_what_is_studied_is_run(study, cases):
    """Every setting of a study is measured in its cases, once."""
    pairs = [(case.name, item.accuracy) for case, item in all_pairs()]
    for accuracy in study():
        for case in cases:
            assert pairs.count((case, accuracy)) == 1


def test_even_layers_are_run_at_presets_only():
    """Where the resolution hardly enters there is no front to look for."""
    pairs = all_pairs()
    for name in settings.EVEN_CASES:
        assert all(item.preset for case, item in pairs if case.name == name)
    assert any(not item.preset for case, item in pairs if case.name == 'dam_break')


def test_a_setting_may_be_for_some_cases_only():
    """The paper's 20,000 steps are taken in one case."""
    paper = {case.name for case, item in all_pairs() if item.preset == 'as-published'}
    assert paper == set(settings.KNOB_CASES)


def test_the_papers_radius_is_a_metre():
    """The fixed volume ends as a disc of 130 m; the particles' distance times 1.84 is 1 m."""
    literal = settings.from_paper()['l = 1 m, as in table 3.1']
    count = 8000.0 * literal.refinement**2
    spacing = math.sqrt(math.pi * 130.0**2 / count)
    assert literal.ratio * spacing == pytest.approx(1.0, rel=1e-3)
    paper = PRESETS['as-published'].accuracy
    assert literal.fixed_step == paper.fixed_step


def test_names_say_what_is_not_usual():
    """Resolution always; knobs by name and value, words by themselves."""
    accuracy = Accuracy(
        ratio=3.5, kernel='poly6', courant_number=0.25, gradient='difference', deterministic=True
    )
    assert name_of(accuracy) == (
        'refinement 1, ratio 3.5, poly6, courant number 0.25, gradient difference, deterministic'
    )


def test_the_lateral_experiments_are_run():
    """All of them, and in a quick report every form at two radii; each at the default preset."""
    names = list(EXPERIMENTS)
    found = [item for case, item in all_pairs() if case.name == LATERAL]
    assert [item.name for item in found] == names
    assert {item.accuracy for item in found} == {PRESETS[DEFAULT].accuracy}
    quick = [item.name for case, item in all_pairs(quick=True) if case.name == LATERAL]
    assert len(quick) == 2 * len(FORMS)
    assert set(quick) < set(names)
