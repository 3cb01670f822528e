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


"""Latent heat against the enthalpy balance."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.scene import Lava
from lava_ros.verification import exact
from solver import only

LATENT = only('cooling', 'latent_heat')

LAVA = Lava(
    viscosity=1e15,
    emissivity=0.0,
    convection=50.0,
    latent_heat=3.5e5,
    liquidus=1400.0,
    solidus=1250.0,
)

CAPACITY = LAVA.density * LAVA.specific_heat


def heat_content(temperature):
    """Heat content over rho c [K]."""
    melt = np.clip((temperature - LAVA.solidus) / (LAVA.liquidus - LAVA.solidus), 0.0, 1.0)
    return temperature + LAVA.latent_heat / LAVA.specific_heat * melt


@pytest.mark.parametrize('step', [600.0, 3600.0, 1e6])
@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_linear_loss_is_exact_for_any_step(device, still_columns, step, precision):
    """Each piece is an exponential: liquid, crystallising and solid, in one step or in many."""
    times = 3600.0 * np.array([0.5, 2.0, 10.0, 60.0, 100.0])
    samples = still_columns(
        LAVA, LATENT, [1423.0], times, longest_step=step, precision=precision, device=device
    )
    thickness = samples[0][1][0]
    options = {'initial': 1423.0, 'ambient': 300.0, 'thickness': thickness}
    right = [exact.crystallising_sheet(LAVA, time, **options) for time in times]
    found = [temperature[0] for temperature, _ in samples]
    within = 1e-8 if precision == 'float64' else 0.1
    assert found == pytest.approx(right, abs=within)
    assert found[0] > 1400.0 > found[1] > found[2] > 1250.0 > found[3]


def test_heating_passes_the_interval_upwards(still_columns):
    """Lava in hotter air melts: the same pieces the other way."""
    times = 3600.0 * np.array([1.0, 100.0, 1000.0])
    lava = replace(LAVA, solidus=350.0, liquidus=500.0)
    samples = still_columns(
        lava, LATENT, [300.0], times, longest_step=1e7, ambient=550.0
    )
    mean_rate = LAVA.convection / (CAPACITY * samples[0][1][0])
    slower = 1.0 + LAVA.latent_heat / (LAVA.specific_heat * 150.0)
    first = np.log(250.0 / 200.0) / mean_rate
    second = first + slower * np.log(200.0 / 50.0) / mean_rate
    for time, (temperature, _) in zip(times, samples, strict=True):
        if time < first:
            right = 550.0 - 250.0 * np.exp(-mean_rate * time)
        elif time < second:
            right = 550.0 - 200.0 * np.exp(-mean_rate * (time - first) / slower)
        else:
            right = 550.0 - 50.0 * np.exp(-mean_rate * (time - second))
        assert temperature[0] == pytest.approx(right, abs=1e-8)


def test_radiation_takes_the_heat_of_crystals_too(still_columns):
    """Heat content falls by the integral of the flux, across both ends of the interval."""
    lava = replace(LAVA, emissivity=0.9)
    times = np.linspace(0.0, 2e5, 2001)[1:]
    samples = still_columns(lava, LATENT, [1423.0], times, longest_step=100.0)
    temperature = np.array([1423.0] + [item[0][0] for item in samples])
    assert temperature[-1] < 1250.0
    flux = 0.9 * 5.670374419e-8 * (temperature**4 - 300.0**4) + 50.0 * (temperature - 300.0)
    taken = 0.5 * (flux[1:] + flux[:-1]).sum() * 100.0 / (CAPACITY * samples[0][1][0])
    assert heat_content(1423.0) - heat_content(temperature[-1]) == pytest.approx(taken, rel=1e-5)


def test_radiation_across_the_interval_is_of_second_order(still_columns):
    """A quarter of the step, much less of the error."""
    lava = replace(LAVA, emissivity=0.9)
    ends = [
        still_columns(lava, LATENT, [1423.0], [1e5], longest_step=step)[0][0][0]
        for step in (50.0, 1000.0, 4000.0)
    ]
    assert abs(ends[1] - ends[0]) < 0.2 * abs(ends[2] - ends[0])
    assert abs(ends[2] - ends[0]) < 1.0


def test_without_latent_heat_nothing_changes(still_columns):
    """L = 0 with the effect on is cooling alone."""
    lava = replace(LAVA, latent_heat=0.0)
    with_effect, without = (
        still_columns(lava, effects, [1423.0, 1300.0, 1000.0], [1e5])[0][0]
        for effects in (LATENT, only('cooling'))
    )
    assert with_effect == pytest.approx(without, abs=1e-9)


@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_temperature_stays_between_air_and_vent_for_any_step(device, still_columns, precision):
    """At the ends of the interval too, and where nothing is lost."""
    temperatures = [1423.0, 1400.0, 1325.0, 1250.0, 1000.0, 300.0]
    for step in (1e-3, 1e9):
        ((temperature, _),) = still_columns(
            replace(LAVA, emissivity=0.9),
            LATENT,
            temperatures,
            [step],
            longest_step=step,
            precision=precision,
            device=device,
        )
        assert ((temperature >= 299.99) & (temperature <= np.array(temperatures) + 1e-3)).all()
    still = replace(LAVA, convection=0.0)
    ((temperature, _),) = still_columns(
        still, LATENT, temperatures, [1e6], longest_step=1e5, device=device
    )
    assert temperature == pytest.approx(temperatures)
