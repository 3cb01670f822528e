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

"""A channel with walls: what lateral stress does to the mean velocity."""

import math

import numpy as np
import pytest

from lava_ros.accuracy import Accuracy
from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Particles, Simulation


def mean_velocity(width, *, spacing, ratio, device, **lateral):
    """Mean over local velocity in a channel of given width [m], lava 1 m thick.

    The channel lies between mirrored ones whose slope is the opposite: the flow is odd about the
    walls, so it vanishes there, as on a wall without slip.
    """
    across, along, cell = 4.0 * width, 12.0, min(0.1, 0.5 * spacing)
    rows, columns = round(1.4 * across / cell), round(1.4 * along / cell)
    y = (np.arange(rows) + 0.5 - 0.5 * rows) * cell
    x = (np.arange(columns) + 0.5 - 0.5 * columns) * cell
    sign = np.where(np.floor((y + 0.5 * width) / width) % 2 == 0, 1.0, -1.0)
    terrain = Terrain(
        -0.01 * np.outer(sign, x), cell, origin=(-0.5 * columns * cell, -0.5 * rows * cell)
    )
    ticks = [
        (np.arange(round(side / spacing)) + 0.5) * spacing - 0.5 * side for side in (along, across)
    ]
    simulation = Simulation(
        Scene(terrain, lava=Lava(viscosity=1e4)),
        effects=Effects(arrhenius=False, cooling=False, steep=False, **lateral),
        accuracy=Accuracy(spacing=spacing, ratio=ratio, thickness=1.0),
        particles=Particles(np.stack(np.meshgrid(*ticks), -1).reshape(-1, 2), spacing**2, 1400.0),
        device=device,
    )
    sample = simulation.sample()
    inside = (np.abs(sample.position[:, 1]) < 0.5 * width) & (np.abs(sample.position[:, 0]) < 1.0)
    local = 2500.0 * 9.81 * 0.01 / 3e4
    return sample.velocity[inside, 0].mean() / local


def exact(width):
    """Mean over free velocity, 1 - tanh(k W / 2) / (k W / 2) with k = sqrt(3) / h."""
    half = 0.5 * math.sqrt(3.0) * width
    return 1.0 - math.tanh(half) / half


@pytest.mark.parametrize(('width', 'spacing'), [(1.0, 0.05), (2.5, 0.125), (5.0, 0.125)])
def test_helmholtz_solve_in_a_channel(device, width, spacing):
    """The solve is within 1 % for channels from one to five thicknesses wide."""
    measured = mean_velocity(width, spacing=spacing, ratio=3.0, device=device, helmholtz=True)
    assert measured == pytest.approx(exact(width), rel=0.01)


def test_green_function_in_a_channel(device):
    """With a support of 6 / k the Green's function is within 1 %, six thicknesses wide."""
    measured = mean_velocity(6.0, spacing=0.3, ratio=11.5, device=device, green=True)
    assert measured == pytest.approx(exact(6.0), rel=0.01)


def test_a_short_support_loses_the_walls(device):
    """Cut off at 1.7 thicknesses the Green's function sees half of the walls: it is no bargain."""
    measured = mean_velocity(6.0, spacing=0.3, ratio=5.5, device=device, green=True)
    assert measured > 1.03 * exact(6.0)
