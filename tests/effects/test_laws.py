# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Flow laws: published viscosities, exact speeds, limits, and lava at rest."""

from dataclasses import replace
import math

import numpy as np
from numpy.polynomial import Polynomial
import pytest

from effects.columns import viscosities
from lava_ros.effects.crystals import MIN_FREE_FRACTION
from lava_ros.effects.laws import LATERAL_DRAG
from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.verification import exact
from solver import flat, incline, lattice, only, simulated

BARE, YIELDING, STEEP = only(), only('yielding'), only('yielding', 'steep')

WEIGHT = 2500.0 * 9.81

MELT = Lava(viscosity=7.0, vft_a=-4.55, vft_b=5700.0, vft_c=600.0)

CRYSTALS = Lava(
    viscosity=50.0, arrhenius=0.01, reference_temperature=1400.0, liquidus=1450.0, solidus=1250.0,
    crystal_law='maron-pierce', crystals=0.5,
)

precisions, viscosity_precisions = (
    pytest.mark.parametrize(('precision', 'within'), [('float32', 1e-4), ('float64', double)])
    for double in (1e-9, 1e-12)
)


def scattered(effects, *, slope=0.1, precision='float64', device='cpu', longest_step=60.0, **lava):
    """Return 500 random particles on a plane with the slope towards +x."""
    rng = np.random.default_rng(7)
    places, volumes = rng.uniform(0, 200, (500, 2)), rng.uniform(50, 150, 500)
    return simulated(
        incline(slope, 40, 40, 10.0, origin=(-100.0, -100.0)),
        Lava(**{'viscosity': 1e4, 'arrhenius': 0.0, **lava}),
        Particles(places, volumes, rng.uniform(1100, 1400, 500)), effects=effects, device=device,
        precision=precision, longest_step=longest_step, deterministic=True, spacing=9.0,
        thickness=1.0,
    )


def mean_temperatures(sample, radius):
    """What viscosity and strength follow (simulation/step/flow.py), by sums over all pairs [K]."""
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
    reference = Lava().reference_temperature
    mean = mean_temperatures(sample, simulation.radius)
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


@pytest.mark.parametrize('integrator', ['rkl2', 'euler'])
def test_slump_of_a_dome_does_not_depend_on_the_step(device, integrator):
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
def test_power_law_of_exponent_one_is_the_simpler_law(device, precision, within, strength):
    effects = only('steep', *['yielding'] * (strength > 0.0))
    simple, general = (
        scattered(on, yield_strength=strength, precision=precision, device=device).sample()
        for on in (effects, replace(effects, power_law=True))
    )
    assert general.velocity == pytest.approx(simple.velocity, rel=within, abs=within * 0.1)


@pytest.mark.parametrize('index', [0.5, 2.0, 5.0])
def test_level_lava_has_a_finite_step(device, index):
    """On a level surface lava of n > 1 has zero viscosity."""
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


def test_viscosity_is_at_most_1e15_at_and_below_c(device):
    temperatures = [300.0, 599.0, 600.0, 600.5, 900.0]
    found = viscosities(temperatures, only('vft'), lava=MELT, precision='float32', device=device)
    assert found[:4] == pytest.approx(1e15, rel=1e-3)
    assert found[4] == pytest.approx(10.0 ** (-4.55 + 5700.0 / 300.0), rel=1e-3)


def test_viscosity_is_constant_below_c_plus_1_kelvin():
    lava = Lava(vft_a=1.0, vft_b=3.0, vft_c=900.0)
    temperatures = [900.0, 901.0, 903.0]
    found = viscosities(temperatures, only('vft'), lava=lava, precision='float64', device='cpu')
    assert found == pytest.approx([1e4, 1e4, 1e2], rel=1e-9)


@viscosity_precisions
@pytest.mark.parametrize(('law', 'exponent'), [('einstein-roscoe', 2.5), ('maron-pierce', 2.0)])
@pytest.mark.parametrize('arrhenius', [False, True])
def test_viscosity_with_crystals_is_as_published(
    device, precision, within, law, exponent, arrhenius
):
    """The viscosity is mu_melt (1 - phi / phi_m)^-e; phi is linear from liquidus to solidus."""
    temperatures = np.linspace(1200.0, 1500.0, 13)
    effects = only('crystals', *['arrhenius'] * arrhenius)
    lava = replace(CRYSTALS, crystal_law=law)
    found = viscosities(temperatures, effects, lava=lava, precision=precision, device=device)
    phi = np.clip(0.5 * (1450.0 - temperatures) / 200.0, 0.0, 0.5)
    melt = 50.0 * np.exp(0.01 * (1400.0 - temperatures)) if arrhenius else 50.0
    assert found == pytest.approx(melt * (1.0 - phi / 0.6) ** -exponent, rel=within)


def test_viscosity_is_finite_at_maximum_packing(device):
    lava, temperatures = replace(CRYSTALS, crystals=0.9), [1260.0, 1300.0, 1450.0]
    found = viscosities(
        temperatures, only('crystals'), lava=lava, precision='float32', device=device
    )
    assert found[0] == pytest.approx(50.0 * MIN_FREE_FRACTION**-2.0, rel=1e-3)
    assert found[1] == pytest.approx(found[0])
    assert found[2] == pytest.approx(50.0, rel=1e-4)


def test_lateral_drag_is_that_of_a_parabolic_profile():
    profile = Polynomial([0.0, 3.0, -1.5])
    mean = profile.integ()
    assert mean(1.0) == pytest.approx(1.0)
    drag, stress = ((item**2).integ()(1.0) for item in (profile.deriv(), profile))
    assert drag / stress == pytest.approx(LATERAL_DRAG)
    x = 0.01
    loss = 1.0 - exact.wave_response(x, 1.0)
    assert x**2 / loss == pytest.approx(LATERAL_DRAG, rel=1e-3)
