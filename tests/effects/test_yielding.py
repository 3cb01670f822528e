# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Yield strength: exact speeds, and lava at rest."""

import math

import numpy as np
import pytest

from effects.rheology import BARE, precisions, responses, scattered, WEIGHT
from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.verification import exact
from solver import flat, only, simulated

YIELDING, STEEP = only('yielding'), only('yielding', 'steep')


def mean_temperatures(sample, radius):
    """Return the means that simulation/step/flow.py uses, by sums over all pairs [K]."""
    apart = sample.position[:, None] - sample.position[None]
    q = np.minimum(np.linalg.norm(apart, axis=-1) / radius, 1.0)
    norm = 7.0 / (math.pi * radius**2)
    weights = sample.volume * norm * (1.0 - q) ** 4 * (1.0 + 4.0 * q)
    pulls = sample.volume * -20.0 * norm / radius**2 * (1.0 - q) ** 3
    rise = np.linalg.norm((pulls[..., None] * apart).sum(axis=1), axis=-1)
    around = (weights @ sample.temperature) / weights.sum(axis=1)
    share = np.maximum(1.0 - radius * rise / (3.0 * sample.thickness), 0.0)
    return sample.temperature + share * (around - sample.temperature)


def sheared(b):
    """Return the speed relative to lava without strength, b = strength / basal stress."""
    return np.where(b < 1.0, 1.0 - 1.5 * b + 0.5 * b**3, 0.0)


@precisions
def test_velocity_follows_strength_at_the_mean_temperature(device, precision, within):
    options = {'precision': precision, 'device': device}
    newtonian = scattered(BARE, **options).sample()
    simulation = scattered(YIELDING, yield_strength=1500.0, yield_rate=0.002, **options)
    sample = simulation.sample()
    slope = -newtonian.velocity / (WEIGHT * newtonian.thickness**2 / 3e4)[:, None]
    reference = Lava.paper().reference_temperature
    mean = mean_temperatures(sample, simulation.accuracy.radius)
    strength = 1500.0 * np.exp(0.002 * (reference - mean))
    b = strength / (WEIGHT * sample.thickness * np.hypot(*slope.T))
    assert 50 < (b < 1.0).sum() < 450
    right = newtonian.velocity * sheared(b)[:, None]
    assert sample.velocity == pytest.approx(right, rel=within, abs=within * 0.1)
    assert (sample.velocity[b > 1.0 + within] == 0.0).all()


def test_lava_below_its_strength_does_not_move(device):
    simulation = scattered(
        STEEP, viscosity=1e2, yield_strength=3e4, precision='float32', device=device,
        longest_step=5e3,
    )
    before = simulation.sample()
    assert (before.velocity == 0.0).all()
    simulation.advance(1e6)
    after = simulation.sample()
    order = [np.lexsort(sample.position.T) for sample in (before, after)]
    assert (after.position[order[1]] == before.position[order[0]]).all()


@pytest.mark.parametrize(('degrees', 'strength'), [(5.0, 2000.0), (30.0, 1e4)])
def test_yielding_velocity_on_a_slope_has_two_components(degrees, strength):
    """With d = h cos b, the stress is rho g d (sin b, cos b d')."""
    slope, cosine = math.tan(math.radians(degrees)), math.cos(math.radians(degrees))
    level = scattered(BARE, slope=slope).sample()
    surface = -level.velocity / (WEIGHT * level.thickness**2 / 3e4)[:, None]
    layer = level.thickness * cosine
    # on the map the slope is tan b - dh/dx along, and dh/dy = d' / cos b across
    stress = WEIGHT * layer[:, None] * surface * np.array([cosine, cosine * cosine])
    b = strength / np.hypot(*stress.T)
    # velocity in the plane of the slope, projected onto the map
    velocity = -layer[:, None] / 3e4 * stress * sheared(b)[:, None] * np.array([cosine, 1.0])
    sample = scattered(STEEP, yield_strength=strength, slope=slope).sample()
    assert 20 < (b > 1.0).sum() < 480
    assert sample.velocity == pytest.approx(velocity, rel=1e-4, abs=1e-5)


def test_slump_of_a_dome_does_not_depend_on_the_step(device):
    strength, density, count = 1e4, 2600.0, 800
    solution = exact.BinghamDome(1.5e5, strength, density, 9.81)
    lava = Lava.paper(density=density, viscosity=1e4, yield_strength=strength, arrhenius=0.0)
    dome = Particles(solution.particles(count, 70.0), 1.5e5 / count, 1400.0)
    spacing = solution.radius * math.sqrt(math.pi / count)
    radii = []
    for courant, method in ((0.5, 'rkl2'), (0.1, 'euler')):
        simulation = simulated(
            flat(50, 6.0), lava, dome, effects=YIELDING, device=device, spacing=spacing,
            thickness=4.7, ratio=3.5, courant_number=courant, integrator=method,
        )
        start = np.hypot(*simulation.sample().velocity.T)
        simulation.advance(100.0)
        sample = simulation.sample()
        assert np.hypot(*sample.velocity.T).max() < 0.003 * start.max()
        radii.append(math.sqrt((sample.position**2).sum(axis=1).mean()))
    assert radii[0] == pytest.approx(radii[1], rel=0.005)
    assert radii[0] == pytest.approx(solution.rms_radius, rel=0.03)


def test_yield_strength_does_not_shorten_the_step(device):
    """The bound of Bingham lava is (rho g h^2 / 3 mu)(1 - B^3)."""
    lava = Lava.paper(viscosity=2e3, yield_strength=800.0)
    slopes = np.geomspace(0.002, 0.9, 60)
    b = 800.0 / (WEIGHT * 0.8 * slopes)
    bound = responses(YIELDING, lava, slopes, 0.8, device)[:, 1]
    newtonian = WEIGHT * 0.8**2 / 6e3
    assert bound == pytest.approx(newtonian * np.maximum(1.0 - b**3, 0.0), rel=1e-9, abs=1e-12)
