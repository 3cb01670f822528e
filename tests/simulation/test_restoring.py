# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checkpoints: a resumed simulation is bitwise identical to one that never stopped."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.checkpoint import from_bytes
from lava_ros.simulation.output.inundation import standing_cells
from lava_ros.simulation.particles import neighbors
from lava_ros.simulation.particles.layout import FAR

#: Times of the checkpoint and of the end [s].
STOP, END = 200.0, 400.0

LAVA = Lava(viscosity=2e3, density=2600.0)

COOLING = Lava(viscosity=5e3, density=2600.0, convection=300.0, yield_strength=500.0,
               yield_rate=0.01, solidus=1395.0)

CRUSTED = Lava(viscosity=2e3, density=2600.0, conductivity=900.0, crust=True,
               ground_conductivity=2.0)

SCENES = {
    'bare': (LAVA, Effects(arrhenius=False, cooling=False)),
    'freezing': (COOLING, Effects(yielding=True, solidification=True)),
    'inertia': (replace(LAVA, viscosity=50.0), Effects(inertia=True)),
    'crust': (CRUSTED, Effects(crust=True, ground=True, conduction=True)),
    'merging': (LAVA, Effects(merging=True)),
}

VENTS = (
    Vent((95.0, 150.0), ((0.0, 30.0), (100.0, 5.0), (300.0, 60.0)), radius=12.0, name='main'),
    Vent((60.0, 60.0), 8.0, end=(80.0, 90.0), radius=4.0, velocity=(2.0, 0.0)),
)


def hill():
    """Return a rough slope towards +x with a hole; lava leaves over its border."""
    x, y = np.meshgrid(np.arange(28) * 10.0, np.arange(30) * 10.0)
    height = 900.0 - 0.25 * x + 3.0 * np.sin(x / 17.0) * np.cos(y / 23.0)
    height[14:16, 16:18] = np.nan
    return Terrain(height, 10.0, origin=(5.0, -3.0), epsg=32633, offset=(500000.0, 4177000.0))


def simulation_at_stop(name, device, precision='float32'):
    """Return a simulation advanced to ``STOP`` whose vents have changed once."""
    lava, effects = SCENES[name]
    accuracy = Accuracy(
        spacing=4.0, thickness=0.5, longest_step=20.0, deterministic=True, precision=precision
    )
    simulation = Simulation(
        Scene(hill(), VENTS[:1], lava), effects=effects, accuracy=accuracy, device=device
    )
    simulation.advance(37.0)
    simulation.set_vents(VENTS)
    simulation.advance(STOP)
    return simulation


@lru_cache
def checkpoint_and_run(name):
    """Return a checkpoint of that simulation on the CPU, and the run resumed from it."""
    checkpoint = simulation_at_stop(name, 'cpu').checkpoint()
    run = Simulation.resume(checkpoint, device='cpu')
    run.advance(END)
    return checkpoint, run


def equal(one, other):
    first, second = one.snapshot(), other.snapshot()
    same_maps = all(
        getattr(first, name) is getattr(second, name)
        or np.array_equal(getattr(first, name), getattr(second, name), equal_nan=True)
        for name in ('thickness', 'temperature', 'frozen')
    )
    same_numbers = (first.budget, first.steps) == (second.budget, second.steps)
    same_state = one.checkpoint().to_bytes() == other.checkpoint().to_bytes()
    return same_maps and same_numbers and same_state


@pytest.mark.parametrize(
    ('name', 'precision'), [*((name, 'float32') for name in SCENES), ('bare', 'float64')]
)
def test_resumed_run_is_bitwise_identical(name, precision, device):
    simulation = simulation_at_stop(name, device, precision)
    checkpoint = simulation.checkpoint()
    data = checkpoint.to_bytes()
    resumed = Simulation.resume(from_bytes(data), device=device)
    assert resumed.time == STOP
    for run in (simulation, resumed):
        run.advance(END)
    assert equal(simulation, resumed)
    assert checkpoint.to_bytes() == data
    budget = simulation.budget()
    assert budget.emitted > 3000.0
    assert budget.error < 1e-5
    assert budget.left > 0.0 or budget.frozen > 0.0


def test_changes_after_a_checkpoint_have_the_same_result(device):
    lava = replace(COOLING, convection=1000.0)
    simulation = Simulation(
        Scene(hill(), VENTS, lava), effects={'merging': False, 'solidification': True},
        accuracy=Accuracy(spacing=4.0, deterministic=True), device=device, horizon=7200.0,
    )
    simulation.advance(STOP)
    data = simulation.checkpoint().to_bytes()
    resumed = Simulation.resume(from_bytes(data), device=simulation.device)
    assert resumed.decisions() == simulation.decisions()
    ground = hill()
    raised = replace(ground, elevation=ground.elevation + np.linspace(0.0, 5.0, 28))
    for run in (simulation, resumed):
        run.advance(260.0)
        run.set_vents(VENTS[1:])
        run.advance(300.0)
        run.set_terrain(raised)
        run.set_effects({'yielding': False}, horizon=3600.0)
        run.advance(350.0)
    assert resumed.effects == simulation.effects
    assert not simulation.effects.yielding
    assert simulation.budget().frozen > 0.0
    assert equal(simulation, resumed)


def test_capacity_grows_in_a_resumed_run_as_in_the_original(device):
    scene = Scene(hill(), (Vent((95.0, 150.0), ((0.0, 1.0), (215.0, 7.2e3)), radius=40.0),), LAVA)
    accuracy = Accuracy(spacing=2.0, thickness=0.5, deterministic=True, longest_step=20.0)
    simulation = Simulation(scene, effects=Effects(), accuracy=accuracy, device=device)
    simulation.advance(STOP)
    checkpoint = simulation.checkpoint()
    resumed = Simulation.resume(checkpoint, device=device)
    for run in (simulation, resumed):
        run.advance(216.0)
    assert simulation.checkpoint().capacity > checkpoint.capacity
    assert equal(simulation, resumed)


def test_resumes_a_checkpoint_with_one_sum_of_lost_lava():
    checkpoint, run = checkpoint_and_run('bare')
    left = checkpoint.arrays['state.left']
    arrays = {**checkpoint.arrays, 'state.left': left.sum(keepdims=True)}
    del arrays['state.top']
    resumed = Simulation.resume(replace(checkpoint, arrays=arrays), device='cpu')
    assert resumed.solver.state.top.numpy()[0] == np.float32(FAR)
    budget = resumed.budget()
    assert (budget.over_border, budget.in_holes) == (left.sum(), 0.0)
    assert run.budget().left >= left.sum()


def test_neighbour_grid_of_a_resumed_run_covers_lava_far_from_vents(device, monkeypatch):
    ground = Terrain(np.zeros((300, 300)), 10.0)
    places = np.stack(np.meshgrid(*[np.arange(100.0, 300.0, 10.0)] * 2), axis=-1).reshape(-1, 2)
    simulation = Simulation(
        Scene(ground, (Vent((2800.0, 2800.0), 1.0),), Lava()), effects=Effects(),
        accuracy=Accuracy(spacing=10.0, thickness=1.0), device=device,
        particles=Particles(places, 100.0, 1400.0),
    )
    monkeypatch.setattr(neighbors, 'MAX_PARTICLES_PER_CELL', 50)
    resumed = Simulation.resume(simulation.checkpoint(), device=device)
    snapshots = [run.snapshot() for run in (simulation, resumed)]
    assert snapshots[0].budget.held == pytest.approx(4e4, rel=1e-6)
    assert (snapshots[0].thickness == snapshots[1].thickness).all()


@pytest.mark.parametrize(
    ('scene', 'array'),
    [
        *(('bare', f'state.{name}') for name in ('particle', 'remainder', 'left')),
        *(('bare', f'vents.{name}') for name in ('volume', 'released')),
        ('freezing', 'solidification.deposit'),
        ('freezing', 'state.frozen'),
        *(('inertia', f'state.{name}') for name in ('velocity', 'clock')),
        *(('crust', f'state.{name}') for name in ('age', 'waited')),
        ('merging', 'state.moved'),
    ],
)
def test_missing_array_is_an_error_and_another_array_another_result(scene, array):
    checkpoint, run = checkpoint_and_run(scene)
    without = {name: values for name, values in checkpoint.arrays.items() if name != array}
    with pytest.raises(LavaError, match=r'checkpoint\.') as refused:
        Simulation.resume(replace(checkpoint, arrays=without), device='cpu')
    assert array.partition('.')[2] in str(refused.value)
    values = checkpoint.arrays[array].copy()
    assert values.any()
    if array == 'state.clock':
        values[1] *= 0.5
    else:
        values = values // 2 if values.dtype.kind == 'i' else 0.5 * values
    other = replace(checkpoint, arrays={**checkpoint.arrays, array: values})
    otherwise = Simulation.resume(other, device='cpu')
    otherwise.advance(END)
    assert not equal(run, otherwise)


def test_resumes_a_checkpoint_without_vent_sequences():
    checkpoint, _ = checkpoint_and_run('bare')
    arrays = dict(checkpoint.arrays)
    del arrays['vents.phase'], arrays['vents.downhill']
    volume = arrays.pop('vents.volume')
    # particles since the last change of the vents, and the volume in the conduits then
    released = arrays['vents.released'].copy()
    size = float(np.float32(4.0 * 4.0 * 0.5))
    earlier = (volume / size).astype(np.int32)
    arrays |= {'vents.carried': volume - earlier * size, 'vents.released': released - earlier}
    old = Simulation.resume(replace(checkpoint, arrays=arrays), device='cpu')
    new = Simulation.resume(checkpoint, device='cpu')
    assert old.budget() == new.budget()
    old.advance(END)
    new.advance(END)
    assert old.budget().error < 1e-6
    assert old.particle_count == pytest.approx(new.particle_count, abs=2)


def test_resumes_a_checkpoint_without_arrival_times():
    checkpoint, _ = checkpoint_and_run('freezing')
    missing = {'arrived.times', 'solidification.placed'}
    arrays = {name: item for name, item in checkpoint.arrays.items() if name not in missing}
    shown = Simulation.resume(replace(checkpoint, arrays=arrays), device='cpu').snapshot()
    assert shown.budget.frozen > 0.0
    frozen = standing_cells(shown.frozen)
    assert frozen.any() and shown.inundated[frozen].all()
    cell = checkpoint.scene.terrain.resolution**2
    held = np.nansum(shown.frozen, dtype=float) * cell
    assert held == pytest.approx(shown.budget.frozen, rel=1e-6)


def test_rejects_arrays_of_another_scene():
    checkpoint, _ = checkpoint_and_run('freezing')
    terrain, particle = checkpoint.scene.terrain, checkpoint.arrays['state.particle']
    small = replace(terrain, elevation=terrain.elevation[:-1])
    for match, change in (
        (r'arrays is \[.solidification.\]', {'effects': Effects(yielding=True)}),
        (r'solidification\.deposit', {'scene': replace(checkpoint.scene, terrain=small)}),
        ('time', {'time': 1.0}),
        (
            r'state\.particle is .*float64',
            {'arrays': {**checkpoint.arrays, 'state.particle': particle.astype(np.float64)}},
        ),
    ):
        with pytest.raises(LavaError, match=rf'checkpoint\.{match}'):
            Simulation.resume(replace(checkpoint, **change), device='cpu')


def test_checkpoint_resumes_on_another_device(device):
    simulation = simulation_at_stop('crust', device)
    resumed = Simulation.resume(simulation.checkpoint(), device='cpu')
    assert resumed.device == 'cpu'
    assert resumed.budget() == simulation.budget()
    resumed.advance(END)
    assert resumed.budget().error < 1e-5
    assert resumed.budget().emitted == pytest.approx(
        simulation.budget().emitted + (8.0 + 5.0) * 100.0 + (8.0 + 60.0) * 100.0
    )
