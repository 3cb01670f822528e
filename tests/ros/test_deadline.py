# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Choice of accuracy and members for a deadline."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.forecast import planning as affordable
from lava_ros.forecast.planning import RunPlan
from lava_ros.ros import diagnostics
from lava_ros.ros.parameters import Settings
from lava_ros.ros.startup_inputs import SimulationFactory
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.numerical_error import AreaError, NumericalError
from lava_ros.simulation.presets import preset_accuracy

SCENE = Scene(Terrain(np.zeros((10, 10)), 10.0), (Vent((50.0, 50.0), 5.0),), lava=Lava.paper())

ERROR = NumericalError(AreaError(0.02, 0.01), AreaError(0.01, 0.0), 25.0, 10.0, 600.0)

SETTINGS = Settings(
    device='cpu', forecast_horizon=600.0, ensemble_members=8, deadline=20.0, preset='draft'
)


@pytest.fixture
def planned_members(monkeypatch):
    """Return a list that records the number of planned members; a plan has at most 20."""
    found = []

    def plan_within(scene, *, within, horizon, members, device):
        found.append(members)
        assert (scene, within, horizon, device) == (SCENE, 20.0, 600.0, 'cpu')
        if members is not None and members > 20:
            raise LavaError('within', within, 'about 31 s: that is what the coarsest take')
        return RunPlan(
            preset='draft', spacing=25.0, refinement=0.4, members=members or 13, wall_time=9.0,
            numerical_error=ERROR, sampling_error=0.1, is_finest=False, pilots=3, spent=4.0,
        )

    monkeypatch.setattr(affordable, 'plan_within', plan_within)
    return found


def test_deadline_chooses_the_finest_plan_in_time(planned_members):
    chooser = SimulationFactory()
    assert chooser.accuracy(SCENE, SETTINGS).spacing == 25.0
    assert planned_members == [17]
    choice = chooser.choice
    assert (choice.members, choice.plan.spacing) == (8, 25.0)
    assert '8 of 8 members: 17 runs in about 9 s of 20 s' in choice.reason
    assert choice.sampling_error == pytest.approx(0.5 / 8**0.5)
    status = diagnostics.deadline_status(20.0, choice, took=3.0)
    assert status.level == status.OK and status.message == choice.reason
    late = diagnostics.deadline_status(20.0, choice, took=30.0)
    assert late.level == status.WARN and late.message.startswith('late: the newest took 30 s')
    assert {item.key: item.value for item in late.values}['numerical_error'] == ERROR.text()


def test_deadline_reduces_the_number_of_members(planned_members):
    chooser = SimulationFactory()
    chooser.accuracy(SCENE, replace(SETTINGS, ensemble_members=100))
    assert planned_members == [201, None]
    assert chooser.choice.members == 6
    assert '6 of 100 members' in chooser.choice.reason


def test_impossible_deadline_is_a_warning(monkeypatch):
    chooser = SimulationFactory()
    too_late = LavaError('within', 20.0, 'longer: the coarsest runs take more')
    monkeypatch.setattr(affordable, 'plan_within', Mock(side_effect=too_late))
    settings = replace(SETTINGS, ensemble_members=0)
    assert chooser.accuracy(SCENE, settings) == preset_accuracy('draft', spacing=None)
    assert chooser.choice.plan is None and 'the coarsest runs take more' in chooser.choice.reason
    status = diagnostics.deadline_status(20.0, chooser.choice, took=0.0)
    assert status.level == status.WARN


def test_no_choice_without_a_deadline_or_a_vent(planned_members):
    chooser = SimulationFactory()
    usual = preset_accuracy('draft', spacing=None)
    assert chooser.accuracy(SCENE, replace(SETTINGS, deadline=0.0)) == usual
    assert chooser.accuracy(replace(SCENE, vents=()), SETTINGS) == usual
    assert chooser.choice is None and planned_members == []
    status = diagnostics.deadline_status(20.0, None, took=1.0)
    assert status.level == status.OK and status.message.startswith('nothing chosen')
