# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Heat that the ground takes from lava."""


import numpy as np
import pytest

from effects.columns import AIR, check_range, check_steps, HOT, HOUR, precisions, still_columns
from lava_ros.scene import Lava
from lava_ros.verification import exact
from solver import only

GROUND = only('ground')

GROUNDED = Lava.paper(viscosity=1e15, emissivity=0.0, convection=0.0, ground_conductivity=2.0)


@precisions
def test_temperature_stays_in_range_for_long_steps(device, precision):
    check_range(GROUNDED, GROUND, 1e9, 30, precision=precision, device=device)


def test_long_steps_lose_the_same_heat():
    """The flux is infinite at first."""
    check_steps(GROUNDED, GROUND, HOUR, (3.6, 360.0, HOUR), 2e-3)


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
