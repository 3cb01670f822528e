# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral stress by the Green's function."""

import numpy as np
import pytest

from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification.cases.confined import channel_velocity
from solver import flat, only, simulated


@pytest.mark.parametrize('precision', ['float32', 'float64'])
@pytest.mark.parametrize('height', [0.1, 1.0, 10.0])
@pytest.mark.parametrize('distance', [0.02, 0.1, 0.3, 1.0])
def test_columns_do_not_attract_each_other(device, precision, height, distance):
    """A neighbour with more weight than the particle itself would attract it."""
    places = 0.5 * distance * np.array([[-1.0, 0.0], [1.0, 0.0]])
    simulation = simulated(
        flat(8), Lava.paper(viscosity=1e6), Particles(places, height, 1400.0),
        effects=only('green'),
        device=device, spacing=1.0, ratio=3.5, precision=precision,
    )
    sample = simulation.sample()
    apart = np.sign(sample.position[:, 0]) * sample.velocity[:, 0]
    # thick columns close to each other have equal weights and stay in place
    assert apart.min() >= 0.0


def test_short_support_underestimates_the_walls(device):
    """Cut off at 1.7 thicknesses the Green's function sums only half of the walls."""
    accuracy = Accuracy(spacing=0.3, ratio=5.5)
    _, mean = channel_velocity(6.0, effect='green', accuracy=accuracy, device=device)
    assert mean.measured > 1.03 * mean.exact
