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

"""Free fall bounds the speed of lava whose balance has no inertia, and nothing that is slower."""

import numpy as np
import pytest
import warp as wp

from lava_ros.scene import Lava, Terrain, Vent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.state import FAR
from solver import incline, only, simulated

#: Ten cells by ten, 50 m deep.
PIT = np.pad(np.zeros((10, 10)), 10, constant_values=50.0)

THIN = Lava(viscosity=100.0, arrhenius=0.0)


def heads(simulation):
    """What u^2 / 2g is over the thickness, less the fall from the top, of each particle [m]."""
    sample = simulation.sample()
    terrain = simulation.scene.terrain
    places = sample.position - 0.5 * np.add(terrain.extent[:2], terrain.extent[2:])
    highest = np.full(len(places), -FAR)
    for n, place in enumerate(places):
        height = wp.full(1, -FAR, dtype=simulation._state.real, device=simulation.device)
        simulation._terrain.raise_to(place[None], height)
        highest[n] = height.numpy()[0]
    fall = np.maximum(simulation._state.top.numpy()[0] - highest, 0.0)
    return (sample.velocity**2).sum(axis=1) / (2.0 * 9.81) - fall - sample.thickness


@pytest.mark.parametrize('on', [(), ('helmholtz',), ('green',)])
def test_no_lava_is_faster_than_its_fall(device, on):
    """Lava that fills a pit: the balance alone makes it 79 m/s at the wall, 7 m deep."""
    simulation = simulated(
        Terrain(PIT, 10.0),
        THIN,
        Vent((150.0, 150.0), 200.0, radius=10.0),
        effects=only('steep', *on),
        device=device,
        refinement=0.5,
    )
    fastest = 0.0
    for time in range(50, 201, 50):
        simulation.advance(time)
        assert heads(simulation).max() < 1e-3
        fastest = max(fastest, np.hypot(*simulation.sample().velocity.T).max())
    # and it is not held back by more than that
    assert fastest > 5.0


def test_slow_lava_is_what_it_was(device):
    """Lava that creeps down a slope moves as if there were no bound, to the bit."""
    ground, vent = incline(0.2, 40, 60, 10.0), Vent((100.0, 200.0), 5.0, radius=10.0)
    samples = []
    for bound in (True, False):
        simulation = simulated(
            ground, Lava(viscosity=1e4), vent, device=device, deterministic=True
        )
        if not bound:
            simulation._state.top.fill_(FAR)
        simulation.advance(1800.0)
        samples.append(simulation.sample())
    assert np.array_equal(samples[0].position, samples[1].position)
    assert np.array_equal(samples[0].velocity, samples[1].velocity)


def test_lava_has_fallen_from_wherever_it_came(device):
    """From the highest particle and open vent there were; on a new terrain from where it is."""
    ground = incline(0.2, 20, 50, 10.0, top=100.0)
    vents = {x: Vent((x, 105.0), 1.0) for x in (105.0, 305.0)}
    lava = Particles(np.array([[205.0, 105.0]]), 10.0, 1400.0)

    def top(simulation):
        return float(simulation._state.top.numpy()[0] + simulation.scene.terrain.elevation.mean())

    simulation = simulated(ground, Lava(), vents[305.0], lava, device=device)
    assert top(simulation) == pytest.approx(60.0)
    simulation.set_vents((vents[105.0],))
    assert top(simulation) == pytest.approx(60.0)
    simulation.advance(1e-3)
    assert top(simulation) == pytest.approx(80.0)
    simulation.set_vents((vents[305.0],))
    assert top(simulation) == pytest.approx(80.0)
    resumed = Simulation.resume(simulation.checkpoint(), device=device)
    assert np.array_equal(resumed._state.top.numpy(), simulation._state.top.numpy())
    simulation.set_effects({'inertia': False, 'crust': True})
    assert top(simulation) == pytest.approx(80.0)
    simulation.set_terrain(Terrain(ground.elevation + 500.0, 10.0))
    # what was in the conduit of the vent that closed came out there
    assert top(simulation) == pytest.approx(580.0, abs=0.01)


def test_bound_of_an_older_checkpoint(device):
    """One that was written before there was a bound goes on without one."""
    checkpoint = simulated(Terrain(PIT, 10.0), Lava(), device=device).checkpoint()
    del checkpoint.arrays['state.top']
    resumed = Simulation.resume(checkpoint, device=device)
    assert resumed._state.top.numpy()[0] == np.float32(FAR)
