# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Diagnostics and log of the node."""

from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from socket import gethostname

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
import pytest

from lava_ros.bag.decoding import Moment
from lava_ros.errors import LavaError
from lava_ros.live.checkpoint_recording import CheckpointRecording
from lava_ros.live.clock import ClockWatch, MIN_LOST, PATIENCE, WARNING_TIME
from lava_ros.live.recorder import Recorder
from lava_ros.live.recording_control import RecordingControl
from lava_ros.live.restart import RestartFile
from lava_ros.live.session import SessionView
from lava_ros.live.worker_status import WorkerState, WorkerStatus
from lava_ros.products.run_warnings import warnings_of_moments
from lava_ros.ros import diagnostics
from lava_ros.ros.input_log import InputLog
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.flow_kind import FlowKind
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.snapshot import Snapshot, StepReport
from lava_ros.simulation.resolution import Resolution

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def _values(status):
    return {item.key: item.value for item in status.values}


def _snapshot(**budget):
    terrain = Terrain(np.zeros((2, 2)), 1.0)
    amounts = {'emitted': 10.0, 'flowing': 9.5, 'waiting': 0.5, **budget}
    return Snapshot(
        time=12.5,
        terrain=terrain,
        thickness=np.array([[1.0, 0.0], [0.0, np.nan]], np.float32),
        temperature=np.zeros((2, 2), np.float32),
        budget=VolumeBudget(**amounts),
        particle_count=3,
        steps=StepReport(40, 40, 1, 0.25, 'advection'),
        # lava has left the second cell
        arrived=np.array([[1.0, 2.0], [np.nan, np.nan]], np.float32),
        inundated=np.array([[1.0, 0.5], [0.0, np.nan]], np.float32),
    )


def _worker(state=WorkerState.RUNNING, **changes):
    fields = {'error': '', 'speed': 2.0, 'mean_speed': 3.0, 'device': 'cpu'}
    return WorkerStatus(state=state, **fields | changes)


def _simulation(
    state=WorkerState.RUNNING, snapshot=None, *, is_active=True, clock=None, **changes
):
    clock = clock or {}
    return diagnostics.simulation_status(
        _worker(state, **changes), snapshot, is_active=is_active, frame_stamp_ns=99, clock=clock
    )


def _counts(log, *keys):
    return tuple(_values(log.status())[key] for key in keys)


def test_input_log_is_an_error_while_the_newest_message_is_rejected():
    log = InputLog()
    assert log.status().level == OK
    log.accept('terrain')
    log.supersede('vents')
    log.supersede('vents')
    assert (log.status().level, *_counts(log, 'superseded')) == (OK, '2')
    assert log.reject('vents', LavaError('vents.size', 9, 'at most 1'))
    status = log.status()
    assert (status.name, status.level) == ('inputs', ERROR)
    assert 'vents: vents.size is 9, expected at most 1' in status.message
    log.accept('terrain')
    assert log.status().level == ERROR
    log.accept('vents')
    assert log.status().level == WARN
    assert _counts(log, 'accepted', 'rejected', 'rejected.vents') == ('3', '1', '1')
    assert 'at most 1' in _values(log.status())['last_error']
    log.reject('message', LavaError('message', 'x', 'y'))
    assert log.status().level == ERROR
    log.downgrade('message')
    assert (log.status().level, *_counts(log, 'rejected.message')) == (WARN, '1')


def test_newest_message_of_a_topic_sets_the_level():
    log = InputLog()
    first = log.arrive()
    log.reject('vents', LavaError('vents.size', 9, 'at most 1'))
    log.accept('vents', first)
    assert log.status().level == ERROR
    log.supersede('vents')
    assert log.status().level == WARN


def test_repeated_error_is_logged_once():
    log = InputLog()
    one, other = LavaError('a', 1, 'b'), LavaError('c', 1, 'd')
    assert [log.reject('t', item) for item in (one, one, other)] == [True, False, True]
    log.accept('t')
    assert log.reject('t', other)
    assert _counts(log, 'rejected') == ('4',)


LONG = {'current_task': 'a step', 'task_duration': 3.25, 'waiting': ('reset', 'snapshot')}
LOST = {'flowing': 4.5, 'lost_over_border': 1.0, 'lost_in_no_data': 4.0}


@pytest.mark.parametrize(
    ('budget', 'worker', 'expected'),
    [
        # accounted for, but outside the map
        ({'overdue': 0.4}, {}, 'behind: 0.4 m3 of lava is overdue in the vents'),
        (
            LOST,
            {'lag': 1.0},
            '10 % of the lava was lost over the border: it is on no map; '
            '40 % of the lava was lost in no-data cells: it is on no map; '
            'running slower than the clock',
        ),
        ({}, LONG, 'a step takes 3.2 s or more; waiting for it: reset, snapshot'),
        (
            {},
            {'age': 70.0, 'max_age': 25.5},
            'the state is 70 s of simulated time old, expected at most 25.5 s: hazard and masks '
            'are not repeated',
        ),
        # a node without a clock is running, but time stands still
        ({}, {'clock': {'clock': '/clock does not', 'lost': 'time'}}, '/clock does not; time'),
    ],
)
def test_lost_lava_and_delays_are_warnings(budget, worker, expected):
    status = _simulation(snapshot=_snapshot(**budget), **worker)
    assert (status.level, status.message) == (WARN, expected)


@pytest.mark.parametrize(
    ('state', 'fields', 'expected'),
    [
        (WorkerState.RUNNING, {'fault': 'simulation thread: OSError: x'}, 'simulation thread: O'),
        (WorkerState.FAILED, {'error': 'the thread has ended'}, 'failed: the thread has ended'),
    ],
)
def test_exceptions_of_the_simulation_thread_are_errors(state, fields, expected):
    status = _simulation(state, _snapshot(), **fields)
    assert (status.level, status.message[: len(expected)]) == (ERROR, expected)


def test_simulation_values_are_those_of_the_frame():
    values = _values(_simulation(snapshot=_snapshot()))
    assert values == {
        'state': 'running', 'lifecycle': 'active', 'device': 'cpu', 'speed': '2',
        'mean_speed': '3', 'age_s': '0', 'max_age_s': '0', 'clock_lost_s': '0',
        'clock_jumps': '0', 'simulated_time_s': '12.5',
        'frame_stamp_ns': '99', 'particles': '3', 'inundated_area_m2': '1.5',
        'inundation_threshold_m': '0.1',
        'standing_area_m2': '1.0', 'volume_emitted_m3': '10.0', 'volume_flowing_m3': '9.5',
        'volume_waiting_m3': '0.5', 'volume_overdue_m3': '0.0', 'volume_solidified_m3': '0.0',
        'volume_lost_over_border_m3': '0.0', 'volume_lost_in_no_data_m3': '0.0',
        'volume_lost_in_sea_m3': '0.0',
        'volume_thin_m3': '0.0',
        'volume_error': '0.000e+00',
        'steps': '40', 'step_s': '0.25', 'step_limit': 'advection', 'step_stages': '1',
        'highest_temperature_c': '-273.15',
    }
    snapshot = _snapshot()
    placed = replace(snapshot.terrain, epsg=32633, offset=(500_000.0, 0.5))
    values = _values(_simulation(snapshot=replace(snapshot, terrain=placed)))
    system = values['epsg'], values['offset_easting'], values['offset_northing']
    assert system == ('32633', '500000.0', '0.5')


@pytest.mark.parametrize(
    ('state', 'changes', 'level', 'expected'),
    [
        (WorkerState.WAITING, {}, WARN, 'waiting for terrain'),
        (WorkerState.RUNNING, {}, OK, 'running'),
        (WorkerState.RUNNING, {'lag': 1.0}, WARN, 'running slower'),
        (
            WorkerState.RUNNING, {'lag': 1.0, 'is_catching_up': True, 'age': 658.0}, WARN,
            'catching up after a restart: 658 s of simulated time behind',
        ),
        # a step or command that takes longer than ten slices, except while starting
        (WorkerState.RUNNING, {**LONG, 'task_duration': 0.9}, OK, 'running'),
        (WorkerState.STARTING, LONG, OK, 'starting'),
        (WorkerState.PAUSED, {}, OK, 'paused'),
        (WorkerState.PAUSED, {'is_active': False}, OK, 'inactive: paused'),
        (WorkerState.FAILED, {'error': 'boom'}, ERROR, 'failed: boom'),
        (WorkerState.FAILED, {'error': 'x', 'is_active': False}, ERROR, 'inactive: failed: x'),
    ],
)
def test_simulation_level_follows_the_state(state, changes, level, expected):
    status = _simulation(state, **changes)
    assert (status.name, status.level) == ('simulation', level)
    assert status.message.startswith(expected)
    is_active = changes.get('is_active', True)
    assert _values(status)['lifecycle'] == ('active' if is_active else 'inactive')


def test_flow_that_needs_an_effect_of_particles_is_a_warning():
    missed = 'the flow needs inertia (Re = 9 > 1, but only method particles has inertia)'
    resolution = Resolution(5.0, 5.0, 200.0, 40.0, 10.0, 'flow', method='cells')
    status = diagnostics.simulation_status(
        _worker(), replace(_snapshot(), method='cells'), is_active=True, frame_stamp_ns=99,
        resolution=resolution, method_reason='it was given', missed=(missed,),
    )
    values = _values(status)
    remedy = 'Set method to particles or auto, and start again with ~/reset'
    assert (status.level, status.message) == (WARN, f'{missed}. {remedy}')
    names = 'method', 'method_reason', 'cells_across', 'missed_effects'
    assert [values[name] for name in names] == ['cells', 'it was given', '40', missed]
    assert values['cells_with_lava'] == '3' and 'particles' not in values
    # pages read the values of a bag
    coarse = {**values, 'cells_across': '4'}
    one, other = warnings_of_moments([Moment(0, 0.0, coarse)])
    assert '4 cells across' in one and 'he flow needs inertia' in other


def test_flow_whose_physics_the_model_lacks_is_a_warning():
    numbers = {'thickness': 5.0, 'width': 200.0, 'diameter': 1000.0}
    for rate, level in ((1.0, WARN), (100.0, OK)):
        kind = FlowKind(
            discharge=rate, slope=0.05, viscosity=500.0, reynolds=0.1, crust_time=40.0, **numbers
        )
        resolution = Resolution(5.0, 5.0, 200.0, 40.0, 10.0, 'flow', kind)
        status = diagnostics.simulation_status(
            _worker(), None, is_active=True, frame_stamp_ns=99, resolution=resolution
        )
        assert status.level == level
        values = _values(status)
        assert values['flow_kind'] == kind.text()
        assert ('outside the model' in status.message) == (level == WARN)
        # pages read the values of a bag
        moment = Moment(0, 0.0, values)
        assert any('outside the model' in text for text in warnings_of_moments([moment])) == (
            level == WARN
        )


def test_lost_volume_is_an_error():
    assert _simulation(snapshot=_snapshot(flowing=9.49995)).level == OK
    for flowing in (9.499, float('nan')):
        status = _simulation(snapshot=_snapshot(flowing=flowing))
        assert status.level == ERROR
        assert status.message.startswith('volume is not conserved')


def test_effects_status_lists_effects_with_reasons():
    table = {'steep': 'on: slope = 0.8 > 0.12', 'green': 'off: never chosen', 'vft': 'on: forced'}
    status = diagnostics.effects_status(table)
    assert (status.name, status.level, status.message) == ('effects', OK, 'on: steep, vft')
    assert _values(status) == table
    assert diagnostics.effects_status({}).message == 'not chosen yet'
    assert diagnostics.effects_status({'vft': 'off: forced'}).message == 'on: none'


def test_failed_recording_is_an_error():
    recorder = Recorder()
    recorder.directory, recorder.files, recorder.messages = 'bags/x', 1, 5
    recorder.state = 'recording'
    checkpoints = CheckpointRecording(recorder, Future)
    file = RestartFile(Path('bags/restart_one.json'))
    recording = RecordingControl(recorder, checkpoints, None, None, file)
    good = diagnostics.recorder_status(recording)
    assert (good.name, good.level, good.message) == ('recorder', OK, 'recording')
    assert _values(good) == {'state': 'recording', 'bag': 'bags/x', 'files': '1', 'messages': '5'}
    file.error = 'disk full'
    blind = diagnostics.recorder_status(recording)
    assert (blind.level, blind.message) == (
        WARN, 'recording; a restart would not know the time of the newest maps: disk full',
    )
    file.error = ''
    recorder.state, recorder.error = 'off', 'disk full'
    bad = diagnostics.recorder_status(recording)
    assert (bad.level, bad.message) == (ERROR, 'disk full')
    recording.is_wanted = True
    assert diagnostics.recorder_status(recording).message == 'disk full; trying again'


def test_status_has_the_name_of_its_node():
    for node, source in (('/lava', 'lava'), ('/etna/lava2', 'etna/lava2')):
        message = DiagnosticArray(status=[diagnostics.effects_status({})])
        diagnostics.sign(message, node, 'cuda:0')
        assert message.status[0].name == f'{source}: effects'
        assert message.status[0].hardware_id == f'{gethostname()} cuda:0'
        # no simulation yet
        diagnostics.sign(message, node, '')
        assert message.status[0].hardware_id == gethostname()


def _look(watch, stamp_ns, now, *, is_simulated=True, **worker):
    return watch.warnings(stamp_ns, now, _worker(**worker), is_simulated=is_simulated)


def test_missing_or_stopped_clock_is_a_warning():
    watch, now = ClockWatch(), 50.0
    assert _look(watch, 0, now) == _look(watch, 0, now + 0.9 * PATIENCE) == {}
    assert _look(watch, 0, now + PATIENCE)['clock'].startswith('/clock does not arrive')
    # the system clock always advances
    assert _look(watch, 0, now + PATIENCE, is_simulated=False) == {}
    assert _look(watch, 10**9, now + 10.0 * PATIENCE) == {}
    assert _look(watch, 2 * 10**9, now + 11.0 * PATIENCE) == {}
    later = _look(watch, 2 * 10**9, now + 12.0 * PATIENCE)
    assert later['clock'].startswith('/clock stands still')
    assert _look(watch, 10**9, now + 13.0 * PATIENCE) == {}


@pytest.mark.parametrize('is_simulated', [True, False])
@pytest.mark.parametrize(
    ('worker', 'kind', 'expected'),
    [
        (
            {'jump': 3600.0, 'jumps': 1, 'lost': 3600.0},
            'ahead',
            'the clock jumped ahead by 3600 s and simulated time did not: it follows steps of up '
            'to 60 s ahead',
        ),
        (
            {'jump': -500.0, 'jumps': 2},
            'back',
            'the clock jumped back by 500 s and simulated time did not: it follows steps of up '
            'to 60 s ahead',
        ),
        ({'lost': 12.5}, 'lost', 'simulated time has lost 12.5 s of the clock: it can be at most'),
    ],
)
def test_jump_or_loss_of_time_is_a_warning_for_a_while(worker, kind, expected, is_simulated):
    watch = ClockWatch()
    assert _look(watch, 1, 0.0, is_simulated=is_simulated) == {}
    for now in (1.0, 0.9 * WARNING_TIME):
        warnings = _look(watch, int(now * 1e9), now, is_simulated=is_simulated, **worker)
        assert list(warnings) == [kind] and warnings[kind].startswith(expected)
    assert _look(watch, 10**11, 2.0 * WARNING_TIME, is_simulated=is_simulated, **worker) == {}
    more = {name: value + MIN_LOST for name, value in worker.items()}
    later = _look(watch, 10**12, 3.0 * WARNING_TIME, is_simulated=is_simulated, **more)
    assert list(later) == [kind]
    # a new start has lost nothing
    assert _look(watch, 10**13, 3.1 * WARNING_TIME, is_simulated=is_simulated) == {}


class _Lines:
    """Stores log lines by severity."""

    def __init__(self):
        self.lines = []

    def info(self, text):
        self.lines.append(text)

    warning = error = info


GROUND = Terrain(np.zeros((4, 5)), 10.0)


def _view(time, changes, *vents):
    return SessionView(time=time, scene=Scene(GROUND, vents, lava=Lava.paper()), changes=changes)


@pytest.mark.parametrize(('time', 'rate'), [
    (0.0, 3), (599.0, 3), (600.0, 40), (1199.0, 40), (1200.0, 0), (5000.0, 0),
])
def test_effusion_rate_is_logged_at_the_time_of_the_change(time, rate):
    lines = _Lines()
    log = diagnostics.NodeLog(lines)
    log.scene(_view(0.0, 1, Vent((15.0, 15.0), 7.0)))
    assert 'vents: 1, 7 m3/s' in lines.lines
    new = Vent((35.0, 25.0), [(0.0, 3.0), (600.0, 40.0), (1200.0, 0.0)])
    lines.lines.clear()
    log.scene(_view(time, 2, new))
    assert lines.lines == [f'vents: 1, {rate} m3/s']
    lines.lines.clear()
    # a later time is no change, nor is another rate of the same vent
    log.scene(_view(900.0, 2, new))
    log.scene(_view(900.0, 3, replace(new, discharge=9.0)))
    assert lines.lines == []
    log.scene(_view(time, 4, replace(new, discharge=9.0), Vent((15.0, 15.0), 0.5)))
    assert lines.lines == ['vents: 2, 9.5 m3/s']
