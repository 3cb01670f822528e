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

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy

BARE = Effects(arrhenius=False, cooling=False, steep=True)

WEIGHT = 2500.0 * 9.81


def scattered(effects, *, precision='float64', device='cpu', slope=0.1, **constants):
    """300 random particles on a plane with the slope towards +x."""
    rng = np.random.default_rng(3)
    x = np.arange(40) * 10.0
    terrain = Terrain(np.tile(-slope * x, (40, 1)), 10.0, origin=(-100.0, -100.0))
    return Simulation(
        Scene(terrain, lava=Lava(arrhenius=0.0, **constants)),
        effects=effects,
        accuracy=Accuracy(
            spacing=9.0, thickness=1.0, precision=precision, deterministic=True
        ),
        particles=Particles(rng.uniform(0, 150, (300, 2)), rng.uniform(50, 150, 300), 1400.0),
        device=device,
    )


@pytest.mark.parametrize('precision', ['float32', 'float64'])
@pytest.mark.parametrize('yielding', [False, True])
def test_exponent_one_is_the_simpler_law(device, precision, yielding):
    """An exponent of 1 gives the speed of Newtonian and of Bingham lava."""
    constants = {'viscosity': 1e4, 'yield_strength': 1500.0 * yielding}
    effects = replace(BARE, yielding=yielding)
    simple, general = (
        scattered(kind, precision=precision, device=device, **constants).sample().velocity
        for kind in (effects, replace(effects, power_law=True))
    )
    tolerance = {'float32': 1e-4, 'float64': 1e-9}[precision]
    assert general == pytest.approx(simple, rel=tolerance, abs=tolerance * 0.1)


@pytest.mark.parametrize('index', [0.3, 0.5, 2.0, 3.0])
def test_speed_follows_the_power_of_the_slope(index):
    """Every particle has n / (2 n + 1) (rho g h s / K)^(1/n) h."""
    effects = replace(BARE, steep=False)
    newtonian = scattered(effects, viscosity=1e4).sample()
    sample = scattered(replace(effects, power_law=True), viscosity=1e4, flow_index=index).sample()
    stress = 3e4 * np.hypot(*newtonian.velocity.T) / newtonian.thickness
    speed = index / (2 * index + 1) * (stress / 1e4) ** (1 / index) * sample.thickness
    assert (stress > 1e-3 * WEIGHT * sample.thickness).all()
    assert np.hypot(*sample.velocity.T) == pytest.approx(speed, rel=1e-8)


@pytest.mark.parametrize('index', [0.5, 2.0, 5.0])
def test_level_lava_has_a_finite_step(device, index):
    """On a level surface, where n > 1 has no viscosity at all, a step is still possible."""
    ticks = np.arange(-15.0, 16.0)
    places = np.stack(np.meshgrid(ticks, ticks), -1).reshape(-1, 2)
    simulation = Simulation(
        Scene(
            Terrain(np.zeros((60, 60)), 1.0, origin=(-30.0, -30.0)),
            lava=Lava(viscosity=1e4, flow_index=index, arrhenius=0.0),
        ),
        effects=replace(BARE, power_law=True),
        accuracy=Accuracy(spacing=1.0, thickness=1.0),
        particles=Particles(places, 1.0, 1400.0),
        device=device,
    )
    assert np.isfinite(simulation.sample().velocity).all()
    simulation.advance(0.5)
    assert simulation.time == 0.5
    assert simulation.snapshot().steps.count < 20
    assert np.isfinite(simulation.sample().velocity).all()
