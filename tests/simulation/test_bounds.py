# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Bounds on the automatic and explicit resolution, and on the memory of a simulation."""

from dataclasses import replace
import math

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy, MAX_PARTICLES_PER_SECOND
from lava_ros.simulation.backend.memory import OutOfMemoryError
from lava_ros.simulation.particles import neighbors
from lava_ros.simulation.particles.solver import ParticleSolver
from lava_ros.simulation.resolution import (
    HORIZON,
    MIN_SPACING,
    MOST_PARTICLES,
    resolution_of,
)
from lava_ros.simulation.step.effects import helmholtz
from solver import incline, only

GROUND = incline(0.1, 100, 100, 10.0)

#: Lava whose viscosity does not depend on its temperature.
STIFF = Lava.paper(viscosity=1e15, arrhenius=0.0)


def vents(rates, radius=5.0):
    """Return vents across the terrain, one for each effusion rate [m3/s]."""
    x, y = np.random.default_rng(1).uniform(100.0, 900.0, (2, len(rates)))
    return tuple(
        Vent((float(a), float(b)), rate, radius=radius)
        for a, b, rate in zip(x, y, rates, strict=True)
    )


def begin(scene, accuracy=None, horizon=HORIZON):
    return Simulation(scene, effects=only(), accuracy=accuracy, device='cpu', horizon=horizon)


@pytest.mark.parametrize(('rates', 'lava', 'horizon'), [
    (np.geomspace(1e-8, 1e3, 20), STIFF, HORIZON),
    (np.geomspace(1e-3, 1e3, 20), Lava.paper(viscosity=1e4, yield_strength=1e7), HORIZON),
    ([1e3] * 20, STIFF, 60.0),
    ([((0.0, 1e7), (1e-5, 0.0))], Lava.paper(), HORIZON),
    ([5.0], replace(STIFF, viscosity=1e12), 1e9),
], ids=['rates', 'strength', 'minute', 'burst', 'years'])
@pytest.mark.parametrize('refinement', [0.707, 2.0])
def test_automatic_resolution_is_physical(rates, lava, horizon, refinement):
    scene = Scene(GROUND, vents(rates), lava)
    found = resolution_of(scene, Accuracy(refinement=refinement), horizon=horizon)
    volume = sum(vent.volume_between(0.0, horizon) for vent in scene.vents)
    # 2 pi h^3 / 3 is the volume of a hemisphere
    assert 2.0 * math.pi * found.thickness**3 / 3.0 <= 1.001 * volume
    assert found.spacing >= 0.99 * MIN_SPACING * found.thickness / refinement
    particle = found.spacing**2 * found.thickness
    assert volume / particle <= 1.02 * MOST_PARTICLES * refinement**2
    assert sum(vent.peak for vent in scene.vents) / particle <= 1.02 * MAX_PARTICLES_PER_SECOND
    assert begin(scene, Accuracy(refinement=refinement), horizon).advance(1e-6) == 1e-6


@pytest.mark.parametrize(('rates', 'lava', 'given', 'field', 'words'), [
    ([1e-10] * 20, Lava.paper(viscosity=1e3), {}, 'vents[0].discharge',
     'automatic spacing of .* neighbour grid .* or give `spacing`'),
    ([1e-3, 5e7], STIFF, {}, 'vents[1].discharge',
     'automatic thickness of .* at most 10000 m; or give `thickness`'),
    ([1e-15], Lava.paper(), {}, 'vents[0].discharge',
     'automatic spacing of .* coincide by rounding'),
    ([5.0], Lava.paper(), {'spacing': 1e-5}, 'accuracy.spacing', 'coincide by rounding'),
    ([5.0] * 20, Lava.paper(), {'spacing': 0.01}, 'accuracy.spacing', 'neighbour grid'),
    ([5.0], Lava.paper(), {'spacing': 0.1, 'thickness': 1e-6}, 'vents[0].discharge',
     'in a second'),
    ([5.0], Lava.paper(), {'thickness': 1e5}, 'accuracy.thickness', 'at most 10000 m'),
])
def test_resolution_that_cannot_be_computed_is_refused(rates, lava, given, field, words):
    scene = Scene(GROUND, vents(rates), lava)
    with pytest.raises(LavaError, match=words) as caught:
        begin(scene, Accuracy(**given))
    assert caught.value.field == field
    if field.startswith('vents'):
        assert caught.value.value == scene.vents[int(field[6])].peak


@pytest.mark.parametrize(('change', 'words'), [
    (lambda it: it.set_vents(vents([1e3], radius=1e3)), 'accuracy.spacing .* neighbour grid'),
    (lambda it: it.set_vents(vents([1e9 - 1.0, 1e8])), 'discharge'),
    (lambda it: it.set_terrain(replace(GROUND, resolution=1e5)), 'accuracy.spacing .* rounding'),
], ids=['wide vent', 'rate', 'terrain'])
def test_refused_change_leaves_the_simulation_as_it_was(change, words, monkeypatch):
    monkeypatch.setattr(neighbors, 'WHOLE', 64)
    monkeypatch.setattr(neighbors, 'MAX_CELLS', 20_000)
    scene = Scene(GROUND, (Vent((500.0, 500.0), 5.0, radius=5.0),), Lava.paper())
    runs = [begin(scene, Accuracy(spacing=2.0, thickness=1.0)) for _ in range(2)]
    for run in runs:
        run.advance(20.0)
    with pytest.raises(LavaError, match=words):
        change(runs[0])
    assert runs[0].scene is scene
    for run in runs:
        run.advance(40.0)
    found, expected = (run.sample() for run in runs)
    assert len(found.volume) > 20
    np.testing.assert_array_equal(found.position, expected.position)


def test_lava_that_outgrows_the_neighbour_grid_is_refused(monkeypatch):
    monkeypatch.setattr(neighbors, 'WHOLE', 64)
    monkeypatch.setattr(neighbors, 'MAX_CELLS', 15_000)
    fluid = Lava.paper(viscosity=10.0, arrhenius=0.0)
    scene = Scene(GROUND, (Vent((500.0, 500.0), 50.0, radius=5.0),), fluid)
    simulation = begin(scene, Accuracy(spacing=2.0, thickness=0.2))
    with pytest.raises(LavaError, match=r'^accuracy\.spacing .*neighbour grid'):
        simulation.advance(600.0)
    assert 0.0 < simulation.time < 600.0


def test_neighbour_grid_covers_wide_vents(monkeypatch):
    monkeypatch.setattr(neighbors, 'WHOLE', 64)
    vent = Vent((500.0, 500.0), 5.0, radius=400.0)
    simulation = begin(Scene(GROUND, (vent,), Lava.paper()), Accuracy(spacing=2.0))
    cells = simulation.solver.neighbors.cells
    assert cells.columns / cells.columns_per_metre > 800.0
    assert cells.rows / cells.rows_per_metre > 800.0


@pytest.mark.parametrize('place', [(-2e3, -3e3), (2e3, 3e3), (0.0, -3e3)])
def test_neighbour_grid_of_places_beyond_the_terrain_is_within_it(place, monkeypatch):
    monkeypatch.setattr(neighbors, 'WHOLE', 64)
    grid = begin(Scene(GROUND, (Vent((500.0, 500.0), 5.0),), STIFF)).solver.neighbors
    first, ends = grid.window(np.array([place]))
    assert (first >= 0).all() and (first < ends).all() and (ends <= grid._all).all()


def test_vent_wider_than_the_terrain_emits_all_over_it():
    """A step raises the terrain, not the area of the vent, by half of the thickness."""
    ground = Terrain(np.zeros((2, 2)), 1.0)
    vent = Vent((1.0, 1.0), 8.0, radius=1e4)
    simulation = begin(Scene(ground, (vent,), STIFF), Accuracy(spacing=0.5, thickness=1.0))
    # 0.5 m on 4 m2 at 8 m3/s
    assert simulation.solver.vents.step_limits[0, 1] == pytest.approx(0.25)
    simulation.advance(5.0)
    position = simulation.sample().position
    assert len(np.unique(position // 0.25, axis=0)) > 40


@pytest.mark.parametrize('error', [
    RuntimeError("Failed to allocate 64 bytes on device 'cpu'"), MemoryError('too large'),
    RuntimeError('device lost'),
], ids=str)
@pytest.mark.parametrize(('method', 'call'), [
    ('__init__', lambda it: begin(it.scene)),
    ('__init__', lambda it: Simulation.resume(it.checkpoint(), device='cpu')),
    ('run_stages', lambda it: it.advance(1.0)),
    ('begin_snapshot', lambda it: it.snapshot()),
    ('begin_snapshot', lambda it: it.begin_snapshot()),
    ('sort', lambda it: it.sample()),
    ('replace_vents', lambda it: it.set_vents([])),
    ('replace_terrain', lambda it: it.set_terrain(incline(0.2, 100, 100, 10.0))),
    ('switch_effects', lambda it: it.set_effects({'steep': True})),
])
def test_exhausted_memory_is_an_error_with_a_remedy(method, call, error, monkeypatch):
    scene = Scene(GROUND, vents([5.0]), Lava.paper())
    simulation = Simulation(
        scene, effects=dict.fromkeys(only(), False) | {'steep': False}, device='cpu'
    )

    def fail(*_, **__):
        raise error

    if call is not None:
        checkpoint = simulation.checkpoint()
        monkeypatch.setattr(simulation, 'checkpoint', lambda: checkpoint)
    monkeypatch.setattr(ParticleSolver, method, fail)
    is_full = 'device' not in str(error) or 'allocate' in str(error)
    kind = OutOfMemoryError if is_full else RuntimeError
    with pytest.raises(kind) as caught:
        call(simulation)
    if is_full:
        assert isinstance(caught.value, LavaError)
        assert 'a larger spacing or a coarser terrain' in str(caught.value)
    else:
        assert caught.value is error


def test_sweeps_of_lateral_stress_are_limited():
    counts = [len(helmholtz._schedule(thickness, 1.0)) for thickness in (1.0, 20.0, 1e4)]
    assert counts[0] < counts[1] < counts[2] == helmholtz.MAX_SWEEPS
