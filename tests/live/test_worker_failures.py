# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The worker: failures, waiting commands, and snapshots in progress."""

from concurrent.futures import Future

import pytest

from lava_ros.errors import LavaError
from lava_ros.live.commands import Command, CommandQueue
from lava_ros.live.worker_status import WorkerState
from waiting import PATIENCE
from worker_bench import Bench, TERRAIN, VENT


@pytest.mark.parametrize(
    ('failure', 'text'),
    [
        (RuntimeError('device lost'), 'RuntimeError: device lost'),
        # an error of Warp has a remedy
        (
            RuntimeError("Failed to allocate 64 bytes on device 'cuda:0'"),
            'out of memory with 0 particles on a terrain of 5 x 4 cells: Failed to allocate 64 '
            "bytes on device 'cuda:0'; a larger spacing or a coarser terrain needs less",
        ),
    ],
)
def test_failure_is_reported_and_reset_recovers(bench, failure, text):
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


def test_failed_start_is_reported(bench):
    bench.refusal = MemoryError('too large')
    with pytest.raises(MemoryError):
        bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait_for_state(WorkerState.FAILED)
    assert 'too large' in bench.worker.status.error


@pytest.mark.parametrize('bench', [{'max_particles': 10}], indirect=True)
def test_simulation_fails_above_max_particles(bench):
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
def test_busy_simulation_runs_commands_between_slices(bench):
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.now += 1.0
    bench.wait(lambda: bench.worker.pace.target == 1000.0)
    # it would take 1000 s to catch up with the clock
    bench.run(bench.worker.set_vents([VENT]))


def test_snapshot_is_updated_on_request(bench):
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait(lambda: len(bench.shown) == 1)
    bench.worker.request_snapshot()
    # earlier requests are complete by then
    bench.run(bench.worker.pause(False))
    # a layer that becomes due between two steps may not have shown this state
    assert len(bench.shown) == 2 and bench.shown[0] is bench.shown[1]
    bench.go_on()
    assert len(bench.shown) == 2
    bench.worker.request_snapshot()
    bench.wait(lambda: len(bench.shown) == 3)
    assert bench.shown[-1].time == pytest.approx(0.5)


def test_stop_fails_waiting_and_later_commands():
    bench = Bench()
    waiting = bench.worker.set_vents([VENT])
    bench.run(bench.worker.pause(False))
    assert bench.worker.stop(PATIENCE)
    for future in (waiting, bench.worker.set_vents([VENT]), bench.worker.reset()):
        with pytest.raises(LavaError, match='simulation has stopped'):
            future.result(0.0)
    assert bench.worker.status.state is WorkerState.STOPPED


def test_stop_fails_waiting_commands_during_a_step():
    bench = Bench()
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.simulation.is_compiled.clear()
    compiling = bench.worker.set_effects({}, horizon=3600.0)
    bench.wait(lambda: len(bench.worker.commands) == 0)
    waiting = bench.worker.reset()
    assert not bench.worker.stop(0.0)
    with pytest.raises(LavaError, match='simulation has stopped'):
        waiting.result(0.0)
    bench.simulation.is_compiled.set()
    bench.run(compiling)
    assert bench.worker.stop(PATIENCE)


@pytest.fixture
def copying(bench):
    bench.start()
    bench.go_on()
    bench.simulation.is_copied.clear()
    bench.worker.request_snapshot()
    bench.wait(lambda: bench.simulation.begun == 1)
    yield bench
    for simulation in bench.made:
        simulation.is_copied.set()


def test_requests_during_a_snapshot_start_one_more(copying):
    shown = len(copying.shown)
    for _ in range(3):
        copying.go_on()
        copying.worker.request_snapshot()
    assert copying.simulation.begun == 1 and copying.worker.latest.time == 0.0
    copying.simulation.is_copied.set()
    copying.wait(lambda: copying.worker.latest.time == pytest.approx(2.0))
    assert copying.simulation.begun == 2
    assert [item.time for item in copying.shown[shown:]] == pytest.approx([0.5, 2.0])


def test_invalid_map_fails_the_simulation_and_is_not_shown(bench):
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


def test_flaw_of_the_previous_simulation_does_not_fail_the_next(bench):
    bench.start()
    bench.simulation.flawed = True
    bench.go_on()
    previous = bench.simulation
    previous.is_copied.clear()
    bench.worker.request_snapshot()
    bench.wait(lambda: previous.begun == 1)
    reset = bench.worker.reset()
    bench.wait(lambda: len(bench.made) == 2)
    previous.is_copied.set()
    bench.run(reset)
    # the previous snapshot has queued its command by then
    bench.worker._finisher.submit(int).result(PATIENCE)
    bench.run(bench.worker.pause(False))
    bench.wait_for_state(WorkerState.RUNNING)
    assert bench.worker.latest.time == 0.0


def test_pause_shows_the_final_state(copying):
    copying.go_on()
    copying.worker.pause(True)
    # the pause waits for the snapshot
    copying.wait(lambda: copying.worker._finishing is None)
    assert copying.worker.latest.time == 0.0
    copying.simulation.is_copied.set()
    copying.wait_for_state(WorkerState.PAUSED)
    assert copying.worker.latest.time == pytest.approx(1.0)
    copying.wait(lambda: copying.shown[-1].time == pytest.approx(1.0))


def test_stop_waits_for_the_snapshot(copying):
    copying.simulation.is_copied.set()
    assert copying.worker.stop(PATIENCE)
    assert copying.worker.latest.time == pytest.approx(0.5)


def put(commands, name, kind=''):
    future = Future()
    commands.put(Command(name, future, kind))
    return future


def waiting_actions(commands):
    return [commands.get(0.0)[0].action for _ in range(len(commands))]


def test_rejects_too_many_commands():
    commands = CommandQueue(limit=3)
    for _ in range(3):
        put(commands, 'click')
    refused = put(commands, 'click')
    with pytest.raises(LavaError, match='3 commands are waiting'):
        refused.result(0.0)
    for _ in range(100):
        put(commands, 'vents', 'vents')
    assert len(commands) == 4


def test_callback_may_add_a_command():
    commands = CommandQueue(limit=1)
    first = put(commands, 'vents', 'vents')
    first.add_done_callback(lambda _: put(commands, 'from callback'))
    put(commands, 'vents', 'vents')
    assert first.cancelled()
    refused = Future()
    refused.add_done_callback(lambda _: put(commands, 'terrain', 'terrain'))
    commands.put(Command('click', refused, ''))
    assert waiting_actions(commands) == ['vents', 'terrain']
