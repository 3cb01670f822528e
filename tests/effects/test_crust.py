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


"""Cooling under a crust against one-dimensional conduction."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lava_ros.scene import Lava
from lava_ros.verification import exact
from solver import only

CRUST = only('crust')

LAVA = Lava(viscosity=1e15, emissivity=0.9, convection=50.0, conductivity=2.0, crust=True)

CAPACITY = LAVA.density * LAVA.specific_heat


def slab(lava, thickness, times):
    """Mean and surface temperatures of a slab that conducts to its top, by finite volumes."""
    # the uppermost of the cells is a micrometre thick: it is the surface
    sizes = np.diff(np.linspace(0.0, 1.0, 121) ** 3 * thickness)
    between = lava.conductivity / (0.5 * (sizes[1:] + sizes[:-1]))

    def rates(_, t):
        loss = lava.emissivity * 5.670374419e-8 * (t[0] ** 4 - 300.0**4)
        loss += lava.convection * (t[0] - 300.0)
        up = np.concatenate([[loss], between * np.diff(t), [0.0]])
        return np.diff(up) / (CAPACITY * sizes)

    solved = solve_ivp(
        rates,
        (0.0, times[-1]),
        np.full(len(sizes), 1423.0),
        method='LSODA',
        lband=1,
        uband=1,
        t_eval=times,
        rtol=1e-6,
    )
    return sizes @ solved.y / thickness, solved.y[0]


@pytest.mark.parametrize('thickness', [1.0, 5.0])
@pytest.mark.parametrize(
    'losses', [{}, {'emissivity': 0.0}, {'convection': 0.0}], ids=['both', 'air', 'radiation']
)
def test_heat_lost_is_that_of_a_conducting_slab(still_columns, thickness, losses):
    """Within 2.5 % of the heat lost (4.5 % without radiation), from ten minutes to four days."""
    lava = replace(LAVA, **losses)
    times = np.array([600.0, 3600.0, 36000.0, 3.6e5])
    samples = still_columns(
        lava, CRUST, [1423.0], times, thickness=thickness, longest_step=100.0
    )
    means, _ = slab(lava, samples[0][1][0], times)
    found = np.array([temperature[0] for temperature, _ in samples])
    worst = 0.045 if 'emissivity' in losses else 0.025
    assert (1423.0 - found) == pytest.approx(1423.0 - means, rel=worst)


def test_convecting_slab_of_the_case_is_the_numerical_one():
    """The series of modes and finite volumes agree: each checks the other."""
    lava = replace(LAVA, emissivity=0.0)
    times = np.array([3600.0, 36000.0, 3.6e5])
    means, _ = slab(lava, 2.0, times)
    series = [
        exact.convecting_slab(
            replace(lava, conductivity=2.0, convection=50.0),
            time,
            initial=1423.0,
            ambient=300.0,
            thickness=2.0,
        )
        for time in times
    ]
    assert means == pytest.approx(series, abs=0.1)


def test_fresh_lava_radiates_as_without_a_crust(device, still_columns):
    """At age 0 the surface is as hot as the core: bare cooling, less and less of it later."""
    for time, share in ((1e-3, (0.97, 1.0)), (3600.0, (0.05, 0.3))):
        crusted, bare = (
            1423.0 - still_columns(LAVA, effects, [1423.0], [time], device=device)[0][0][0]
            for effects in (CRUST, only('cooling'))
        )
        assert share[0] < crusted / bare < share[1]


def test_old_crust_lets_through_what_it_conducts(still_columns):
    """Emissivity hardly matters any more: half of it changes the loss by 3 % after a day."""
    half = replace(LAVA, emissivity=0.45)
    whole, less = (
        1423.0 - still_columns(lava, CRUST, [1423.0], [86400.0], longest_step=300.0)[0][0][0]
        for lava in (LAVA, half)
    )
    assert 0.97 < less / whole < 1.0


def test_crust_beside_cooling_is_the_crust(still_columns):
    """The crust's loss replaces the bare one: it is not counted twice."""
    one, two = (
        still_columns(LAVA, effects, [1423.0], [3600.0])[0][0][0]
        for effects in (CRUST, only('crust', 'cooling'))
    )
    assert one == two


def test_longer_steps_change_little(still_columns):
    """An hour in one step, or in 60: the same heat to 10 %; a day in steps of an hour, to 3 %."""
    for time, steps, within in ((3600.0, (60.0, 3600.0), 0.1), (86400.0, (60.0, 3600.0), 0.03)):
        lost = [
            1423.0 - still_columns(LAVA, CRUST, [1423.0], [time], longest_step=step)[0][0][0]
            for step in steps
        ]
        assert lost[1] == pytest.approx(lost[0], rel=within)


@pytest.mark.parametrize('precision', ['float32', 'float64'])
@pytest.mark.parametrize('losses', [{}, {'emissivity': 0.0}, {'convection': 0.0}])
def test_temperature_stays_between_air_and_vent(device, still_columns, precision, losses):
    """For any step, material and temperature, lava that is colder than the air included."""
    for conductivity in (1e-6, 2.0, 1e3):
        lava = replace(LAVA, conductivity=conductivity, **losses)
        for step in (1.0, 1e9):
            ((temperature, _),) = still_columns(
                lava,
                CRUST,
                [1423.0, 301.0, 300.0, 250.0],
                [10.0 * step],
                longest_step=step,
                precision=precision,
                device=device,
            )
            assert (temperature >= [299.99, 299.99, 299.99, 250.0]).all()
            assert (temperature <= [1423.0, 301.0, 300.01, 300.01]).all()
