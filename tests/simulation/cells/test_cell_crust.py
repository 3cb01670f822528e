# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The age of a crust that stays in its cell: from arrival, over changes and restarts."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.scene import Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.cells.state import UNREACHED
from simulation.cells.test_cell_solver import LAVA, simulated, slope
from solver import only

CRUSTED = replace(LAVA, arrhenius=0.02, solidus=1100.0)


def crusted_flow(effects, *, ground=None):
    """Return a flow of ten minutes, with effects or those of its crust, and its columns."""
    vent = Vent((-60.0, 3.0), 8.0, radius=7.0, temperature=1400.0)
    simulation = simulated(ground or slope(), vent, effects=effects, lava=CRUSTED, spacing=5.0)
    simulation.advance(600.0)
    return simulation, simulation.solver.columns()


def test_crust_is_as_old_as_the_lava_in_its_cell():
    """It counts from the arrival of lava, whichever lava the cell has now."""
    simulation, lava = crusted_flow(only('steep', 'arrhenius', 'insulation'))
    arrived = simulation.snapshot().arrived
    is_wet = np.isfinite(arrived)
    assert (lava.emission_time[lava.thickness == 0.0] == UNREACHED).all()
    # the map of arrival counts from the start in vents
    is_beyond = arrived > 0.0
    np.testing.assert_allclose(lava.emission_time[is_beyond], arrived[is_beyond], rtol=1e-6)
    assert 0.0 < lava.emission_time.min() < 40.0 and arrived[is_wet].max() > 400.0


def ages_by_arrival(arrived, cell):
    """Return when lava reached cells of 5 m [s] by the map of arrival, on cells of a size [m]."""
    if cell > 5.0:
        mean = np.kron(arrived, np.ones((2, 2)))
    else:
        parts = arrived.reshape(60, -1, 60, round(5.0 / cell)).transpose(0, 2, 1, 3)
        count = np.isfinite(parts).sum(axis=(2, 3))
        mean = np.where(count > 0, np.nansum(parts, axis=(2, 3)) / np.maximum(count, 1), np.nan)
    return np.where(np.isfinite(mean), mean.astype(float), UNREACHED)


@pytest.mark.parametrize('cell', [5.0, 10.0, 2.5])
def test_crust_that_is_switched_on_is_as_old_as_the_inundation(cell):
    """The cells of the terrain are as large as those of the solver, twice or half as large."""
    ground = slope(cells=round(300.0 / cell), cell=cell)
    simulation, _ = crusted_flow(only('steep'), ground=ground)
    expected = ages_by_arrival(simulation.snapshot().arrived, cell)
    simulation.set_effects({'insulation': True, 'arrhenius': True, 'cooling': False})
    ages = simulation.solver.columns().emission_time
    np.testing.assert_allclose(ages, expected, rtol=1e-6)
    has_crust = expected < UNREACHED
    assert has_crust.sum() > 20 and expected.min() < 10.0
    simulation.advance(700.0)
    later = simulation.solver.columns().emission_time
    np.testing.assert_array_equal(later[has_crust], ages[has_crust])
    assert (later < UNREACHED).sum() > has_crust.sum()


def test_lava_takes_its_age_with_it_after_a_crust():
    simulation, _ = crusted_flow(only('steep', 'arrhenius', 'insulation'))
    simulation.set_effects({'insulation': False, 'cooling': True, 'crust_strength': True})
    assert simulation.effects.any('needs_age')
    simulation.advance(900.0)
    lava = simulation.solver.columns()
    is_wet = lava.thickness > 0.0
    assert 0.0 <= lava.emission_time[is_wet].min() <= lava.emission_time[is_wet].max() <= 900.0


@pytest.mark.parametrize('cell', [10.0, 2.5])
def test_crust_survives_a_restart_and_another_terrain(cell):
    simulation, before = crusted_flow(only('steep', 'arrhenius', 'insulation'))
    resumed = Simulation.resume(simulation.checkpoint(), device='cpu')
    np.testing.assert_array_equal(
        resumed.solver.columns().emission_time, before.emission_time
    )
    simulation.set_terrain(slope(cells=round(300.0 / cell), cell=cell))
    expected = ages_by_arrival(simulation.snapshot().arrived, cell)
    np.testing.assert_allclose(
        simulation.solver.columns().emission_time, expected, rtol=1e-6
    )
    assert 20 < (expected < UNREACHED).sum() < expected.size
