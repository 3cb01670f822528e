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


"""Fixtures of the tests of effects."""

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy


@pytest.fixture
def still_columns():
    """A function that lets columns stand apart, too stiff to move, and samples them at times."""

    def run(
        lava,
        effects,
        temperatures,
        times,
        *,
        thickness=2.0,
        longest_step=60.0,
        precision='float64',
        ambient=300.0,
        device='cpu',
    ):
        """Samples at the times [s], their columns in the order of the temperatures [K]."""
        x = 10.0 * np.arange(len(temperatures))
        simulation = Simulation(
            Scene(
                Terrain(np.zeros((4, len(x) + 2)), 10.0, origin=(-15.0, -20.0)),
                lava=lava,
                ambient_temperature=ambient,
            ),
            effects=effects,
            accuracy=Accuracy(
                spacing=3.0, ratio=3.0, longest_step=longest_step, precision=precision
            ),
            # a column alone has 0.0275 m a cubic metre
            particles=Particles(
                np.column_stack([x, 0.0 * x]), thickness / 0.0275, np.asarray(temperatures)
            ),
            device=device,
        )
        samples = []
        for time in times:
            simulation.advance(time)
            samples.append(simulation.sample())
        order = np.argsort(samples[0].position[:, 0])
        return [(item.temperature[order], item.thickness[order]) for item in samples]

    return run


@pytest.fixture
def viscosities():
    """A function that gives the viscosity [Pa s] of particles at temperatures [K]."""
    bare = Effects(arrhenius=False, cooling=False, steep=False)

    def measure(temperatures, effects, *, lava, precision, device):
        """Viscosity [Pa s] of particles at these temperatures: what it makes of a sheet's speed.

        Under little gravity thin lava is slower than its free fall too, which bounds speeds.
        """
        ticks = np.arange(len(temperatures)) * 10.0
        terrain = Terrain(
            np.tile(-0.1 * np.arange(len(ticks) + 4) * 10.0, (8, 1)), 10.0, origin=(-20.0, -40.0)
        )
        speeds = []
        for kind, material in ((effects, lava), (bare, Lava(viscosity=1e3, arrhenius=0.0))):
            simulation = Simulation(
                Scene(terrain, lava=material, gravity=1e-3),
                effects=kind,
                accuracy=Accuracy(spacing=5.0, thickness=1.0, ratio=1.5, precision=precision),
                particles=Particles(
                    np.column_stack([ticks, 0.0 * ticks]), 25.0, np.asarray(temperatures)
                ),
                device=device,
            )
            sample = simulation.sample()
            speeds.append(sample.velocity[np.argsort(sample.position[:, 0]), 0])
        return 1e3 * speeds[1] / speeds[0]

    return measure
