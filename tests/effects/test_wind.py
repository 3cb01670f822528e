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

"""Wind: what a column loses by forced convection."""

import math

import numpy as np
import pytest

from lava_ros.effects.laws import heat_loss
from lava_ros.effects.wind import TRANSFER
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.selection import effects_for
from solver import only

LAVA = Lava(viscosity=1e11, arrhenius=0.0, emissivity=0.0, convection=5.0)
GROUND = Terrain(np.zeros((12, 12)), 2.0)
TIME = 3600.0


def cooled(device, speed, on=True):
    """Temperature and thickness of lava that is too stiff to flow, in the middle of a slab."""
    x, y = (axis.ravel() for axis in np.mgrid[4.5:20.0:1.0, 4.5:20.0:1.0])
    slab = Particles(np.column_stack([x, y]), np.full(x.size, 1.0), 1400.0)
    simulation = Simulation(
        Scene(GROUND, lava=LAVA, wind_speed=speed),
        effects=only('steep', 'cooling', *['wind'] * on),
        accuracy=Accuracy(spacing=1.0, thickness=1.0, precision='float64', longest_step=60.0),
        device=device,
        particles=slab,
    )
    simulation.advance(TIME)
    sample = simulation.sample()
    inside = np.hypot(*(sample.position - 12.0).T) < 4.0
    return sample.temperature[inside], sample.thickness[inside]


def test_a_column_loses_what_the_wind_takes(device):
    """T - Ta falls as exp(-(lambda + CH rho c U) t / (rho c h))."""
    temperature, thickness = cooled(device, 20.0)
    transfer = LAVA.convection + 20.0 * TRANSFER
    rate = transfer / (LAVA.density * LAVA.specific_heat * thickness)
    assert temperature == pytest.approx(300.0 + 1100.0 * np.exp(-rate * TIME), abs=0.01)
    still, _ = cooled(device, 0.0)
    assert still.mean() - temperature.mean() > 30.0


def test_without_the_effect_the_wind_takes_nothing(device):
    """Its part is in no sum when it is off."""
    assert cooled(device, 20.0, on=False)[0].tolist() == cooled(device, 0.0)[0].tolist()


def test_it_is_chosen_by_the_speed():
    """Wind is on where it takes more than a percent, and scenes without any have none."""
    vents = (Vent((12.0, 12.0), 0.01),)
    lava = Lava()
    assert 'wind' not in effects_for(Scene(GROUND, vents, lava))
    assert 'wind' in effects_for(Scene(GROUND, vents, lava, wind_speed=10.0))


def test_the_host_knows_of_it():
    """The loss that the choice of effects takes is that of the balance."""
    windy, still = (heat_loss(Scene(GROUND, lava=LAVA, wind_speed=u))(1400.0) for u in (10.0, 0.0))
    assert windy - still == pytest.approx(10.0 * TRANSFER * 1100.0)
    # FLOWGO's coefficient for 5 m/s
    assert math.isclose(5.0 * TRANSFER, 8.73, abs_tol=0.005)
