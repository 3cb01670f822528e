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

"""Time integration: order, stability and cost of super-time-stepping."""

import math

import numpy as np
import pytest

from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification.cases import spread_of_fixed_volume
from solver import flat, lattice, only, simulated


def relaxed(longest_step, integrator='rkl2', viscosity=2e4, **options):
    """Positions of a heap of particles after 20 s, in their first order, and the evaluations."""
    places = lattice(9.5)
    places = places[np.hypot(*places.T) < 9.0]
    # each particle has a temperature of its own, which tells it from the others
    label = 1000.0 + np.arange(len(places))
    simulation = simulated(
        flat(40),
        Lava(viscosity=viscosity),
        Particles(places, 0.5 + 0.5 * np.exp(-0.02 * (places**2).sum(axis=1)), label),
        effects=only(),
        longest_step=longest_step,
        integrator=integrator,
        **{'spacing': 1.0, 'thickness': 1.0, 'precision': 'float64', **options},
    )
    simulation.advance(20.0)
    sample = simulation.sample()
    steps = simulation.snapshot().steps
    return sample.position[np.argsort(sample.temperature)], steps


def test_order_in_time_is_two():
    """Halving the step divides the error of RKL2 by four, of Euler by two."""
    # of second order its own error is a 25th of the smallest that is held against it
    reference, _ = relaxed(0.01)
    for integrator, order in (('rkl2', 2.0), ('euler', 1.0)):
        steps = (0.2, 0.1, 0.05)
        errors = [
            np.linalg.norm(relaxed(step, integrator)[0] - reference, axis=1).mean()
            for step in steps
        ]
        measured = [math.log2(errors[0] / errors[1]), math.log2(errors[1] / errors[2])]
        assert measured == pytest.approx([order, order], abs=0.2)


@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_many_stages_stay_stable(device, precision):
    """Steps of many stages of a stiff heap stay close to small explicit ones: no noise."""
    reference, _ = relaxed(5.0, 'euler', viscosity=200.0)
    position, steps = relaxed(5.0, precision=precision, device=device, viscosity=200.0)
    assert steps.evaluations > 4 * steps.count
    spread = np.linalg.norm(reference, axis=1).max() - 9.0
    assert spread > 2.0
    assert np.linalg.norm(position - reference, axis=1).mean() < 0.03 * spread


def test_super_time_steps_are_cheaper_than_explicit_ones():
    """At no more error, RKL2 evaluates the velocity at least three times less than Euler."""
    euler = spread_of_fixed_volume(
        8000, accuracy=Accuracy(integrator='euler', diffusion_number=2.0, courant_number=0.5)
    )
    rkl2 = spread_of_fixed_volume(8000, accuracy=Accuracy(diffusion_number=2.0))
    for quantity in ('radius', 'profile'):
        assert rkl2.errors[quantity] <= euler.errors[quantity]
    assert euler.evaluations >= 3 * rkl2.evaluations
