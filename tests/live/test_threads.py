# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Background threads: the owner of a simulation, unexpected exceptions, and bursts of commands."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros import errors
from lava_ros.errors import Guard, LavaError
from lava_ros.live import forecaster, worker
from lava_ros.live.ensemble_forecasts import ForecastRules
from lava_ros.live.forecaster import Forecaster
from lava_ros.live.worker_status import WorkerState
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from waiting import PATIENCE, wait_until
from worker_bench import OUTSIDE, TERRAIN, VENT

RULES = ForecastRules(horizon=60.0, threshold=0.01, max_age=1e9, share=1.0, max_particles=1000)

USES = {
    'time': lambda simulation: simulation.time,
    'device': lambda simulation: simulation.device,
    'scene': lambda simulation: simulation.scene,
    'effects': lambda simulation: simulation.effects,
    'particles': lambda simulation: simulation.particle_count,
    'advance': lambda simulation: simulation.advance(1.0),
    'snapshot': lambda simulation: simulation.snapshot(),
    'checkpoint': lambda simulation: simulation.checkpoint(),
    'vents': lambda simulation: simulation.set_vents([]),
}


def in_a_thread(action):
    """Run an action in a thread, and return its result or its exception."""
    found = []

    def run():
        try:
            found.append(action())
        except Exception as error:
            found.append(error)

    thread = threading.Thread(target=run, name='another')
    thread.start()
    thread.join(PATIENCE)
    return found[0]


@pytest.fixture(scope='module')
def simulation():
    ground = Terrain(np.zeros((20, 20)), 10.0)
    scene = Scene(ground, (Vent((100.0, 100.0), 5.0),), lava=Lava.paper())
    return Simulation(scene, accuracy=Accuracy(spacing=10.0), device='cpu')


@pytest.mark.parametrize('use', USES)
def test_another_thread_cannot_use_a_simulation(simulation, use):
    error = in_a_thread(lambda: USES[use](simulation))
    assert isinstance(error, RuntimeError)
    assert "thread 'another' has used a simulation of another thread" in str(error)
    USES['time'](simulation)


def test_any_thread_completes_a_snapshot(simulation):
    simulation.advance(5.0)
    pending = simulation.begin_snapshot()
    assert in_a_thread(pending.result).time == 5.0


def raising(error):
    """Return a function that raises an error while its ``is_broken``."""

    def work(*_, **__):
        if work.is_broken:
            raise error

    work.is_broken = True
    return work


def in_commands(bench, error):
    """Break the queue of commands."""
    broken, get = raising(error), bench.worker.commands.get
    bench.worker.commands.get = lambda timeout: broken() or get(timeout)
    return broken, lambda: bench.worker.status.fault, 'simulation thread: '


def in_the_report_of_a_snapshot(bench, error):
    broken = raising(error)
    bench.worker.on_snapshot = broken
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time > 0.0)
    bench.worker.request_snapshot()
    return broken, lambda: bench.worker.status.fault, 'simulation thread: '


def in_forecasts(bench, error):
    broken = raising(error)
    bench.forecaster = Forecaster(
        bench.worker, lambda: RULES, on_change=broken, make_process=broken
    )
    bench.forecaster.start()
    bench.forecaster.want(True)
    return broken, lambda: bench.forecaster.status.error, ''


def in_a_process_of_forecasts(bench, error):
    broken = raising(error)
    process = SimpleNamespace(request=broken, reply=broken, end=lambda: None)
    bench.forecaster = Forecaster(bench.worker, lambda: RULES, make_process=lambda: process)
    bench.forecaster._is_something_new = lambda: False
    bench.forecaster.start()
    bench.forecaster.want(True)
    return broken, lambda: bench.forecaster.status.error, ''


THREADS = [
    in_commands, in_the_report_of_a_snapshot, in_forecasts, in_a_process_of_forecasts,
]


@pytest.mark.parametrize('error', [OSError(22, 'Invalid'), RuntimeError('odd'), KeyError('x')])
@pytest.mark.parametrize('break_thread', THREADS)
def test_thread_reports_an_unexpected_exception_and_continues(
    bench, caplog, monkeypatch, break_thread, error
):
    monkeypatch.setattr(errors, 'REPORT_TIME', PATIENCE)
    monkeypatch.setattr(forecaster, '_RETRY_TIMES', (0.01, 0.01))
    bench.start()
    broken, reported, prefix = break_thread(bench, error)
    text = f'{prefix}{type(error).__name__}: {error}'
    bench.wait(lambda: reported() == text)
    bench.wait(lambda: any(type(error).__name__ in item.message for item in caplog.records))
    assert caplog.records[0].exc_info is not None
    broken.is_broken = False
    bench.go_on()
    bench.run(bench.worker.pause(False))
    assert bench.worker.status.state is WorkerState.RUNNING
    if hasattr(bench, 'forecaster'):
        assert bench.forecaster._thread.is_alive()
        assert bench.forecaster.stop(PATIENCE)


def test_recurring_exception_is_logged_once(caplog):
    thread = Guard('thread')
    for _ in range(3):
        thread.run(raising(OSError('odd')))
    assert thread.error == 'thread: OSError: odd'
    assert len(caplog.records) == 1


def test_expected_exception_is_left_to_its_handler(caplog):
    handled, thread = [], Guard('thread', ChildProcessError)
    for error in (LavaError('a', 1, '2'), ChildProcessError('ended')):
        thread.run(raising(error), handled.append)
    assert len(handled) == 2 and not caplog.records and thread.error == ''


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_ended_thread_is_a_failure(bench):
    bench.start()

    def end(_):
        raise SystemExit

    bench.worker.commands.get = end
    wait_until(lambda: not bench.worker._thread.is_alive())
    status = bench.worker.status
    assert status.state is WorkerState.FAILED and status.is_stale
    assert status.error == 'the thread of the simulation has ended'


def held(bench):
    """Hold the thread in a command, and return its future."""
    bench.simulation.is_compiled.clear()
    future = bench.worker.set_effects({}, horizon=1.0)
    bench.wait(lambda: bench.worker.status.current_task == 'effects')
    return future


def test_burst_of_vents_is_one_change(bench):
    bench.start()
    changes, set_vents = [], bench.simulation.set_vents
    bench.simulation.set_vents = lambda vents: (changes.append(len(vents)), set_vents(vents))
    future = held(bench)
    more = [Vent((5.0 + number % 40, 15.0), 2.0, 1360.0) for number in range(300)]
    added = [bench.worker.add_vent(vent) for vent in more[:200]]
    refused = bench.worker.add_vent(OUTSIDE)
    added += [bench.worker.add_vent(vent) for vent in more[200:]]
    bench.simulation.is_compiled.set()
    bench.run(future)
    for item in added:
        bench.run(item)
    with pytest.raises(LavaError, match='position'):
        bench.run(refused)
    assert changes == [301]
    assert bench.worker.view.scene.vents == (VENT, *more)


def test_vents_keep_their_order_with_other_commands(bench):
    bench.start()
    future = held(bench)
    one, two, three = (Vent((place, 15.0), 2.0, 1360.0) for place in (5.0, 15.0, 35.0))
    futures = [bench.worker.add_vent(one), bench.worker.set_vents([two])]
    futures.append(bench.worker.add_vent(three))
    bench.simulation.is_compiled.set()
    for item in (future, *futures):
        bench.run(item)
    assert bench.worker.view.scene.vents == (two, three)


def test_only_vents_whose_sum_is_too_large_are_refused(bench):
    bench.start()
    given = bench.simulation.set_vents

    def set_vents(vents):
        if sum(vent.peak for vent in vents) > 10.0:
            raise LavaError('vents', len(vents), 'a smaller sum')
        given(vents)

    bench.simulation.set_vents = set_vents
    future = held(bench)
    added = [bench.worker.add_vent(VENT) for _ in range(7)]
    bench.simulation.is_compiled.set()
    bench.run(future)
    wait_until(lambda: all(item.done() for item in added))
    assert [item.exception() is None for item in added] == 4 * [True] + 3 * [False]
    assert len(bench.worker.view.scene.vents) == 5


def test_simulation_advances_between_slow_commands(bench, monkeypatch):
    bench.start()
    clock = SimpleNamespace(now=0.0, monotonic=lambda: clock.now, sleep=lambda _: None)
    monkeypatch.setattr(worker, 'time', clock)
    future, times = held(bench), []

    def work():
        # half of the time of a round
        clock.now += 0.5 * worker.MAX_ROUND_WALL_TIME
        bench.now += 0.5
        times.append(bench.simulation.time)

    futures = [bench.worker.commands.submit(work) for _ in range(20)]
    bench.simulation.is_compiled.set()
    for item in (future, *futures):
        bench.run(item)
    assert len(set(times)) >= 8


def test_other_threads_read_a_consistent_view(bench):
    bench.start()
    before = bench.worker.view
    bench.run(bench.worker.set_vents([]))
    after = bench.worker.view
    assert (before.scene.vents, before.schedule) == ((VENT,), (VENT,))
    assert after.scene.vents == () and after.changes == before.changes + 1
    assert after.device == 'paper' and before.scene.terrain is TERRAIN
