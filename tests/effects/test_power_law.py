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

"""Power-law and Herschel-Bulkley lava: its limits, its exact speed, and level surfaces."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from solver import flat, incline, lattice, only, simulated

STEEP = only('steep')

WEIGHT = 2500.0 * 9.81


def scattered(effects, *, precision='float64', device='cpu', **constants):
    """300 random particles on a plane that falls towards +x."""
    rng = np.random.default_rng(3)
    return simulated(
        incline(0.1, 40, 40, 10.0, origin=(-100.0, -100.0)),
        Lava(arrhenius=0.0, **constants),
        Particles(rng.uniform(0, 150, (300, 2)), rng.uniform(50, 150, 300), 1400.0),
        effects=effects,
        device=device,
        spacing=9.0,
        thickness=1.0,
        precision=precision,
    )


@pytest.mark.parametrize('precision', ['float32', 'float64'])
@pytest.mark.parametrize('yielding', [False, True])
def test_exponent_one_is_the_simpler_law(device, precision, yielding):
    """An exponent of 1 gives the speed of Newtonian and of Bingham lava."""
    constants = {'viscosity': 1e4, 'yield_strength': 1500.0 * yielding}
    effects = replace(STEEP, yielding=yielding)
    simple, general = (
        scattered(kind, precision=precision, device=device, **constants).sample().velocity
        for kind in (effects, replace(effects, power_law=True))
    )
    tolerance = {'float32': 1e-4, 'float64': 1e-9}[precision]
    assert general == pytest.approx(simple, rel=tolerance, abs=tolerance * 0.1)


@pytest.mark.parametrize('index', [0.3, 0.5, 2.0, 3.0])
def test_speed_follows_the_power_of_the_slope(index):
    """Every particle has n / (2 n + 1) (rho g h s / K)^(1/n) h."""
    newtonian = scattered(only(), viscosity=1e4).sample()
    sample = scattered(only('power_law'), viscosity=1e4, flow_index=index).sample()
    stress = 3e4 * np.hypot(*newtonian.velocity.T) / newtonian.thickness
    speed = index / (2 * index + 1) * (stress / 1e4) ** (1 / index) * sample.thickness
    assert (stress > 1e-3 * WEIGHT * sample.thickness).all()
    assert np.hypot(*sample.velocity.T) == pytest.approx(speed, rel=1e-8)


@pytest.mark.parametrize('index', [0.5, 2.0, 5.0])
def test_level_lava_has_a_finite_step(device, index):
    """On a level surface, where n > 1 has no viscosity at all, a step is still possible."""
    simulation = simulated(
        flat(60),
        Lava(viscosity=1e4, flow_index=index, arrhenius=0.0),
        Particles(lattice(15.5), 1.0, 1400.0),
        effects=only('steep', 'power_law'),
        device=device,
        spacing=1.0,
        thickness=1.0,
    )
    assert np.isfinite(simulation.sample().velocity).all()
    simulation.advance(0.5)
    assert simulation.time == 0.5
    assert simulation.snapshot().steps.count < 20
    assert np.isfinite(simulation.sample().velocity).all()
