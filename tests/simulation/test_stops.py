# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A deterministic flow is bitwise identical however it is run: with stops, restarts, threads."""

from dataclasses import replace
from functools import lru_cache
from itertools import cycle
from random import Random
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.runs.drive import drive, driving
from lava_ros.runs.sinks import PeakSink
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation import simulation as simulation_module
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend import threads
from lava_ros.simulation.batch import Batch
from lava_ros.simulation.output.checkpoint import from_bytes
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles import neighbors
from lava_ros.simulation.particles import solver as solver_module
from lava_ros.simulation.particles.solver import ParticleSolver
from lava_ros.simulation.step import motion

END = 400.0

LAVA = Lava.paper(viscosity=2e3, density=2600.0)

COOLING = Lava.paper(viscosity=5e3, density=2600.0, convection=300.0, yield_strength=500.0,
               yield_rate=0.01, solidus=1395.0, conductivity=900.0)

INSULATED = replace(LAVA, solidus=1150.0, conductivity=2.0)

CRUSTED = replace(LAVA, conductivity=900.0, crust=True, ground_conductivity=2.0)

SCENES = {
    'bare': (LAVA, Effects(arrhenius=False, cooling=False)),
    'freezing': (COOLING, Effects(yielding=True, solidification=True, conduction=True)),
    'inertia': (replace(LAVA, viscosity=50.0), Effects(inertia=True)),
    'green': (LAVA, Effects(green=True)),
    'helmholtz': (LAVA, Effects(helmholtz=True)),
    'crust': (CRUSTED, Effects(crust=True, ground=True, conduction=True)),
    'insulation': (INSULATED, Effects(insulation=True, cooling=False)),
    'merging': (COOLING, Effects(merging=True, solidification=True)),
    'cells': (LAVA, Effects(arrhenius=False, cooling=False)),
    'freezing cells': (COOLING, Effects(yielding=True, solidification=True, conduction=True)),
    'crust on cells': (CRUSTED, Effects(crust=True, ground=True, conduction=True)),
}

#: The second one opens later and higher up, on lava that may have solidified.
VENTS = (
    Vent((95.0, 150.0), ((0.0, 30.0), (100.0, 5.0), (300.0, 60.0)), radius=12.0),
    Vent((60.0, 140.0), ((210.0, 8.0),), end=(80.0, 170.0), radius=4.0, velocity=(2.0, 0.0)),
)


def hill(rise=0.0):
    """Return a rough slope towards +x with a hole, down which lava runs off the map."""
    x, y = np.meshgrid(np.arange(28) * 10.0, np.arange(30) * 10.0)
    height = 900.0 - 0.25 * x + 3.0 * np.sin(x / 17.0) * np.cos(y / 23.0) + rise * (y > 160.0)
    height[14:16, 16:18] = np.nan
    return Terrain(height, 10.0)


def begun(name, device):
    """Return an eruption before its first step; the bare one in float64."""
    lava, effects = SCENES[name]
    precision = 'float64' if name == 'bare' else 'float32'
    if 'cells' in name and device != 'cpu':
        pytest.skip('cells run on a CPU')
    return Simulation(
        Scene(hill(), VENTS, lava), effects=effects, device=device,
        accuracy=Accuracy(
            spacing=4.0, thickness=0.5, longest_step=20.0, deterministic=True,
            precision=precision, method='cells' if 'cells' in name else 'particles',
        ),
    )


def result_of(simulation):
    """Return the arrays and counts that later steps and maps depend on, by name."""
    # removes lost and solidified particles, and sorts the others by cell
    simulation.sample()
    checkpoint = simulation.checkpoint()
    if checkpoint.accuracy.method == 'cells':
        return dict(checkpoint.arrays)
    clock, counts = simulation.solver.state.read_clock()
    passing = ('state.clock', 'state.counts', 'state.stage', 'state.rates')
    arrays = {name: item for name, item in checkpoint.arrays.items() if name not in passing}
    places = [at.PARTICLES, at.STEPS, at.EVALUATIONS, at.LIMIT, at.STAGES]
    return arrays | {
        'clock': clock[[at.TIME, at.STEP, at.FULL_STEP]],
        'counts': counts[places],
        'capacity': np.array(checkpoint.capacity),
    }


@lru_cache
def without_stops(name, device):
    simulation = begun(name, device)
    simulation.advance(END)
    return result_of(simulation)


def stops(count):
    return [END * (number / count) for number in range(1, count + 1)]


def resumed(simulation):
    data = simulation.checkpoint().to_bytes()
    return Simulation.resume(from_bytes(data), device=simulation.device)


#: Actions at a stop; one that returns a simulation replaces it.
READINGS = {
    'snapshots': lambda simulation: simulation.snapshot(),
    'pending snapshots': lambda simulation: simulation.begin_snapshot().result(),
    'samples': lambda simulation: simulation.sample(),
    'budgets': lambda simulation: simulation.budget(),
    'checkpoints': lambda simulation: simulation.checkpoint(),
    'resumed checkpoints': resumed,
}


def observe(simulation, times, is_in_a_batch):
    """Observe as a forecast does, in parts, or as the members of an ensemble do."""
    peaks = PeakSink(simulation, times, threshold=0.1)
    if is_in_a_batch:
        Batch().run([driving(simulation, END, [peaks])])
    while not peaks.is_done:
        drive(simulation, END, [peaks], wall_limit=0.01)


def run_at_random(name, device, seed, monkeypatch):
    """Run a scene with any number of stops, readings, restarts and threads, graphs or none."""
    chance = Random(f'{name} {seed}')
    for module in (motion, neighbors):
        monkeypatch.setattr(module, 'MIN_MOVES', 50)
    simulation, times = begun(name, device), stops(chance.choice((1, 4, 7, 12, 24)))
    switch = chance.randrange(2 * len(times))
    for number, time in enumerate(times):
        threads.use_threads(chance.choice((1, 3)))
        is_captured = chance.random() < 0.5
        monkeypatch.setattr(solver_module, 'is_alone', lambda _, value=is_captured: value)
        if number == switch:
            can_batch = seed not in EVERY_RUN or name in BATCHED
            observe(simulation, times[number:], chance.random() < 0.5 and can_batch)
            break
        reached = simulation.advance(time, limit=END)
        assert reached == simulation.time
        assert time <= reached <= min(time + 20.0, END)
        read = READINGS[chance.choice(list(READINGS))](simulation)
        simulation = read if isinstance(read, Simulation) else simulation
    return simulation


#: Seeds of each run, and the scenes that may then be members of a batch, which has kernels of its
#: own.
EVERY_RUN, BATCHED = range(2), ('freezing', 'cells', 'freezing cells', 'crust on cells')


@pytest.mark.parametrize('seed', [
    pytest.param(seed, marks=[pytest.mark.nightly] * (seed not in EVERY_RUN)) for seed in range(20)
])
@pytest.mark.parametrize('name', SCENES)
def test_flow_does_not_depend_on_stops_readings_restarts_threads_or_graphs(
    name, seed, device, monkeypatch
):
    expected = without_stops(name, device)
    try:
        simulation = run_at_random(name, device, seed, monkeypatch)
    finally:
        threads.use_threads(None)
    found = result_of(simulation)
    assert found.keys() == expected.keys()
    assert [key for key in expected if found[key].tobytes() != expected[key].tobytes()] == []
    assert (expected['arrived.times'] > 0.0).sum() > 50
    assert 'freezing' != name or expected['solidified.placed'].any()
    assert 'freezing cells' != name or expected['heat.frozen'].any()


@pytest.mark.parametrize('name', SCENES)
def test_whole_steps_are_those_of_one_advance(name, device):
    simulation, times = begun(name, device), set()
    for time in stops(320):
        reached = simulation.advance(time, limit=END, whole_steps=True)
        assert simulation.time == reached <= time < reached + simulation.step + 1e-6 * END
        times.add(reached)
    assert 8 < len(times) < 320 and reached == END
    found, expected = result_of(simulation), without_stops(name, device)
    assert [key for key in expected if found[key].tobytes() != expected[key].tobytes()] == []


def test_advance_stays_within_its_limit():
    simulation = begun('bare', 'cpu')
    with pytest.raises(LavaError, match='limit'):
        simulation.advance(20.0, limit=10.0)
    assert simulation.advance(33.3) == 33.3
    passed = simulation.advance(40.1, limit=END)
    assert 40.1 < passed == simulation.advance(40.1, limit=END)
    assert simulation.advance(passed + 1e-3, limit=passed + 1e-3) == passed + 1e-3


def test_highest_source_of_a_later_vent_does_not_depend_on_stops(device):
    """It uses the ground before lava solidified on it, also after resuming."""
    vents = Vent((150.0, 150.0), 30.0, radius=12.0), Vent((170.0, 150.0), ((350.0, 8.0),))
    simulation = Simulation(
        Scene(Terrain(np.zeros((30, 30)), 10.0), vents, replace(COOLING, convection=1000.0)),
        effects=Effects(solidification=True),
        accuracy=Accuracy(spacing=4.0, thickness=0.5, deterministic=True), device=device,
    )
    tops = []
    for time in stops(4):
        simulation.advance(time, limit=END)
        simulation = resumed(simulation)
        frozen = simulation.snapshot().frozen
        tops.append((time, float(simulation.solver.state.top.numpy()[0]), float(frozen[15, 17])))
    assert frozen[15, 17] > 0.1
    assert {top for _, top, _ in tops} == {0.0}, tops


@pytest.mark.parametrize('name', [
    pytest.param(name, marks=() if name in ('bare', 'merging') else pytest.mark.nightly)
    for name in SCENES
])
def test_wall_limit_interrupts_a_step_without_changing_the_flow(name, monkeypatch):
    """Each launch takes a second, and each limit of two or three seconds ends within a step."""
    now, run_stages = [0.0], ParticleSolver.run_stages
    clock = SimpleNamespace(monotonic=lambda: now[0])
    for module in (solver_module, simulation_module):
        monkeypatch.setattr(module, 'wall_clock', clock)

    def launch(solver):
        now[0] += 1.0
        run_stages(solver)

    monkeypatch.setattr(ParticleSolver, 'run_stages', launch)
    simulation, readings = begun(name, 'cpu'), cycle(READINGS)
    interrupted = 0
    for number, limit in enumerate(cycle((2.0, 3.0))):
        before = now[0]
        reached = simulation.advance(END, wall_limit=limit)
        assert now[0] - before <= limit
        if reached >= END:
            break
        interrupted += simulation.solver.state.read_clock()[1][at.STAGE] > 0
        if number % 20 == 0:
            read = READINGS[next(readings)](simulation)
            assert not simulation.solver.state.read_clock()[1][at.STAGE]
            simulation = read if isinstance(read, Simulation) else simulation
    assert (interrupted > 0) == (name != 'inertia')
    expected = without_stops(name, 'cpu')
    for key, values in result_of(simulation).items():
        np.testing.assert_array_equal(values, expected[key], key)


def test_wall_limit_leaves_a_review_to_whatever_comes_next(monkeypatch):
    now = [0.0]
    clock = SimpleNamespace(monotonic=lambda: now[0])
    for module in (solver_module, simulation_module):
        monkeypatch.setattr(module, 'wall_clock', clock)
    simulation = Simulation(Scene(hill(), VENTS, LAVA), device='cpu', horizon=END)
    due = simulation._choice.due
    to_review = ParticleSolver.advancing_to

    def slow(*arguments):
        reached = yield from to_review(*arguments)
        now[0] += 1.0
        return reached

    monkeypatch.setattr(ParticleSolver, 'advancing_to', slow)
    assert simulation.advance(END, wall_limit=0.5) >= due
    assert simulation.review_count == 0
    simulation.snapshot()
    assert simulation.review_count == 1
    assert simulation._choice.due > simulation.time
