# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Exact solutions of heat against numerical integration and limits."""

from dataclasses import replace
from functools import partial
import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.special import erf, erfcx

from lava_ros.scene import Lava
from lava_ros.verification import exact
from lava_ros.verification.cases import heat as silicone

CAPACITY = 2500.0 * 1150.0
LAVA = Lava.paper(density=2500.0, specific_heat=1150.0)


def column_on_ground(thickness):
    """Return the temperature, by time, of a column at 1400 K on ground at 300 K."""
    lava = replace(LAVA, ground_conductivity=2.0, ground_diffusivity=7e-7)
    return partial(exact.column_on_ground, lava, initial=1400.0, ground=300.0, thickness=thickness)


def test_column_on_ground_obeys_duhamels_integral():
    column = column_on_ground(1.0)
    time = 1e6
    rate = 2.0 / math.sqrt(7e-7) / CAPACITY
    assert column(0.0) == 1400.0
    assert column(time) == pytest.approx(300.0 + 1100.0 * erfcx(rate * math.sqrt(time)))
    # flux = kg / sqrt(pi a) [(T0 - Tg) / sqrt(t) + int T'(s) / sqrt(t - s) ds], s = t sin^2 v

    def change(v):
        s = time * math.sin(v) ** 2
        near = max(1e-3 * s, 1e-9)
        slope = (column(s + near) - column(max(s - near, 0.0))) / (near + min(near, s))
        return slope * 2.0 * math.sqrt(time) * math.sin(v)

    memory = quad(change, 1e-9, 0.5 * math.pi, limit=400)[0]
    flux = 2.0 / math.sqrt(math.pi * 7e-7) * (1100.0 / math.sqrt(time) + memory)
    fall = (column(time - 10.0) - column(time + 10.0)) / 20.0
    assert CAPACITY * fall == pytest.approx(flux, rel=1e-4)


def test_thick_column_loses_heat_as_at_constant_temperature():
    column = column_on_ground(1000.0)
    lost = CAPACITY * 1000.0 * (1400.0 - column(3600.0))
    # the flux kg dT / sqrt(pi a t) of a surface of constant temperature, integrated
    taken = 2.0 * 2.0 * 1100.0 * math.sqrt(3600.0 / (math.pi * 7e-7))
    assert lost == pytest.approx(taken, rel=1e-3)


def test_crystallizing_sheet_conserves_heat():
    lava = replace(LAVA, convection=50.0, latent_heat=3.5e5, liquidus=1400.0, solidus=1250.0)
    sheet = partial(exact.crystallising_sheet, lava, initial=1423.0, ambient=300.0, thickness=2.0)
    for time in (1e3, 3e4, 1e5):
        flux = quad(lambda t: 50.0 * (sheet(t) - 300.0), 0.0, time, limit=500)[0]
        end = sheet(time)
        melt = np.clip((end - 1250.0) / 150.0, 0.0, 1.0)
        content = CAPACITY * 2.0 * (1423.0 - end) + 2500.0 * 2.0 * 3.5e5 * (1.0 - melt)
        assert content == pytest.approx(flux, rel=1e-6)


def test_radiating_sheet_solves_its_equation():
    """Rho c h T' = -eps sigma (T^4 - Ta^4)."""
    rate = 0.9 * 5.670374419e-8 / (CAPACITY * 2.0)
    times = 3600.0 * np.array([1.0, 10.0, 24.0])
    solved = solve_ivp(
        lambda t, y: -rate * (y**4 - 300.0**4), (0.0, 86400.0), [1423.0], t_eval=times, rtol=1e-10
    )
    start, *values = (
        exact.radiating_sheet(
            replace(LAVA, emissivity=0.9), time, initial=1423.0, ambient=300.0, thickness=2.0
        )
        for time in (0.0, *times)
    )
    assert start == pytest.approx(1423.0)
    assert values == pytest.approx(solved.y[0], rel=1e-7)
    assert values == pytest.approx([1312.1159, 916.3931, 725.8872], abs=1e-3)


def test_solidified_fraction_of_a_freezing_lens():
    lava = Lava.paper(density=3000.0, specific_heat=1000.0, convection=25.0, solidus=1300.0)
    lens = exact.FreezingLens(lava, depth=3.0, radius=60.0, first=1423.0, ambient=300.0)
    r = 60.0 * np.sqrt((np.arange(100000) + 0.5) / 100000)
    h = lens.thickness(r)
    for fraction in (0.2, 0.5, 0.9):
        time = fraction * lens.end
        temperature = 300.0 + 1123.0 * np.exp(-25.0 * time / (3e6 * h))
        frozen = h[temperature < 1300.0].sum() / h.sum()
        assert lens.frozen_fraction(time) == pytest.approx(frozen, abs=1e-4)
    assert lens.frozen_fraction(2.0 * lens.end) == 1.0


def test_temperature_step_and_warming_by_descent():
    x = np.array([-3.0, 0.0, 1.0])
    found = exact.temperature_step(x, 100.0, low=1000.0, high=1400.0, diffusivity=0.01)
    assert found == pytest.approx(1200.0 + 200.0 * erf(x / 2.0))
    warming = exact.warming_by_descent(1000.0, gravity=9.81, specific_heat=1150.0)
    assert warming == pytest.approx(8.53, abs=0.01)


def test_cooling_current_solves_its_heat_balance():
    """Rho c Q dT/dr = -2 pi r F(T)."""
    options = {'initial': 1423.0, 'ambient': 300.0, 'discharge': 2.0}
    lava = replace(LAVA, emissivity=0.9, convection=50.0)
    current = exact.CoolingCurrent(lava, **options)
    distances = np.linspace(0.0, 150.0, 7)
    solved = solve_ivp(
        lambda r, t: -2.0 * math.pi * r * current.flux(t) / (CAPACITY * 2.0),
        (0.0, 150.0), [1423.0], t_eval=distances, rtol=1e-9,
    )
    assert current.temperature(distances) == pytest.approx(solved.y[0], abs=0.02)
    power = quad(
        lambda r: 2.0 * math.pi * r * float(current.flux(current.temperature(r))), 0.0, 1000.0,
        limit=500,
    )[0]
    assert power == pytest.approx(current.power, rel=1e-3)
    convecting = exact.CoolingCurrent(replace(lava, emissivity=0.0), **options)
    radius = math.sqrt(CAPACITY * 2.0 / (math.pi * 50.0))
    assert convecting.thermal_radius == pytest.approx(radius, rel=1e-4)
    assert float(convecting.temperature(0.7 * radius)) == pytest.approx(
        300.0 + 1123.0 * math.exp(-0.49), rel=1e-4
    )


def test_cooling_spread_conserves_heat():
    discharge, loss, capacity = 2.2e-8, 7.8, 954.0 * 1500.0
    spread = exact.ConstantFluxSpread(discharge, 3.56e-3, 9.81)
    cooling = exact.CoolingSpread(spread, loss=loss, capacity=capacity)
    radius = math.sqrt(capacity * discharge / (math.pi * loss))

    def heat(time):
        """Return the stored heat over rho c Q and the source's temperature difference [s]."""
        r = np.linspace(0.0, spread.radius(time), 20_001)
        held = cooling.difference(r, time) * spread.thickness(r, time) * 2.0 * math.pi * r
        return 0.5 * float(np.diff(r) @ (held[1:] + held[:-1])) / discharge

    for front in (0.5, 1.0, 3.0):
        time = (front * radius / spread.coefficient) ** 2
        kept = (heat(1.001 * time) - heat(0.999 * time)) / (0.002 * time)
        assert cooling.power(time) == pytest.approx(1.0 - kept, abs=2e-4)
        r = np.linspace(0.0, spread.radius(time), 20_001)
        lost = loss * cooling.difference(r, time) * 2.0 * math.pi * r
        total = 0.5 * float(np.diff(r) @ (lost[1:] + lost[:-1])) / (capacity * discharge)
        assert cooling.power(time) == pytest.approx(total, rel=1e-4)
    long = (30.0 * radius / spread.coefficient) ** 2
    places = np.array([0.3, 1.0, 1.5])
    assert cooling.difference(places * radius, long) == pytest.approx(
        np.exp(-(places**2)), abs=1e-4
    )


def test_linear_heat_loss_of_silicone_oil_is_within_the_uncertainty():
    places = np.array([0.5, 1.0, 1.5]) * 0.0358
    curves, oil, room = [], 315.0, 293.0
    for convection in (1.0, 2.0, 3.0):
        lava = Lava.paper(
            density=silicone.DENSITY, specific_heat=silicone.SPECIFIC_HEAT,
            emissivity=0.96, convection=convection,
        )
        current = exact.CoolingCurrent(
            lava, initial=oil, ambient=room, discharge=silicone.DISCHARGE
        )
        above = current.temperature(places) - room
        curves.append(above / (oil - room))
    supply = silicone.DENSITY * silicone.SPECIFIC_HEAT * silicone.DISCHARGE
    linear = np.exp(-math.pi * silicone.LOSS * places**2 / supply)
    slow, middle, fast = curves
    assert np.abs(linear - middle).max() < 0.007
    assert (linear < slow - 0.01).all() and (linear > fast + 0.01).all()
    assert 0.5 * (slow - fast)[1] == pytest.approx(0.047, abs=0.002)
