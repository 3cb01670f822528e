# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral stress on cells: the solution of its equation on the faces, and its effect on a flow."""

import numpy as np
import pytest

from lava_ros.effects.laws import LATERAL_DRAG
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from solver import only

LAVA, CELL = Lava.paper(viscosity=1e7, arrhenius=0.0), 1.0


def simulated(terrain, *vents, effects, particles=None, horizon=3600.0):
    """Return a simulation on the cells of a terrain."""
    return Simulation(
        Scene(terrain, vents, LAVA), effects=effects, particles=particles, device='cpu',
        accuracy=Accuracy(method='cells', spacing=CELL, thickness=2.0), horizon=horizon,
    )


def patch(slope):
    """Return rough ground, and lava of uneven thickness on its middle."""
    rng = np.random.default_rng(5)
    ground = rng.normal(0.0, 0.02, (24, 20)) - slope * np.arange(20)
    i, j = (ticks.ravel() for ticks in np.mgrid[5:19, 4:15])
    is_wet = rng.uniform(size=i.size) < 0.9
    places = np.column_stack([j + 0.5, i + 0.5])[is_wet]
    return Terrain(ground, CELL), Particles(places, rng.uniform(0.5, 3.0, len(places)), 1400.0)


def carried(flux, thickness):
    """Return the thickness that fluxes along axis 1 carry, with Koren's limiter."""
    wide = np.pad(thickness, ((0, 0), (1, 1)))
    behind, own, other = (wide[:, k : k + flux.shape[1]] for k in range(3))
    after = wide[:, 3 : 3 + flux.shape[1]]
    is_forward = np.where(flux == 0.0, own > other, flux > 0.0)
    own, other, behind = (
        np.where(is_forward, *pair) for pair in ((own, other), (other, own), (behind, after))
    )
    before, after = own - behind, other - own
    slopes = np.abs([(before + 2.0 * after) / 3.0, 2.0 * before, 2.0 * after]).min(axis=0)
    limited = own + 0.5 * np.where(before * after > 0.0, np.sign(after) * slopes, 0.0)
    cubes = 0.25 * (own + other) * (own**2 + other**2)
    return np.maximum(limited, np.sqrt(cubes / np.maximum(np.maximum(own, other), 1e-9)))


def solved(flux, thickness, factor):
    """Return the fluxes through the faces along axis 1, by a direct solution.

    ``flux`` are those without lateral stress, ``thickness`` that of the cells, with a ring; face
    (i, j) is between the cells (i, j) and (i, j + 1). ``factor`` reduces the local flux.
    """
    h = carried(flux, thickness)
    local = np.divide(flux, h, out=np.zeros_like(h), where=h > 0.0)
    rows, columns = local.shape
    mean = 0.5 * (thickness[:, :-1] + thickness[:, 1:])
    faces = np.argwhere(mean > 0.0)
    number = {tuple(face): index for index, face in enumerate(faces.tolist())}
    matrix, source = np.zeros((len(faces), len(faces))), np.zeros(len(faces))
    for (i, j), index in number.items():
        a, b = thickness[i, j : j + 2]
        drag = LATERAL_DRAG * h[i, j] ** 2 / (0.25 * (a + b) * (a**2 + b**2) * factor[i, j])
        matrix[index, index] += drag
        source[index] = drag * local[i, j]
        for other, amount in (
            ((i, j - 1), thickness[i, j]), ((i, j + 1), thickness[i, j + 1]),
            ((i - 1, j), None), ((i + 1, j), None),
        ):
            if other in number and amount != 0.0:
                if amount is None:
                    amount = 2.0 * mean[i, j] * mean[other] / (mean[i, j] + mean[other])
                matrix[index, index] += amount / CELL**2
                matrix[index, number[other]] -= amount / CELL**2
    found = np.zeros((rows, columns))
    found[tuple(faces.T)] = np.linalg.solve(matrix, source)
    return found * h


def test_sweeps_solve_the_equation_on_the_faces():
    terrain, lava = patch(0.5)
    local, found = (
        simulated(terrain, effects=only('steep', *more), particles=lava)
        for more in ((), ('helmholtz',))
    )
    fluxes = []
    for simulation in (local, found):
        simulation.sample()
        state = simulation.solver.state
        fluxes.append([state.first_x.numpy()[:, :-1].copy(), state.first_y.numpy()[:-1].T.copy()])
    state = found.solver.state
    thickness = state.thickness.numpy()
    factors = state.factor_x.numpy()[:, :-1], state.factor_y.numpy()[:-1].T
    for before, after, h, factor in zip(*fluxes, (thickness, thickness.T), factors, strict=True):
        expected = solved(before.astype(float), h, factor)
        largest = np.abs(before - expected).max()
        assert largest > 0.2 * np.abs(before).max()
        # a cell gives no more than it has, however its lava is pulled
        gives = np.minimum(h[:, :-1], h[:, 1:]) > 0.1
        assert gives.sum() > 80
        assert np.abs(after - expected)[gives].max() < 1e-3 * largest


def test_lateral_stress_keeps_the_volume_and_holds_lava_in_a_valley():
    y = np.arange(40) - 19.5
    ground = np.add.outer(0.2 * y**2, -0.2 * np.arange(90))
    vent = Vent((10.0, 20.0), 0.01, radius=2.0)
    ends = []
    for effects in (only('steep'), only('steep', 'helmholtz')):
        simulation = simulated(Terrain(ground, CELL), vent, effects=effects, horizon=3e4)
        for until in (1e4, 3e4):
            simulation.advance(until)
        snapshot = simulation.snapshot()
        assert snapshot.budget.lost < 1e-12
        volume = np.nansum(snapshot.thickness, dtype=float)
        assert volume == pytest.approx(snapshot.budget.emitted, rel=1e-6)
        assert snapshot.budget.flowing == pytest.approx(snapshot.budget.emitted, rel=1e-12)
        ends.append((np.nonzero(snapshot.footprint)[1].max(), np.nanmax(snapshot.thickness)))
    # the flow is 8 m wide
    assert ends[1][0] < ends[0][0] and ends[1][1] > 1.08 * ends[0][1]


def test_lateral_stress_can_be_switched_on_and_survives_a_restart():
    terrain, lava = patch(0.2)
    simulation = simulated(terrain, effects=only('steep'), particles=lava)
    simulation.advance(600.0)
    simulation.set_effects({'helmholtz': True})
    assert 'helmholtz' in simulation.effects
    simulation.advance(1200.0)
    resumed = Simulation.resume(simulation.checkpoint(), device='cpu')
    local = Simulation.resume(simulation.checkpoint(), device='cpu')
    local.set_effects({'helmholtz': False})
    for one in (simulation, resumed, local):
        one.advance(1800.0)
    np.testing.assert_array_equal(
        simulation.snapshot().thickness, resumed.snapshot().thickness
    )
    assert np.abs(local.snapshot().thickness - simulation.snapshot().thickness).max() > 1e-3
