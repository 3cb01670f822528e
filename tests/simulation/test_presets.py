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

"""Presets are points on the measured front, and their evidence is the committed file's."""

from itertools import pairwise
from pathlib import Path

import pytest

from lava_ros.errors import LavaError
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import DEFAULT, preset_accuracy, PRESETS
from lava_ros.verification.rows import points, read_csv

#: The measurements the presets rest on, what made them, and the case that compares presets.
ROWS = read_csv(Path(__file__).parents[2] / 'docs/accuracy/h200.csv')
COMMAND = 'lava accuracy --device cuda:0 --longest 20'
CASE = 'fixed_volume'

POINTS = [item for item in points(ROWS) if item.case == CASE]

#: The ladder of accuracy, without what is there for comparison only.
LADDER = ('draft', 'standard', 'fine', 'reference')


def point(preset):
    """The preset's point."""
    (found,) = (item for item in POINTS if item.preset == preset)
    return found


def test_names():
    """The ladder, and the paper's settings; the default is the automatic spacing as it is."""
    assert tuple(PRESETS) == (*LADDER, 'as-published')
    assert PRESETS[DEFAULT].accuracy.refinement == Accuracy().refinement
    wide = [name for name, item in PRESETS.items() if item.accuracy.precision == 'float64']
    assert wide == ['reference']


def test_spacing_takes_the_place_of_the_automatic_one():
    """A spacing is taken as it is; without one the preset is as it stands."""
    assert preset_accuracy('draft') == PRESETS['draft'].accuracy
    chosen = preset_accuracy('draft', spacing=12.0)
    assert chosen.spacing == 12.0
    assert chosen.ratio == PRESETS['draft'].accuracy.ratio


def test_unknown_preset():
    """Another name is refused with those there are."""
    with pytest.raises(LavaError, match='one of draft, standard, fine, reference, as-published'):
        preset_accuracy('best')


def test_the_evidence_was_made_as_it_says():
    """The rows that are quoted name the command, and none a place on somebody's disk."""
    assert {row.command for row in ROWS if row.case == CASE} == {COMMAND}
    assert all(row.command.startswith('lava accuracy ') for row in ROWS)
    assert not any('/' in row.command for row in ROWS)


@pytest.mark.parametrize('name', PRESETS)
def test_evidence_is_what_was_measured(name):
    """The committed errors are those quoted, rounded up by less than a half."""
    errors = PRESETS[name].errors
    rows = [row for row in ROWS if (row.case, row.preset) == (CASE, name)]
    assert {row.quantity for row in rows} >= set(errors)
    for row in rows:
        if row.quantity in errors:
            assert row.error <= errors[row.quantity] <= 1.5 * row.error, row.quantity


@pytest.mark.parametrize('name', LADDER)
def test_presets_lie_on_the_front(name):
    """No setting is better than a preset by more than a fifth in both error and time."""
    own = point(name)
    better = [
        item.setting
        for item in POINTS
        if item.error < 0.8 * own.error and item.cost < 0.8 * own.cost
    ]
    assert better == []


def test_the_ladder_climbs():
    """Each preset of the ladder does more work than the one before, and its error is smaller."""
    steps = [point(name) for name in LADDER]
    work = []
    for step in steps:
        row = next(row for row in ROWS if (row.case, row.preset) == (step.case, step.preset))
        # so few particles do not fill a GPU: its time is that of waiting
        work.append(row.particles * row.evaluations)
    for cheap, dear in pairwise(zip(steps, work, strict=True)):
        assert dear[1] > cheap[1]
        assert dear[0].error < cheap[0].error


def test_the_paper_is_dominated():
    """At no more time than the paper's settings take, a draft errs five times less."""
    paper, draft = point('as-published'), point('draft')
    assert draft.cost < paper.cost
    assert draft.error < 0.2 * paper.error
