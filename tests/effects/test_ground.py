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


"""Conduction into the ground against exact solutions."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.scene import Lava, Vent
from lava_ros.verification import exact
from solver import flat, only, simulated

GROUND = only('ground')

LAVA = Lava(viscosity=1e15, emissivity=0.0, convection=0.0, ground_conductivity=2.0)


@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_column_that_cools_follows_the_exact_solution(device, still_columns, precision):
    """exp(x^2) erfc(x) to 0.5 % and the heat lost to 0.8 %, up to where 70 % of it has gone."""
    times = 3600.0 * np.array([1.0, 10.0, 100.0, 1000.0, 10000.0])
    samples = still_columns(
        LAVA, GROUND, [1423.0], times, longest_step=1e4, precision=precision, device=device
    )
    thickness = samples[0][1][0]
    options = {'initial': 1423.0, 'ground': 300.0, 'thickness': thickness}
    exacts = np.array([exact.column_on_ground(LAVA, time, **options) for time in times])
    found = np.array([temperature[0] for temperature, _ in samples])
    assert exacts[-1] < 300.0 + 0.3 * 1123.0
    assert found == pytest.approx(exacts, abs=0.005 * 1123.0)
    assert (1423.0 - found) == pytest.approx(1423.0 - exacts, rel=0.008)


def test_first_step_may_be_of_any_length(still_columns):
    """The flux is infinite at first; 1, 10 or 1000 steps to an hour give the same heat."""
    results = [
        1423.0 - still_columns(LAVA, GROUND, [1423.0], [3600.0], longest_step=step)[0][0][0]
        for step in (3.6, 360.0, 3600.0)
    ]
    assert results[1:] == pytest.approx([results[0]] * 2, rel=2e-3)


def test_temperature_stays_between_ground_and_vent_for_any_step(device, still_columns):
    """After a thousand years in long steps it is between the ground's temperature and its own."""
    ((temperature, _),) = still_columns(
        LAVA, GROUND, [1423.0, 300.0, 250.0], [3e10], longest_step=1e9, device=device
    )
    assert 300.0 <= temperature[0] < 600.0
    assert temperature[1] == pytest.approx(300.0)
    assert 250.0 < temperature[2] <= 300.0


def test_each_column_has_its_own_age():
    """Lava that came out later is hotter, though all of it rests on the same ground."""
    lava = replace(LAVA, viscosity=1e3, arrhenius=0.0)
    vent = Vent((0.0, 0.0), 5.0)
    simulation = simulated(flat(40, 10.0), lava, vent, effects=GROUND, spacing=10.0)
    simulation.advance(1500.0)
    sample = simulation.sample()
    distance = np.hypot(*sample.position.T)
    middle = np.median(distance)
    near = sample.temperature[distance < middle].mean()
    far = sample.temperature[distance > middle].mean()
    assert far < near < 1423.0
