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

"""What is chosen by the deadline of forecasts, and what the node says of it."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.forecast import planning as affordable
from lava_ros.forecast.planning import Affordable
from lava_ros.ros import diagnostics
from lava_ros.ros.deadline import DeadlineChooser
from lava_ros.ros.parameters import Settings
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.presets import preset_accuracy

SCENE = Scene(Terrain(np.zeros((10, 10)), 10.0), (Vent((50.0, 50.0), 5.0),), lava=Lava())

SETTINGS = Settings(
    device='cpu', forecast_horizon=600.0, ensemble_members=8, deadline=20.0, preset='draft'
)


def plan(members):
    """A plan of so many runs."""
    return Affordable(
        preset='draft', spacing=25.0, refinement=0.4, members=members, wall_time=9.0, error=0.02,
        sampling_error=0.1, is_finest=False, pilots=3, spent=4.0,
    )


@pytest.fixture
def asked(monkeypatch):
    """Members that were planned for; as many as 20 can be had."""
    found = []

    def afford(scene, *, within, horizon, members, device):
        found.append(members)
        assert (scene, within, horizon, device) == (SCENE, 20.0, 600.0, 'cpu')
        if members is not None and members > 20:
            raise LavaError('within', within, 'about 31 s: that is what the coarsest take')
        return plan(members or 13)

    monkeypatch.setattr(affordable, 'afford', afford)
    return found


def test_the_finest_that_is_there_in_time(asked):
    """A forecast, and members that take turns with the next ones; the spacing is the plan's."""
    chooser = DeadlineChooser()
    assert chooser.accuracy(SCENE, SETTINGS).spacing == 25.0
    assert asked == [17]
    choice = chooser.choice
    assert (choice.members, choice.is_met, choice.spacing) == (8, True, 25.0)
    assert '8 of 8 members: 17 runs in about 9 s of 20 s' in choice.reason
    assert choice.sampling_error == pytest.approx(0.5 / 8**0.5)
    status = diagnostics.deadline_status(20.0, choice, took=3.0)
    assert status.level == status.OK and status.message == choice.reason
    late = diagnostics.deadline_status(20.0, choice, took=30.0)
    assert late.level == status.WARN and late.message.startswith('late: the newest took 30 s')
    assert {item.key: item.value for item in late.values}['expected_error'] == '0.02'


def test_fewer_members_where_not_even_the_coarsest_fit(asked):
    """As many as err least."""
    chooser = DeadlineChooser()
    chooser.accuracy(SCENE, replace(SETTINGS, ensemble_members=100))
    assert asked == [201, None]
    assert chooser.choice.members == 6
    assert '6 of 100 members' in chooser.choice.reason


def test_a_flow_is_never_refused_for_a_deadline(monkeypatch):
    """Late maps are better than none: the preset is that of the parameters, with a warning."""
    chooser = DeadlineChooser()
    settings = replace(SETTINGS, ensemble_members=0)

    def too_late(*_, **__):
        raise LavaError('within', 20.0, 'longer: the coarsest runs take more')

    monkeypatch.setattr(affordable, 'afford', too_late)
    assert chooser.accuracy(SCENE, settings) == preset_accuracy('draft', spacing=None)
    assert not chooser.choice.is_met and 'the coarsest runs take more' in chooser.choice.reason
    status = diagnostics.deadline_status(20.0, chooser.choice, took=0.0)
    assert status.level == status.WARN


def test_nothing_to_choose(asked):
    """Without a deadline, or without lava that comes."""
    chooser = DeadlineChooser()
    usual = preset_accuracy('draft', spacing=None)
    assert chooser.accuracy(SCENE, replace(SETTINGS, deadline=0.0)) == usual
    assert chooser.accuracy(replace(SCENE, vents=()), SETTINGS) == usual
    assert chooser.choice is None and asked == []
    status = diagnostics.deadline_status(20.0, None, took=1.0)
    assert status.level == status.OK and status.message.startswith('nothing chosen')
