# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The node in a real graph: itself, a publisher and subscribers, each a process of its own."""

import hashlib
import json
from pathlib import Path
import signal
import time

import numpy as np
import pytest
import yaml

from lava_ros.bag import BagReader

CONFIGS = Path(__file__).parents[2] / 'msg_configs'
GRIDS = ('height', 'temperature', 'hazard')


class Running:
    """A node that simulates and records, with someone who feeds it and someone who listens."""

    def __init__(self, graph):
        self.graph = graph
        self.bag = graph.directory / 'bag'
        config = graph.directory / 'often.yaml'
        default = (CONFIGS / 'default.yaml').read_text(encoding='utf-8')
        config.write_text(default.replace('rate: 1.0 ', 'rate: 4.0 '), encoding='utf-8')
        self.node = graph.node(
            time_scale=60.0,
            device='cpu',
            record=True,
            bag_directory=str(self.bag),
            msg_config=str(config),
        )
        self.publisher = graph.publisher()
        self.listener = graph.listener(*GRIDS)
        # The vents come first: they wait for the terrain.
        self.publisher.publish('vents', 'terrain_info', 'terrain')
        self.listener.wait_for_topic('height', lambda grid: grid['wet'] > 0, timeout=90.0)

    def inputs(self):
        """The state of the inputs in the next diagnostics."""
        return self.listener.wait_for_status('inputs', lambda _: True)

    def last_inputs(self):
        """The state of the inputs in the last diagnostics there were."""
        for message in reversed(self.listener.seen):
            if message['topic'] == 'diagnostics':
                return message['status']['lava: inputs']
        return self.inputs()

    def wait_for_state(self, state):
        """Wait until the simulation is in a state, and return its status."""
        return self.listener.wait_for_status(
            'simulation', lambda status: status['state'] == state
        )


@pytest.fixture(scope='module')
def running(graph):
    """One node for all tests of this module that do not need one of their own."""
    return Running(graph)


def test_grids_arrive(running):
    """All three grids come, of the terrain's size and place, and lava flows."""
    for topic in GRIDS:
        grid = running.listener.wait_for_topic(topic, lambda grid: grid['wet'] > 0)
        assert grid['frame_id'] == 'map'
        assert grid['shape'] == [30, 40]
        assert grid['resolution'] == 10.0
        assert grid['origin'] == [0.0, 0.0]
        assert grid['min'] == 0
        assert grid['max'] <= 100
    wet = running.listener.wait_for_topic('height')['wet']
    running.listener.wait_for_topic('height', lambda grid: grid['wet'] > wet)


def test_diagnostics(running):
    """The diagnostics tell the state, the speed and the volume budget of a published frame."""
    status = running.listener.wait_for_status(
        'simulation',
        lambda status: float(status['speed']) > 50.0 and int(status['wet_cells']) > 0,
    )
    assert status['state'] == 'running'
    assert status['device'] == 'cpu'
    assert float(status['simulated_time_s']) > 0.0
    assert int(status['particles']) > 0
    assert float(status['volume_error']) < 1e-5
    emitted = float(status['volume_emitted_m3'])
    assert emitted == pytest.approx(20.0 * float(status['simulated_time_s']), rel=1e-6)
    kept = float(status['volume_held_m3']) + float(status['volume_left_m3'])
    assert kept == pytest.approx(emitted, rel=1e-5)
    frames = [item for item in running.listener.seen if item['topic'] in GRIDS]
    stamps = {item['stamp_ns'] for item in frames}
    assert int(status['frame_stamp_ns']) in stamps


@pytest.mark.parametrize(
    ('case', 'topic', 'words'),
    [
        ('nan_hole', 'terrain', '1 of 1200 cells without data'),
        ('infinite', 'terrain', 'terrain.data is inf'),
        ('wrong_encoding', 'terrain', "terrain.encoding is 'rgb8'"),
        ('wrong_row_step', 'terrain', 'terrain.data is'),
        ('short_data', 'terrain', 'terrain.data is'),
        ('zero_size', 'terrain', "terrain.size is '0 x 0'"),
        ('wrong_frame', 'terrain', "terrain.header.frame_id is 'odom'"),
        ('zero_resolution', 'terrain_info', 'terrain_info.resolution is 0.0'),
        ('rotated', 'terrain_info', 'rotated grids are not supported'),
        ('size_mismatch', 'terrain', "terrain_info.size is '41 x 30'"),
        ('cloud_without_z', 'terrain_cloud', 'missing: z'),
        ('cloud_with_hole', 'terrain_cloud', '1 of 1200 cells without data'),
        ('negative_discharge', 'vents', 'discharge is -1.0'),
        ('vent_off_map', 'vents', 'vents[0].position is (-500.0, 155.0)'),
        ('vents_without_fields', 'vents', 'missing: discharge, radius'),
        ('vents_wrong_frame', 'vents', "vents.header.frame_id is 'base_link'"),
        ('click_off_map', 'clicked_point', 'a place on the terrain'),
    ],
)
def test_malformed_input(running, case, topic, words):
    """One clear error in the log and in the diagnostics; the flow goes on as it was."""
    before = running.last_inputs()
    logged = running.node.log.count('refused')
    running.publisher.publish(case)
    after = running.listener.wait_for_status(
        'inputs', lambda status: status['rejected'] != before['rejected']
    )
    assert int(after['rejected']) == int(before['rejected']) + 1
    key = f'rejected.{topic}'
    assert int(after[key]) == int(before.get(key, 0)) + 1
    assert after['level'] == 2
    assert words in after['last_error']
    assert after['last_error'] in after['message']
    new = running.node.log.split('\n')
    errors = [line for line in new if 'refused' in line][logged:]
    assert len(errors) == 1, errors
    assert '[ERROR]' in errors[0]
    assert words in errors[0]
    wet = running.listener.wait_for_topic('height')['wet']
    assert wet > 0


def test_a_bad_message_repeated_is_logged_once(running):
    """Each one is counted, one is logged."""
    running.publisher.publish('vents')
    before = int(running.inputs()['rejected'])
    logged = running.node.log.count('refused')
    running.publisher.publish(*['vents_wrong_frame'] * 3)
    running.listener.wait_for_status(
        'inputs', lambda status: int(status['rejected']) == before + 3
    )
    assert running.node.log.count('refused') == logged + 1


def test_good_input_after_bad(running):
    """A good message on each topic ends the error; the count stays as a warning."""
    running.publisher.publish('wrong_frame')
    running.listener.wait_for_status('inputs', lambda status: status['level'] == 2)
    running.publisher.publish('terrain', 'terrain_info', 'terrain_cloud', 'vents', 'click')
    status = running.listener.wait_for_status('inputs', lambda status: status['level'] == 1)
    assert int(status['rejected']) > 0
    running.publisher.publish('terrain', 'terrain_info', 'vents')
    running.inputs()


def test_a_late_subscriber_gets_all_grids(running):
    """After a pause nothing is published, and a new subscriber gets the last of all three."""
    assert running.publisher.call('pause', True) == {'success': True, 'message': 'pausing'}
    status = running.wait_for_state('paused')
    # A frame may be on its way; two heartbeats later there is none.
    running.listener.wait_for_topic('diagnostics')
    seen = len(running.listener.seen)
    last = {item['topic']: item for item in running.listener.seen if item['topic'] in GRIDS}
    late = running.graph.listener(*GRIDS)
    got = {}
    while set(got) != set(GRIDS):
        message = late.wait(lambda item: item['topic'] in GRIDS, timeout=10.0)
        got[message['topic']] = message
    assert got == last
    late.end(signal.SIGINT)
    running.listener.wait_for_topic('diagnostics')
    published = [item['topic'] for item in running.listener.seen[seen:]]
    assert set(published) == {'diagnostics'}
    now = running.wait_for_state('paused')
    assert now['simulated_time_s'] == status['simulated_time_s']

    answer = running.publisher.call('step')
    assert answer == {'success': True, 'message': 'advancing 60 s'}
    target = float(now['simulated_time_s']) + 60.0
    stepped = running.listener.wait_for_status(
        'simulation', lambda status: float(status['simulated_time_s']) > target - 1e-3
    )
    assert float(stepped['simulated_time_s']) == pytest.approx(target, abs=1e-3)
    assert stepped['state'] == 'paused'
    assert running.publisher.call('pause', False)['success']
    running.wait_for_state('running')
    assert not running.publisher.call('step')['success']


def test_parameters(running):
    """Good values are applied, bad ones are refused with a reason, some are fixed."""
    assert running.publisher.set(time_scale=30.0)['success']
    running.listener.wait_for_status('simulation', lambda status: float(status['speed']) < 50.0)
    assert 'out of range' in running.publisher.set(time_scale=-1.0)['message']
    assert 'out of range' in running.publisher.set(lava__density=0.0)['message']
    assert 'type' in running.publisher.set(time_scale=3)['message']
    assert 'read-only' in running.publisher.set(device='cuda:0')['message']
    assert running.publisher.set(time_scale=60.0)['success']


def test_effects_are_told_with_their_reasons(running):
    """Each effect is on or off in the diagnostics, with the number that says so."""
    status = running.listener.wait_for_status('effects', lambda _: True)
    assert status['level'] == 0
    assert status['cover'].startswith('on: heat lost = ')
    assert status['crystals'] == 'off: the material has none'
    assert 'cover' in status['message']


def test_wrong_effects_are_refused(running):
    """The answer names the parameter, the value and what is known; nothing changes."""
    before = running.listener.wait_for_status('effects', lambda _: True)
    for values, words in (
        ({'effects_on': ['lava']}, ("effects_on is 'lava'", 'yielding', 'merging')),
        ({'effects_off': [1]}, ('effects_off is 1', 'expected one of steep')),
        ({'effects_on': ['steep'], 'effects_off': ['steep']}, ("effects_off is 'steep'",)),
        ({'effects_on': ['helmholtz', 'green']}, ('effects_on is', 'beside green')),
        ({'horizon': 0.0}, ('horizon', 'out of range')),
    ):
        answer = running.publisher.set(**values)
        assert not answer['success']
        assert all(word in answer['message'] for word in words), answer
    running.listener.wait_for_topic('diagnostics')
    assert running.listener.wait_for_status('effects', lambda _: True) == before


def test_changing_effects_does_not_stop_publishing(running):
    """Effects go on and off in a flow that goes on; grids and heartbeats keep coming."""
    first = running.listener.wait_for_topic('height', lambda grid: grid['wet'] > 0)
    time_of = lambda: float(running.wait_for_state('running')['simulated_time_s'])  # noqa: E731
    before = time_of()
    for values, effect, text in (
        ({'effects_on': ['helmholtz']}, 'helmholtz', 'on: forced'),
        ({'effects_on': [], 'effects_off': ['cover']}, 'cover', 'off: forced'),
        ({'effects_off': [''], 'horizon': 1e-3}, 'cover', 'off: heat lost = '),
        ({'horizon': 24.0}, 'cover', 'on: heat lost = '),
    ):
        assert running.publisher.set(**values)['success']
        running.listener.wait_for_status(
            'effects', lambda status: status[effect].startswith(text)  # noqa: B023
        )
        running.listener.wait_for_topic('height')
    assert time_of() > before
    for topic in ('height', 'diagnostics'):
        seen = [item for item in running.listener.seen if item['topic'] == topic]
        stamps = [item['stamp_ns'] for item in seen if item['stamp_ns'] >= first['stamp_ns']]
        # a busy machine is late, a node that has stopped stays silent
        assert len(stamps) > 4, topic
        assert np.diff(stamps).max() / 1e9 < 30.0, topic
    grids = [item for item in running.listener.seen if item['topic'] == 'height']
    assert all(item['wet'] > 0 for item in grids if item['stamp_ns'] >= first['stamp_ns'])


def test_reset(running):
    """A reset starts again at time 0 with the same terrain and vents."""
    status = running.listener.wait_for_status(
        'simulation', lambda status: float(status['simulated_time_s']) > 60.0
    )
    answer = running.publisher.call('reset')
    assert answer == {'success': True, 'message': 'starting again at time 0'}
    before = float(status['simulated_time_s'])
    running.listener.wait_for_status(
        'simulation', lambda status: float(status['simulated_time_s']) < before
    )
    running.listener.wait_for_topic('height', lambda grid: grid['wet'] > 0)


def test_recording_ends_and_matches_the_wire(running):
    """The bag starts with the inputs, holds the bytes of the wire, and describes itself."""
    answer = running.publisher.call('record', False)
    assert answer == {'success': True, 'message': f'recorded {running.bag}'}
    status = running.listener.wait_for_status(
        'recorder', lambda status: status['state'] == 'off'
    )
    assert status['level'] == 0
    bag = BagReader(running.bag)
    messages = [(item.topic, bytes(item.data)) for item in bag.messages()]
    assert [topic for topic, _ in messages[:3]] == ['/terrain', '/terrain_info', '/vents']
    recorded = {(topic, hashlib.sha256(data).hexdigest()) for topic, data in messages}
    heard = [item for item in running.listener.seen if item['topic'] in GRIDS]
    end = bag.end_ns
    heard = [('/' + item['topic'], item['sha256']) for item in heard if item['stamp_ns'] <= end]
    assert len(heard) > 30
    assert set(heard) <= recorded
    for topic in GRIDS:
        assert bag.topics[f'/{topic}'].qos.durability == 'transient_local'
    scene = yaml.safe_load(bag.custom_data['scene'])
    assert scene['terrain']['shape'] == [30, 40]
    # a click opened and a message replaced vents meanwhile: what each emitted is there
    fluxes = [vent['discharge'] for vent in scene['vents']]
    assert 20.0 in [item if isinstance(item, float) else item[-1][1] for item in fluxes]
    assert yaml.safe_load(bag.custom_data['parameters'])['frame_id'] == 'map'
    effects = json.loads(bag.custom_data['effects'])
    assert effects[0]['effects']['cover'].startswith('on: ')
    assert len(effects[0]['effects']) > 10
    assert any(entry['effects'].get('helmholtz') == 'on: forced' for entry in effects[1:])
    assert bag.custom_data['device'] == 'cpu'
    assert bag.custom_data['version']
    refused = running.publisher.call('record', True)
    assert not refused['success']
    assert 'does not exist yet' in refused['message']


@pytest.fixture
def terrain_file(tmp_path):
    """A slope in a file, for nodes that nobody feeds."""
    _, x = np.mgrid[0:20, 0:30]
    path = tmp_path / 'slope.npz'
    np.savez(path, elevation=(300.0 - x).astype(np.float32), resolution=10.0)
    return path


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_node(graph, tmp_path, terrain_file, number):
    """SIGINT and SIGTERM end the node with 0, and the bag is finished."""
    bag = tmp_path / 'bag'
    node = graph.node(
        aside=True,
        device='cpu',
        terrain_file=str(terrain_file),
        record=True,
        bag_directory=str(bag),
    )
    node.wait_for_log('simulation running')
    assert node.end(number) == 0
    assert 'Traceback' not in node.log
    finished = BagReader(bag)
    assert not finished.recovered
    assert {f'/{topic}' for topic in GRIDS} < set(finished.topics)


def test_a_changed_msg_config_changes_the_messages(graph, terrain_file, tmp_path):
    """Another file publishes other layers; time follows /clock and effects are forced if asked."""
    config = tmp_path / 'mine.yaml'
    config.write_text(
        'layers:\n'
        '  depth: {source: thickness, message: sensor_msgs/Image, threshold: 0.0, rate: 5.0}\n'
        '  danger: {source: hazard, message: nav_msgs/OccupancyGrid, rate: 5.0}\n'
    )
    node = graph.node(
        aside=True,
        device='cpu',
        terrain_file=str(terrain_file),
        msg_config=str(config),
        use_sim_time=True,
        time_scale=10.0,
        effects_on=[],
        effects_off=['cooling'],
    )
    listener = graph.listener('depth:image', 'danger', 'height', aside=True)
    publisher = graph.publisher(aside=True)
    node.wait_for_log('simulation running')
    publisher.publish('click')
    for tick in range(40):
        publisher.clock(1000.0 + 0.25 * tick)
        time.sleep(0.05)
    image = listener.wait_for_topic('depth', lambda image: image['max'] > 0.0)
    assert (image['shape'], image['encoding']) == ([20, 30], '32FC1')
    assert 1000 * 10**9 < image['stamp_ns'] < 1011 * 10**9
    grid = listener.wait_for_topic('danger', lambda grid: grid['max'] == 100)
    assert grid['stamp_ns'] < 1011 * 10**9
    assert 'height' not in {item['topic'] for item in listener.seen}
    status = listener.wait_for_status('simulation', lambda status: 'particles' in status)
    assert 0.0 < float(status['simulated_time_s']) <= 100.0
    effects = listener.wait_for_status('effects', lambda _: True)
    assert effects['cooling'] == 'off: forced'
    assert node.end() == 0


def test_parameters_without_effect_are_warned_of(graph):
    """Each is named, with what it may have been meant for, and where vents come from."""
    node = graph.node(aside=True, device='cpu', discharge=60.0, time_scales=2.0, unheard_of=1)
    node.wait_for_log('active')
    assert node.end() == 0
    said = [line for line in node.log.splitlines() if 'has no effect' in line]
    assert all('[WARN]' in line for line in said)
    discharge, scale, unheard_of = said
    assert "this node has no parameter 'discharge'" in discharge
    assert 'similar names: default_discharge; vents come by the scene file (scene)' in discharge
    assert "'time_scales'" in scale and 'vents' not in scale
    assert 'similar names: time_scale' in scale
    assert unheard_of.endswith("no parameter 'unheard_of': its value has no effect")


@pytest.mark.parametrize(
    ('parameters', 'words'),
    [
        ({'time_scale': 60}, 'written 5.0'),
        ({'time_scale': -1.0}, 'time_scale'),
        ({'msg_config': 'nothing.yaml'}, 'nothing.yaml'),
        ({'effects_on': ['lava']}, "effects_on is 'lava'"),
        ({'terrain_file': 'nothing.npz'}, 'nothing.npz'),
    ],
)
def test_a_wrong_start_is_refused(graph, parameters, words):
    """A node that cannot start says why in one sentence and ends with 1."""
    node = graph.node(aside=True, **parameters)
    assert node.wait_for_end() == 1
    assert 'Traceback' not in node.log
    (sentence,) = [line for line in node.log.splitlines() if 'cannot start' in line]
    assert words in sentence
