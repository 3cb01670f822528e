# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Merging and splitting of particles."""

import numpy as np
import pytest

from lava_ros.scene import Lava, Vent
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.particles.layout import FULL, IS_LAST, PARTICLES, STEP
from lava_ros.simulation.step.effects import merging as merging
from lava_ros.verification.cases import CASES, spreading
from solver import incline, only, simulated

LAVA = Lava.paper(viscosity=2e3, density=2600.0, arrhenius=0.0, emissivity=0.0, convection=0.0)

MERGING = only('merging')


def simulation_of(device, particles, effects=MERGING, **knobs):
    """Return particles on level ground; nominal spacing 5 m and volume 25 m3."""
    ground, knobs = incline(0.0, 60, 90, 10.0), {'spacing': 5.0, 'thickness': 1.0, **knobs}
    return simulated(ground, LAVA, particles, effects=effects, device=device, **knobs)


def one_pass(simulation):
    """Merge and split particles once."""
    state = simulation.solver.state
    simulation.solver.evaluate()
    state.take_order()
    counts, clock = state.counts.numpy(), state.clock.numpy()
    # the fastest particle has moved far enough for a pass
    counts[IS_LAST], clock[STEP] = 1, 1.0
    state.arrays['moved'].assign([merging.PASS_INTERVAL, 0.0])
    state.counts.assign(counts)
    state.clock.assign(clock)
    solver = simulation.solver
    solver.stage.parts['merging'].finish_step(solver.stage.arguments)


def rows_of(simulation):
    rows = simulation.solver.state.read_particles()
    return rows[rows[:, 2] > 0.0]


def lattice(spacing, count, volume, seed=3):
    """Return particles on a jittered lattice with random temperatures."""
    random = np.random.default_rng(seed)
    ticks = np.arange(count) * spacing + 300.0
    places = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    places += random.uniform(-0.2, 0.2, places.shape) * spacing
    return Particles(places, volume, random.uniform(1000.0, 1400.0, len(places)))


def moments(rows):
    return np.array([rows[:, 2].sum(), *(rows[:, [0, 1, 3]] * rows[:, 2:3]).sum(axis=0)])


@pytest.mark.parametrize('precision', ['float32', 'float64'])
@pytest.mark.parametrize(('spacing', 'volume', 'fewer'), [(2.5, 25.0, True), (10.0, 100.0, False)])
def test_sums_of_volume_heat_and_position_are_kept(device, precision, spacing, volume, fewer):
    simulation = simulation_of(device, lattice(spacing, 20, volume), precision=precision)
    before = rows_of(simulation)
    one_pass(simulation)
    after = rows_of(simulation)
    assert (len(after) < 0.8 * len(before)) if fewer else (len(after) > 1.3 * len(before))
    assert after[:, 2].sum() == before[:, 2].sum()
    rounding = 1e-7 if precision == 'float32' else 1e-12
    assert moments(after) == pytest.approx(moments(before), rel=rounding)


def test_only_the_two_nearest_particles_merge(device):
    row = [[300.0, 300.0], [300.5, 300.0], [301.2, 300.0]]
    turn = np.arange(9) * 2.0 * np.pi / 9
    ring = np.column_stack([300.5 + 4.0 * np.cos(turn), 300.0 + 4.0 * np.sin(turn)])
    temperature = np.array([1400.0, 1200.0, 1350.0] + [1000.0] * 9)
    simulation = simulation_of(device, Particles(np.vstack([row, ring]), 25.0, temperature))
    one_pass(simulation)
    rows = rows_of(simulation)
    rows = rows[np.argsort(np.abs(rows[:, 0] + 149.5) + np.abs(rows[:, 1]))]
    assert rows[0] == pytest.approx([-149.75, 0.0, 50.0, 1300.0], abs=1e-3)
    assert rows[1] == pytest.approx([-148.8, 0.0, 25.0, 1350.0], abs=1e-3)


def test_particles_do_not_merge_if_the_sum_is_rounded():
    random = np.random.default_rng(3)
    volume = (20.0 * 7.0 ** -np.arange(8) * random.uniform(1.0, 1.2, 8)).astype(np.float32)
    first, second = np.triu_indices(8, 1)
    exact = volume.astype(float)[first] + volume.astype(float)[second]
    assert (exact != volume[first] + volume[second]).all()
    places = 300.0 + random.uniform(0.0, 1.0, (8, 2))
    simulation = simulation_of('cpu', Particles(places, volume, 1400.0))
    one_pass(simulation)
    assert len(rows_of(simulation)) == 8


def test_particles_of_the_emitted_volume_do_not_split(device):
    simulation = simulation_of(device, lattice(20.0, 10, 25.0))
    one_pass(simulation)
    assert len(rows_of(simulation)) == 100


def test_halves_lie_across_the_way_to_the_nearest_particle(device):
    places = np.array([[300.0, 300.0], [308.0, 300.0]])
    simulation = simulation_of(device, Particles(places, np.array([100.0, 25.0]), 1400.0))
    one_pass(simulation)
    rows = rows_of(simulation)
    halves = rows[rows[:, 2] == 50.0]
    assert len(halves) == 2 and np.ptp(halves[:, 0]) < 1e-3 < 1.0 < np.ptp(halves[:, 1])


def test_merging_and_splitting_keep_momentum_heat_and_emission_time(device):
    effects = only('cooling', 'inertia', 'ground', 'merging')
    for spacing, volume in ((2.5, 25.0), (10.0, 100.0)):
        simulation = simulation_of(device, lattice(spacing, 12, volume), effects)
        state = simulation.solver.state
        random = np.random.default_rng(5)
        simulation.solver.evaluate()
        state.take_order()

        def sums(state=state):
            volumes = state.read_particles()[:, 2]
            arrays = state.velocity, state.emission_time
            carried = [item.numpy()[: len(volumes)] for item in arrays]
            temperature, rest = (
                item.numpy()[: len(volumes)].astype(np.float64)
                for item in (state.particle, state.temperature_remainder)
            )
            carried.append(temperature[:, 3] + rest)
            return [values.astype(np.float64).T @ volumes for values in carried]

        for name, draw, size in (
            ('velocity', random.normal, 1.0), ('emission_time', random.uniform, 1.0),
            # less than float32 resolves
            ('temperature_remainder', random.uniform, 5e-5),
        ):
            values = state.arrays[name].numpy()
            values[:] = size * draw(size=values.shape)
            state.arrays[name].assign(values)
            state.arrays[f'ordered_{name}'].assign(values)
        before = sums()
        one_pass(simulation)
        after = sums()
        assert after[0] == pytest.approx(before[0], rel=1e-5, abs=1e-2)
        assert after[1] == pytest.approx(before[1], rel=1e-5)
        assert after[2] == pytest.approx(before[2], rel=1e-9)


def test_splitting_is_limited_by_the_capacity(device):
    simulation = simulation_of(device, lattice(10.0, 20, 100.0))
    simulation.solver.state.grow(410)
    one_pass(simulation)
    counts = simulation.solver.state.counts.numpy()
    assert counts[PARTICLES] == 410
    assert counts[FULL] == 1
    assert rows_of(simulation)[:, 2].sum() == 400 * 100.0


def flow(device, effects, **knobs):
    ground, vent = incline(0.05, 60, 90, 10.0), Vent((150.0, 300.0), 20.0, radius=15.0)
    knobs = {'spacing': 5.0, 'thickness': 0.6, **knobs}
    simulation = simulated(ground, LAVA, vent, effects=effects, device=device, **knobs)
    simulation.advance(900.0)
    return simulation


def test_merging_saves_particles_in_the_same_flow(device):
    plain, merged = flow(device, only()), flow(device, MERGING)
    assert merged.particle_count < 0.67 * plain.particle_count
    a, b = plain.snapshot().thickness, merged.snapshot().thickness
    assert np.abs(a - b).sum() < 0.05 * a.sum()
    assert abs((a > 0.1).sum() - (b > 0.1).sum()) < 0.03 * (a > 0.1).sum()


@pytest.mark.nightly
def test_merging_saves_work_at_the_same_error(device, monkeypatch):
    accuracy = Accuracy(refinement=0.6, ratio=3.5)
    plain = CASES['constant_flux'].run(accuracy, device)
    monkeypatch.setattr(spreading, 'FLAT', MERGING)
    merged = CASES['constant_flux'].run(accuracy, device)
    assert merged.particles * merged.evaluations < plain.particles * plain.evaluations / 1.5
    for item, other in zip(merged.measurements, plain.measurements, strict=True):
        assert item.error <= other.error + 0.001, item
