# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Columns of lava and sheets that stay in place."""

import numpy as np
import pytest

from lava_ros.effects.heat import STEFAN_BOLTZMANN
from lava_ros.scene import Lava, Terrain
from lava_ros.simulation import Particles
from solver import incline, only, simulated

#: Temperature of the air and of fresh lava [K].
AIR, HOT = 300.0, 1423.0

#: Heat capacity of lava of a default density [J/(m3 K)].
CAPACITY = Lava.paper().density * Lava.paper().specific_heat

HOUR = 3600.0

precisions = pytest.mark.parametrize('precision', ['float32', 'float64'])


def still_columns(lava, effects, temperatures, times, *, thickness=2.0, **options):
    """Cool columns that are too stiff to move.

    Returns:
        Temperatures [K], shape [times, columns], and the thickness of each column [m].
    """
    x = 10.0 * np.arange(len(temperatures))
    # a single column has a thickness of 0.0275 m per cubic metre
    particles = Particles(
        np.column_stack([x, 0.0 * x]), thickness / 0.0275, np.asarray(temperatures)
    )
    ground = Terrain(np.zeros((4, len(x) + 2)), 10.0, origin=(-15.0, -20.0))
    knobs = {'longest_step': 60.0, 'precision': 'float64', 'ambient_temperature': AIR, **options}
    simulation = simulated(
        ground, lava, particles, effects=effects, spacing=3.0, ratio=3.0, **knobs
    )
    found = []
    for time in times:
        simulation.advance(time)
        sample = simulation.sample()
        found.append(sample.temperature[np.argsort(sample.position[:, 0])])
    assert np.ptp(sample.thickness) == 0.0
    return np.array(found), sample.thickness[0]


def lost(lava, effects, time, **options):
    """Return the cooling of a hot column by a time [K]."""
    return HOT - still_columns(lava, effects, [HOT], [time], **options)[0][0, 0]


def viscosities(temperatures, effects, *, lava, precision, device):
    """Return viscosities [Pa s] at temperatures [K], from the speed of a sheet.

    Gravity is low, so that the free fall limit does not apply.
    """
    x = np.arange(len(temperatures)) * 10.0
    particles = Particles(np.column_stack([x, 0.0 * x]), 25.0, np.asarray(temperatures))
    ground = incline(0.1, 8, len(x) + 4, 10.0, origin=(-20.0, -40.0))
    knobs = {'spacing': 5.0, 'thickness': 1.0, 'ratio': 1.5, 'gravity': 1e-3}
    speeds = []
    for kind, material in ((effects, lava), (only(), Lava.paper(viscosity=1e3, arrhenius=0.0))):
        simulation = simulated(
            ground, material, particles, effects=kind, precision=precision, device=device, **knobs
        )
        sample = simulation.sample()
        speeds.append(sample.velocity[np.argsort(sample.position[:, 0]), 0])
    return 1e3 * speeds[1] / speeds[0]


def flux(lava, surface):
    """Return the heat flux of a bare surface to the air [W/m2]."""
    radiation = lava.emissivity * STEFAN_BOLTZMANN * (surface**4 - AIR**4)
    return radiation + lava.convection * (surface - AIR)


def check_range(lava, effects, step, steps, *, precision, device):
    """Check that no column passes the temperature of the air, and that hot lava cools in years."""
    before = np.array([HOT, 1400.0, 1325.0, 1250.0, 1000.0, 301.0, AIR, 250.0])
    (after,), _ = still_columns(
        lava, effects, before, [steps * step], longest_step=step, precision=precision,
        device=device,
    )
    assert steps * step < 1e9 or after[0] < before[0] - 1.0
    assert (after >= np.minimum(before, AIR - 0.01)).all()
    assert (after <= np.maximum(before, AIR + 0.01)).all()


def check_equal(lava, one, other, off):
    """Check that two sets of effects cool columns alike, to ``off`` [K]."""
    starts = [HOT, 1300.0, 1000.0]
    ends = [still_columns(lava, on, starts, [1e5])[0] for on in (one, other)]
    assert (ends[0] < np.subtract(starts, 1.0)).all()
    assert ends[0] == pytest.approx(ends[1], rel=0.0, abs=off)


def check_steps(lava, effects, time, steps, within):
    """Check that columns lose as much heat in steps of any length [s], to a fraction."""
    first, *others = (lost(lava, effects, time, longest_step=step) for step in steps)
    assert others == pytest.approx([first] * len(others), rel=within)
