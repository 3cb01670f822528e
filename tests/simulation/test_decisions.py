# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Decisions about effects before and during a run, and the error of leaving an effect off."""

from dataclasses import replace
import math

import numpy as np
import pytest

from lava_ros.effects import EFFECTS, Effects
from lava_ros.simulation.selection import Decision, noted
from lava_ros.simulation.setup.review import Review


def decision(name, value, **others):
    return Decision(name, EFFECTS[name], value, others.pop('is_on', False), **others)


def effects(*names):
    return Effects(**{**dict.fromkeys(EFFECTS, False), **dict.fromkeys(names, True)})


@pytest.mark.parametrize('name', ['steep', 'cooling', 'helmholtz', 'inertia'])
def test_cost_is_proportional_to_the_largest_number(name):
    effect = EFFECTS[name]
    assert decision(name, effect.threshold).cost == pytest.approx(effect.cost)
    half = decision(name, 0.5 * effect.threshold)
    assert half.cost == pytest.approx(0.5 * effect.cost)
    assert replace(half, measured=0.1 * effect.threshold).cost == half.cost
    assert replace(half, measured=effect.threshold).cost == pytest.approx(effect.cost)


def test_effects_that_are_on_or_unavailable_cost_nothing():
    assert decision('steep', 0.5, is_on=True).cost == 0.0
    assert decision('yielding', math.nan).cost == 0.0
    assert decision('green', 0.5).cost == 0.0
    assert decision('vft', math.nan).cost == 0.0


def test_review_measures_an_excluded_effect():
    review, on = Review(), effects('inertia')
    for value in (0.1, 0.4, 0.3):
        called_for = [decision('helmholtz', value, is_on=value > EFFECTS['helmholtz'].threshold)]
        assert review.note(called_for, on) == []
    assert review.largest == {'helmholtz': 0.4} and review.count == 3
    assert review.note(called_for, effects()) == ['helmholtz']
    assert review.note(called_for, effects('helmholtz')) == []


def test_decision_names_the_effect_that_excludes_it():
    before = decision('helmholtz', 0.01)
    low, high = (noted(before, effects('inertia'), measured, math.nan) for measured in (0.1, 0.4))
    assert low.rival == '' and low.reason.endswith('0.01 <= 0.22, measured 0.1')
    assert high.rival == 'inertia'
    assert high.reason == 'h / half-width = 0.4 > 0.22, but excluded by inertia'
    assert high.cost == pytest.approx(EFFECTS['helmholtz'].cost * 0.4 / 0.22)
    switched = noted(before, effects('helmholtz'), 0.4, 60.0)
    assert switched.is_on and switched.rival == '' and switched.cost == 0.0
    assert switched.reason == 'h / half-width = 0.4 > 0.22 since 60 s, 0.01 expected'
    assert np.isnan(noted(before, effects(), math.nan, math.nan).measured)
