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

"""Runs that are timed and looked at on their way."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.forecast import pilots
from lava_ros.forecast.pilots import MARKS
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.resolution import ACROSS, flow_width

SCENE = Scene(Terrain(np.zeros((40, 40)), 10.0), (Vent((200.0, 200.0), 20.0),), lava=Lava())


def test_refinements_between_presets_have_their_accuracy():
    """All but the spacing is as the presets have it."""
    scene = replace(SCENE, lava=Lava(viscosity=1e4))
    width = flow_width(scene, horizon=3600.0)
    for refinement, name in ((0.3, 'draft'), (1.0, 'standard'), (1.3, 'standard'), (2.5, 'fine')):
        accuracy = pilots.accuracy_at(scene, refinement, 3600.0)
        assert accuracy.spacing == pytest.approx(width / (ACROSS * refinement), rel=5e-3)
        expected = replace(pilots.PRESETS[name].accuracy, spacing=accuracy.spacing)
        assert accuracy == expected


def test_a_run_is_timed_by_the_clock_it_is_given():
    """From building the simulation to its snapshot; one that takes too long is stopped."""
    scene = replace(SCENE, lava=Lava(viscosity=1e6))
    full, stopped = (
        pilots.run_at(
            scene, 0.5, 3600.0, device='cpu', wall_limit=limit, clock=iter(range(10**6)).__next__
        )
        for limit in (1e6, 10.0)
    )
    assert full.is_done and full.setup == 1.0
    # a tick for each part, before each look, and before and after all of them
    assert full.wall_time == full.progress[-1, 2] + MARKS + 2.0
    assert full.spent == full.wall_time + MARKS - 1
    assert not stopped.is_done and stopped.progress[-1, 2] == 11.0
    assert 0.0 < stopped.progress[-1, 0] < 1.0 == full.progress[-1, 0]
    assert (np.diff(full.progress, axis=0) >= 0.0).all()
    assert stopped.progress[-1, 3] < full.progress[-1, 3]
    assert stopped.evaluations < full.evaluations


def test_a_run_has_the_effects_it_is_given(device):
    """Those of a finer run, whatever the scene calls for at this spacing."""
    scene = replace(SCENE, lava=Lava(viscosity=1e6))
    own = pilots.run_at(scene, 0.5, 60.0, device=device, wall_limit=600.0)
    other = replace(own.effects, green=not own.effects.green, helmholtz=False)
    given = pilots.run_at(scene, 0.5, 60.0, device=device, wall_limit=600.0, effects=other)
    assert given.effects == other != own.effects
    forced = {'green': other.green, 'helmholtz': False}
    given = pilots.run_at(scene, 0.5, 60.0, device=device, wall_limit=600.0, effects=forced)
    assert given.effects == other
    stopped = pilots.run_at(scene, 0.5, 1e9, device=device, wall_limit=1e-3)
    assert not stopped.is_done and stopped.progress[-1, 0] < 1.0
