# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Strength of the crust: exact speeds by thickness and age, and lava that comes to rest."""

import math

import numpy as np
import pytest

from lava_ros.scene import Lava, Vent
from lava_ros.simulation import Particles
from solver import incline, only, simulated

WEIGHT, SLOPE, DIFFUSIVITY = 2500.0 * 9.81, 0.2, 5e-7


def scattered(effects, particles, device, precision, **lava):
    """Return a simulation of particles on a plane, of very viscous lava."""
    return simulated(
        incline(SLOPE, 40, 40, 10.0, origin=(-100.0, -100.0)),
        Lava.paper(viscosity=1e9, arrhenius=0.0, **lava), particles,
        effects=effects, device=device, precision=precision, spacing=9.0, thickness=1.0,
        longest_step=1e4,
    )


@pytest.mark.parametrize('core', [0.0, 1500.0], ids=['crust alone', 'with a yield strength'])
@pytest.mark.parametrize(
    ('age', 'strength'), [(0.0, 3e4), (2e4, 3e4), (1e7, 5e3)],
    ids=['new', 'hours', 'crust to the base'],
)
@pytest.mark.parametrize(('precision', 'within'), [('float32', 2e-4), ('float64', 1e-9)])
def test_speed_by_thickness_and_age(device, core, age, strength, precision, within):
    """The stress sigma min(sqrt(kappa t), h) / h adds to the yield strength of the core."""
    rng = np.random.default_rng(7)
    start = Particles(rng.uniform(0, 200, (500, 2)), rng.uniform(50, 150, 500), 1300.0)
    names = ['crust_strength'] + ['yielding'] * (core > 0.0)
    constants = {'crust_strength': strength, 'yield_strength': core}
    simulation = scattered(only(*names), start, device, precision, **constants)
    simulation.advance(age)
    sample = simulation.sample()
    now = Particles(sample.position, sample.volume, sample.temperature)
    newtonian = scattered(only(), now, device, precision).sample()
    order, other = (np.lexsort(one.position.T) for one in (sample, newtonian))
    thickness = newtonian.thickness[other]
    free = newtonian.velocity[other]
    slope = np.linalg.norm(free, axis=1) / (WEIGHT * thickness**2 / 3e9)
    crust = strength * np.minimum(math.sqrt(DIFFUSIVITY * age), thickness) / thickness
    b = np.minimum((crust + core) / (WEIGHT * thickness * slope), 1.0)
    right = free * (1.0 - 1.5 * b + 0.5 * b**3)[:, None]
    largest = np.abs(free).max()
    assert sample.velocity[order] == pytest.approx(right, rel=within, abs=within * largest)
    if age:
        assert 20 < (b < 1.0).sum() < 480


def test_flow_is_narrower_and_thicker(device):
    """Lava on a plane keeps to a channel: its sides are old, thin and at rest."""
    widths = []
    for strength in (0.0, 1e5):
        simulation = simulated(
            incline(0.15, 60, 90, 5.0, origin=(-60.0, -150.0)),
            Lava.paper(viscosity=1e4, arrhenius=0.0, crust_strength=strength),
            Vent((0.0, 0.0), 2.0, radius=8.0),
            effects=only(*['crust_strength'] * (strength > 0.0)), device=device, spacing=4.0,
            thickness=1.5,
        )
        simulation.advance(7200.0)
        sample = simulation.sample()
        widths.append(np.ptp(sample.position[:, 1]))
    assert widths[1] < 0.8 * widths[0]
