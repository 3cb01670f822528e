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

"""The choice of effects."""

import math

import numpy as np
import pytest

from lava_ros.effects import Effects, effects_for, steepest_slope
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain


def slope(angle):
    """A terrain that rises by an angle in degrees."""
    x = np.arange(10) * 10.0
    return Terrain(np.tile(math.tan(math.radians(angle)) * x, (10, 1)), 10.0)


def test_effects_follow_the_scene():
    """Cooling needs a loss, Arrhenius a rate, the steep-slope factor a slope."""
    gentle = effects_for(Scene(slope(3.0), lava=Lava(emissivity=0, convection=0, arrhenius=0)))
    assert gentle == Effects(green=False, arrhenius=False, cooling=False, steep=False)
    assert effects_for(Scene(slope(20.0))) == Effects(
        green=False, arrhenius=True, cooling=True, steep=True
    )


def test_overrides_win_and_are_checked():
    """A user can force an effect by name; another name is an error."""
    scene = Scene(slope(20.0))
    assert effects_for(scene, {'green': True, 'steep': False}) == Effects(green=True, steep=False)
    with pytest.raises(LavaError, match='effects.gren'):
        effects_for(scene, {'gren': True})
    with pytest.raises(LavaError, match='effects.green'):
        effects_for(scene, {'green': 'yes'})


def test_effects_are_a_key():
    """Equal effects hash alike: they key the compiled step."""
    assert hash(Effects(green=True)) == hash(Effects(green=True)) != hash(Effects())


def test_steepest_slope_skips_cells_without_data():
    """The slope is the largest over neighbours that both have data."""
    elevation = np.zeros((4, 4))
    elevation[2, 2] = np.nan
    elevation[0, 0] = 5.0
    assert steepest_slope(Terrain(elevation, 10.0)) == 0.5
