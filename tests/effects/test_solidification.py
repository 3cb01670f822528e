# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava that solidifies into terrain."""

import math

import numpy as np
import pytest

from lava_ros.scene import Lava, Terrain, Vent
from lava_ros.simulation import Particles
from lava_ros.simulation.output.covered_cells import WIDTH
from solver import incline, only, simulated

#: Lava that does not cool; particles below 1200 K solidify in the first step.
LAVA = Lava.paper(viscosity=2e3, density=2600.0, arrhenius=0.0, emissivity=0.0, convection=0.0,
            solidus=1200.0)

#: Lava that cools by convection alone.
COOLING = Lava.paper(
    viscosity=2e4, density=2600.0, arrhenius=0.0, emissivity=0.0, convection=2000.0,
    solidus=1300.0,
)


def hillside(rows=40, columns=60, cell=10.0):
    return incline(0.1, rows, columns, cell, top=1000.0)


def layer():
    """Return an even layer 2 m thick on 300 m by 200 m, which solidifies in the first step."""
    x, y = np.meshgrid(np.arange(150.0, 450.0, 5.0), np.arange(100.0, 300.0, 5.0))
    return Particles(np.column_stack([x.ravel(), y.ravel()]) + 2.5, 50.0, 1100.0)


def freezing(device, terrain, *on_it, lava=LAVA, **knobs):
    effects = only('solidification', *['cooling'] * (lava.convection > 0.0))
    knobs = {'spacing': 5.0, 'thickness': 1.0, 'longest_step': 20.0, **knobs}
    return simulated(terrain, lava, *on_it, effects=effects, device=device, **knobs)


def frozen_in(simulation):
    """Return the thickness of solidified lava on maps, in full precision [m]."""
    return simulation.solver.raised.thickness()


def raised_in(simulation):
    """Return the rise of the ground by solidified lava [m], shape [rows, columns]."""
    terrain = simulation.solver.terrain
    return (terrain.height.numpy().astype(float) - terrain.bare.numpy())[1:-1, 1:-1]


@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_even_layer_raises_the_ground_evenly(device, precision):
    simulation = freezing(device, hillside(), layer(), precision=precision)
    simulation.advance(1.0)
    snapshot = simulation.snapshot()
    assert snapshot.particle_count == 0
    assert snapshot.budget.flowing == 0.0
    assert snapshot.budget.solidified == pytest.approx(300.0 * 200.0 * 2.0, rel=1e-12)
    exact = frozen_in(simulation)
    assert exact.sum() * 100.0 == pytest.approx(120000.0, rel=1e-12)
    raised = raised_in(simulation)
    for shown in (snapshot.frozen, raised):
        inside = shown[14:26, 19:41]
        assert inside == pytest.approx(np.full_like(inside, 2.0), abs=1e-3)
    assert (snapshot.temperature[snapshot.frozen > 0.0] == 1200.0).all()
    assert np.array_equal(snapshot.thickness, snapshot.frozen)
    assert raised.sum() * 100.0 == pytest.approx(120000.0, rel=1e-5)
    # maps show it where it was, in fewer cells than the raised ground
    layer_cells = np.zeros((40, 60), dtype=bool)
    layer_cells[10:30, 15:45] = True
    np.testing.assert_array_equal(exact > 0.0, layer_cells)
    assert exact[layer_cells] == pytest.approx(2.0, rel=0.2)
    assert ((raised > 0.01) & ~layer_cells).any()


def test_single_column_makes_no_spike(device):
    particles = Particles([[303.0, 201.0]], 300.0, 1100.0)
    simulation = freezing(device, hillside(200, 300, 2.0), particles)
    thickness = simulation.sample().thickness[0]
    simulation.advance(1.0)
    raised = raised_in(simulation)
    assert raised.sum() * 4.0 == pytest.approx(300.0, rel=1e-4)
    assert 0.2 * thickness < raised.max() < thickness
    assert np.abs(np.diff(raised, axis=1)).max() < 0.3 * raised.max()
    snapshot = simulation.snapshot()
    assert snapshot.frozen.sum() * 4.0 == pytest.approx(300.0, rel=1e-6)
    side = WIDTH * math.sqrt(300.0 / thickness) / 2.0
    rows, columns = np.nonzero(snapshot.frozen)
    for cells in (rows, columns):
        assert np.ptp(cells) + 1 == pytest.approx(side, abs=1.0)
    # the volume of cells that the rim covers in part is in the other cells
    assert snapshot.frozen.max() < thickness * (side / (side - 1.0)) ** 2
    np.testing.assert_array_equal(snapshot.footprint, snapshot.frozen > 0.0)


def test_solidified_volume_is_exact_next_to_borders_and_holes(device):
    terrain = hillside()
    elevation = terrain.elevation.copy()
    elevation[15:25, 30:40] = np.nan
    places = np.array([[2.0, 3.0], [598.0, 399.0], [297.0, 201.0], [350.0, 148.0], [405.0, 255.0]])
    simulation = freezing(device, Terrain(elevation, 10.0), Particles(places, 77.0, 1100.0))
    simulation.advance(1.0)
    snapshot = simulation.snapshot()
    assert snapshot.budget.solidified == pytest.approx(5 * 77.0, rel=1e-12)
    assert snapshot.budget.error < 1e-12
    exact = frozen_in(simulation)
    assert exact.sum() * 100.0 == pytest.approx(5 * 77.0, rel=1e-12)
    assert (exact[15:25, 30:40] == 0.0).all()
    assert np.isnan(snapshot.frozen[15:25, 30:40]).all()
    # a terrain with the same cells keeps the continuation of the deposit beyond them
    height = simulation.solver.terrain.height.numpy().copy()
    beyond = np.isnan(np.pad(elevation, 1, constant_values=np.nan))
    assert (height != simulation.solver.terrain.bare.numpy())[beyond].sum() > 10
    simulation.set_terrain(Terrain(elevation, 10.0))
    assert np.array_equal(simulation.solver.terrain.height.numpy(), height)
    # cells that get data are ground without lava
    before = raised_in(simulation)
    simulation.set_terrain(hillside())
    hole = np.isnan(elevation)
    assert (before[hole] > 0.0).any() and (raised_in(simulation)[hole] == 0.0).all()
    assert simulation.budget().solidified == snapshot.budget.solidified


def test_solidified_columns_are_not_particles_with_other_effects(device):
    """A checkpoint, and a simulation with other effects, do not contain particles of volume 0."""
    simulation = freezing(device, hillside(), layer())
    simulation.advance(1.0)
    assert len(simulation.checkpoint().arrays['state.particle']) == 0
    simulation = freezing(device, hillside(), layer())
    simulation.advance(1.0)
    simulation.set_effects({'solidification': False})
    assert simulation.particle_count == 0


def test_solidified_volume_is_exact_over_many_steps(device):
    vent = Vent((150.0, 200.0), 20.0, temperature=1423.0, radius=10.0)
    simulation = freezing(device, hillside(), vent, lava=COOLING, precision='float64')
    before = np.zeros((40, 60))
    for minutes in range(10, 41, 10):
        simulation.advance(60.0 * minutes)
        budget = simulation.budget()
        assert budget.error < 1e-12
        frozen = frozen_in(simulation)
        assert frozen.sum() * 100.0 == pytest.approx(budget.solidified, rel=1e-12, abs=1e-9)
        assert (frozen >= before).all()
        before = frozen
    snapshot = simulation.snapshot()
    assert 0.3 * budget.emitted < budget.solidified < budget.emitted
    assert simulation.sample().temperature.min() >= COOLING.solidus
    assert np.isfinite(snapshot.temperature[snapshot.thickness > 0.0]).all()
    # no spike
    assert frozen.max() < 3.0 * simulation.sample().thickness.max()


def test_new_terrain_keeps_solidified_lava(device):
    simulation = freezing(device, hillside(), layer())
    simulation.advance(1.0)
    before = simulation.snapshot().frozen
    height = simulation.solver.terrain.height.numpy().copy()
    simulation.set_terrain(hillside())
    assert np.array_equal(simulation.snapshot().frozen, before)
    assert np.array_equal(simulation.solver.terrain.height.numpy(), height)

    fine = Terrain(np.zeros((150, 260)), 4.0, origin=(-33.0, -41.0))
    simulation.set_terrain(fine)
    snapshot = simulation.snapshot()
    assert snapshot.frozen.sum() * 16.0 == pytest.approx(120000.0, rel=1e-5)
    assert snapshot.budget.lost == 0.0
    x = -33.0 + 4.0 * (np.arange(260) + 0.5)
    centre = (snapshot.frozen.sum(axis=0) * x).sum() / snapshot.frozen.sum()
    x = 10.0 * (np.arange(60) + 0.5)
    assert centre == pytest.approx((before.sum(axis=0) * x).sum() / before.sum(), abs=0.01)

    simulation.set_terrain(Terrain(np.zeros((50, 30)), 10.0))
    budget = simulation.budget()
    assert budget.lost == budget.lost_over_border == pytest.approx(60000.0, rel=0.05)

    holed = np.zeros((50, 30))
    holed[:, 15:] = np.nan
    simulation.set_terrain(Terrain(holed, 10.0))
    after = simulation.budget()
    assert after.lost_in_no_data == pytest.approx(budget.solidified - after.solidified)
    assert after.lost_in_no_data > 0.9 * budget.solidified
    assert after.lost_over_border == budget.lost_over_border
