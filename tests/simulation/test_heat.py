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


@pytest.mark.parametrize(
    ('hours', 'exact'), [(1.0, 1312.1159), (10.0, 916.3931), (24.0, 725.8872)]
)
def test_radiating_sheet_cools_as_the_exact_solution(device, hours, exact):
    """F(T) - F(T0) = eps sigma t / (rho c h), for a sheet 2 m thick."""
    lava = Lava(viscosity=1e14, convection=0.0)
    temperature, thickness = cooled(lava, hours, longest_step=60.0, device=device)
    assert thickness == pytest.approx(2.0, rel=1e-3)
    assert temperature == pytest.approx(exact, rel=1e-3)


def test_convection_and_radiation_together():
    """Both losses at once match a numerical integration of the balance."""
    lava = Lava(viscosity=1e14, convection=50.0)
    temperature, thickness = cooled(lava, 10.0, longest_step=60.0)
    capacity = 2500.0 * 1150.0 * thickness
    exact = solve_ivp(
        lambda _, t: -(0.9 * 5.670374419e-8 * (t**4 - 300.0**4) + 50.0 * (t - 300.0)) / capacity,
        (0, 36000.0),
        [1423.0],
        rtol=1e-9,
    ).y[0, -1]
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
