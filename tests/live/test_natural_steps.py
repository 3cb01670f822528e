# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A worker that follows a clock takes time steps of their natural length."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.effects import EFFECTS
from lava_ros.live.clock import MAX_LAG
from lava_ros.live.pace import MAX_DELAY, MAX_WAIT
from lava_ros.live.worker import SimulationWorker
from lava_ros.live.worker_status import WorkerState
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.materials import default_lava
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import METHODS

X = 10.0 * np.arange(40)

#: Slope towards +x with a vent at its top.
SCENE = Scene(
    Terrain(np.tile(500.0 - 0.2 * X, (30, 1)), 10.0), (Vent((60.0, 150.0), 20.0),), default_lava()
)

#: A limit of steps that none of them reaches [s].
FAR = 1e9

NOW = 100.0


#: Forced effects of lava of one temperature, for which cells need few kernels.
PLAIN = {name: name == 'steep' for name in EFFECTS}


@pytest.fixture(params=METHODS)
def method(request):
    return request.param


def simulation_of(scene, method='particles', device='cpu', effects=None):
    forced = {'particles': {}, 'cells': PLAIN}[method] | (effects or {})
    accuracy = Accuracy(method=method, spacing=8.0, deterministic=True)
    return Simulation(scene, effects=forced, accuracy=accuracy, device=device)


class Driven:
    """A worker whose slices and commands run in the thread of the test, with its own clock."""

    def __init__(
        self, scene=SCENE, *, method='particles', device='cpu', effects=None, **options
    ):
        self.now = NOW
        self.worker = SimulationWorker(
            lambda scene: simulation_of(scene, method, device, effects), clock=lambda: self.now,
            **options,
        )
        self.run(self.worker.set_scene(scene))

    @property
    def session(self):
        return self.worker.session

    def run(self, future):
        """Run the waiting commands, and return the result of one of them."""
        self.worker._run_commands()
        return future.result(0.0)

    def follow(self, until, tick=0.1):
        """Advance the clock to ``until`` [s since the start] in ticks."""
        start = self.now
        for number in range(1, round((NOW + until - start) / tick) + 1):
            self.now = start + number * tick
            self.worker._advance()
            self.worker._update_status()
            yield self.worker.status


def flow_of(simulation):
    """Return the time, steps and evaluations, and the sorted particles or the columns."""
    sample, steps = simulation.sample(), simulation.snapshot().steps
    numbers = simulation.time, steps.count, steps.evaluations
    if simulation.accuracy.method == 'particles':
        return numbers, simulation.solver.state.read_particles().tobytes()
    return numbers, *(value.tobytes() for value in vars(sample).values())


@pytest.mark.parametrize(('method', 'scale', 'tick', 'effects'), [
    ('particles', 1.0, 0.1, {}), ('particles', 1.0, 0.02, {'insulation': True}),
    ('particles', 10.0, 0.1, {}), ('cells', 1.0, 0.1, {}), ('cells', 10.0, 0.1, {}),
], indirect=['method'])
def test_worker_takes_the_steps_of_one_advance(device, method, scale, tick, effects):
    driven = Driven(method=method, device=device, effects=effects, time_scale=scale)
    simulation, launches = driven.session.simulation, []
    name = {'particles': 'run_stages', 'cells': '_take_steps'}[method]
    launch = getattr(simulation.solver, name)
    setattr(simulation.solver, name, lambda: (launches.append(1), launch()))
    for status in driven.follow(200.0 / scale, tick):
        assert not status.is_behind and not status.is_stale and status.lost == status.lag == 0.0
        assert status.age < driven.session.view.step
        assert driven.session.time + status.age == pytest.approx((driven.now - NOW) * scale)
    found = flow_of(simulation)
    assert 100.0 < driven.session.time == simulation.time < 200.0
    assert effects.keys() <= set(simulation.effects)
    expected = simulation_of(SCENE, method, device, effects)
    expected.advance(driven.session.time, limit=FAR)
    assert found == flow_of(expected)
    # about one idle stage for each step computes the length of the next step
    _, steps, evaluations = found[0]
    assert steps > 3 and len(launches) <= 3 * evaluations


EVENT = TerrainEvent(52.5, 'new ground', replace(SCENE.terrain, elevation=np.tile(X, (30, 1))))


def test_events_change_the_ground_at_their_times(method):
    scene = replace(SCENE, events=(EVENT,))
    driven, times = Driven(scene, method=method), set()
    for _ in driven.follow(100.0):
        times.add(driven.session.time)
    assert EVENT.time in times and driven.session.scene.events == ()
    expected = simulation_of(scene, method)
    expected.advance(driven.session.time, limit=FAR)
    assert flow_of(driven.session.simulation) == flow_of(expected)


def change_nothing(worker):
    yield worker.set_vents(SCENE.vents)
    yield worker.set_terrain(Terrain(SCENE.terrain.elevation.copy(), 10.0))
    choice = worker.session.simulation._choice
    yield worker.set_effects(choice.forced, horizon=choice.horizon)
    yield worker.checkpoint()
    yield worker.fork()


def test_commands_that_change_nothing_shorten_no_step(method):
    driven = Driven(method=method)
    for number, _ in enumerate(driven.follow(100.0)):
        if number % 50 == 25:
            for future in change_nothing(driven.worker):
                driven.run(future)
    expected = simulation_of(SCENE, method)
    expected.advance(driven.session.time, limit=FAR)
    assert flow_of(driven.session.simulation) == flow_of(expected)


CHANGES = {
    'vents': lambda worker: worker.set_vents([Vent((100.0, 150.0), 5.0)]),
    'another vent': lambda worker: worker.add_vent(Vent((100.0, 150.0), 5.0)),
    'terrain': lambda worker: worker.set_terrain(replace(
        SCENE.terrain, elevation=SCENE.terrain.elevation + (X > 200.0)
    )),
    'effects': lambda worker: worker.set_effects({'steep': False}, horizon=3600.0),
    'pause': lambda worker: worker.pause(True),
}


@pytest.mark.parametrize('name', CHANGES)
def test_changes_take_place_at_the_time_of_the_clock(name, method):
    driven = Driven(method=method)
    list(driven.follow(100.3))
    assert driven.session.time < 100.0
    driven.run(CHANGES[name](driven.worker))
    assert driven.session.time == driven.session.simulation.time == pytest.approx(100.3)
    driven.worker._update_status()
    assert driven.worker.status.age == driven.worker.status.lost == 0.0
    if name == 'vents':
        assert driven.session.simulation.budget().emitted == pytest.approx(100.3 * 20.0)


def test_end_time_and_steps_of_a_pause_are_exact(method):
    driven = Driven(method=method, end_time=77.7)
    *_, status = driven.follow(100.0)
    assert driven.session.time == 77.7 and status.state is WorkerState.FINISHED
    driven.run(driven.worker.set('end_time', None))
    driven.run(driven.worker.pause(True))
    driven.run(driven.worker.step(3.3))
    driven.worker._advance()
    assert driven.session.time == pytest.approx(81.0)


def test_steps_longer_than_the_maximum_lag_are_reached(method):
    driven = Driven(method=method, time_scale=0.01)
    *_, status = driven.follow(4e3, tick=2.0)
    assert driven.session.view.step > MAX_LAG * driven.worker.pace.time_scale
    assert driven.session.time > 1.0 and status.lost == 0.0


def test_fork_has_the_time_of_the_clock_of_its_state(method):
    driven = Driven(method=method, time_scale=2.0)
    list(driven.follow(40.0))
    fork = driven.run(driven.worker.fork())
    assert 0.0 < fork.checkpoint.time < 75.0
    assert fork.clock == pytest.approx(NOW + fork.checkpoint.time / 2.0)


def test_scale_changes_the_clock_but_not_the_time_reached():
    driven = Driven()
    *_, status = driven.follow(100.3)
    driven.run(driven.worker.set('time_scale', 60.0))
    driven.worker._update_status()
    assert driven.worker.status.age == status.age
    # a lag remains in time of the clock
    pace, view = driven.worker.pace, driven.session.view
    pace.target = view.time + view.step + 120.0
    lag = pace.lag
    driven.run(driven.worker.set('time_scale', 30.0))
    assert pace.lag == pytest.approx(lag)
    assert pace.target == pytest.approx(view.time + view.step + 60.0)


@pytest.mark.parametrize('scale', [1.0, 10.0])
def test_state_is_stale_when_it_does_not_follow_the_clock(scale):
    driven = Driven(time_scale=scale)
    *_, status = driven.follow(100.0)
    delay = (MAX_DELAY + 0.1) * scale
    assert status.max_age == pytest.approx(driven.session.view.step + delay)
    # the thread is busy: the clock continues, and nothing updates the status
    driven.now += MAX_DELAY
    assert driven.worker.status.age == status.age
    driven.worker._updated -= 10.0
    age = driven.worker.status.age
    assert age == pytest.approx(status.age + MAX_DELAY * scale)
    assert not driven.worker.status.is_stale
    driven.now += status.max_age
    assert driven.worker.status.is_stale
    # it has continued
    list(driven.follow(driven.now - NOW))
    driven.worker._advance()
    driven.worker._update_status()
    assert not driven.worker.status.is_stale


def test_paused_state_is_never_stale():
    driven = Driven()
    list(driven.follow(100.0))
    driven.run(driven.worker.pause(True))
    driven.worker._update_status()
    driven.now += 1e4
    driven.worker._updated -= 10.0
    assert driven.worker.status.age == 0.0 and not driven.worker.status.is_stale


@pytest.mark.parametrize(
    ('method', 'scale'), [('particles', 1.0), ('particles', 10.0), ('cells', 1.0)],
    indirect=['method'],
)
def test_maps_wait_a_bounded_time_for_the_end_of_a_step(method, scale):
    slow = replace(SCENE, vents=(Vent((60.0, 150.0), 1e-3),))
    driven = Driven(slow, method=method, time_scale=scale)
    ages = [status.age for status in driven.follow(150.0, tick=0.5)]
    assert (MAX_WAIT - 1.0) * scale <= max(ages) <= (MAX_WAIT + 0.5) * scale
    assert driven.session.time >= 2.0 * MAX_WAIT * scale
