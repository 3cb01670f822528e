# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Terrain, vents and description of a bag."""

from functools import partial
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from std_srvs.srv import Trigger
import yaml

from lava_ros.bag import BagReader, BagWriter, LATCHED
from lava_ros.cli.main import main
from lava_ros.layers.recording import Recording
from lava_ros.live import recording_control
from lava_ros.ros import runtime
from lava_ros.ros.input_log import LIMITS
from lava_ros.ros.node_graph import NodeGraph
from lava_ros.ros.recording import SceneRecording
from lava_ros.scene import Lava, Scene, Terrain, Vent
from recording import snapshot_at
from ros.conftest import start_flow

TERRAIN = Terrain(np.zeros((4, 5)), 10.0)
STEEP = {'steep': 'on: slope = 0.5 > 0.12', 'inertia': 'off: number = 0.01 <= 0.1'}
FAST = {'steep': 'on: slope = 0.5 > 0.12', 'inertia': 'on: number = 0.2 > 0.1'}


class FrameRecording:
    """A recording of frames."""

    def __init__(self, directory, terrain=TERRAIN):
        self.directory = directory
        self.scene = Scene(terrain, (Vent((25.0, 15.0), 2.0),), lava=Lava.paper())
        self.schedule = self.scene.vents
        node = SimpleNamespace(
            resolve_topic_name='/{}'.format, get_namespace=lambda: '/',
            get_fully_qualified_name=lambda: '/lava',
        )
        graph = NodeGraph(node, 'map')
        self.recorder = graph.recorder
        self.parameters = dict[str, object]()
        self.recording = SceneRecording(graph, configs={}, parameters=lambda: self.parameters)

    def write(self, time, effects):
        terrain = self.scene.terrain
        snapshot = snapshot_at(time, np.zeros(terrain.shape, np.float32), terrain)
        session = SimpleNamespace(
            scene=self.scene, effects=effects, schedule=self.schedule, origin=None, device='cpu',
        )
        self.recording.write(session, snapshot, int(time * 1e9))
        self.recorder.flush()

    def description(self, name):
        return yaml.safe_load(BagReader(self.directory / name).custom_data['parameters'])

    def effects(self, name):
        return json.loads(BagReader(self.directory / name).custom_data['effects'])


@pytest.fixture
def frames(tmp_path):
    result = FrameRecording(tmp_path)
    result.recorder.arm(tmp_path / 'one')
    result.write(1.0, STEEP)
    return result


@pytest.mark.parametrize(('name', 'value'), [
    ('preset', 'fine'), ('method', 'cells'), ('spacing', 3.0), ('lava.viscosity', 7.0),
    ('ambient_temperature', 250.0),
])
def test_description_has_parameters_of_its_run_until_the_next_start(name, value, tmp_path):
    frames = FrameRecording(tmp_path)
    frames.parameters = {name: 'before', 'time_scale': 1.0}
    frames.recording.note_start()
    frames.recorder.arm(tmp_path / 'one')
    frames.write(1.0, STEEP)
    frames.parameters = {name: value, 'time_scale': 2.0}
    frames.write(2.0, FAST)
    for bag in ('two', 'three'):
        frames.recorder.stop()
        if bag == 'three':
            frames.recording.note_start()
        frames.recorder.arm(tmp_path / bag)
        frames.write(3.0, STEEP)
    assert frames.description('one') == {name: 'before', 'time_scale': 2.0}
    assert frames.description('two') == {name: 'before', 'time_scale': 2.0}
    assert frames.description('three') == {name: value, 'time_scale': 2.0}


def test_bag_has_each_change_of_effects(frames):
    frames.write(2.0, {**STEEP, 'steep': 'on: slope = 0.6 > 0.12'})
    frames.write(3.0, FAST)
    # also in a truncated recording
    assert [entry['time'] for entry in frames.effects('one')] == [1.0, 3.0]
    frames.scene = Scene(TERRAIN, lava=Lava.paper())
    frames.write(4.0, FAST)
    frames.write(5.0, STEEP)
    frames.write(6.0, FAST)
    frames.recorder.stop()
    entries = frames.effects('one')
    assert [entry['time'] for entry in entries] == [1.0, 3.0, 5.0, 6.0]
    assert entries[1]['effects'] == entries[3]['effects'] == {'inertia': FAST['inertia']}
    assert entries[2]['effects'] == {'inertia': STEEP['inertia']}
    frames.recorder.arm(frames.directory / 'two')
    frames.write(7.0, FAST)
    frames.recorder.stop()
    assert frames.effects('two') == [{'stamp_ns': 7 * 10**9, 'time': 7.0, 'effects': FAST}]


def test_bag_has_the_schedule_of_closed_vents(frames):
    frames.schedule = (Vent((25.0, 15.0), ((0.0, 2.0), (3.0, 5.0), (4.0, 0.0)), 1423.0),)
    frames.scene = Scene(TERRAIN, lava=Lava.paper())
    frames.write(4.0, STEEP)
    frames.recorder.stop()
    scene = yaml.safe_load(BagReader(frames.directory / 'one').custom_data['scene'])
    assert scene['vents'][0]['discharge'] == [[0.0, 2.0], [3.0, 5.0], [4.0, 0.0]]
    assert main(['bag', 'info', str(frames.directory / 'one')]) == 0


def test_terrain_and_vents_are_repeated_as_the_bag_grows(tmp_path):
    """They are repeated once a minute if the bag has grown by their size."""
    random = np.random.default_rng(0)
    frames = FrameRecording(tmp_path, Terrain(random.random((50, 60)), 1.0))
    frames.recorder.arm(tmp_path / 'one')
    for second in range(1, 186):
        frames.recorder.write(
            '/noise', 'std_msgs/msg/Empty', random.bytes(1000), second * 10**9, qos=LATCHED
        )
        frames.write(float(second), STEEP)
    for second in range(1000, 2000, 100):
        frames.write(float(second), STEEP)
    frames.recorder.stop()
    seen, bag = {}, BagReader(tmp_path / 'one')
    for item in bag.messages():
        seen.setdefault(item.topic, []).append(item.stamp_ns // 10**9)
    # nothing else is written after that
    assert seen['/terrain'] == [1, 61, 121, 181]
    scene = (
        '/terrain', '/terrain_info', '/terrain_georeference', '/relief', '/vents',
        '/vents_markers',
    )
    assert all(seen[topic] == seen['/terrain'] for topic in scene)
    assert all(bag.topics[topic].qos == LATCHED for topic in scene)


def times_of(bag):
    """Return the simulated times of the frames of a bag that contains no damage."""
    recording = Recording(bag)
    times = [frame.time for frame in recording.frames()]
    assert recording.bag.damage == ()
    assert recording.frame_at(times[-1]).time == times[-1]
    return times


@pytest.mark.parametrize('jump', [-1.5, -9_000.0, 1e9])
def test_bag_continues_where_the_clock_jumps(local, jump):
    node = start_flow(local, record=True, bag_directory='bag')
    node.run(3.0)
    node.jump(node.now + jump)
    # the simulation reads the clock
    node.worker.request_snapshot()
    node.run_commands()
    node.run(3.0)
    assert node.status_now('recorder')['state'] == 'recording'
    assert node.change('deactivate') and node.change('cleanup')
    assert [path.name for path in node.directory.glob('bag*')] == ['bag']
    times = times_of('bag')
    assert times == sorted(set(times))
    # 20 simulated seconds to one of the clock; the jump itself is not followed
    assert 100.0 < times[-1] <= 160.0
    bag = BagReader('bag')
    log_times = [item.stamp_ns for item in bag.messages()]
    assert log_times == sorted(log_times)
    # the last tick of the clock, of half a second, may come after the last message
    assert 6.5e9 <= bag.duration_ns <= 9e9


def test_looping_clock_gives_one_bag(local):
    """Many times as many loops as the service may start recordings."""
    node = start_flow(local, record=True, bag_directory='bag', bag_max_duration=7.0)
    start = node.now
    for _ in range(3 * LIMITS['record'][0]):
        node.run(1.5)
        node.jump(start)
        node.worker.request_snapshot()
        node.run_commands()
    node.run(1.0)
    simulated = node.worker.session.time
    assert node.status_now('recorder', lambda item: item['state'] == 'recording')['level'] == 0
    assert node.change('deactivate') and node.change('cleanup')
    assert '[ERROR]' not in node.log
    assert [path.name for path in node.directory.glob('bag*')] == ['bag']
    assert len(BagReader('bag').files) > 2
    times = times_of('bag')
    assert times == sorted(set(times))
    # maps come once a second of the clock, in which 20 s are simulated, at the end of a step
    assert len(times) > 10 and simulated - 50.0 < times[-1] <= simulated
    assert max(np.diff(times)) < 60.0
    assert main(['bag', 'info', 'bag']) == 0


def time_of_retries(monkeypatch):
    """Return the time [s], in a list, by which nodes that start later retry recordings."""
    now = [0.0]
    control = partial(recording_control.RecordingControl, clock=lambda: now[0])
    monkeypatch.setattr(runtime, 'RecordingControl', control)
    return now


def test_failed_recording_is_tried_again(local, monkeypatch):
    now = time_of_retries(monkeypatch)
    node = start_flow(local, record=True, bag_directory='bag')

    def fail(*_args, **_options):
        raise OSError(28, 'No space left on device')

    def failed(item):
        return item['state'] == 'off' and item['message'].endswith('; trying again')

    with monkeypatch.context() as patch:
        patch.setattr(BagWriter, 'flush', fail)
        patch.setattr(BagWriter, '_open_file', fail)
        assert node.status_now('recorder', failed)['level'] == 2
        # one attempt, which fails in the same way
        now[0] += recording_control.RETRY_PERIOD
        node.wait_for_log('cannot record to bag_2: [Errno 28] No space left on device')
        assert node.status_now('recorder', failed)['bag'] == 'bag_2'
    assert not Path('bag_2').exists()
    # each failure doubles the time to the next attempt
    now[0] += 1.5 * recording_control.RETRY_PERIOD
    node.status_now('recorder', failed)
    assert node.status_now('recorder')['state'] == 'off'
    now[0] += 0.6 * recording_control.RETRY_PERIOD
    node.run(1.0)
    status = node.status_now('recorder', lambda item: item['state'] == 'recording')
    assert (status['level'], status['bag']) == (0, 'bag_2')
    node.run(1.0)
    # the diagnostics have the times of the last maps
    node.status_now('simulation')
    assert node.call('record', False)['success']
    assert times_of('bag_2')
    # on request it stays off
    now[0] += 1e6
    node.run(1.0)
    assert node.status_now('recorder')['state'] == 'off'


def test_later_attempt_does_not_follow_a_new_link(local, monkeypatch, tmp_path):
    now = time_of_retries(monkeypatch)
    node = start_flow(local, record=True, bag_directory='bags/bag')
    (tmp_path / 'outside').mkdir()
    Path('bags').rename('moved')
    Path('bags').symlink_to(tmp_path / 'outside')
    node.run(1.0)
    node.status_now('recorder', lambda item: 'removed, moved or replaced' in item['message'])
    now[0] += recording_control.RETRY_PERIOD
    node.status_now('recorder', lambda item: 'a symbolic link' in item['message'])
    assert list((tmp_path / 'outside').iterdir()) == []


def test_bag_begins_at_the_first_time_of_the_clock(local):
    node = local(record=True, bag_directory='bag')
    node.jump(0.0)
    assert node.change('configure') and node.change('activate'), node.log
    node.publish('vents', 'terrain_info', 'terrain')
    node.newest('height')
    assert not node.request(Trigger, '/lava/save', 1.0).success
    node.jump(1e9)
    node.newest('height', condition=lambda newest: newest['height']['stamp_ns'] == 10**18)
    assert BagReader('bag').start_ns == 10**18


def test_description_has_the_parameters_of_a_start_before_the_activation(local):
    node = local(record=True, bag_directory='bag', spacing=8.0)
    assert node.change('configure'), node.log
    node.publish('vents', 'terrain_info', 'terrain')
    node.wait_until(lambda: node.worker.view.starts)
    assert node.set(spacing=2.5, lava__viscosity=7e4)['success']
    assert node.change('activate'), node.log
    node.newest('height')
    assert node.worker.view.accuracy.spacing == 8.0
    assert node.change('deactivate') and node.change('cleanup')
    parameters = yaml.safe_load(BagReader('bag').custom_data['parameters'])
    assert (parameters['spacing'], parameters['lava.viscosity']) == (8.0, 5e5)


def test_save_continues_a_recording_that_has_failed(local, monkeypatch):
    node = start_flow(local, record=True, bag_directory='bag')

    def fail(*_args, **_options):
        raise OSError(28, 'No space left on device')

    with monkeypatch.context() as patch:
        patch.setattr(BagWriter, 'flush', fail)
        node.status_now('recorder', lambda item: item['message'].endswith('; trying again'))
        answer = node.call('save')
        assert not answer['success'] and 'No space left' in answer['message']
        node.status_now('recorder', lambda item: item['message'].endswith('; trying again'))
    assert node.call('save') == {'success': True, 'message': 'saved in bag_3'}
    status = node.status_now('recorder')
    assert (status['level'], status['state'], status['bag']) == (0, 'recording', 'bag_3')
    node.run(3.0)
    node.status_now('simulation')
    assert node.call('record', False) == {'success': True, 'message': 'recorded bag_3'}
    assert len(times_of('bag_3')) > 1


def test_end_of_a_recording_names_a_bag_only_if_it_exists(local):
    node = local(bag_directory='bag')
    assert node.change('configure') and node.change('activate'), node.log
    nothing = {'success': True, 'message': 'recorded nothing'}
    assert node.call('record', False) == nothing
    assert node.call('record', True)['message'] == 'recording to bag at the first map'
    assert node.call('record', False) == nothing
    assert node.status_now('recorder')['bag'] == '' and not Path('bag').exists()
    assert node.call('record', True)['success']
    node.publish('terrain_info', 'terrain')
    node.status_now('recorder', lambda item: item['state'] == 'recording')
    assert node.call('record', False)['message'] == 'recorded bag'
    assert node.call('record', False) == nothing
