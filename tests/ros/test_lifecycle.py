# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Transitions of the managed node, including failed ones, and its behaviour in each state."""

from pathlib import Path
import threading

import numpy as np
import pytest
from std_srvs.srv import Trigger

from lava_ros.bag import BagReader
from lava_ros.live.worker_status import WorkerState
from lava_ros.ros import node as node_module
from lava_ros.ros import runtime
from lava_ros.ros.runtime import NodeRuntime
from lava_ros.simulation import Simulation
from ros.graph_publisher import elevation, Publisher
from ros_domain import own_domain
from waiting import PATIENCE

GRIDS = {'/hazard', '/height', '/temperature'}
#: Names of a configured node.
CONFIGURED = {*GRIDS, '/terrain', '/diagnostics', '/lava/step'}


def change(node, *names):
    """Make transitions that succeed."""
    for name in names:
        assert node.change(name), node.log


def refuse(node, name, words, state):
    """Request a transition that fails, with the reason in the log and the resulting state."""
    before = len(node.log)
    assert not node.change(name)
    assert node.state() == state
    assert words in node.log[before:]
    assert '[ERROR]' in node.log[before:]


def break_transition(patch, name):
    """Make a transition raise an error in its middle, until the patch is undone."""
    method = {
        'configure': '_begin', 'activate': '_publish', 'deactivate': 'deactivate',
        'cleanup': '_close_bag',
    }[name]

    def run(*_, **__):
        raise RuntimeError(f'{name} went wrong')

    patch.setattr(NodeRuntime, method, run)


@pytest.fixture
def start(local, tmp_path):
    """Return a function that starts a node with a slope and a vent, and sets its state."""
    _, x = np.mgrid[0:30, 0:40]
    np.savez(tmp_path / 'slope.npz', elevation=(300.0 - x).astype(np.float32), resolution=10.0)

    def start_node(state, **parameters):
        node = local(terrain_file='slope.npz', bag_root=str(tmp_path), **parameters)
        if state == 'active':
            change(node, 'configure', 'activate')
            node.publish('vents')
            # inputs are used once the simulation has started
            node.status_now('inputs', lambda item: item['accepted'] == '2')
        return node

    return start_node


def test_unconfigured_node_has_no_topics_and_settable_parameters(start):
    node = start('unconfigured')
    assert node.state() == 'unconfigured'
    alone = node.names()
    assert '/lava/change_state' in alone
    assert not CONFIGURED & alone
    for name in ('activate', 'deactivate', 'cleanup'):
        refuse(node, name, 'no transition of id', 'unconfigured')
    assert node.set(frame_id='world')['success']
    change(node, 'configure')
    assert node.names() > CONFIGURED
    assert node.map('height')['shape'] == [0, 0]
    refuse(node, 'configure', 'no transition of id 1 from', 'inactive')
    answer = node.set(frame_id='map')
    assert not answer['success']
    assert 'read-only' in answer['message']
    change(node, 'cleanup')
    assert node.set(frame_id='map')['success']
    assert not node.set(autostart=True)['success']
    answer = node.set(horizon=3.0, discharge=5.0)
    assert not answer['success'] and "['discharge']" in answer['message']
    change(node, 'configure', 'cleanup', 'shutdown')
    refuse(node, 'configure', 'no transition of id 1 from', 'finalized')


def test_inactive_node_accepts_inputs_while_time_stands_still(start):
    node = start('active', record=True, bag_directory='bag')
    node.run(2.0)
    change(node, 'deactivate')
    before = node.status_now('simulation', lambda item: item['state'] == 'paused')
    assert before['lifecycle'] == 'inactive'
    node.publish('click')
    inputs = node.status_now('inputs', lambda item: item['accepted'] == '3')
    assert inputs['rejected'] == '0'
    assert node.call('pause', False)['success']
    since = len(node.seen)
    node.jump(node.now + 100.0)
    node.run_commands()
    after = node.status_now('simulation')
    assert (after['lifecycle'], after['state']) == ('inactive', 'paused')
    assert after['simulated_time_s'] == before['simulated_time_s']
    assert {item['topic'] for item in node.seen[since:]} == {'diagnostics'}
    for name, data in (('step', False), ('save', False), ('record', True)):
        answer = node.call(name, data)
        assert not answer['success']
        assert answer['message'].startswith('The node is inactive. Activate it')
    recorder = node.status_now('recorder')
    assert (recorder['state'], recorder['bag']) == ('recording', 'bag')
    simulated = node.simulated
    # a pause continues after the activation
    assert node.call('pause', True)['success']
    change(node, 'activate')
    node.wait_for_topic('height', lambda grid: grid['stamp_ns'] == round(node.now * 1e9))
    status = node.status_now('simulation')
    assert (status['lifecycle'], status['state']) == ('active', 'paused')
    assert node.call('pause', False)['success']
    node.status_now('simulation', lambda item: item['state'] == 'running')
    node.run(0.5)
    # half a second of the clock at 20 times its speed
    assert node.simulated - simulated == pytest.approx(10.0)


def test_deactivation_stops_a_step(start):
    node = start('active')
    assert node.call('pause', True)['success']
    node.status_now('simulation', lambda item: item['state'] == 'paused')
    # longer than the deactivation takes on any machine
    assert node.set(time_scale=1e6)['success']
    node.run_commands()
    assert node.call('step')['success']
    node.wait_until(lambda: node.worker.session.time > 0.0)
    change(node, 'deactivate')
    node.run_commands()
    reached = node.worker.session.time
    for _ in range(3):
        # one round of the simulation thread
        node.run_commands()
        assert float(node.status_now('simulation')['simulated_time_s']) <= reached < 1e6
    assert node.worker.session.time == reached


def test_failed_simulation_is_not_activated(start, monkeypatch):
    node = start('active')

    def fail(*_, **__):
        raise RuntimeError('device lost')

    with monkeypatch.context() as patch:
        patch.setattr(Simulation, 'advance', fail)
        node.jump(node.now + 0.5)
        node.status_now('simulation', lambda item: item['state'] == 'failed')
        change(node, 'deactivate')
        refuse(node, 'activate', 'device lost', 'inactive')
    assert node.call('reset')['success']
    status = node.status_now('simulation', lambda item: item['state'] == 'paused')
    # ignore warnings about the last map, where lava may have reached the border
    assert status['message'].startswith('inactive: ')
    assert 'device lost' not in status['message']
    change(node, 'activate')
    node.status_now('simulation', lambda item: item['state'] == 'running')


def test_cleanup_finishes_the_bag_which_does_not_continue(start, tmp_path):
    node = start('unconfigured', record=True, bag_directory='bag')
    alone = node.names()
    change(node, 'configure', 'activate')
    node.newest('height')
    node.status_now('recorder', lambda item: item['state'] == 'recording')
    change(node, 'deactivate', 'cleanup')
    assert node.names() == alone
    bag = BagReader(tmp_path / 'bag')
    assert not bag.recovered
    assert {*GRIDS, '/terrain', '/diagnostics'} < set(bag.topics)
    change(node, 'configure')
    refuse(node, 'activate', 'a folder that does not exist yet', 'inactive')
    assert node.set(bag_directory='other')['success']
    change(node, 'activate')
    # an ended recording does not restart
    node.status_now('recorder', lambda item: item['state'] == 'recording')
    assert node.call('record', False) == {'success': True, 'message': 'recorded other'}
    change(node, 'deactivate', 'activate')
    node.jump(node.now + 1.0)
    assert node.status_now('recorder')['state'] == 'off'


def test_failed_transition_leaves_the_node_unconfigured(start, monkeypatch):
    node = start('unconfigured', record=True)
    alone, threads = node.names(), set(threading.enumerate())
    assert node.set(terrain_file='gone.npz')['success']
    refuse(node, 'configure', 'gone.npz', 'unconfigured')
    assert node.set(terrain_file='slope.npz')['success']
    for *path, name in (
        ('configure',), ('configure', 'activate'), ('configure', 'activate', 'deactivate'),
        ('configure', 'activate', 'deactivate', 'cleanup'),
    ):
        change(node, *path)
        with monkeypatch.context() as patch:
            break_transition(patch, name)
            refuse(node, name, f'RuntimeError: {name} went wrong', 'unconfigured')
        assert node.names() == alone
    node.wait_until(lambda: set(threading.enumerate()) <= threads)
    change(node, 'configure', 'shutdown')
    refuse(node, 'configure', 'no transition of id 1 from', 'finalized')


def test_configuration_waits_for_the_last_step_of_the_previous_simulation(start, monkeypatch):
    node = start('active')
    monkeypatch.setattr(runtime, 'STOP_TIMEOUT', 0.1)
    begun, may_end, advance = threading.Event(), threading.Event(), Simulation.advance

    def advance_slowly(*arguments, **options):
        begun.set()
        may_end.wait()
        return advance(*arguments, **options)

    monkeypatch.setattr(Simulation, 'advance', advance_slowly)
    try:
        node.jump(node.now + 0.5)
        node.wait_until(begun.is_set)
        change(node, 'deactivate', 'cleanup')
        assert not node.names() & CONFIGURED
        refuse(node, 'configure', 'Configure the node again later', 'unconfigured')
    finally:
        may_end.set()
    # the step ends at its next check, which may be late on a busy machine
    node.wait_until(lambda: node.change('configure'))


@pytest.mark.nightly
def test_many_cycles_release_threads_and_memory(start):
    def resources():
        status = Path('/proc/self/status').read_text(encoding='utf-8')
        values = dict(line.split(':') for line in status.splitlines())
        return int(values['Threads']), int(values['VmRSS'].split()[0]) / 1024.0

    node = start('unconfigured', record=True)
    alone, used = node.names(), []
    for _ in range(12):
        change(node, 'configure', 'activate')
        node.wait_for_topic('height')
        change(node, 'deactivate', 'cleanup')
        used.append(resources())
    threads, memory = zip(*used, strict=True)
    # threads of the middleware end later
    node.wait_until(lambda: resources()[0] <= threads[1])
    assert memory[-1] - memory[1] < 8.0, memory
    assert node.names() == alone


def test_shutdown_of_an_active_node_finishes_its_bag(start, tmp_path):
    node = start('active', record=True, bag_directory='bag')
    node.newest('height')
    change(node, 'shutdown')
    assert not BagReader(tmp_path / 'bag').recovered
    assert not node.names() & CONFIGURED
    refuse(node, 'configure', 'no transition of id 1 from', 'finalized')


@pytest.mark.parametrize('end', ['cleanup', 'shutdown', 'interrupt'])
def test_calls_are_answered_when_the_node_ends_their_simulation(start, monkeypatch, end):
    node, client = start('active'), Publisher(own_domain('local'))
    monkeypatch.setattr(runtime, 'STOP_TIMEOUT', 0.1)
    monkeypatch.setattr(node_module, 'SingleThreadedExecutor', lambda: node._executor)
    make, is_ended = runtime.make_simulation, threading.Event()
    monkeypatch.setattr(runtime, 'make_simulation', lambda *given: (
        is_ended.wait(PATIENCE), make(*given)
    )[1])
    try:
        reset = client.node.create_client(Trigger, '/lava/reset')
        assert reset.wait_for_service(timeout_sec=PATIENCE)
        executing = reset.call_async(Trigger.Request())
        node.wait_until(lambda: node.worker.status.state is WorkerState.STARTING)
        waiting = reset.call_async(Trigger.Request())
        node.wait_until(lambda: 'reset' in node.worker.status.waiting)
        if end == 'interrupt':
            node_module._run(node.node, lambda: True)
        else:
            change(node, *(['deactivate'] if end == 'cleanup' else []), end)
        if end != 'interrupt':
            node.wait_until(lambda: client.spin() or (executing.done() and waiting.done()))
        client.spin_until(lambda: executing.done() and waiting.done())
        for answer in (executing.result(), waiting.result()):
            assert not answer.success
            assert answer.message.startswith('The node has ended the simulation before reset was')
    finally:
        is_ended.set()
        client.close()
    if end == 'cleanup':
        # the new services are the only ones
        node.wait_until(lambda: node.node.close())
        change(node, 'configure')
        assert node.call('pause')['success']


def test_input_that_waits_when_the_node_ends_is_no_error(local):
    node = local()
    change(node, 'configure', 'activate')
    node.publish('vents')
    node.wait_until(lambda: node.worker._waiting_vents)
    change(node, 'deactivate', 'cleanup')
    assert '[ERROR]' not in node.log


def test_constants_of_parameters_replace_those_of_the_scene_file(local, tmp_path):
    np.savez(tmp_path / 'slope.npz', elevation=np.zeros((30, 40)), resolution=10.0)
    (tmp_path / 'scene.yaml').write_text(
        'terrain: {file: slope.npz}\nlava: {viscosity: 1.0e4}\ngravity: 3.7\n'
        'vents: [{position: [200.0, 150.0], effusion_rate: 20.0, temperature: 1360.0}]\n'
    )
    node = local(
        scene=str(tmp_path / 'scene.yaml'), lava__viscosity=2e6, ambient_temperature=250.0
    )
    change(node, 'configure', 'activate')
    node.wait_until(lambda: node.worker.status.state is WorkerState.RUNNING)
    for starts in (1, 2):
        view = node.worker.view
        found = view.scene.lava.viscosity, view.scene.ambient_temperature, view.scene.gravity
        assert (view.starts, *found) == (starts, 2e6, 250.0, 3.7)
        assert node.call('reset')['success']


SCENE = """
terrain: {file: slope.npz%s}
vents: [{position: [60.0, 155.0], effusion_rate: 20.0, temperature: 1360.0}]
lava: {viscosity: %s}
"""


@pytest.mark.parametrize(('before', 'after'), [
    ('scene', 'scene'), ('resume', 'scene'), ('scene', 'resume'),
])
def test_configuration_has_no_values_of_an_earlier_scene_or_bag(local, tmp_path, before, after):
    np.savez(tmp_path / 'slope.npz', elevation=elevation(), resolution=10.0)
    sea = SCENE % (', sea_level: 470', '2.0e4') + 'onset: 2026-11-27T05:30:00Z\n'
    inputs = {}
    for name, text in (('sea', sea), ('plain', SCENE % ('', '1.0e4'))):
        (tmp_path / f'{name}.yaml').write_text(text, encoding='utf-8')
        inputs[name] = {'scene': f'{name}.yaml', 'resume': name}
        if 'resume' in (before, after):
            node = local(
                scene=f'{name}.yaml', record=True, bag_directory=name, effects_off=['cooling'],
                horizon=2.0,
            )
            change(node, 'configure', 'activate')
            node.newest('height')
            change(node, 'deactivate', 'cleanup')

    def values(node):
        change(node, 'configure')
        return dict(node.node._values)

    own = {after: inputs['plain'][after]}
    expected = values(local(time_scale=3.0, **own))
    node = local(**{before: inputs['sea'][before]})
    first = values(node)
    assert (first['sea_level'], first['onset'][:4]) == (470.0, '2026')
    # a value of the user remains
    assert node.set(time_scale=3.0)['success']
    change(node, 'cleanup')
    assert node.set(**{before: '', **own})['success']
    assert values(node) == expected
