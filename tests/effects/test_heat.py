# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Heat loss of columns: bare, crusted, to the ground, in wind, and during crystallization."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

from effects.columns import AIR, HOT, lost, still_columns
from lava_ros.effects.laws import heat_loss, STEFAN_BOLTZMANN
from lava_ros.effects.wind import TRANSFER
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Particles
from lava_ros.simulation.selection import effects_for
from lava_ros.verification import exact
from lava_ros.verification.cases.case import plane
from solver import flat, lattice, only, simulated

COVER, CRUST, GROUND, LATENT = (
    only('cover'), only('crust'), only('ground'), only('cooling', 'latent_heat')
)

#: Lava with the properties that each effect needs; all have the same heat capacity.
COVERED = Lava(viscosity=1e15, emissivity=0.95, convection=9.0, crust_cover=0.9,
               crust_cover_decay=0.16, crust_temperature=773.15)
CRUSTED = Lava(viscosity=1e15, emissivity=0.9, convection=50.0, conductivity=2.0, crust=True)
GROUNDED = Lava(viscosity=1e15, emissivity=0.0, convection=0.0, ground_conductivity=2.0)
FREEZING = Lava(viscosity=1e15, emissivity=0.0, convection=50.0, latent_heat=3.5e5,
                liquidus=1400.0, solidus=1250.0)
WINDY = Lava(viscosity=1e15, emissivity=0.0, convection=5.0)

CAPACITY = CRUSTED.density * CRUSTED.specific_heat

HOUR = 3600.0

precisions = pytest.mark.parametrize('precision', ['float32', 'float64'])


def flux(lava, surface):
    """Return the heat flux of a bare surface to the air [W/m2]."""
    radiation = lava.emissivity * STEFAN_BOLTZMANN * (surface**4 - AIR**4)
    return radiation + lava.convection * (surface - AIR)


@pytest.mark.parametrize(
    ('lava', 'effects', 'step', 'steps'),
    [
        *(
            (replace(CRUSTED, conductivity=conductivity, **losses), CRUST, step, 10)
            for losses in ({}, {'emissivity': 0.0}, {'convection': 0.0})
            for conductivity in (1e-6, 2.0, 1e3)
            for step in (1.0, 1e9)
        ),
        *((replace(FREEZING, emissivity=0.9), LATENT, step, 1) for step in (1e-3, 1e9)),
        (GROUNDED, GROUND, 1e9, 30),
        (Lava(viscosity=1e14), only('cooling'), 1e9, 1),
    ],
)
@precisions
def test_temperature_stays_in_range_for_any_step(device, precision, lava, effects, step, steps):
    """For any step, material and temperature, including lava that is colder than the air."""
    before = np.array([HOT, 1400.0, 1325.0, 1250.0, 1000.0, 301.0, AIR, 250.0])
    (after,), _ = still_columns(
        lava, effects, before, [steps * step], longest_step=step, precision=precision,
        device=device,
    )
    assert (after >= np.minimum(before, AIR - 0.01)).all()
    assert (after <= np.maximum(before, AIR + 0.01)).all()


@pytest.mark.parametrize(
    ('lava', 'one', 'other', 'off'),
    [
        (COVERED, COVER, only('cooling', 'cover'), 1e-9),
        (replace(COVERED, crust_cover=0.0), COVER, only('cooling'), 1e-9),
        (CRUSTED, CRUST, only('cooling', 'crust'), 0.0),
        (replace(FREEZING, latent_heat=0.0), LATENT, only('cooling'), 1e-9),
    ],
    ids=['cover', 'no cover', 'crust', 'no latent heat'],
)
def test_effects_replace_or_equal_plain_cooling(lava, one, other, off):
    ends = [still_columns(lava, on, [HOT, 1300.0, 1000.0], [1e5])[0] for on in (one, other)]
    assert ends[0] == pytest.approx(ends[1], rel=0.0, abs=off)


@pytest.mark.parametrize(
    ('lava', 'effects', 'time', 'steps', 'within'),
    [
        (CRUSTED, CRUST, HOUR, (60.0, HOUR), 0.1),
        (CRUSTED, CRUST, 24.0 * HOUR, (60.0, HOUR), 0.03),
        # the flux is infinite at first
        (GROUNDED, GROUND, HOUR, (3.6, 360.0, HOUR), 2e-3),
    ],
)
def test_long_steps_lose_the_same_heat(lava, effects, time, steps, within):
    first, *others = (lost(lava, effects, time, longest_step=step) for step in steps)
    assert others == pytest.approx([first] * len(others), rel=within)


def covered(lava, initial, time, thickness, speed=0.0):
    """Return the temperature of a column under a partial crust, by integration."""
    fraction = lava.crust_cover * np.exp(-lava.crust_cover_decay * speed)

    def rate(_, temperature):
        crust = np.minimum(lava.crust_temperature, temperature)
        mean = fraction * flux(lava, crust) + (1.0 - fraction) * flux(lava, temperature)
        return -mean / (CAPACITY * thickness)

    return solve_ivp(rate, (0.0, time), [initial], rtol=1e-8, atol=1e-6).y[0, -1]


@pytest.mark.parametrize(('precision', 'off'), [('float64', 0.02), ('float32', 0.1)])
def test_covered_columns_cool_as_integrated(device, precision, off):
    before, times = [HOT, 900.0, 773.15, 500.0, AIR, 280.0], HOUR * np.array([1.0, 10.0, 100.0])
    found, thickness = still_columns(
        COVERED, COVER, before, times, precision=precision, device=device
    )
    expected = [[covered(COVERED, start, time, thickness) for start in before] for time in times]
    assert found == pytest.approx(np.array(expected), rel=0.0, abs=off)


def test_fast_lava_loses_more_heat_through_its_cover(device):
    lava = replace(COVERED, viscosity=3e3, crust_cover_decay=0.5)
    simulation = simulated(
        plane((-100.0, -100.0, 100.0, 100.0), 5.0, 0.3), lava,
        Particles(lattice(30.0, 2.0), 8.0, HOT), effects=COVER, device=device,
        spacing=2.0, thickness=2.0, precision='float64',
    )
    start = simulation.sample()
    simulation.advance(1.0)
    end = simulation.sample()
    inside = np.hypot(*start.position.T) < 10.0
    speed = np.hypot(*(end.position - start.position)[inside].T).mean()
    assert speed > 2.0
    thickness = float(end.thickness[inside].mean())
    fast, slow = (HOT - covered(lava, HOT, 1.0, thickness, u) for u in (speed, 0.0))
    found = HOT - end.temperature[inside].mean()
    assert found == pytest.approx(fast, rel=0.005)
    assert found > 1.5 * slow


def test_rejects_a_partial_crust_with_a_full_one():
    with pytest.raises(LavaError, match=r'crust_cover.*0\.9.*0 with lava\.crust'):
        Lava(crust=True, conductivity=2.0, crust_cover=0.9)


def slab(lava, thickness, times):
    """Return mean temperatures of a slab that conducts to its top, by finite volumes."""
    # the uppermost cell is 1 um thick and represents the surface
    sizes = np.diff(np.linspace(0.0, 1.0, 121) ** 3 * thickness)
    between = lava.conductivity / (0.5 * (sizes[1:] + sizes[:-1]))

    def rates(_, t):
        up = np.concatenate([[flux(lava, t[0])], between * np.diff(t), [0.0]])
        return np.diff(up) / (CAPACITY * sizes)

    solved = solve_ivp(
        rates, (0.0, times[-1]), np.full(len(sizes), HOT), method='LSODA', lband=1, uband=1,
        t_eval=times, rtol=1e-6,
    )
    return sizes @ solved.y / thickness


@pytest.mark.parametrize('thickness', [1.0, 5.0])
@pytest.mark.parametrize(
    ('losses', 'worst'),
    [({}, 0.025), ({'emissivity': 0.0}, 0.045), ({'convection': 0.0}, 0.025)],
    ids=['both', 'air', 'radiation'],
)
def test_crusted_lava_loses_the_heat_of_a_conducting_slab(thickness, losses, worst):
    lava, times = replace(CRUSTED, **losses), np.array([600.0, HOUR, 36000.0, 3.6e5])
    found, thickness = still_columns(
        lava, CRUST, [HOT], times, thickness=thickness, longest_step=100.0
    )
    assert HOT - found[:, 0] == pytest.approx(HOT - slab(lava, thickness, times), rel=worst)


def test_exact_convecting_slab_equals_finite_volumes():
    """The series of modes and finite volumes check each other."""
    lava, times = replace(CRUSTED, emissivity=0.0), np.array([HOUR, 36000.0, 3.6e5])
    options = {'initial': HOT, 'ambient': AIR, 'thickness': 2.0}
    expected = [exact.convecting_slab(lava, time, **options) for time in times]
    assert slab(lava, 2.0, times) == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize(('time', 'least', 'most'), [(1e-3, 0.97, 1.0), (HOUR, 0.05, 0.3)])
def test_fresh_crust_loses_heat_as_bare_lava(device, time, least, most):
    crusted, bare = (lost(CRUSTED, on, time, device=device) for on in (CRUST, only('cooling')))
    assert least < crusted / bare < most


def test_heat_loss_through_an_old_crust_is_limited_by_conduction():
    whole, less = (
        lost(replace(CRUSTED, emissivity=emissivity), CRUST, 86400.0, longest_step=300.0)
        for emissivity in (0.9, 0.45)
    )
    assert 0.97 < less / whole < 1.0


@precisions
def test_column_on_the_ground_follows_the_exact_solution(device, precision):
    """exp(x^2) erfc(x), up to a loss of 70 % of the heat."""
    times = HOUR * np.array([1.0, 10.0, 100.0, 1000.0, 10000.0])
    found, thickness = still_columns(
        GROUNDED, GROUND, [HOT], times, longest_step=1e4, precision=precision, device=device
    )
    options = {'initial': HOT, 'ground': AIR, 'thickness': thickness}
    expected = np.array([exact.column_on_ground(GROUNDED, time, **options) for time in times])
    assert expected[-1] < AIR + 0.3 * 1123.0
    assert found[:, 0] == pytest.approx(expected, abs=0.005 * 1123.0)
    assert HOT - found[:, 0] == pytest.approx(HOT - expected, rel=0.008)


def test_long_steps_do_not_cool_below_the_ground(device):
    (found,), _ = still_columns(
        GROUNDED, GROUND, [HOT, AIR, 250.0], [3e10], longest_step=1e9, device=device
    )
    assert AIR <= found[0] < 600.0
    assert found[1] == pytest.approx(AIR)
    assert 250.0 < found[2] <= AIR


def test_later_lava_is_hotter_on_the_ground():
    lava = replace(GROUNDED, viscosity=1e3, arrhenius=0.0)
    vent = Vent((0.0, 0.0), 5.0)
    simulation = simulated(flat(40, 10.0), lava, vent, effects=GROUND, spacing=10.0)
    simulation.advance(1500.0)
    sample = simulation.sample()
    distance = np.hypot(*sample.position.T)
    is_near = distance < np.median(distance)
    assert sample.temperature[~is_near].mean() < sample.temperature[is_near].mean() < HOT


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


def test_temperature_is_constant_without_losses(device):
    still, before = replace(FREEZING, convection=0.0), [HOT, 1400.0, 1325.0, 1250.0, 1000.0, AIR]
    (after,), _ = still_columns(still, LATENT, before, [1e6], longest_step=1e5, device=device)
    assert after == pytest.approx(before)


def test_wind_cools_a_column(device):
    """T - Ta falls as exp(-(lambda + CH rho c U) t / (rho c h))."""
    ends = {}
    for names, speed in ((('wind',), 20.0), (('wind',), 0.0), ((), 20.0)):
        found, thickness = still_columns(
            WINDY, only('cooling', *names), [1400.0], [HOUR], thickness=1.0, wind_speed=speed,
            device=device,
        )
        ends[names, speed] = found[0, 0]
    rate = (WINDY.convection + 20.0 * TRANSFER) / (CAPACITY * thickness)
    assert ends[('wind',), 20.0] == pytest.approx(AIR + 1100.0 * np.exp(-rate * HOUR), abs=0.01)
    assert ends[('wind',), 0.0] == ends[(), 20.0] > ends[('wind',), 20.0] + 30.0


def test_wind_is_on_above_a_speed():
    scene = Scene(Terrain(np.zeros((12, 12)), 2.0), (Vent((12.0, 12.0), 0.01),), Lava())
    assert 'wind' not in effects_for(scene)
    assert 'wind' in effects_for(replace(scene, wind_speed=10.0))


def test_heat_loss_on_the_host_equals_that_of_a_column():
    ground = plane((0.0, 0.0, 40.0, 40.0), 10.0, 0.0)
    found, thickness = still_columns(COVERED, COVER, [HOT], [1.0], longest_step=1.0)
    expected = heat_loss(Scene(ground, lava=COVERED))(HOT)
    assert (HOT - found[0, 0]) * CAPACITY * thickness == pytest.approx(expected, rel=1e-3)
    windy, still = (heat_loss(Scene(ground, lava=WINDY, wind_speed=u))(1400.0) for u in (10, 0))
    assert windy - still == pytest.approx(10.0 * TRANSFER * 1100.0)
    # FLOWGO's coefficient for 5 m/s
    assert pytest.approx(8.73, abs=0.005) == 5.0 * TRANSFER
