# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The accuracy knobs; presets are points on the measured front, by the committed evidence."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.accuracy import Accuracy, accuracy_from_dict, expected_thickness
from lava_ros.simulation.presets import DEFAULT, preset_accuracy, PRESETS
from lava_ros.verification.rows import points, read_csv

#: The measurements the presets rest on, what made them, and the case that compares presets.
ROWS = read_csv(Path(__file__).parents[2] / 'docs/accuracy/h200.csv')
COMMAND = 'lava accuracy --device cuda:0 --longest 20'
CASE = 'fixed_volume'

POINTS = [item for item in points(ROWS) if item.case == CASE]

#: The ladder of accuracy, without what is there for comparison only.
LADDER = ('draft', 'standard', 'fine', 'reference')


@pytest.mark.parametrize(
    'knob',
    [
        {'spacing': 0.0}, {'thickness': -1.0}, {'ratio': 1.0}, {'kernel': 'gauss'},
        {'diffusion_number': 3.0}, {'courant_number': 0.0}, {'longest_step': 0.0},
        {'precision': 'float16'},
    ],
    ids=''.join,
)
def test_knobs_are_checked_by_name(knob):
    """Each unusable knob raises an error that names it."""
    with pytest.raises(LavaError, match=rf'^accuracy\.{"".join(knob)}'):
        accuracy_from_dict(knob)


def test_unknown_knob_is_refused():
    """A misspelt key is named with the allowed ones, and none gives the defaults."""
    assert accuracy_from_dict({}) == Accuracy()
    with pytest.raises(LavaError, match=r'accuracy\.spaceing.*one of spacing'):
        accuracy_from_dict({'spaceing': 3})


def test_expected_thickness_is_the_scale_of_a_point_source():
    """(3 mu Q / (rho g))^(1/4) with the largest discharge; 1 m3/s where no vent flows."""
    terrain = Terrain(np.zeros((10, 10)), 10.0)
    lava = Lava(viscosity=1e4, density=2600.0)
    vents = (Vent((5.0, 5.0), 10.0), Vent((50.0, 50.0), [(0.0, 4.0), (5.0, 160.0)]))
    assert expected_thickness(Scene(terrain, vents, lava)) == pytest.approx(3.703, abs=1e-3)
    assert expected_thickness(Scene(terrain, vents[:1], lava)) == pytest.approx(1.852, abs=1e-3)
    assert expected_thickness(Scene(terrain, (), lava)) == pytest.approx(1.041, abs=1e-3)


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
    with pytest.raises(LavaError, match='one of draft, standard, fine, reference, as-published'):
        preset_accuracy('best')


def test_spacing_takes_the_place_of_the_automatic_one():
    """A spacing is taken as it is; without one the preset is as it stands."""
    assert preset_accuracy('draft') == PRESETS['draft'].accuracy
    chosen = preset_accuracy('draft', spacing=12.0)
    assert chosen.spacing == 12.0
    assert chosen.ratio == PRESETS['draft'].accuracy.ratio


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
