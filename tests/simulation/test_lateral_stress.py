# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral stress: the Helmholtz solve, the Green's function, and flow in a channel."""

from dataclasses import replace
import math

import numpy as np
import pytest

from lava_ros.scene import Lava, Terrain
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.particles.state import ADVECTION
from lava_ros.verification.cases.confined import channel_velocity
from lava_ros.verification.cases.sheets import response
from solver import flat, lattice, only, simulated

LAVA = Lava(viscosity=1e4, arrhenius=0.0)


@pytest.mark.parametrize('radius', [0.6, 1.0, 3.5, 10.0])
def test_response_is_that_of_stokes_flow(device, radius):
    run = response('helmholtz', radius, 8.0 * radius, Accuracy(ratio=3.0), device)
    assert run.measurements[0].error < 0.01


def test_sweeps_solve_the_matrix():
    rng = np.random.default_rng(2)
    places = rng.uniform(-4.0, 4.0, (200, 2))
    x = np.arange(40) * 0.5
    terrain = Terrain(np.tile(0.3 * np.sin(x / 2.0), (40, 1)), 0.5, origin=(-10.0, -10.0))
    particles = Particles(places, 0.36 * rng.uniform(0.5, 2.0, 200), 1400.0)
    # slow enough that the free fall limit does not apply
    lava, knobs = replace(LAVA, viscosity=1e5), {'spacing': 0.6, 'precision': 'float64'}
    bare, simulation = (
        simulated(terrain, lava, particles, effects=effects, thickness=1.0, **knobs)
        for effects in (only(), only('helmholtz'))
    )
    local, solved = bare.sample(), simulation.sample()
    assert np.array_equal(local.position, solved.position)
    radius, h = simulation.radius, local.thickness
    q = np.linalg.norm(local.position[:, None] - local.position[None], axis=-1) / radius
    force = 7 / math.pi / radius**4 * 20 * np.clip(1 - q, 0, None) ** 3
    matrix = -force * (local.volume / h) * (h[:, None] + h)
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, 2.5 / h - matrix.sum(axis=1))
    exact = np.linalg.solve(matrix, (2.5 / h)[:, None] * local.velocity)
    error = np.abs(solved.velocity - exact).max()
    assert error < 2e-3 * np.abs(local.velocity - exact).max()


def test_no_speed_exceeds_the_largest_local_speed():
    rng = np.random.default_rng(4)
    terrain = Terrain(rng.normal(size=(40, 40)), 1.0)
    given = Particles(rng.uniform(8.0, 32.0, (600, 2)), rng.uniform(0.2, 3.0, 600), 1400.0)
    speeds = []
    for effects in (only(), only('helmholtz')):
        simulation = simulated(terrain, LAVA, given, effects=effects, spacing=1.0, thickness=2.0)
        speeds.append(np.abs(simulation.sample().velocity).max())
    assert 0.0 < speeds[1] <= speeds[0]


def test_step_length_follows_the_reduced_speed():
    simulation = simulated(
        flat(20), replace(LAVA, viscosity=1e8), Particles(lattice(3.0), 50.0, 1400.0),
        effects=only('helmholtz'), spacing=1.0, thickness=50.0,
    )
    speed = np.linalg.norm(simulation.sample().velocity, axis=1).max()
    reach = simulation.solver.stage.constants.reach
    simulation.advance(1e-3)
    rates = simulation.solver.state.rates.numpy()
    assert rates[ADVECTION] == pytest.approx(speed / reach, rel=0.01)


@pytest.mark.parametrize('precision', ['float32', 'float64'])
@pytest.mark.parametrize('height', [0.1, 1.0, 10.0])
@pytest.mark.parametrize('distance', [0.02, 0.1, 0.3, 1.0])
def test_columns_do_not_attract_each_other(device, precision, height, distance):
    """A neighbour with more weight than the particle itself would attract it."""
    places = 0.5 * distance * np.array([[-1.0, 0.0], [1.0, 0.0]])
    simulation = simulated(
        flat(8), Lava(viscosity=1e6), Particles(places, height, 1400.0), effects=only('green'),
        device=device, spacing=1.0, ratio=3.5, precision=precision,
    )
    sample = simulation.sample()
    apart = np.sign(sample.position[:, 0]) * sample.velocity[:, 0]
    # thick columns close to each other have equal weights and stay in place
    assert apart.min() >= 0.0


def test_short_support_underestimates_the_walls(device):
    """Cut off at 1.7 thicknesses the Green's function sums only half of the walls."""
    accuracy = Accuracy(spacing=0.3, ratio=5.5)
    _, mean = channel_velocity(6.0, effect='green', accuracy=accuracy, device=device)
    assert mean.measured > 1.03 * mean.exact
