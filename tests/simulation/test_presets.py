# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Accuracy settings; presets against the committed measurements of error and cost."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.accuracy import Accuracy, accuracy_from_dict, expected_thickness
from lava_ros.simulation.presets import DEFAULT, preset_accuracy, PRESETS
from lava_ros.verification.rows import points, read_csv

#: The measurements behind the presets, and the case that compares presets.
ROWS = read_csv(Path(__file__).parents[2] / 'docs/accuracy/h200.csv')
CASE = 'fixed_volume'

POINTS = [item for item in points(ROWS) if item.case == CASE]

#: The presets in order of accuracy, without the one for comparison.
LADDER = ('draft', 'standard', 'fine', 'reference')


def test_rejects_an_unknown_setting():
    assert accuracy_from_dict({}) == Accuracy()
    with pytest.raises(LavaError, match=r'accuracy\.spaceing.*one of method, spacing'):
        accuracy_from_dict({'spaceing': 3})


def test_expected_thickness_is_the_scale_of_a_point_source():
    """(3 mu Q / (rho g))^(1/4), with 1 m3/s if no vent is active."""
    terrain = Terrain(np.zeros((10, 10)), 10.0)
    lava = Lava.paper(viscosity=1e4, density=2600.0)
    vents = (Vent((5.0, 5.0), 10.0), Vent((50.0, 50.0), [(0.0, 4.0), (5.0, 160.0)]))
    assert expected_thickness(Scene(terrain, vents, lava)) == pytest.approx(3.703, abs=1e-3)
    assert expected_thickness(Scene(terrain, vents[:1], lava)) == pytest.approx(1.852, abs=1e-3)
    assert expected_thickness(Scene(terrain, (), lava)) == pytest.approx(1.041, abs=1e-3)


def point(preset):
    (found,) = (item for item in POINTS if item.preset == preset)
    return found


def test_unknown_preset_is_an_error_that_lists_them():
    assert tuple(PRESETS) == (*LADDER, 'as-published')
    assert PRESETS[DEFAULT].accuracy.refinement == Accuracy().refinement
    wide = [name for name, item in PRESETS.items() if item.accuracy.precision == 'float64']
    assert wide == ['reference']
    with pytest.raises(LavaError, match='one of draft, standard, fine, reference, as-published'):
        preset_accuracy('best')


@pytest.mark.parametrize('name', PRESETS)
def test_preset_errors_are_those_measured(name):
    errors = PRESETS[name].errors
    rows = [row for row in ROWS if (row.case, row.preset) == (CASE, name)]
    assert {row.quantity for row in rows} >= set(errors)
    for row in rows:
        if row.quantity in errors:
            assert row.error <= errors[row.quantity] <= 1.5 * row.error, row.quantity


@pytest.mark.parametrize('name', LADDER)
def test_no_setting_dominates_a_preset(name):
    """No setting is better by more than a fifth in both error and time."""
    own = point(name)
    assert [
        item.setting for item in POINTS
        if item.error < 0.8 * own.error and item.cost < 0.8 * own.cost
    ] == []


def test_each_preset_is_more_accurate_and_more_expensive():
    steps = [point(name) for name in LADDER]
    work = []
    for step in steps:
        row = next(row for row in ROWS if (row.case, row.preset) == (step.case, step.preset))
        # so few particles do not fill a GPU: the measured time is latency
        work.append(row.particles * row.evaluations)
    for (cheap, cheap_work), (fine, fine_work) in pairwise(zip(steps, work, strict=True)):
        assert fine_work > cheap_work
        assert fine.error < cheap.error


def test_draft_is_more_accurate_and_cheaper_than_the_paper():
    paper, draft = point('as-published'), point('draft')
    assert draft.cost < paper.cost
    assert draft.error < 0.2 * paper.error
