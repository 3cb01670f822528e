# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Heat loss through a crust that covers a part of the surface."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from effects.columns import AIR, CAPACITY, check_equal, flux, HOT, HOUR, still_columns
from lava_ros.effects.heat import heat_loss
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene
from lava_ros.simulation import Particles
from lava_ros.verification.cases.case import plane
from solver import lattice, only, simulated

COVER = only('cover')

COVERED = Lava.paper(viscosity=1e15, emissivity=0.95, convection=9.0, crust_cover=0.9,
               crust_cover_decay=0.16, crust_temperature=773.15)


def test_cover_replaces_plain_cooling_or_equals_it():
    check_equal(COVERED, COVER, only('cooling', 'cover'), 1e-9)
    check_equal(replace(COVERED, crust_cover=0.0), COVER, only('cooling'), 1e-9)


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
        Lava.paper(crust=True, conductivity=2.0, crust_cover=0.9)


def test_heat_loss_on_the_host_equals_that_of_a_column():
    ground = plane((0.0, 0.0, 40.0, 40.0), 10.0, 0.0)
    found, thickness = still_columns(COVERED, COVER, [HOT], [1.0], longest_step=1.0)
    expected = heat_loss(Scene(ground, lava=COVERED))(HOT)
    assert expected > 0.0
    assert (HOT - found[0, 0]) * CAPACITY * thickness == pytest.approx(expected, rel=1e-3)
