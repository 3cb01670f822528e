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

"""The printed formulas, against the same written out in numpy, and against the corrected ones."""

import math

import numpy as np
import pytest

from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification.cases import spread_of_fixed_volume
from solver import incline, lattice, only, simulated


def test_published_velocity_is_the_printed_sum(device):
    """Equations 3.36, 3.40 and 3.44, summed over all pairs."""
    rng = np.random.default_rng(5)
    places = rng.uniform(4.0, 16.0, (150, 2))
    slope = 0.125
    simulation = simulated(
        incline(-slope, 20, 20, 1.0),
        Lava(viscosity=100.0),
        Particles(places, 0.64, 1423.0),
        effects=only(),
        device=device,
        spacing=0.8,
        ratio=2.5,
        thickness=1.0,
        kernel='poly6',
        formulation='as-published',
        precision='float64',
    )
    sample = simulation.sample()
    radius = simulation.radius
    offset = sample.position[:, None] - sample.position[None]
    distance = np.linalg.norm(offset, axis=-1)
    near = distance < radius
    height = (0.64 * 4 / (math.pi * radius**8) * near * (radius**2 - distance**2) ** 3).sum(axis=1)
    pull = -24 / (math.pi * radius**8) * near * (radius**2 - distance**2) ** 2 * 0.64
    surface = (pull[..., None] * offset).sum(axis=1) + np.array([slope, 0.0])
    b = -(height**3)[:, None] * 2500.0 * 9.81 * surface / (100.0 * 100.0)
    r = np.maximum(distance, 1e-3)
    log = np.log(2 / r) - 0.577216
    weight = np.where(near, log + 0.25 * r**2 * (log + 1), 0.0)
    mean = (weight[..., None] * b[None]).sum(axis=1) / weight.sum(axis=1)[:, None]
    assert sample.thickness == pytest.approx(height, rel=1e-9)
    assert sample.velocity == pytest.approx((height**3)[:, None] * mean, rel=1e-6, abs=1e-12)


def test_published_speed_is_not_that_of_a_sheet():
    """On a uniform sheet the print is rho g h^6 grad S / mu^2, not rho g h^2 grad S / (3 mu)."""
    sheet = Particles(lattice(6.5) + 10.0, 2.0, 1423.0)
    speeds = {}
    for formulation in ('as-published', 'corrected'):
        simulation = simulated(
            incline(-0.1, 20, 20, 1.0),
            Lava(viscosity=1e4),
            sheet,
            effects=only(),
            spacing=1.0,
            thickness=2.0,
            formulation=formulation,
            precision='float64',
        )
        sample = simulation.sample()
        middle = np.abs(sample.position - 10.0).max(axis=1) < 1.0
        speeds[formulation] = -sample.velocity[middle, 0].mean()
    weight = 2500.0 * 9.81 * 0.1
    assert speeds['corrected'] == pytest.approx(weight * 2.0**2 / 3e4, rel=2e-3)
    assert speeds['as-published'] == pytest.approx(weight * 2.0**6 / 1e8, rel=1e-2)


def test_fixed_step_is_taken_whatever_the_limits_say():
    """With the paper's 0.01 s the number of steps is the time over it."""
    spread = spread_of_fixed_volume(
        200, accuracy=Accuracy(fixed_step=0.05, integrator='euler'), growth=1.05
    )
    duration = spread.steps * 0.05
    assert 5.0 < duration < 60.0
    limited = spread_of_fixed_volume(200, accuracy=Accuracy(integrator='euler'), growth=1.05)
    assert limited.steps < 0.2 * spread.steps
