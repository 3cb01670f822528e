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

"""Bingham, power-law and Herschel-Bulkley lava: exact speeds, limits, and rest that is rest."""

from dataclasses import replace
import math

import numpy as np
import pytest

from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.verification import exact
from solver import flat, incline, lattice, only, simulated

BARE, YIELDING, STEEP = only(), only('yielding'), only('yielding', 'steep')

WEIGHT = 2500.0 * 9.81

precisions = pytest.mark.parametrize(
    ('precision', 'within'), [('float32', 1e-4), ('float64', 1e-9)]
)


def scattered(effects, *, slope=0.1, precision='float64', device='cpu', longest_step=60.0, **lava):
    """500 random particles on a plane with the slope towards +x."""
    rng = np.random.default_rng(7)
    places, volumes = rng.uniform(0, 200, (500, 2)), rng.uniform(50, 150, 500)
    return simulated(
        incline(slope, 40, 40, 10.0, origin=(-100.0, -100.0)),
        Lava(**{'viscosity': 1e4, 'arrhenius': 0.0, **lava}),
        Particles(places, volumes, rng.uniform(1100, 1400, 500)),
        effects=effects, device=device, precision=precision, longest_step=longest_step,
        spacing=9.0, thickness=1.0,
    )


def sheared(b):
    """Speed over that of lava without strength, for the strength over the stress at the base."""
    return np.where(b < 1.0, 1.0 - 1.5 * b + 0.5 * b**3, 0.0)


@precisions
def test_velocity_is_the_depth_average(device, precision, within):
    """Every particle's speed is the formula's for its thickness, slope and temperature."""
    options = {'precision': precision, 'device': device}
    newtonian = scattered(BARE, **options).sample()
    sample = scattered(YIELDING, yield_strength=1500.0, yield_rate=0.002, **options).sample()
    slope = -newtonian.velocity / (WEIGHT * newtonian.thickness**2 / 3e4)[:, None]
    reference = Lava().reference_temperature
    strength = 1500.0 * np.exp(0.002 * (reference - sample.temperature))
    b = strength / (WEIGHT * sample.thickness * np.hypot(*slope.T))
    assert 50 < (b < 1.0).sum() < 450
    right = newtonian.velocity * sheared(b)[:, None]
    assert sample.velocity == pytest.approx(right, rel=within, abs=within * 0.1)
    assert (sample.velocity[b > 1.0 + within] == 0.0).all()


def test_lava_below_its_strength_never_moves(device):
    """Uneven lava whose stress is below the strength everywhere is where it was, to the bit."""
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
def test_stress_on_a_slope_has_parts_along_and_across_it(degrees, strength):
    """With lava thicker on one side the stress is rho g d (sin b, cos b d'), d = h cos b."""
    slope, cosine = math.tan(math.radians(degrees)), math.cos(math.radians(degrees))
    level = scattered(BARE, slope=slope).sample()
    surface = -level.velocity / (WEIGHT * level.thickness**2 / 3e4)[:, None]
    layer = level.thickness * cosine
    # on the map the slope along is tan b - dh/dx and across dh/dy = d' / cos b
    stress = WEIGHT * layer[:, None] * surface * np.array([cosine, cosine * cosine])
    b = strength / np.hypot(*stress.T)
    # velocity in the plane of the slope, and its part down the slope as a map shows it
    velocity = -layer[:, None] / 3e4 * stress * sheared(b)[:, None] * np.array([cosine, 1.0])
    sample = scattered(STEEP, yield_strength=strength, slope=slope).sample()
    assert 20 < (b > 1.0).sum() < 480
    assert sample.velocity == pytest.approx(velocity, rel=1e-4, abs=1e-5)


@pytest.mark.parametrize('integrator', ['rkl2', 'euler'])
def test_slump_does_not_depend_on_the_step(device, integrator):
    """A dome that slumps is as wide with short explicit steps as with long staged ones."""
    strength, density, count = 1e4, 2600.0, 800
    solution = exact.BinghamDome(1.5e5, strength, density, 9.81)
    lava = Lava(density=density, viscosity=1e4, yield_strength=strength, arrhenius=0.0)
    dome = Particles(solution.particles(count, 70.0), 1.5e5 / count, 1400.0)
    spacing = solution.radius * math.sqrt(math.pi / count)
    radii = []
    for courant, method in ((0.5, integrator), (0.1, 'euler')):
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


@precisions
@pytest.mark.parametrize('strength', [0.0, 1500.0])
def test_exponent_one_is_the_simpler_law(device, precision, within, strength):
    """An exponent of 1 gives the speed of Newtonian and of Bingham lava."""
    effects = only('steep', *['yielding'] * (strength > 0.0))
    simple, general = (
        scattered(on, yield_strength=strength, precision=precision, device=device).sample()
        for on in (effects, replace(effects, power_law=True))
    )
    assert general.velocity == pytest.approx(simple.velocity, rel=within, abs=within * 0.1)


@pytest.mark.parametrize('index', [0.3, 0.5, 2.0, 3.0])
def test_speed_follows_the_power_of_the_slope(index):
    """Every particle has n / (2 n + 1) (rho g h s / K)^(1/n) h."""
    newtonian = scattered(BARE).sample()
    sample = scattered(only('power_law'), flow_index=index).sample()
    stress = 3e4 * np.hypot(*newtonian.velocity.T) / newtonian.thickness
    speed = index / (2 * index + 1) * (stress / 1e4) ** (1 / index) * sample.thickness
    assert (stress > 1e-3 * WEIGHT * sample.thickness).all()
    assert np.hypot(*sample.velocity.T) == pytest.approx(speed, rel=1e-8)


@pytest.mark.parametrize('index', [0.5, 2.0, 5.0])
def test_level_lava_has_a_finite_step(device, index):
    """On a level surface, where n > 1 has no viscosity at all, a step is still possible."""
    simulation = simulated(
        flat(60), Lava(viscosity=1e4, flow_index=index, arrhenius=0.0),
        Particles(lattice(15.5), 1.0, 1400.0), effects=only('steep', 'power_law'), device=device,
        spacing=1.0, thickness=1.0,
    )
    assert np.isfinite(simulation.sample().velocity).all()
    simulation.advance(0.5)
    assert simulation.time == 0.5
    assert simulation.snapshot().steps.count < 20
    assert np.isfinite(simulation.sample().velocity).all()
