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

from collections import Counter
import hashlib
import json
import re

import pytest
import yaml

from lava_ros.bag import BagReader

GRIDS = ('height', 'temperature', 'hazard')


class Running:
    """A node that simulates and records, with someone who feeds it and someone who listens."""

    def __init__(self, graph):
        self.graph = graph
        self.bag = graph.directory / 'bag'
        self.node = graph.node(
            time_scale=60.0,
            device='cpu',
            record=True,
            bag_directory=str(self.bag),
        )
        self.publisher = graph.publisher()
        self.listener = graph.listener(*GRIDS)
        # The vents come first: they wait for the terrain.
        self.publisher.publish('vents', 'terrain_info', 'terrain')
        self.listener.wait_for_topic('height', lambda grid: grid['wet'] > 0, timeout=90.0)

    def inputs(self):
        """The state of the inputs, of which nothing is on its way."""
        return self.listener.newest('diagnostics')['diagnostics']['status']['lava: inputs']

    def refusals(self):
        """What the log has of messages that were refused."""
        return [line for line in self.node.log.splitlines() if 'refused' in line]


@pytest.fixture(scope='module')
def running(graph):
    """One node for all tests of this module that do not need one of their own."""
    return Running(graph)


def test_grids_arrive(running):
    """All three grids come, of the terrain's size and place, and lava flows."""
    for topic in GRIDS:
        grid = running.listener.wait_for_topic(topic, lambda grid: grid['wet'] > 0)
        place = {name: grid[name] for name in ('frame_id', 'shape', 'resolution', 'origin')}
        assert list(place.values()) == ['map', [30, 40], 10.0, [0.0, 0.0]]
        assert grid['min'] == 0 and grid['max'] <= 100


def test_the_log_says_what_the_node_does(running):
    """What it waits for, takes, chooses and records, each in one line."""
    running.node.wait_for_log('recording to')
    lines = re.findall(r'^\[INFO\] \[[\d.]+\] \[lava\]: (.*)$', running.node.log, re.MULTILINE)
    waiting = 'waiting for terrain on terrain, terrain_info, terrain_cloud'
    assert lines[0].startswith(waiting)
    assert lines[1:3] == ['configured', 'active']
    for expected in (
        'terrain: 40 x 30 cells of 10 m',
        'vents: 1, 20 m3/s',
        f'recording to {running.bag}',
    ):
        assert lines.count(expected) == 1, (expected, lines)
    assert [line for line in lines if line.startswith('effects: ')], lines
    # where there is no GPU Warp says so
    assert not [line for line in running.node.log.splitlines() if line.startswith('Warp ')]


def test_diagnostics(running):
    """The diagnostics tell the state, the speed and the volume budget of a published frame."""
    status = running.listener.wait_for_status(
        'simulation',
        lambda status: float(status['speed']) > 0.0 and int(status['wet_cells']) > 0,
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
    stamp = int(status['frame_stamp_ns'])
    # the frame that they are of may come after them
    running.listener.newest(*GRIDS, condition=lambda newest: newest['hazard']['stamp_ns'] >= stamp)
    frames = [item for item in running.listener.seen if item['topic'] in GRIDS]
    assert stamp in {item['stamp_ns'] for item in frames}


#: Messages that are refused, some of each topic, whose fault that is, and what is said of them.
MALFORMED = (
    ('nan_hole', 'terrain', '1 of 1200 cells without data'),
    ('wrong_frame', 'terrain', "terrain.header.frame_id is 'odom'"),
    ('rotated', 'terrain_info', 'rotated grids are not supported'),
    ('size_mismatch', 'terrain', "terrain_info.size is '41 x 30'"),
    ('cloud_with_hole', 'terrain_cloud', '1 of 1200 cells without data'),
    ('negative_discharge', 'vents', 'discharge is -1.0'),
    ('vents_without_fields', 'vents', 'missing: discharge, radius'),
    ('click_off_map', 'clicked_point', 'a place on the terrain'),
)


def test_malformed_input(running):
    """One clear error in the log for each, all in the diagnostics; the flow goes on as it was."""
    before = running.inputs()
    for case, topic, words in MALFORMED:
        length = len(running.node.log)
        running.publisher.publish(case)
        running.node.wait_for_log(words, after=length)
        (error,) = [line for line in running.node.log[length:].splitlines() if 'refused' in line]
        assert '[ERROR]' in error and f'{topic} refused: ' in error, case
    rejected = int(before['rejected']) + len(MALFORMED)
    after = running.listener.wait_for_status(
        'inputs', lambda status: int(status['rejected']) >= rejected
    )
    assert (int(after['rejected']), after['level']) == (rejected, 2)
    for topic, count in Counter(topic for _, topic, _ in MALFORMED).items():
        assert int(after[f'rejected.{topic}']) == count
    assert words in after['last_error'] and after['last_error'] in after['message']
    since = running.listener.seen[-1]['stamp_ns']
    grid = running.listener.wait_for_topic('height', lambda grid: grid['stamp_ns'] > since)
    assert grid['wet'] > 0


def test_good_input_after_bad(running):
    """A bad message repeated is logged once; good ones end the error, the count stays."""
    before = running.inputs()
    running.publisher.publish('vents')
    running.listener.wait_for_status(
        'inputs', lambda status: int(status['accepted']) > int(before['accepted'])
    )
    logged = len(running.refusals())
    running.publisher.publish(*['vents_wrong_frame'] * 3)
    rejected = int(before['rejected']) + 3
    status = running.listener.wait_for_status(
        'inputs', lambda status: int(status['rejected']) == rejected
    )
    assert status['level'] == 2
    running.publisher.publish('terrain', 'terrain_info', 'terrain_cloud', 'vents', 'click')
    running.listener.wait_for_status('inputs', lambda status: status['level'] == 1)
    assert len(running.refusals()) == logged + 1
    running.publisher.publish('terrain', 'terrain_info', 'vents')


def test_a_late_subscriber_gets_all_grids(running):
    """After a pause nothing is published, and a new subscriber gets the last of all three."""
    assert running.publisher.call('pause', True) == {'success': True, 'message': 'pausing'}
    last = running.listener.at_rest(*GRIDS)
    seen = len(running.listener.seen)
    assert running.graph.listener(*GRIDS).newest(*GRIDS) == last
    status = running.listener.status_now('simulation')
    published = {item['topic'] for item in running.listener.seen[seen:]}
    assert published == {'diagnostics'}
    assert status['state'] == 'paused'

    # a step is a second of the clock, so as long as the scale that was set last
    assert running.publisher.set(time_scale=30.0)['success']
    answer = running.publisher.call('step')
    assert answer == {'success': True, 'message': 'advancing 30 s'}
    target = float(status['simulated_time_s']) + 30.0
    stepped = running.listener.wait_for_status(
        'simulation', lambda status: float(status['simulated_time_s']) > target - 1e-3
    )
    assert float(stepped['simulated_time_s']) == pytest.approx(target, abs=1e-3)
    assert stepped['state'] == 'paused'
    assert running.publisher.set(time_scale=60.0)['success']
    assert running.publisher.call('pause', False)['success']
    running.listener.wait_for_status('simulation', lambda status: status['state'] == 'running')
    assert not running.publisher.call('step')['success']


def test_parameters(running):
    """Bad values are refused with a reason, some are fixed, and some wait for a start."""
    for values, said in (
        ({'lava__density': 0.0}, 'out of range'),
        ({'time_scale': 3}, 'type'),
        ({'device': 'cuda:0'}, 'read-only'),
        ({'effects_on': ['lava']}, "effects_on is 'lava', expected one of"),
    ):
        assert said in running.publisher.set(**values)['message']
    for name, values in (('preset', ('draft', 'standard')), ('lava.viscosity', (50.0, 100.0))):
        for value in values:
            assert running.publisher.set(**{name: value})['success']
        running.node.wait_for_log(f'{name}: the new value is used from the next start or reset on')


def test_changing_effects_does_not_stop_publishing(running):
    """Effects go on and off in a flow that goes on, with reasons; after each, lava is shown."""
    status = running.listener.status_now('simulation')
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
        changed = running.listener.seen[-1]['stamp_ns']
        grid = running.listener.wait_for_topic(
            'height', lambda grid: grid['stamp_ns'] > changed  # noqa: B023
        )
        assert grid['wet'] > 0
    before = float(status['simulated_time_s'])
    running.listener.wait_for_status(
        'simulation', lambda status: float(status['simulated_time_s']) > before
    )


def test_reset(running):
    """A reset starts again at time 0 with the same terrain and vents; a pause stays."""
    assert running.publisher.call('pause', True)['success']
    answer = running.publisher.call('reset')
    assert answer == {'success': True, 'message': 'starting again at time 0'}
    running.listener.wait_for_status(
        'simulation', lambda status: status['simulated_time_s'] == '0.0'
    )
    running.node.wait_for_log('reset: starting again at time 0')
    assert running.publisher.call('pause', False)['success']
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
    assert {f'/{topic}' for topic in GRIDS} == {topic for topic, _ in heard}
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


def test_parameters_without_effect_are_warned_of(graph):
    """A file may be for other nodes too: each is named, and what it may have been meant for."""
    values = {'device': 'cpu', 'discharge': 60.0, 'time_scales': 2.0, 'unheard_of': 1}
    file = graph.directory / 'for_all.yaml'
    file.write_text(json.dumps({'/**': {'ros__parameters': values}}), encoding='utf-8')
    words = ('-m', 'lava_ros.ros.node', '--ros-args', '--params-file', str(file))
    node = graph.node(aside=True, program=words)
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


def test_a_wrong_start_is_refused(graph):
    """A node that cannot start says why in one sentence and ends with 1."""
    nodes = [
        (graph.node(aside=True, **parameters), words)
        for parameters, words in (
            ({'time_scale': 60}, 'written 5.0'),
            (
                {'discharge': 60.0},
                '-p discharge is 60.0, expected a parameter that this node has; similar names: '
                'default_discharge; vents come by the scene file',
            ),
            ({'layers_on': ['points']}, "layers_on is 'points', expected one of height, temp"),
        )
    ]
    for node, words in nodes:
        assert node.wait_for_end() == 1
        assert 'Traceback' not in node.log
        (sentence,) = [line for line in node.log.splitlines() if 'cannot start' in line]
        assert words in sentence
