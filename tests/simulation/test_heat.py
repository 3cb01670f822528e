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

"""Cooling against exact solutions."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from solver import flat, lattice, only, simulated


def cooled(lava, hours, *, longest_step, device='cpu'):
    """Temperature and thickness of the middle of a sheet that is too stiff to move."""
    simulation = simulated(
        flat(20),
        lava,
        Particles(lattice(6.0), 2.0, 1423.0),
        effects=only('cooling'),
        device=device,
        spacing=1.0,
        thickness=2.0,
        longest_step=longest_step,
    )
    simulation.advance(3600.0 * hours)
    sample = simulation.sample()
    middle = np.argmin(np.abs(sample.position).sum(axis=1))
    return sample.temperature[middle], sample.thickness[middle]


@pytest.mark.parametrize('convection', [0.0, 50.0])
@pytest.mark.parametrize('hours', [1.0, 10.0, 24.0])
def test_a_sheet_cools_as_the_balance_says(device, hours, convection):
    """By radiation, and by convection too, for a sheet 2 m thick."""
    lava = Lava(viscosity=1e14, convection=convection)
    temperature, thickness = cooled(lava, hours, longest_step=60.0, device=device)
    assert thickness == pytest.approx(2.0, rel=1e-3)
    capacity = 2500.0 * 1150.0 * thickness

    def rate(_, t):
        return -(0.9 * 5.670374419e-8 * (t**4 - 300.0**4) + convection * (t - 300.0)) / capacity

    exact = solve_ivp(rate, (0.0, 3600.0 * hours), [1423.0], rtol=1e-9).y[0, -1]
    assert temperature == pytest.approx(exact, rel=1e-3)


def test_cooling_is_second_order_in_time():
    """Halving the step divides the error by four."""
    lava = Lava(viscosity=1e14, convection=0.0)
    reference, _ = cooled(lava, 10.0, longest_step=30.0)
    errors = [
        abs(cooled(lava, 10.0, longest_step=step)[0] - reference) for step in (7200.0, 3600.0)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.3)


def test_temperature_stays_between_air_and_vent_for_any_step(device):
    """One step of a year neither overshoots the air's temperature nor makes NaN."""
    lava = Lava(viscosity=1e14)
    temperature, _ = cooled(lava, 24.0 * 365, longest_step=1e9, device=device)
    assert 300.0 <= temperature < 1423.0


def test_without_losses_nothing_cools():
    """Emissivity 0 and convection 0 keep the temperature to the bit."""
    lava = Lava(viscosity=1e14, emissivity=0.0, convection=0.0)
    assert cooled(lava, 10.0, longest_step=600.0)[0] == 1423.0
