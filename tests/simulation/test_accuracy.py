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

"""The accuracy knobs."""

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.accuracy import Accuracy, accuracy_from_dict, expected_thickness


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('spacing', 0.0),
        ('thickness', -1.0),
        ('ratio', 1.0),
        ('kernel', 'gauss'),
        ('diffusion_number', 3.0),
        ('courant_number', 0.0),
        ('longest_step', 0.0),
        ('precision', 'float16'),
    ],
)
def test_knobs_are_checked_by_name(name, value):
    """Each unusable knob raises an error that names it."""
    with pytest.raises(LavaError, match=rf'^accuracy\.{name}'):
        accuracy_from_dict({name: value})


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
