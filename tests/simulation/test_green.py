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

"""The Green's function: what its weights do to lava that is close together."""

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy


@pytest.mark.parametrize('precision', ['float32', 'float64'])
@pytest.mark.parametrize('height', [0.1, 1.0, 10.0])
@pytest.mark.parametrize('distance', [0.02, 0.1, 0.3, 1.0])
def test_columns_push_each_other_apart(device, precision, height, distance):
    """However near and thick: one that counted more than the other itself drew it in."""
    places = 0.5 * distance * np.array([[-1.0, 0.0], [1.0, 0.0]])
    simulation = Simulation(
        Scene(Terrain(np.zeros((8, 8)), 1.0, (-4.0, -4.0)), lava=Lava(viscosity=1e6)),
        effects=Effects(arrhenius=False, cooling=False, steep=False, green=True),
        accuracy=Accuracy(spacing=1.0, ratio=3.5, precision=precision),
        particles=Particles(places, [height, height], 1400.0),
        device=device,
    )
    sample = simulation.sample()
    apart = np.sign(sample.position[:, 0]) * sample.velocity[:, 0]
    # near each other thick columns count alike: they stay where they are
    assert apart.min() >= 0.0
