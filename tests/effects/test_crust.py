# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Heat loss through a crust that thickens."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from effects.columns import (
    AIR,
    CAPACITY,
    check_equal,
    check_range,
    check_steps,
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

CRUST = only('crust')

CRUSTED = Lava.paper(viscosity=1e15, emissivity=0.9, convection=50.0, conductivity=2.0, crust=True)


@pytest.mark.parametrize('losses', [{}, {'emissivity': 0.0}, {'convection': 0.0}], ids=str)
@pytest.mark.parametrize('conductivity', [1e-6, 2.0, 1e3])
@pytest.mark.parametrize('step', [1.0, 1e9])
@precisions
def test_temperature_stays_in_range_for_any_step(device, precision, losses, conductivity, step):
    lava = replace(CRUSTED, conductivity=conductivity, **losses)
    check_range(lava, CRUST, step, 10, precision=precision, device=device)


def test_crust_replaces_plain_cooling():
    check_equal(CRUSTED, CRUST, only('cooling', 'crust'), 0.0)


@pytest.mark.parametrize(('hours', 'within'), [(1.0, 0.1), (24.0, 0.03)])
def test_long_steps_lose_the_same_heat(hours, within):
    check_steps(CRUSTED, CRUST, hours * HOUR, (60.0, HOUR), within)


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
