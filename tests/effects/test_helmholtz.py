# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral stress by solving an equation."""

from dataclasses import replace
import math

import numpy as np
from numpy.polynomial import Polynomial
import pytest

from lava_ros.effects.laws import LATERAL_DRAG, REDUCTION
from lava_ros.scene import Lava, Terrain
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.step.effects.helmholtz import _schedule, LARGEST_EIGENVALUE
from lava_ros.verification import exact
from lava_ros.verification.cases.confined import channel_velocity, WIDTHS
from lava_ros.verification.cases.sheets import response
from solver import only, simulated

LAVA = Lava.paper(viscosity=1e4, arrhenius=0.0)


@pytest.mark.parametrize('thickness', [0.1, 2.0, 40.0])
def test_sweeps_reduce_the_error_of_every_wavelength(thickness):
    weights = _schedule(thickness, 3.0)
    smallest = 1.0 / (1.0 + 28.0 * thickness**2 / (LATERAL_DRAG * 3.0**2))
    eigenvalues = np.linspace(smallest, LARGEST_EIGENVALUE, 2000)
    error, change = np.ones(2000), np.zeros(2000)
    for momentum, relaxation in weights:
        change = momentum * change - relaxation * eigenvalues * error
        error += change
    assert np.abs(error).max() <= REDUCTION


@pytest.mark.parametrize('radius', [0.6, 1.0, 3.5, 10.0])
def test_response_is_that_of_stokes_flow(device, radius):
    run = response('helmholtz', radius, 8.0 * radius, Accuracy(ratio=3.0), device)
    assert run.measurements[0].error < 0.01


def test_speed_in_a_channel_has_its_order_in_the_spacing(device):
    """The measured order is 1.87, for 4 to 16 particles across half of a channel 5 h wide."""
    counts = np.array([4, 6, 8, 12, 16])
    errors = []
    for count in counts:
        accuracy = Accuracy(spacing=2.5 / int(count), ratio=3.5)
        _, found = channel_velocity(5.0, effect='helmholtz', accuracy=accuracy, device=device)
        errors.append(found.error)
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] > 1.6


@pytest.mark.parametrize(('width', 'count'), WIDTHS.items())
def test_speed_in_a_channel_on_cells_is_that_of_the_equation(width, count, device):
    accuracy = Accuracy(method='cells', spacing=0.5 * width / count)
    _, found = channel_velocity(width, effect='helmholtz', accuracy=accuracy, device=device)
    half = 0.5 * width * math.sqrt(LATERAL_DRAG)
    assert found.measured == pytest.approx(1.0 - math.tanh(half) / half, rel=0.004)


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
    radius, h = simulation.accuracy.radius, local.thickness
    q = np.linalg.norm(local.position[:, None] - local.position[None], axis=-1) / radius
    force = 7 / math.pi / radius**4 * 20 * np.clip(1 - q, 0, None) ** 3
    matrix = -force * (local.volume / h) * (h[:, None] + h)
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, 2.5 / h - matrix.sum(axis=1))
    solution = np.linalg.solve(matrix, (2.5 / h)[:, None] * local.velocity)
    error = np.abs(solved.velocity - solution).max()
    assert error < 2e-3 * np.abs(local.velocity - solution).max()


def test_no_speed_exceeds_the_largest_local_speed():
    rng = np.random.default_rng(4)
    terrain = Terrain(rng.normal(size=(40, 40)), 1.0)
    given = Particles(rng.uniform(8.0, 32.0, (600, 2)), rng.uniform(0.2, 3.0, 600), 1400.0)
    speeds = []
    for effects in (only(), only('helmholtz')):
        simulation = simulated(terrain, LAVA, given, effects=effects, spacing=1.0, thickness=2.0)
        speeds.append(np.abs(simulation.sample().velocity).max())
    assert 0.0 < speeds[1] <= speeds[0]


def test_lateral_drag_is_that_of_a_parabolic_profile():
    profile = Polynomial([0.0, 3.0, -1.5])
    mean = profile.integ()
    assert mean(1.0) == pytest.approx(1.0)
    drag, stress = ((item**2).integ()(1.0) for item in (profile.deriv(), profile))
    assert drag / stress == pytest.approx(LATERAL_DRAG)
    x = 0.01
    loss = 1.0 - exact.wave_response(x, 1.0)
    assert x**2 / loss == pytest.approx(LATERAL_DRAG, rel=1e-3)
