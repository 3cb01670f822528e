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

"""The mapped footprint: where the lava ends, whatever the kernel radius."""

import math

import numpy as np
import pytest

from lava_ros.accuracy import Accuracy
from lava_ros.effects import Effects
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation import Particles, Simulation
from lava_ros.verification.exact import FixedVolumeSpread

RADIUS, VOLUME = 130.0, 1e5
DOME = FixedVolumeSpread(VOLUME, 1e4 / 2600.0, 9.81)
TIME = DOME.time_of_radius(RADIUS)


def mapped(count, ratio, device='cpu', cells=300):
    """The map of Huppert's profile given as particles, and the area of its cells [m2]."""
    side = 400.0
    simulation = Simulation(
        Scene(Terrain(np.zeros((cells, cells)), side / cells, origin=(-0.5 * side,) * 2)),
        effects=Effects(arrhenius=False, cooling=False, steep=False),
        accuracy=Accuracy(
            spacing=RADIUS * math.sqrt(math.pi / count),
            thickness=VOLUME / (math.pi * RADIUS**2),
            ratio=ratio,
        ),
        particles=Particles(DOME.particles(count, TIME), VOLUME / count, 1400.0),
        device=device,
    )
    return simulation.snapshot(), (side / cells) ** 2


@pytest.mark.parametrize('count', [500, 2000, 8000])
@pytest.mark.parametrize('ratio', [2.5, 3.0, 4.0])
def test_footprint_does_not_swell_with_the_kernel(device, count, ratio):
    """The radius where the lava is over 10 cm is right within 1 %; a bare sum is 1 to 5 % out."""
    snapshot, area = mapped(count, ratio, device)
    centre = float(DOME.thickness(0.0, TIME))
    exact = RADIUS * math.sqrt(1.0 - (0.1 / centre) ** 3)
    radius = math.sqrt((snapshot.thickness > 0.1).sum() * area / math.pi)
    assert radius == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize('count', [500, 2000, 8000])
def test_map_holds_the_volume(device, count):
    """Thickness times area, summed over the cells, is the volume within 0.5 %."""
    snapshot, area = mapped(count, 3.0, device)
    assert snapshot.thickness.sum() * area == pytest.approx(VOLUME, rel=0.005)


def test_map_has_the_profile():
    """Thickness along a radius follows the exact profile to the edge."""
    snapshot, _ = mapped(8000, 3.0)
    row = snapshot.thickness[150]
    x = (np.arange(300) + 0.5) * 400.0 / 300 - 200.0
    inside = np.abs(x) < 0.9 * RADIUS
    assert row[inside] == pytest.approx(DOME.thickness(np.abs(x[inside]), TIME), rel=0.03)


def test_a_lone_particle_is_on_the_map():
    """One particle covers some cells and holds its volume, more or less."""
    simulation = Simulation(
        Scene(Terrain(np.zeros((40, 40)), 1.0)),
        accuracy=Accuracy(spacing=4.0, thickness=1.0),
        particles=Particles([[20.0, 20.0]], 16.0, 1400.0),
        device='cpu',
    )
    thickness = simulation.snapshot().thickness
    assert thickness[20, 20] > 0.1
    assert thickness.sum() == pytest.approx(16.0, rel=0.5)
