# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Thickness, velocity and step limits against direct sums over all pairs and exact sheets.

Also the published formulas against numpy, and the order, stability and cost of time integration.
"""

import math

import numpy as np
import pytest

from lava_ros.scene import Lava, Terrain, Vent
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import INTEGRATORS
from lava_ros.simulation.particles.layout import FAR
from lava_ros.simulation.particles.state import State
from solver import flat, incline, lattice, only, simulated


def scattered(effects, count=500, **options):
    rng = np.random.default_rng(7)
    x = np.arange(30) * 10.0
    terrain = Terrain(5 * np.sin(x / 40)[None, :] + 0.1 * x[:, None], 10.0, origin=(-40.0, 15.0))
    particles = Particles(
        rng.uniform([0, 60], [200, 260], (count, 2)), rng.uniform(50, 150, count),
        rng.uniform(1100, 1400, count),
    )
    knobs = {'spacing': 9.0, 'thickness': 1.0, **options}
    simulation = simulated(terrain, Lava.paper(viscosity=1e4), particles, effects=effects, **knobs)
    return simulation, particles


def wendland(distance, radius):
    """Return the smoothing kernel at a distance [1/m2]."""
    q = np.clip(distance / radius, 0, 1)
    return 7 / (math.pi * radius**2) * (1 - q) ** 4 * (1 + 4 * q)


@pytest.mark.parametrize(
    ('gradient', 'effects'),
    [
        ('energy', only('green')),
        *(
            pytest.param(*others, marks=pytest.mark.nightly)
            for others in (('energy', only('helmholtz')), ('balanced', only()))
        ),
    ],
)
def test_sums_in_parts_equal_whole_sums(monkeypatch, gradient, effects):
    """For members of a batch on a GPU, one thread adds four parts."""
    knobs = {'precision': 'float64', 'gradient': gradient}
    whole = scattered(effects, **knobs)[0].sample()
    for name, value in (('parts', 4), ('lanes', 1), ('is_wide', False)):
        monkeypatch.setattr(State, name, value)
    parts = scattered(effects, **knobs)[0].sample()
    for name in ('thickness', 'velocity'):
        expected = getattr(whole, name)
        assert np.abs(expected).max() > 0.0
        np.testing.assert_allclose(getattr(parts, name), expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize('count', [3, 500])
@pytest.mark.parametrize('name', ['yielding', 'green', 'helmholtz'])
def test_sums_over_eight_neighbours_equal_sums_over_one(monkeypatch, name, count):
    """On a CPU, in float32; ``yielding`` adds the mean temperature to the sums of the flow."""
    wide = scattered(only(name), count)[0].sample()
    monkeypatch.setattr(State, 'is_wide', False)
    single = scattered(only(name), count)[0].sample()
    for field in ('thickness', 'velocity'):
        expected = getattr(single, field)
        limit = 1e-4 * np.abs(expected).max()
        assert limit > 0.0
        np.testing.assert_allclose(getattr(wide, field), expected, rtol=0.0, atol=limit)


@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_thickness_is_the_sum_over_all_pairs(device, precision):
    """The neighbour grid finds every pair: thickness equals the direct sum (3.9)."""
    simulation, given = scattered(only(), device=device, precision=precision)
    sample = simulation.sample()
    distance = np.linalg.norm(sample.position[:, None] - given.position[None], axis=-1)
    total = (wendland(distance, simulation.accuracy.radius) * given.volume).sum(axis=1)
    excess = 1.25 * (sample.volume / (total * simulation.accuracy.radius**2)) ** 2.5
    tolerance = 1e-5 if precision == 'float32' else 1e-12
    assert len(sample.position) == 500
    assert sample.thickness == pytest.approx(total * (1 - excess), rel=tolerance)


def test_velocity_follows_the_gradient_of_the_thickness_sum():
    places = np.random.default_rng(1).uniform(20, 80, (60, 2))
    simulation = simulated(
        Terrain(np.zeros((10, 10)), 10.0), Lava.paper(viscosity=1e4),
        Particles(places, 64.0, 1400.0),
        effects=only(), spacing=8.0, thickness=1.0, precision='float64',
    )
    sample = simulation.sample()
    first = np.argmin(np.linalg.norm(sample.position - places[0], axis=1))

    def total(place):
        distance = np.append(0.0, np.linalg.norm(places[1:] - place, axis=1))
        return 64.0 * wendland(distance, simulation.accuracy.radius).sum()

    slope = [
        (total(places[0] + step) - total(places[0] - step)) / 2e-4 for step in 1e-4 * np.eye(2)
    ]
    mobility = 2500.0 * 9.81 * sample.thickness[first] ** 2 / (3 * 1e4)
    assert sample.velocity[first] == pytest.approx(-mobility * np.array(slope), rel=1e-5)


STIFF = {'viscosity': 1e4, 'reference_temperature': 1400.0}


def checkered(lava, on, high=1400.0, low=1300.0, device='cpu', **knobs):
    """Return the speed of columns in the middle of an even layer on a slope, and which are hot."""
    places = lattice(12.0)
    is_hot = np.round(places.sum(axis=1)).astype(int) % 2 == 0
    simulation = simulated(
        incline(0.1, 80, 80, 1.0, origin=(-40.0, -40.0)),
        lava,
        Particles(places, 1.0, np.where(is_hot, high, low)),
        effects=only(*on),
        device=device,
        spacing=1.0,
        thickness=1.0,
        ratio=3.5,
        **knobs,
    )
    if 'inertia' in on:
        simulation.advance(0.5)
    sample = simulation.sample()
    middle = np.abs(sample.position).max(axis=1) < 4.0
    return sample.velocity[middle, 0], sample.temperature[middle] > 1350.0


ARRHENIUS = {'arrhenius': 0.03}

CRYSTALS = {
    'arrhenius': 0.0, 'crystals': 0.4, 'crystal_law': 'maron-pierce', 'liquidus': 1500.0,
    'solidus': 1200.0,
}


@pytest.mark.parametrize(
    ('on', 'constants', 'gradient'),
    [
        *(('arrhenius', ARRHENIUS, form) for form in ('energy', 'balanced')),
        ('vft', {'vft_a': -4.55, 'vft_b': 10000.0, 'vft_c': 300.0}, 'energy'),
        ('arrhenius crystals', CRYSTALS, 'energy'),
        ('yielding', {'arrhenius': 0.0, 'yield_strength': 500.0, 'yield_rate': 0.01}, 'energy'),
        ('arrhenius helmholtz', ARRHENIUS, 'energy'),
        ('arrhenius inertia', ARRHENIUS, 'energy'),
    ],
)
def test_columns_in_one_place_do_not_overtake_each_other(device, gradient, on, constants):
    on = on.split()
    lava = Lava.paper(**STIFF, **constants)
    speeds, is_hot = checkered(lava, on, gradient=gradient, device=device)
    alone = [checkered(lava, on, kelvin, kelvin, device)[0].mean() for kelvin in (1400.0, 1300.0)]
    assert alone[0] > 1.5 * alone[1]
    assert is_hot.any() and not is_hot.all()
    expected = checkered(lava, on, 1350.0, 1350.0, device)[0].mean()
    assert speeds == pytest.approx(expected, rel=0.06)


def test_printed_formulas_follow_the_temperature_of_each_column():
    lava = Lava.paper(**STIFF, arrhenius=0.03)
    speeds, is_hot = checkered(lava, ('arrhenius', 'green'), formulation='as-published')
    mixed, _ = checkered(lava, ('arrhenius', 'green'), 1350.0, 1350.0, formulation='as-published')
    assert abs(speeds[is_hot].mean() / mixed.mean() - 1.0) > 0.1


def test_edge_moves_by_its_own_temperature():
    # a plain mean makes the edge 3.4 times as fast
    places = lattice(12.0)
    is_edge = places[:, 0] > 11.0
    lava = Lava.paper(**STIFF, arrhenius=0.03)

    def speed(inside):
        simulation = simulated(
            flat(80), lava, Particles(places, 1.0, np.where(is_edge, 1300.0, inside)),
            effects=only('arrhenius'), spacing=1.0, thickness=1.0, ratio=3.5,
        )
        sample = simulation.sample()
        x, y = sample.position.T
        return sample.velocity[(x > 11.0) & (np.abs(y) < 4.0), 0].mean()

    cold, beside_hot = speed(1300.0), speed(1400.0)
    assert 0.0 < cold <= beside_hot < 2.0 * cold


def sheet_velocity(lava, thickness, device='cpu', **options):
    """Return the mean velocity in the middle of a uniform sheet on a slope of 0.1 towards +x."""
    simulation = simulated(
        incline(0.1, 40, 40, 1.0, origin=(-20.0, -20.0)), lava,
        Particles(lattice(10.0), thickness, 1400.0), device=device, spacing=1.0,
        thickness=thickness, **options,
    )
    sample = simulation.sample()
    return sample.velocity[np.abs(sample.position).max(axis=1) < 1.0].mean(axis=0)


def test_green_velocity_of_a_uniform_sheet_is_the_local_one(device):
    green, local = (
        sheet_velocity(Lava.paper(), 1.0, device, effects=only(*names), ratio=4.0)
        for names in (('green',), ())
    )
    assert green == pytest.approx(local, rel=1e-4, abs=1e-5)


def test_published_velocity_is_the_printed_sum(device):
    """Equations 3.36, 3.40 and 3.44, summed over all pairs."""
    slope = 0.125
    simulation = simulated(
        incline(-slope, 20, 20, 1.0), Lava.paper(viscosity=100.0),
        Particles(np.random.default_rng(5).uniform(4.0, 16.0, (150, 2)), 0.64, 1423.0),
        effects=only(), device=device, spacing=0.8, ratio=2.5, thickness=1.0, kernel='poly6',
        formulation='as-published', precision='float64',
    )
    sample, radius = simulation.sample(), simulation.accuracy.radius
    offset = sample.position[:, None] - sample.position[None]
    distance = np.linalg.norm(offset, axis=-1)
    near = distance < radius
    height = (0.64 * 4 / (math.pi * radius**8) * near * (radius**2 - distance**2) ** 3).sum(axis=1)
    pull = -24 / (math.pi * radius**8) * near * (radius**2 - distance**2) ** 2 * 0.64
    surface = (pull[..., None] * offset).sum(axis=1) + np.array([slope, 0.0])
    b = -(height**3)[:, None] * 2500.0 * 9.81 * surface / (100.0 * 100.0)
    r = np.maximum(distance, 1e-3)
    log = np.log(2 / r) - 0.577216
    weight = np.where(near, log + 0.25 * r**2 * (log + 1), 0.0)
    mean = (weight[..., None] * b[None]).sum(axis=1) / weight.sum(axis=1)[:, None]
    assert sample.thickness == pytest.approx(height, rel=1e-9)
    assert sample.velocity == pytest.approx((height**3)[:, None] * mean, rel=1e-6, abs=1e-12)


def test_fixed_step_ignores_the_step_limits():
    simulation, _ = scattered(only(), integrator='euler', fixed_step=1e4)
    simulation.advance(2e4)
    assert (simulation.steps, simulation.snapshot().steps.length) == (2, 1e4)


@pytest.mark.parametrize('integrator', INTEGRATORS)
def test_steps_stay_within_their_limits(device, integrator):
    simulation, _ = scattered(only(), device=device, integrator=integrator)
    for time in (5.0, 20.0, 50.0):
        simulation.advance(time)
        before = simulation.sample()
        diffusivity = (2500.0 * 9.81 * before.thickness**3 / (3 * 1e4)).max()
        speed = np.linalg.norm(before.velocity, axis=1).max()
        simulation.advance(time + 1e-3)
        steps = simulation.snapshot().steps
        reach = simulation.accuracy.courant_number * min(simulation.accuracy.radius, 10.0)
        assert steps.length * speed <= 1.001 * reach
        is_fast = steps.length * speed >= 0.999 * reach
        assert steps.limit == ('advection' if is_fast else 'diffusion')
        if integrator == 'euler':
            assert steps.length <= 2.0 * simulation.accuracy.radius**2 / (10.18 * diffusivity)


def test_free_fall_limit_does_not_change_slow_lava(device):
    ground, vent = incline(0.2, 40, 60, 10.0), Vent((100.0, 200.0), 5.0, radius=10.0)
    samples = []
    for bound in (True, False):
        simulation = simulated(
            ground, Lava.paper(viscosity=1e4), vent, device=device, deterministic=True
        )
        if not bound:
            simulation.solver.state.top.fill_(FAR)
        simulation.advance(1800.0)
        samples.append(simulation.sample())
    assert np.array_equal(samples[0].position, samples[1].position)
    assert np.array_equal(samples[0].velocity, samples[1].velocity)


def relaxed(longest_step, integrator='rkl2', viscosity=2e4, **options):
    """Return positions of a heap after 20 s in their initial order, and the step report."""
    places = lattice(9.5)
    places = places[np.hypot(*places.T) < 9.0]
    # each particle has a different temperature, which identifies it
    label = 1000.0 + np.arange(len(places))
    simulation = simulated(
        flat(40), Lava.paper(viscosity=viscosity),
        Particles(places, 0.5 + 0.5 * np.exp(-0.02 * (places**2).sum(axis=1)), label),
        effects=only(), longest_step=longest_step, integrator=integrator,
        **{'spacing': 1.0, 'thickness': 1.0, 'precision': 'float64', **options},
    )
    simulation.advance(20.0)
    sample = simulation.sample()
    steps = simulation.snapshot().steps
    return sample.position[np.argsort(sample.temperature)], steps


def test_integrators_have_their_orders():
    # the reference error, of second order, is a 25th of the smallest error compared with it
    reference, _ = relaxed(0.01)
    for integrator, order in (('rkl2', 2.0), ('rkl1', 1.0), ('euler', 1.0)):
        steps = (0.2, 0.1, 0.05)
        errors = [
            np.linalg.norm(relaxed(step, integrator)[0] - reference, axis=1).mean()
            for step in steps
        ]
        measured = [math.log2(errors[0] / errors[1]), math.log2(errors[1] / errors[2])]
        assert measured == pytest.approx([order, order], abs=0.2)


@pytest.mark.parametrize('integrator', ['rkl2', 'rkl1'])
@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_many_stages_stay_stable(device, precision, integrator):
    reference, _ = relaxed(5.0, 'euler', viscosity=200.0)
    position, steps = relaxed(
        5.0, integrator, precision=precision, device=device, viscosity=200.0
    )
    # more than the two stages of the shortest step
    assert steps.evaluations > 3 * steps.count
    spread = np.linalg.norm(reference, axis=1).max() - 9.0
    assert spread > 2.0
    assert np.linalg.norm(position - reference, axis=1).mean() < 0.03 * spread


@pytest.mark.parametrize('names', [(), ('yielding',)])
def test_limit_of_the_mobility_slows_only_faster_lava(device, names):
    """Speeds above it are those of a higher viscosity; the speeds below it do not change."""
    free = scattered(only(*names))[0].sample()
    rise = np.linalg.norm(free.velocity, axis=1)
    unchanged = scattered(only(*names), mobility_limit=1e9)[0].sample()
    np.testing.assert_array_equal(unchanged.velocity, free.velocity)
    limit = float(np.median(rise[rise > 0.0]))
    slow = scattered(only(*names), mobility_limit=limit)[0].sample()
    found = np.linalg.norm(slow.velocity, axis=1)
    assert (found <= rise * (1.0 + 1e-6)).all()
    assert (found < 0.9 * rise).any() and (found[rise > 0.0] > 0.0).all()
    # lava moves in the same direction
    cross = free.velocity[:, 0] * slow.velocity[:, 1] - free.velocity[:, 1] * slow.velocity[:, 0]
    assert np.abs(cross).max() <= 1e-5 * (rise * found).max()
