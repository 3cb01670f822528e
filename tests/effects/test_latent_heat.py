# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cooling of lava that crystallizes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid

from effects.columns import (
    AIR,
    CAPACITY,
    check_equal,
    check_range,
    flux,
    HOT,
    HOUR,
    lost,
    precisions,
    still_columns,
)
from lava_ros.scene import Lava
from lava_ros.verification import exact
from solver import only

LATENT = only('cooling', 'latent_heat')

FREEZING = Lava.paper(viscosity=1e15, emissivity=0.0, convection=50.0, latent_heat=3.5e5,
                liquidus=1400.0, solidus=1250.0)


@pytest.mark.parametrize('step', [1e-3, 1e9])
@precisions
def test_temperature_stays_in_range_for_any_step(device, precision, step):
    lava = replace(FREEZING, emissivity=0.9)
    check_range(lava, LATENT, step, 1, precision=precision, device=device)


def test_no_latent_heat_is_plain_cooling():
    check_equal(replace(FREEZING, latent_heat=0.0), LATENT, only('cooling'), 1e-9)


@pytest.mark.parametrize('step', [600.0, HOUR, 1e6])
@pytest.mark.parametrize(('precision', 'within'), [('float32', 0.1), ('float64', 1e-8)])
def test_cooling_through_crystallization_is_exact_for_any_step(device, step, precision, within):
    """Liquid, crystallizing and solid lava each cool exponentially."""
    times = HOUR * np.array([0.5, 2.0, 10.0, 60.0, 100.0])
    (*found,), thickness = still_columns(
        FREEZING, LATENT, [HOT], times, longest_step=step, precision=precision, device=device
    )
    options = {'initial': HOT, 'ambient': AIR, 'thickness': thickness}
    expected = [exact.crystallising_sheet(FREEZING, time, **options) for time in times]
    assert found == pytest.approx(expected, abs=within)
    assert found[0] > 1400.0 > found[1] > found[2] > 1250.0 > found[3]


def test_lava_in_hotter_air_melts():
    times = HOUR * np.array([1.0, 100.0, 1000.0])
    lava = replace(FREEZING, solidus=350.0, liquidus=500.0)
    found, thickness = still_columns(
        lava, LATENT, [300.0], times, longest_step=1e7, ambient_temperature=550.0
    )
    rate = lava.convection / (CAPACITY * thickness)
    slower = 1.0 + lava.latent_heat / (lava.specific_heat * 150.0)
    first = np.log(250.0 / 200.0) / rate
    second = first + slower * np.log(200.0 / 50.0) / rate
    assert times[0] < first < times[1] < second < times[2]
    since = np.array([times[0], (times[1] - first) / slower, times[2] - second])
    expected = 550.0 - np.array([250.0, 200.0, 50.0]) * np.exp(-rate * since)
    assert found[:, 0] == pytest.approx(expected, abs=1e-8)


def test_radiation_removes_latent_heat():
    """Heat content falls by the integral of the flux."""
    lava = replace(FREEZING, emissivity=0.9)
    times = np.linspace(0.0, 2e5, 2001)[1:]
    found, thickness = still_columns(lava, LATENT, [HOT], times, longest_step=100.0)
    temperature = np.array([HOT, *found[:, 0]])
    assert temperature[-1] < 1250.0
    taken = trapezoid(flux(lava, temperature), dx=100.0) / (CAPACITY * thickness)
    latent = lava.latent_heat / lava.specific_heat
    assert HOT - temperature[-1] + latent == pytest.approx(taken, rel=1e-5)


def test_radiation_with_latent_heat_is_of_second_order():
    lava = replace(FREEZING, emissivity=0.9)
    ends = [lost(lava, LATENT, 1e5, longest_step=step) for step in (50.0, 1000.0, 4000.0)]
    assert abs(ends[1] - ends[0]) < 0.2 * abs(ends[2] - ends[0])
    assert abs(ends[2] - ends[0]) < 1.0
