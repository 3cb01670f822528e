# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Viscous heating against the potential energy that lava loses."""

import math

import numpy as np
import pytest

from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.verification import exact
from solver import flat, incline, lattice, only, simulated

# a small heat capacity, so that the warming is measurable
LAVA = Lava.paper(viscosity=1e4, specific_heat=1.0, emissivity=0.0, convection=0.0)


def sheet(device='cpu', *lateral, slope=10.0, **knobs):
    """Return a sheet 1 m thick on a slope [degrees], and a function that samples its middle."""
    ground = incline(math.tan(math.radians(slope)), 60, 200, 1.0, origin=(-100.0, -30.0))
    sheet = Particles(lattice(24.5), 1.0, 1400.0)
    effects = only('steep', 'viscous_heating', *lateral)
    knobs = {'spacing': 1.0, 'thickness': 1.0, **knobs}
    simulation = simulated(ground, LAVA, sheet, effects=effects, device=device, **knobs)

    def middle():
        sample = simulation.sample()
        inside = (np.abs(sample.position[:, 0]) < 8.0) & (np.abs(sample.position[:, 1]) < 8.0)
        return sample.temperature[inside], sample.velocity[inside, 0].mean()

    return simulation, middle


@pytest.mark.parametrize(
    ('lateral', 'knobs', 'time', 'within'),
    [
        ([], {}, 10.0, 2e-3),
        ([], {'integrator': 'euler'}, 10.0, 2e-3),
        ([], {'gradient': 'balanced'}, 10.0, 2e-3),
        ([], {'precision': 'float64'}, 10.0, 2e-3),
        (['green'], {}, 5.0, 5e-3),
        (['helmholtz'], {}, 5.0, 5e-3),
    ],
    ids=str,
)
def test_sheet_on_a_slope_warms_by_its_descent(device, lateral, knobs, time, within):
    """A column that goes u t down a slope b warms by g tan(b) u t / c."""
    simulation, middle = sheet(device, *lateral, **knobs)
    _, speed = middle()
    simulation.advance(time)
    temperature, later = middle()
    descent = 0.5 * (speed + later) * time * math.tan(math.radians(10.0))
    warming = exact.warming_by_descent(descent, gravity=9.81, specific_heat=1.0)
    assert warming > 1.0
    assert temperature.mean() - 1400.0 == pytest.approx(warming, rel=within)


@pytest.mark.parametrize('gradient', ['energy', 'balanced'])
def test_spreading_turns_potential_energy_into_heat(gradient):
    """The gain rho c sum V dT is the loss of sum rho g V h / 2."""
    solution = exact.FixedVolumeSpread(1e4, 4.0, 9.81)
    places = solution.particles(2000, solution.time_of_radius(60.0))
    simulation = simulated(
        flat(40, 10.0), LAVA, Particles(places, 5.0, 1400.0), effects=only('viscous_heating'),
        spacing=2.5, thickness=1.0, gradient=gradient, longest_step=5.0,
    )
    before = simulation.sample()
    simulation.advance(1000.0)
    after = simulation.sample()
    lost = 0.5 * 9.81 * 5.0 * (before.thickness.sum() - after.thickness.sum())
    gained = (after.volume * (after.temperature - 1400.0)).sum()
    assert lost > 1e3
    assert gained == pytest.approx(lost, rel=0.03)


def test_lava_at_rest_is_not_warmed():
    simulation, middle = sheet(slope=0.0)
    simulation.advance(10.0)
    assert middle()[0] == pytest.approx(1400.0, abs=2e-3)
