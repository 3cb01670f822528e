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

from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from solver import flat, only, simulated


@pytest.mark.parametrize('precision', ['float32', 'float64'])
@pytest.mark.parametrize('height', [0.1, 1.0, 10.0])
@pytest.mark.parametrize('distance', [0.02, 0.1, 0.3, 1.0])
def test_columns_push_each_other_apart(device, precision, height, distance):
    """However near and thick: one that counted more than the other itself drew it in."""
    places = 0.5 * distance * np.array([[-1.0, 0.0], [1.0, 0.0]])
    simulation = simulated(
        flat(8),
        Lava(viscosity=1e6),
        Particles(places, height, 1400.0),
        effects=only('green'),
        device=device,
        spacing=1.0,
        ratio=3.5,
        precision=precision,
    )
    sample = simulation.sample()
    apart = np.sign(sample.position[:, 0]) * sample.velocity[:, 0]
    # near each other thick columns count alike: they stay where they are
    assert apart.min() >= 0.0
