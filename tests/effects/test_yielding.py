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

"""Yield strength: the exact speed, rest that is rest, slumps that do not depend on the step."""

import math

import numpy as np
import pytest

from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.verification import exact
from solver import flat, incline, only, simulated

BARE, YIELDING, STEEP = only(), only('yielding'), only('yielding', 'steep')

WEIGHT = 2500.0 * 9.81


def scattered(effects, *, lava, slope=0.1, **options):
    """500 random particles on a plane with the slope towards +x."""
    rng = np.random.default_rng(7)
    places, volumes = rng.uniform(0, 200, (500, 2)), rng.uniform(50, 150, 500)
    return simulated(
        incline(slope, 40, 40, 10.0, origin=(-100.0, -100.0)),
        lava,
        Particles(places, volumes, rng.uniform(1100, 1400, 500)),
        effects=effects,
        **{'spacing': 9.0, 'thickness': 1.0, 'precision': 'float64', **options},
    )


@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_velocity_is_the_depth_average(device, precision):
    """Every particle's speed is the formula's for its thickness, slope and temperature."""
    lava = Lava(viscosity=1e4, yield_strength=1500.0, yield_rate=0.002, arrhenius=0.0)
    options = {'lava': lava, 'precision': precision, 'device': device}
    newtonian = scattered(BARE, **options).sample()
    sample = scattered(YIELDING, **options).sample()
    mobility = WEIGHT * newtonian.thickness**2 / 3e4
    slope = -newtonian.velocity / mobility[:, None]
    strength = 1500.0 * np.exp(0.002 * (lava.reference_temperature - sample.temperature))
    b = strength / (WEIGHT * sample.thickness * np.hypot(*slope.T))
    share = np.where(b < 1.0, 1.0 - 1.5 * b + 0.5 * b**3, 0.0)
    assert 50 < (b < 1.0).sum() < 450
    tolerance = {'float32': 1e-4, 'float64': 1e-9}[precision]
    assert sample.velocity == pytest.approx(
        newtonian.velocity * share[:, None], rel=tolerance, abs=tolerance * 0.1
    )
    assert (sample.velocity[b > 1.0 + tolerance] == 0.0).all()


def test_lava_below_its_strength_never_moves(device):
    """Uneven lava whose stress is below the strength everywhere is where it was, to the bit."""
    lava = Lava(viscosity=1e2, yield_strength=3e4, arrhenius=0.0)
    simulation = scattered(
        STEEP, lava=lava, precision='float32', device=device, longest_step=5e3
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
    slope = math.tan(math.radians(degrees))
    cosine = math.cos(math.radians(degrees))
    lava = Lava(viscosity=1e4, yield_strength=strength, arrhenius=0.0)
    flat = scattered(BARE, lava=lava, slope=slope).sample()
    surface = -flat.velocity / (WEIGHT * flat.thickness**2 / 3e4)[:, None]
    layer = flat.thickness * cosine
    # on the map the slope along is tan b - dh/dx and across dh/dy = d' / cos b
    stress = WEIGHT * layer[:, None] * surface * np.array([cosine, cosine * cosine])
    b = strength / np.hypot(*stress.T)
    share = np.where(b < 1.0, 1.0 - 1.5 * b + 0.5 * b**3, 0.0)
    # velocity in the plane of the slope, and its part down the slope as a map shows it
    velocity = -layer[:, None] / 3e4 * stress * share[:, None] * np.array([cosine, 1.0])
    sample = scattered(STEEP, lava=lava, slope=slope).sample()
    assert 20 < (b > 1.0).sum() < 480
    assert sample.velocity == pytest.approx(velocity, rel=1e-4, abs=1e-5)


@pytest.mark.parametrize('integrator', ['rkl2', 'euler'])
def test_slump_does_not_depend_on_the_step(device, integrator):
    """A dome that slumps is as wide with short explicit steps as with long staged ones."""
    strength, density = 1e4, 2600.0
    solution = exact.BinghamDome(1.5e5, strength, density, 9.81)
    count = 800
    lava = Lava(density=density, viscosity=1e4, yield_strength=strength, arrhenius=0.0)
    radii = []
    for courant in (0.5, 0.1):
        simulation = simulated(
            flat(50, 6.0),
            lava,
            Particles(solution.particles(count, 70.0), 1.5e5 / count, 1400.0),
            effects=YIELDING,
            device=device,
            spacing=solution.radius * math.sqrt(math.pi / count),
            thickness=4.7,
            ratio=3.5,
            courant_number=courant,
            integrator=integrator if courant == 0.5 else 'euler',
        )
        start = np.hypot(*simulation.sample().velocity.T)
        simulation.advance(100.0)
        sample = simulation.sample()
        assert np.hypot(*sample.velocity.T).max() < 0.003 * start.max()
        radii.append(math.sqrt((sample.position**2).sum(axis=1).mean()))
    assert radii[0] == pytest.approx(radii[1], rel=0.005)
    assert radii[0] == pytest.approx(solution.rms_radius, rel=0.03)
