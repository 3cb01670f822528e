# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checkpoints: each array matters, and wrong ones are refused.

test_stops.py compares resumed runs with uninterrupted ones.
"""

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
from lava_ros.simulation.particles import neighbors
from simulation.test_stops import begun, COOLING, END, hill, VENTS

#: Time of the checkpoints [s].
STOP = 200.0


@lru_cache
def checkpoint_and_run(name):
    """Return a checkpoint on the CPU, and the run resumed from it."""
    simulation = begun(name, 'cpu')
    simulation.advance(37.0)
    # part of a particle waits in the conduit
    simulation.set_vents((VENTS[0], replace(VENTS[1], discharge=8.0)))
    simulation.advance(STOP)
    checkpoint = simulation.checkpoint()
    run = Simulation.resume(checkpoint, device='cpu')
    run.advance(END)
    return checkpoint, run


def resumed(checkpoint, **changes):
    """Resume a checkpoint on the CPU after changes of its fields."""
    return Simulation.resume(replace(checkpoint, **changes), device='cpu')


def are_equal(one, other):
    """Return True if states, maps and counts of steps are bitwise identical."""
    maps = [
        [run.snapshot().thickness.tobytes(), run.snapshot().temperature.tobytes()]
        for run in (one, other)
    ]
    same = maps[0] == maps[1] and one.snapshot().steps == other.snapshot().steps
    return same and one.checkpoint().to_bytes() == other.checkpoint().to_bytes()


def test_changes_after_a_checkpoint_have_the_same_result(device):
    lava = replace(COOLING, convection=1000.0)
    simulation = Simulation(
        Scene(hill(), VENTS, lava), effects={'merging': False, 'solidification': True},
        accuracy=Accuracy(spacing=4.0, deterministic=True), device=device, horizon=7200.0,
    )
    simulation.advance(STOP)
    copy = from_bytes(simulation.checkpoint().to_bytes())
    other = Simulation.resume(copy, device=simulation.device)
    assert other.decisions() == simulation.decisions()
    ground = hill()
    raised = replace(ground, elevation=ground.elevation + np.linspace(0.0, 5.0, 28))
    for run in (simulation, other):
        run.advance(260.0)
        run.set_vents(VENTS[1:])
        run.advance(300.0)
        run.set_terrain(raised)
        run.set_effects({'yielding': False}, horizon=3600.0)
        run.advance(350.0)
    assert other.effects == simulation.effects
    assert not simulation.effects.yielding
    assert simulation.budget().solidified > 0.0
    assert are_equal(simulation, other)


def test_neighbour_grid_of_a_resumed_run_covers_lava_far_from_vents(device, monkeypatch):
    ground = Terrain(np.zeros((300, 300)), 10.0)
    places = np.stack(np.meshgrid(*[np.arange(100.0, 300.0, 10.0)] * 2), axis=-1).reshape(-1, 2)
    simulation = Simulation(
        Scene(ground, (Vent((2800.0, 2800.0), 1.0),), Lava.paper()), effects=Effects(),
        accuracy=Accuracy(spacing=10.0, thickness=1.0), device=device,
        particles=Particles(places, 100.0, 1400.0),
    )
    monkeypatch.setattr(neighbors, 'MAX_PARTICLES_PER_CELL', 50)
    other = Simulation.resume(simulation.checkpoint(), device=device)
    snapshots = [run.snapshot() for run in (simulation, other)]
    assert snapshots[0].budget.flowing == pytest.approx(4e4, rel=1e-6)
    assert (snapshots[0].thickness == snapshots[1].thickness).all()


@pytest.mark.parametrize('scene', ['bare', 'freezing', 'inertia', 'crust', 'merging'])
def test_missing_array_is_an_error(scene):
    checkpoint, _ = checkpoint_and_run(scene)
    for array in checkpoint.arrays:
        without = {name: values for name, values in checkpoint.arrays.items() if name != array}
        with pytest.raises(LavaError, match=r'checkpoint\.') as refused:
            resumed(checkpoint, arrays=without)
        assert array.partition('.')[2] in str(refused.value)


@pytest.mark.spoils_volume
@pytest.mark.parametrize(
    ('scene', 'array'),
    [
        *(('bare', f'state.{name}') for name in ('particle', 'top', 'left')),
        *(('bare', f'vents.{name}') for name in ('volume', 'released')),
        *(('freezing', f'solidified.{name}') for name in ('deposit', 'placed')),
        *(('freezing', f'arrived.{name}') for name in ('times', 'half_inundated', 'squares')),
        *(('inertia', f'state.{name}') for name in ('remainder', 'velocity', 'clock')),
        *(('crust', f'state.{name}') for name in ('emission_time', 'waited')),
        ('merging', 'state.moved'),
    ],
)
def test_another_array_has_another_result(scene, array):
    checkpoint, run = checkpoint_and_run(scene)
    values = checkpoint.arrays[array].copy()
    assert values.any()
    if array == 'state.clock':
        values[1] *= 0.5
    elif array == 'state.moved':
        # particles merge later
        values[0] = 0.0
    else:
        values = values // 2 if values.dtype.kind == 'i' else 0.5 * values
    try:
        otherwise = resumed(checkpoint, arrays={**checkpoint.arrays, array: values})
    except LavaError as error:
        assert error.field == 'checkpoint.volume'
        return
    otherwise.advance(END)
    assert not are_equal(run, otherwise)


def test_rejects_arrays_of_another_scene():
    checkpoint, _ = checkpoint_and_run('freezing')
    terrain, arrays = checkpoint.scene.terrain, checkpoint.arrays
    small = replace(terrain, elevation=terrain.elevation[:-1])
    wide = arrays['state.particle'].astype(np.float64)
    placed, deposit = (arrays[f'solidified.{name}'] for name in ('placed', 'deposit'))
    for match, change in (
        (r'arrays is \[.cells.\]', {'arrays': {**arrays, 'cells.sizes': arrays['arrived.times']}}),
        (r'solidified\.deposit', {'scene': replace(checkpoint.scene, terrain=small)}),
        (r'solidified\.placed .*data', {'arrays': {**arrays, 'solidified.placed': placed + 1}}),
        (r'solidified\.deposit', {'arrays': {**arrays, 'solidified.deposit': -deposit}}),
        ('time', {'time': 1e6}),
        (r'state\.particle is .*float64', {'arrays': {**arrays, 'state.particle': wide}}),
        ('arrived', {'arrays': {**arrays, 'arrived.times': np.zeros((2, 2), np.float32)}}),
    ):
        with pytest.raises(LavaError, match=rf'checkpoint\.{match}'):
            resumed(checkpoint, **change)


def test_checkpoint_resumes_on_another_device(device):
    simulation = begun('crust', device)
    simulation.advance(STOP)
    other = Simulation.resume(simulation.checkpoint(), device='cpu')
    assert other.device == 'cpu'
    assert other.budget() == simulation.budget()
    other.advance(END)
    assert other.budget().emitted == pytest.approx(
        simulation.budget().emitted + 100.0 * 5.0 + 100.0 * 60.0 + 190.0 * 8.0
    )
