# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Thickness, velocity and the limits they set, against sums over all pairs and exact sheets."""

import math

import numpy as np
import pytest

from lava_ros.scene import Lava, Terrain
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.state import State
from lava_ros.verification.cases.case import ISOTHERMAL
from lava_ros.verification.cases.sheets import GREEN_RADIUS, response, sheet_speed
from solver import incline, lattice, only, simulated


def scattered(effects, **options):
    """A simulation of 500 random particles on a wavy terrain, and the particles."""
    rng = np.random.default_rng(7)
    x = np.arange(30) * 10.0
    terrain = Terrain(5 * np.sin(x / 40)[None, :] + 0.1 * x[:, None], 10.0, origin=(-40.0, 15.0))
    particles = Particles(
        rng.uniform([0, 60], [200, 260], (500, 2)),
        rng.uniform(50, 150, 500),
        rng.uniform(1100, 1400, 500),
    )
    knobs = {'spacing': 9.0, 'thickness': 1.0, **options}
    simulation = simulated(terrain, Lava(viscosity=1e4), particles, effects=effects, **knobs)
    return simulation, particles


@pytest.mark.parametrize(
    ('gradient', 'effects'),
    [
        ('energy', only()),
        ('balanced', only()),
        ('energy', only('green')),
        ('energy', only('helmholtz')),
    ],
)
def test_sums_in_parts_are_the_same_sums(monkeypatch, gradient, effects):
    """As a GPU adds up those of a batch's members: one thread takes four parts."""
    knobs = {'precision': 'float64', 'gradient': gradient}
    whole = scattered(effects, **knobs)[0].sample()
    monkeypatch.setattr(State, 'parts', 4)
    monkeypatch.setattr(State, 'lanes', 1)
    monkeypatch.setattr(State, 'is_wide', False)
    parts = scattered(effects, **knobs)[0].sample()
    for name in ('thickness', 'velocity'):
        expected = getattr(whole, name)
        assert np.abs(expected).max() > 0.0
        np.testing.assert_allclose(getattr(parts, name), expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_thickness_is_the_sum_over_all_pairs(device, precision):
    """The neighbour grid finds every pair: thickness equals the direct sum (3.9)."""
    simulation, given = scattered(only(), device=device, precision=precision)
    sample = simulation.sample()
    distance = np.linalg.norm(sample.position[:, None] - given.position[None], axis=-1)
    q = np.clip(distance / simulation.radius, 0, 1)
    weight = 7 / (math.pi * simulation.radius**2) * (1 - q) ** 4 * (1 + 4 * q)
    total = (weight * given.volume).sum(axis=1)
    excess = 1.25 * (sample.volume / (total * simulation.radius**2)) ** 2.5
    tolerance = 1e-5 if precision == 'float32' else 1e-12
    assert len(sample.position) == 500
    assert sample.thickness == pytest.approx(total * (1 - excess), rel=tolerance)


def test_velocity_is_minus_the_gradient_of_the_sum():
    """The SPH gradient is the derivative of the thickness sum with respect to position."""
    rng = np.random.default_rng(1)
    places = rng.uniform(20, 80, (60, 2))

    def sample(at):
        simulation = simulated(
            Terrain(np.zeros((10, 10)), 10.0),
            Lava(viscosity=1e4),
            Particles(at, 64.0, 1400.0),
            effects=only(),
            spacing=8.0,
            thickness=1.0,
            precision='float64',
        )
        rows = simulation.sample()
        index = np.argmin(np.linalg.norm(rows.position - at[0], axis=1))
        radius = simulation.radius
        q = np.linalg.norm(at - at[0], axis=1) / radius
        total = (7 / (math.pi * radius**2) * 64.0 * np.clip(1 - q, 0, 1) ** 4 * (1 + 4 * q)).sum()
        return rows.thickness[index], rows.velocity[index], total

    thickness, velocity, _ = sample(places)
    slope = []
    for axis in (0, 1):
        totals = []
        for sign in (1, -1):
            moved = places.copy()
            moved[0, axis] += sign * 1e-4
            totals.append(sample(moved)[2])
        slope.append((totals[0] - totals[1]) / 2e-4)
    mobility = 2500.0 * 9.81 * thickness**2 / (3 * 1e4)
    assert velocity == pytest.approx(-mobility * np.array(slope), rel=1e-5)


@pytest.mark.parametrize('degrees', [2.0, 10.0, 30.0, 45.0])
def test_sheet_moves_at_the_exact_speed(device, degrees):
    """A uniform sheet moves at rho g h^2 sin(b) / (3 mu) along the slope, however steep."""
    slope = math.radians(degrees)
    run = sheet_speed('speed', ISOTHERMAL, Accuracy(), device, slope=slope)
    assert run.measurements[0].error < 0.002


@pytest.mark.parametrize('wavelength', [4.0, 8.0, 20.0])
def test_green_velocity_has_the_exact_response(device, wavelength):
    """The response to sin(q x) is 1 / (1 + q^2 / k^2), support 6 / k."""
    run = response('green', GREEN_RADIUS, wavelength, Accuracy(ratio=6.0), device)
    assert run.measurements[0].error < 0.02


def test_green_velocity_of_a_uniform_sheet_is_the_local_one(device):
    """On a uniform sheet the Green's function changes nothing."""
    velocities = []
    for effects in (only('green'), only()):
        simulation = simulated(
            incline(0.1, 40, 40, 1.0, origin=(-20.0, -20.0)),
            Lava(),
            Particles(lattice(10.0), 1.0, 1400.0),
            effects=effects,
            device=device,
            spacing=1.0,
            thickness=1.0,
            ratio=4.0,
        )
        sample = simulation.sample()
        middle = np.abs(sample.position).max(axis=1) < 1.0
        velocities.append(sample.velocity[middle].mean(axis=0))
    assert velocities[0] == pytest.approx(velocities[1], rel=1e-4, abs=1e-5)


@pytest.mark.parametrize('integrator', ['euler', 'rkl2'])
def test_steps_beyond_the_limit_are_not_taken(device, integrator):
    """No step moves a particle too far, and no Euler step exceeds the stable one."""
    simulation, _ = scattered(only(), device=device, integrator=integrator)
    for time in (5.0, 20.0, 50.0):
        simulation.advance(time)
        before = simulation.sample()
        diffusivity = (2500.0 * 9.81 * before.thickness**3 / (3 * 1e4)).max()
        speed = np.linalg.norm(before.velocity, axis=1).max()
        simulation.advance(time + 1e-3)
        steps = simulation.snapshot().steps
        assert steps.limit in ('diffusion', 'advection')
        reach = simulation.accuracy.courant_number * min(simulation.radius, 10.0)
        assert steps.length * speed <= 1.001 * reach
        if integrator == 'euler':
            assert steps.length <= 2.0 * simulation.radius**2 / (10.18 * diffusivity)
