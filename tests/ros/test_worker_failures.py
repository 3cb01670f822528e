# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The worker when something fails or waits, its commands, and snapshots on their way."""

from concurrent.futures import Future
import queue
import threading

import pytest

from lava_ros.errors import LavaError
from lava_ros.ros.worker_status import Command, CommandQueue, WorkerState
from lava_ros.scene import Vent
from worker_bench import Bench, PATIENCE, TERRAIN, VENT


@pytest.mark.parametrize(
    ('failure', 'text'),
    [
        (RuntimeError('device lost'), 'RuntimeError: device lost'),
        # what Warp raises is told with what helps
        (
            RuntimeError("Failed to allocate 64 bytes on device 'cuda:0'"),
            'out of memory with 0 particles on 5 x 4 cells: Failed to allocate 64 bytes on device '
            "'cuda:0'; a larger spacing or a coarser terrain needs less",
        ),
    ],
)
def test_a_failure_is_reported_and_reset_recovers(bench, failure, text):
    """An exception in the thread is a state; the last snapshot stays; reset starts again."""
    bench.start()
    last = bench.worker.latest
    bench.simulation.failure = failure
    bench.now += 0.5
    bench.wait_for_state(WorkerState.FAILED)
    assert bench.worker.status.error == text
    assert bench.worker.latest is last
    bench.run(bench.worker.set_vents([]))
    assert bench.worker.status.state is WorkerState.FAILED
    bench.run(bench.worker.reset())
    bench.wait_for_state(WorkerState.RUNNING)
    assert bench.worker.status.error == ''
    assert bench.simulation.scene.vents == ()


def test_a_failed_start_is_reported(bench):
    """So is an exception that is not about input when a simulation is made."""
    bench.refusal = MemoryError('too large')
    with pytest.raises(MemoryError):
        bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait_for_state(WorkerState.FAILED)
    assert 'too large' in bench.worker.status.error


@pytest.mark.parametrize('bench', [{'max_particles': 10}], indirect=True)
def test_too_many_particles(bench):
    """Beyond the limit the simulation fails and shows what it had; a higher limit helps."""
    bench.start()
    bench.simulation.particle_count = 10
    bench.go_on()
    bench.simulation.particle_count = 11
    bench.now += 0.5
    bench.wait_for_state(WorkerState.FAILED)
    assert bench.worker.status.error.startswith('11 particles, expected at most 10 (max_part')
    assert bench.worker.latest.time == pytest.approx(1.0)
    bench.run(bench.worker.set('max_particles', 20))
    bench.run(bench.worker.reset())
    bench.simulation.particle_count = 11
    bench.go_on()


@pytest.mark.parametrize('bench', [{'speed': 1.0, 'time_scale': 1000.0}], indirect=True)
def test_commands_are_quick_under_load(bench):
    """A busy simulation takes a command between two slices, long before it has caught up."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.now += 1.0
    bench.wait(lambda: bench.worker._target == 1000.0)
    # Catching up with the clock would take a thousand seconds.
    bench.run(bench.worker.set_vents([VENT]))


def test_a_flood_of_vents_is_coalesced(bench):
    """Of what waits the newest counts; simulated time goes on; nothing piles up."""
    bench.start()
    given, set_vents = [], bench.simulation.set_vents
    goes_on = threading.Event()

    def slow_set_vents(vents):
        given.append(vents[0].discharge)
        assert goes_on.wait(60.0)
        set_vents(vents)

    bench.simulation.set_vents = slow_set_vents
    futures = []
    for batch in range(5):
        goes_on.clear()
        for index in range(100):
            futures.append(bench.worker.set_vents([Vent((25.0, 15.0), 100.0 * batch + 1 + index)]))
            assert len(bench.worker._commands) < 10
            if index == 0:
                bench.wait(lambda: given[-1:] == [100.0 * batch + 1])  # noqa: B023
        goes_on.set()
        bench.run(futures[-1])
        bench.now += 0.1
        bench.wait(lambda: bench.simulation.time == pytest.approx(0.1 * (batch + 1)))  # noqa: B023
    assert given == [1.0, 100.0, 101.0, 200.0, 201.0, 300.0, 301.0, 400.0, 401.0, 500.0]
    assert bench.simulation.scene.vents[0].discharge == 500.0
    assert all(future.done() for future in futures)
    assert sum(not future.cancelled() for future in futures) == len(given)


def test_snapshots_come_on_request(bench):
    """A request renews the snapshot once there is something new, and says so once."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait(lambda: len(bench.shown) == 1)
    bench.worker.request_snapshot()
    # whatever was asked for before this is done then
    bench.run(bench.worker.pause(False))
    assert len(bench.shown) == 1
    bench.go_on()
    assert len(bench.shown) == 1
    bench.worker.request_snapshot()
    bench.wait(lambda: len(bench.shown) == 2)
    assert bench.shown[-1].time == pytest.approx(0.5)


def test_stop_answers_what_waits():
    """Commands that were not run hold the reason, those that come later too."""
    bench = Bench()
    waiting = bench.worker.set_vents([VENT])
    bench.run(bench.worker.pause(False))
    assert bench.worker.stop(60.0)
    for future in (waiting, bench.worker.set_vents([VENT]), bench.worker.reset()):
        with pytest.raises(LavaError, match="'stopped'"):
            future.result(0.0)
    assert bench.worker.status.state is WorkerState.STOPPED


def test_stop_answers_at_once_what_a_step_keeps_waiting():
    """A step that does not end keeps nobody waiting for an answer."""
    bench = Bench()
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.simulation.is_compiled.clear()
    compiling = bench.worker.set_effects({}, horizon=3600.0)
    bench.wait(lambda: len(bench.worker._commands) == 0)
    waiting = bench.worker.reset()
    assert not bench.worker.stop(0.0)
    with pytest.raises(LavaError, match="'stopped'"):
        waiting.result(0.0)
    bench.simulation.is_compiled.set()
    bench.run(compiling)
    assert bench.worker.stop(60.0)


@pytest.fixture
def copying(bench):
    """A simulation half a second old, of which a snapshot is on its way and does not come."""
    bench.start()
    bench.go_on()
    bench.simulation.is_copied.clear()
    bench.worker.request_snapshot()
    bench.wait(lambda: bench.simulation.begun == 1)
    yield bench
    for simulation in bench.made:
        simulation.is_copied.set()


def test_the_simulation_goes_on_meanwhile(copying):
    """Time passes while it is on its way, and what is shown then is of the moment it was begun."""
    shown = len(copying.shown)
    copying.go_on()
    assert copying.worker.latest.time == 0.0
    copying.simulation.is_copied.set()
    copying.wait(lambda: len(copying.shown) > shown)
    assert copying.shown[-1].time == pytest.approx(0.5)
    assert copying.worker.latest is copying.shown[-1]


def test_what_is_asked_for_meanwhile_comes_next(copying):
    """However often: one more is begun when the first is there, and none is lost."""
    for _ in range(3):
        copying.go_on()
        copying.worker.request_snapshot()
    assert copying.simulation.begun == 1
    copying.simulation.is_copied.set()
    copying.wait(lambda: copying.worker.latest.time == pytest.approx(2.0))
    assert copying.simulation.begun == 2


def test_what_is_no_map_is_not_shown(bench):
    """A flaw fails the simulation as soon as it shows; the snapshot before it stays."""
    bench.start()
    last = bench.worker.latest
    bench.simulation.flawed = True
    bench.go_on()
    bench.simulation.is_copied.clear()
    bench.worker.request_snapshot()
    bench.wait(lambda: bench.simulation.begun == 1)
    bench.go_on()
    assert bench.worker.status.state is WorkerState.RUNNING
    bench.simulation.is_copied.set()
    bench.wait_for_state(WorkerState.FAILED)
    assert 'thickness is not a number of metres in 20 cells' in bench.worker.status.error
    assert bench.worker.latest is last
    bench.run(bench.worker.reset())
    bench.wait_for_state(WorkerState.RUNNING)


def test_a_flaw_of_the_former_simulation_is_none_of_the_next(bench):
    """A reset meanwhile: the new simulation runs, and shows itself."""
    bench.start()
    bench.simulation.flawed = True
    bench.go_on()
    former = bench.simulation
    former.is_copied.clear()
    bench.worker.request_snapshot()
    bench.wait(lambda: former.begun == 1)
    reset = bench.worker.reset()
    bench.wait(lambda: len(bench.made) == 2)
    former.is_copied.set()
    bench.run(reset)
    # the previous snapshot queues its command before this one
    bench.worker._finisher.submit(int).result(PATIENCE)
    bench.run(bench.worker.pause(False))
    bench.wait_for_state(WorkerState.RUNNING)
    assert bench.worker.latest.time == 0.0


def test_what_is_at_rest_has_been_waited_for(copying):
    """A pause shows the state that stands still, not the one that was on its way."""
    copying.go_on()
    copying.worker.pause(True)
    # the pause has begun to wait for it
    copying.wait(lambda: copying.worker._finishing is None)
    assert copying.worker.latest.time == 0.0
    copying.simulation.is_copied.set()
    copying.wait_for_state(WorkerState.PAUSED)
    assert copying.worker.latest.time == pytest.approx(1.0)
    copying.wait(lambda: copying.shown[-1].time == pytest.approx(1.0))


def test_the_end_waits_for_it(copying):
    """Stopping leaves no thread behind."""
    copying.simulation.is_copied.set()
    assert copying.worker.stop(60.0)
    assert copying.worker.latest.time == pytest.approx(0.5)


def put(commands, name, kind=''):
    """Add a command that is nothing but its name."""
    future = Future()
    commands.put(Command(name, future, kind))
    return future


def taken(commands):
    """The names of all that wait, oldest first."""
    return [commands.get(0.0).action for _ in range(len(commands))]


def test_the_newest_of_a_kind_replaces_the_one_that_waits():
    """The older one is cancelled; the newer one comes after what was put between them."""
    commands = CommandQueue()
    old = put(commands, 'old vents', 'vents')
    put(commands, 'terrain', 'terrain')
    put(commands, 'step')
    new = put(commands, 'new vents', 'vents')
    assert old.cancelled()
    assert not new.done()
    assert taken(commands) == ['terrain', 'step', 'new vents']
    later = put(commands, 'later vents', 'vents')
    assert not later.done()
    assert taken(commands) == ['later vents']
    with pytest.raises(queue.Empty):
        commands.get(0.0)


def test_too_many_are_refused():
    """Beyond the limit a command is refused, but for one that has a kind."""
    commands = CommandQueue(limit=3)
    for _ in range(3):
        put(commands, 'click')
    refused = put(commands, 'click')
    with pytest.raises(LavaError, match='3 waiting'):
        refused.result(0.0)
    for _ in range(100):
        put(commands, 'vents', 'vents')
    assert len(commands) == 4


def test_a_callback_may_put_another():
    """What a cancelled or refused command calls back may use the queue."""
    commands = CommandQueue(limit=1)
    first = put(commands, 'vents', 'vents')
    first.add_done_callback(lambda _: put(commands, 'from callback'))
    put(commands, 'vents', 'vents')
    assert first.cancelled()
    refused = Future()
    refused.add_done_callback(lambda _: put(commands, 'terrain', 'terrain'))
    commands.put(Command('click', refused, ''))
    assert taken(commands) == ['vents', 'terrain']
