# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The worker without ROS: simulated time and the clock, changing scenes, and effects."""

from dataclasses import asdict, replace
from functools import partial
import time

import numpy as np
import pytest

from lava_ros.bag.description import effect_table, is_on
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.live.catch_up import Published
from lava_ros.live.session import Origin
from lava_ros.live.worker import SimulationWorker
from lava_ros.live.worker_status import MAX_TASK_DURATION, WorkerState
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.selection import decide, effects_for, HORIZON
from waiting import PATIENCE
from worker_bench import OUTSIDE, TERRAIN, VENT


def test_terrain_starts_the_simulation(bench):
    assert bench.worker.status.state is WorkerState.WAITING
    assert bench.worker.latest is None
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait_for_state(WorkerState.RUNNING)
    assert bench.worker.latest.time == 0.0
    assert bench.worker.status.device == 'paper'


def test_pause_holds_time_and_a_step_is_exact(bench):
    with pytest.raises(LavaError, match='is waiting for terrain. Publish a terrain first'):
        bench.run(bench.worker.step(1.0))
    bench.run(bench.worker.set_terrain(TERRAIN))
    with pytest.raises(LavaError, match='Pause it first'):
        bench.run(bench.worker.step(1.0))
    bench.go_on()
    bench.run(bench.worker.pause(True))
    bench.wait_for_state(WorkerState.PAUSED)
    bench.wait(lambda: bench.worker.latest.time == pytest.approx(0.5))
    bench.now += 0.5
    time.sleep(0.25)
    assert bench.simulation.time == pytest.approx(0.5)
    bench.run(bench.worker.step(10.0))
    bench.wait(lambda: bench.worker.latest.time == pytest.approx(10.5))
    assert bench.worker.status.state is WorkerState.PAUSED
    bench.run(bench.worker.pause(False))
    bench.go_on(0.25)


@pytest.mark.parametrize('bench', [{'speed': 20.0}], indirect=True)
def test_steps_that_follow_each_other_add_up(bench):
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.run(bench.worker.pause(True))
    begin = bench.simulation.time
    for _ in range(3):
        bench.run(bench.worker.step(8.0))
    bench.wait(lambda: bench.worker.pace.step_target is None)
    assert bench.simulation.time - begin == pytest.approx(24.0)


@pytest.mark.parametrize('bench', [{'speed': 20.0}], indirect=True)
def test_pause_ends_a_step(bench):
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.go_on()
    bench.run(bench.worker.pause(True))
    bench.run(bench.worker.step(1e6))
    bench.wait(lambda: bench.simulation.time > 1.0)
    bench.run(bench.worker.pause(True))
    bench.wait(lambda: bench.worker.status.lag <= 0.0)
    bench.run(bench.worker.pause(False))
    # the rest of the step is not made up for
    bench.go_on(0.25)


@pytest.mark.parametrize('bench', [{'end_time': 2.0, 'time_scale': 10.0}], indirect=True)
def test_simulation_stops_at_the_end_time(bench):
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.now += 0.9
    bench.wait_for_state(WorkerState.FINISHED)
    bench.wait(lambda: bench.worker.latest.time == 2.0)
    with pytest.raises(LavaError, match='is finished. Raise end_time'):
        bench.run(bench.worker.step(1.0))
    bench.run(bench.worker.set('end_time', 5.0))
    bench.wait_for_state(WorkerState.RUNNING)
    bench.now += 0.9
    bench.wait(lambda: bench.worker.latest.time == 5.0)
    bench.run(bench.worker.reset())
    bench.wait_for_state(WorkerState.RUNNING)
    assert bench.simulation.time < 5.0


def test_reset_makes_a_new_simulation_at_time_0(bench):
    with pytest.raises(LavaError, match='reset'):
        bench.run(bench.worker.reset())
    bench.start()
    bench.go_on()
    bench.run(bench.worker.pause(True))
    bench.run(bench.worker.set_constants({'lava': Lava.paper(viscosity=7.0)}))
    bench.run(bench.worker.reset())
    assert len(bench.made) == 2
    assert bench.simulation.scene.vents == (VENT,)
    assert bench.simulation.scene.lava.viscosity == 7.0
    assert bench.worker.latest.time == 0.0
    bench.wait_for_state(WorkerState.PAUSED)


@pytest.mark.parametrize(
    'kind', ['pause', 'step', 'reset', 'vents', 'terrain', 'effects', 'snapshot']
)
def test_waiting_command_is_replaced_by_the_next_of_its_kind(bench, kind):
    bench.start()
    bench.simulation.is_compiled.clear()
    held = bench.worker.set_effects({}, horizon=1.0)
    bench.wait(lambda: bench.worker.status.current_task == 'effects')
    ask = {
        'pause': partial(bench.worker.pause, True),
        'step': partial(bench.worker.step, 1.0),
        'reset': bench.worker.reset,
        'vents': partial(bench.worker.set_vents, [VENT]),
        'terrain': partial(bench.worker.set_terrain, TERRAIN),
        'effects': partial(bench.worker.set_effects, {}, horizon=1.0),
        'snapshot': bench.worker.request_snapshot,
    }[kind]
    for _ in range(400):
        ask()
    assert bench.worker.status.waiting == (kind,)
    assert len(bench.worker.commands) == 1
    bench.simulation.is_compiled.set()
    bench.run(held)


def test_status_has_the_current_task_and_waiting_commands(bench):
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait(lambda: bench.worker.status.blocked_by == '')
    bench.simulation.is_compiled.clear()
    futures = [bench.worker.set_effects({}, horizon=3600.0)]
    bench.wait(lambda: bench.worker.status.current_task == 'effects')
    futures.append(bench.worker.reset())
    before = bench.worker.status
    bench.wait(lambda: bench.worker.status.task_duration > before.task_duration)
    assert before.waiting == ('reset',)
    bench.simulation.is_compiled.set()
    for future in futures:
        bench.run(future)
    bench.simulation.slowness = MAX_TASK_DURATION
    bench.now += 0.5
    bench.wait(lambda: bench.worker.status.task_duration >= MAX_TASK_DURATION)
    assert bench.worker.status.blocked_by.startswith('a step takes ')
    bench.simulation.slowness = 0.0
    bench.go_on()
    bench.wait(lambda: bench.worker.status.blocked_by == '')


def test_newest_vents_wait_for_the_terrain(bench):
    first = bench.worker.set_vents([OUTSIDE])
    second = bench.worker.set_vents([VENT])
    bench.wait(first.cancelled)
    assert not second.done()
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.run(second)
    assert bench.simulation.scene.vents == (VENT,)


def test_rejects_waiting_vents_off_the_terrain(bench):
    vents = bench.worker.set_vents([OUTSIDE])
    bench.run(bench.worker.set_terrain(TERRAIN))
    with pytest.raises(LavaError, match=r'vents\[0\].position'):
        bench.run(vents)
    assert bench.simulation.scene.vents == ()


def test_first_vents_restart_the_simulation(bench):
    """The resolution depends on the vents."""
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.go_on()
    bench.run(bench.worker.set_vents([VENT]))
    assert len(bench.made) == 2
    assert bench.simulation.scene.vents == (VENT,)
    bench.go_on()
    bench.run(bench.worker.set_vents([]))
    bench.run(bench.worker.add_vent(VENT))
    assert len(bench.made) == 2
    assert bench.worker.session.scene.vents == bench.simulation.scene.vents == (VENT,)


@pytest.mark.parametrize(
    ('kind', 'noise', 'change'),
    [
        ('vents', [replace(VENT, discharge=VENT.peak * 1.01)], [replace(VENT, discharge=9.0)]),
        ('vents', [replace(VENT, temperature=VENT.temperature + 1.0)], []),
        ('vents', [VENT], [VENT, VENT]),
        (
            'terrain',
            replace(TERRAIN, elevation=TERRAIN.elevation + 0.05),
            replace(TERRAIN, elevation=TERRAIN.elevation + 0.2),
        ),
    ],
)
def test_noise_of_inputs_does_not_outdate_forecasts(bench, kind, noise, change):
    session, put = bench.worker.session, getattr(bench.worker, f'set_{kind}')
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.run(bench.worker.set_vents([VENT]))
    before = session.view.changes
    bench.run(put(noise))
    assert session.view.changes == before
    given = bench.simulation.scene
    assert (given.terrain if kind == 'terrain' else list(given.vents)) == noise
    bench.run(put(change))
    assert session.view.changes == before + 1


def test_slow_drift_outdates_forecasts(bench):
    session = bench.worker.session
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.run(bench.worker.set_vents([VENT]))
    before = session.view.changes
    for step in range(1, 11):
        discharge = VENT.peak * (1.0 + 0.02 * step)
        bench.run(bench.worker.set_vents([replace(VENT, discharge=discharge)]))
    assert before < session.view.changes < before + 10


def test_origin_and_schedule_are_kept_until_a_reset(bench):
    assert bench.worker.session.view.origin is None
    earlier = replace(VENT, discharge=((0.0, 7.0), (2.0, 9.0)))
    scene, origin = Scene(TERRAIN, (VENT,), lava=Lava.paper()), Origin('bags/first', 120.0, 7)
    bench.run(bench.worker.pause(True))
    bench.run(bench.worker.resume_with(lambda: bench.make(scene), scene, origin, (earlier,)))
    assert bench.worker.session.view.origin == origin
    bench.run(bench.worker.set_vents([replace(VENT, discharge=4.0)]))
    assert bench.worker.session.scene.vents[0].discharge == 4.0
    bench.simulation.time = 3.0
    bench.run(bench.worker.set_vents([]))
    (vent,) = bench.worker.session.view.schedule
    assert vent.discharge == ((0.0, 4.0), (3.0, 0.0))
    assert bench.worker.session.view.origin == origin
    # a reset starts a new eruption
    bench.run(bench.worker.reset())
    assert bench.worker.session.view.schedule == ()
    assert bench.worker.session.view.origin is None


@pytest.mark.parametrize(
    ('bench', 'reached', 'expected'),
    [({}, 0.0, 7.0), ({}, 5.0, 7.0), ({}, 40.0, 40.0), ({'end_time': 30.0}, 40.0, 30.0)],
    indirect=['bench'],
)
def test_resumed_simulation_catches_up_before_it_is_shown(bench, reached, expected):
    scene = Scene(TERRAIN, (VENT,), lava=Lava.paper())

    def resume():
        simulation = bench.make(scene)
        simulation.time = 7.0
        return simulation

    bench.run(bench.worker.pause(True))
    bench.run(bench.worker.resume_with(resume, scene, published=Published(reached)))
    bench.wait(lambda: bench.shown)
    assert bench.simulation.time == bench.shown[0].time == expected


@pytest.mark.parametrize(
    ('published', 'expected'),
    [
        (None, 7.0),
        (Published(40.0), 40.0),
        # 1200 s before the restart, at twice the speed of the clock; more than a lag that is lost
        (Published(40.0, 100.0 - 1200.0), 2440.0),
        # a clock that has gone back, and one that was wrong by years
        (Published(40.0, 3700.0), 40.0),
        (Published(40.0, -1e9), 40.0),
    ],
)
@pytest.mark.parametrize('bench', [{'time_scale': 2.0, 'speed': 1000.0}], indirect=True)
def test_resumed_simulation_catches_up_with_the_clock(bench, published, expected):
    scene, worker = Scene(TERRAIN, (VENT,), lava=Lava.paper()), bench.worker

    def resume():
        simulation = bench.make(scene)
        simulation.time = 7.0
        return simulation

    bench.run(worker.pause(True))
    bench.run(worker.resume_with(resume, scene, published=published))
    bench.run(worker.pause(False))
    bench.wait(lambda: not worker.status.is_catching_up and bench.simulation.time >= expected)
    assert bench.simulation.time == expected
    bench.now += 5.0
    bench.wait(lambda: bench.simulation.time > expected)
    bench.wait(lambda: bench.simulation.time == expected + 10.0)
    is_wrong = published is not None and published.clock in (3700.0, -1e9)
    assert worker.status.jumps == is_wrong
    assert is_wrong or worker.status.lost == 0.0
    # a new start has nothing to catch up with
    bench.run(worker.reset())
    assert not worker.status.is_catching_up


@pytest.mark.parametrize('bench', [{'speed': 1000.0}], indirect=True)
def test_simulation_that_catches_up_says_so(bench):
    scene, worker = Scene(TERRAIN, (VENT,), lava=Lava.paper()), bench.worker
    made = bench.make(scene)
    made.speed = 1e-3
    bench.run(worker.pause(True))
    bench.run(worker.resume_with(lambda: made, scene, published=Published(0.0, 100.0 - 3600.0)))
    bench.run(worker.pause(False))
    bench.wait(lambda: worker.status.is_catching_up)
    status = worker.status
    assert status.is_stale and status.age == pytest.approx(3600.0, abs=1.0)
    # a pause gives the lag up
    bench.run(worker.pause(True))
    made.speed = None
    bench.run(worker.pause(False))
    bench.wait(lambda: not worker.status.is_catching_up)
    assert worker.status.lost == pytest.approx(3600.0, abs=1.0)


def test_rejected_inputs_change_nothing(bench):
    with pytest.raises(LavaError, match='Publish a terrain first'):
        bench.run(bench.worker.add_vent(VENT))
    bench.start()
    for command in (
        bench.worker.set_vents([OUTSIDE]),
        bench.worker.add_vent(OUTSIDE),
        bench.worker.set_terrain(Terrain(np.zeros((4, 5)), 1.0, origin=(900.0, 0.0))),
    ):
        with pytest.raises(LavaError, match='position'):
            bench.run(command)
    assert bench.worker.session.scene.vents == bench.simulation.scene.vents == (VENT,)
    assert bench.simulation.scene.terrain is TERRAIN
    bench.go_on()


def test_rejected_reset_keeps_the_old_simulation(bench):
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.refusal = LavaError('device', 'cuda:9', 'one of cpu')
    with pytest.raises(LavaError, match='cuda:9'):
        bench.run(bench.worker.reset())
    bench.wait_for_state(WorkerState.RUNNING)
    bench.now += 0.5
    bench.wait(lambda: bench.made[0].time == pytest.approx(0.5))


def test_new_terrain_is_shown_immediately(bench):
    bench.run(bench.worker.set_terrain(TERRAIN))
    bench.run(bench.worker.pause(True))
    other, same = (Terrain(np.ones((7, 6)), 10.0) for _ in range(2))
    for terrain in (other, same):
        bench.run(bench.worker.set_terrain(terrain))
        assert bench.worker.latest.terrain is bench.simulation.scene.terrain is other


def test_effects_follow_terrain_and_vents(bench):
    assert bench.worker.session.view.effects == {}
    bench.start()
    before = bench.worker.session.view.effects
    assert not is_on(before['steep'])
    bench.run(bench.worker.set_vents([Vent((25.0, 15.0), 2.0, temperature=1300.0)]))
    assert bench.worker.session.view.effects['inertia'] != before['inertia']
    hill = np.tile(np.arange(5) * 8.0, (4, 1))
    bench.run(bench.worker.set_terrain(Terrain(hill, 10.0)))
    assert bench.worker.session.view.effects['steep'].startswith('on: slope = 0.8 > ')


def test_effects_can_be_forced_during_a_run(bench):
    bench.run(bench.worker.set_effects({'steep': True}, horizon=60.0))
    bench.start()
    bench.run(bench.worker.set_effects({'steep': True}, horizon=60.0))
    assert bench.worker.session.view.effects['steep'] == 'on: forced'
    with pytest.raises(LavaError, match='vft'):
        bench.run(bench.worker.set_effects({'vft': True}, horizon=HORIZON))
    assert bench.worker.session.view.effects['steep'] == 'on: forced'
    assert bench.simulation.horizon == 60.0
    bench.go_on()
    assert len(bench.made) == 1


def _scene(slope=0.5, **material):
    x = 10.0 * np.arange(30)
    terrain = Terrain(np.tile(500.0 - slope * x, (20, 1)), 10.0)
    return Scene(terrain, (Vent((50.0, 100.0), 20.0),), Lava.paper(**material))


def test_every_effect_has_a_reason():
    scene = _scene()

    def table(**forced):
        return effect_table(effects_for(scene, forced), decide(scene, forced))

    known = table()
    assert {name: is_on(text) for name, text in known.items()} == asdict(effects_for(scene))
    assert known['steep'].startswith('on: slope = 0.5 > 0.087')
    assert known['yielding'] == 'off: the material has none'
    assert known['merging'] == 'off: never chosen automatically'
    # forced
    known = table(steep=False, helmholtz=True, merging=True)
    assert known['steep'] == 'off: forced'
    assert known['helmholtz'] == known['merging'] == 'on: forced'
    scene = _scene(viscosity=20.0)
    (inertia,) = (item for item in decide(scene, {'green': True}) if item.name == 'inertia')
    known = table(green=True)
    assert known['inertia'] == f'off: {inertia.reason}'
    assert known['inertia'].endswith(', but excluded by green')
    frozen = replace(Effects(), solidification=True)
    known = effect_table(frozen, decide(_scene(solidus=1200.0), horizon=1.0))
    assert known['solidification'].startswith('on: fraction of the way to the solidus = ')
    assert known['solidification'].endswith(', but an effect stays on during a run')


def test_frames_continue_while_effects_change():
    x = 10.0 * np.arange(40)
    scene = Scene(
        Terrain(np.tile(300.0 - 0.3 * x, (30, 1)), 10.0), (Vent((60.0, 150.0), 20.0),),
        lava=Lava.paper()
    )
    frames = []
    worker = SimulationWorker(
        lambda scene: Simulation(scene, device='cpu'), clock=time.monotonic, time_scale=60.0,
        on_snapshot=lambda: frames.append(worker.latest),
    )
    worker.start()
    worker.set_scene(scene).result(PATIENCE)

    def show_frames(count):
        end, first = time.monotonic() + PATIENCE, len(frames)
        while len(frames) - first < count:
            assert time.monotonic() < end, worker.status
            worker.request_snapshot()
            time.sleep(0.1)

    show_frames(3)
    for forced in ({'helmholtz': True}, {'inertia': True}, {'steep': False}, {}):
        change = worker.set_effects(forced, horizon=HORIZON)
        show_frames(3)
        change.result(PATIENCE)
        assert {name: worker.session.view.effects[name] for name in forced} == {
            name: f'{"on" if is_on else "off"}: forced' for name, is_on in forced.items()
        }
    assert worker.stop(PATIENCE)
    times = [snapshot.time for snapshot in frames]
    assert times == sorted(times) and times[0] < times[-1]
    assert worker.status.error == ''
