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

"""Several simulations at once."""


import numpy as np
import pytest

from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.batch import interleave


def scene_of(flux):
    """Lava on a slope."""
    slope = Terrain(-0.2 * np.tile(np.arange(24.0), (20, 1)) * 2.0, 2.0)
    vent = Vent((12.0, 20.0), discharge=flux, temperature=1400.0)
    return Scene(slope, vents=(vent,), lava=Lava())


def simulation_of(flux, device):
    """A simulation of it, that gives the same bits in every run."""
    accuracy = Accuracy(spacing=1.5, deterministic=True)
    return Simulation(scene_of(flux), accuracy=accuracy, device=device)


def route_of(flux, device, ends):
    """Go to 20 s with a stop at 10 s, and leave where the particles are."""
    simulation = simulation_of(flux, device)
    yield from simulation.advancing(10.0)
    yield from simulation.advancing(20.0)
    ends[flux] = simulation.sample().position


def test_together_is_as_one_by_one(device):
    """Simulations that take turns, some after others, end where each of them ends alone."""
    fluxes, ends = (1.0, 2.0, 3.0, 5.0, 8.0), {}
    interleave((route_of(flux, device, ends) for flux in fluxes), device, at_once=3)
    assert sorted(ends) == sorted(fluxes)
    for flux in fluxes:
        alone = simulation_of(flux, device)
        alone.advance(10.0)
        alone.advance(20.0)
        assert np.array_equal(alone.sample().position, ends[flux]), flux


def test_what_a_route_raises_is_raised(device):
    """An error is not lost among the others."""

    def route(error):
        yield
        if error:
            raise ValueError('here')

    with pytest.raises(ValueError, match='here'):
        interleave((route(error) for error in (False, True, False)), device)
