# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node: inputs, log, topics and bags, in the test's process and in a graph."""

from collections import Counter
import hashlib
import json
import re

import pytest
import yaml

from lava_ros.bag import BagReader

pytestmark = pytest.mark.usefixtures('alone')

#: Topics of the grids that are published by default.
GRIDS = ('height', 'temperature', 'hazard')


@pytest.fixture
def running(flowing):
    return flowing()


def test_log_has_one_line_for_each_event(flowing):
    node = flowing(record=True, bag_directory='bag')
    node.wait_for_log('recording to')
    node.wait_for_log('simulation running')
    lines = re.findall(r'^\[INFO\] \[[\d.]+\] \[lava\]: (.*)$', node.log, re.MULTILINE)
    waiting = 'waiting for terrain on terrain, terrain_info, terrain_cloud'
    assert lines[0].startswith(waiting)
    assert lines[1:3] == ['configured', 'active']
    for expected in ('terrain: 40 x 30 cells of 10 m', 'vents: 1, 20 m3/s'):
        assert lines.count(expected) == 1, (expected, lines)
    for start_of_line in ('effects: ', 'recording to '):
        assert [line.startswith(start_of_line) for line in lines].count(True) >= 1, lines


def test_diagnostics_have_state_speed_and_budget(running):
    status = running.status_now('simulation')
    assert status['state'] == 'running'
    assert status['device'] == 'cpu'
    assert float(status['speed']) > 0.0 and float(status['standing_area_m2']) > 0.0
    assert float(status['inundated_area_m2']) >= float(status['standing_area_m2'])
    assert float(status['simulated_time_s']) > 0.0
    assert int(status['particles']) > 0
    assert float(status['volume_error']) < 1e-5
    emitted = float(status['volume_emitted_m3'])
    assert emitted == pytest.approx(20.0 * float(status['simulated_time_s']), rel=1e-6)
    kept = float(status['volume_held_m3']) + float(status['volume_left_m3'])
    assert kept == pytest.approx(emitted, rel=1e-5)
    stamp = int(status['frame_stamp_ns'])
    assert stamp in {item['stamp_ns'] for item in running.seen if item['topic'] in GRIDS}


#: Rejected messages, the topic in the error, and its text.
MALFORMED = (
    ('nan_hole', 'terrain', '1 of 1200 cells without data'),
    ('wrong_frame', 'terrain', "terrain.header.frame_id is 'odom'"),
    ('rotated', 'terrain_info', 'rotated grids are not supported'),
    ('size_mismatch', 'terrain', "terrain_info.size is '41 x 30'"),
    ('cloud_with_hole', 'terrain_cloud', '1 of 1200 cells without data'),
    ('negative_discharge', 'vents', 'discharge is -1.0'),
    ('vents_without_fields', 'vents', 'missing: discharge, radius'),
    ('vents_wrong_frame', 'vents', "vents.header.frame_id is 'base_link'"),
    ('click_off_map', 'clicked_point', 'a place on the terrain'),
)


def test_malformed_input_is_logged_and_counted(running):
    for case, topic, words in MALFORMED:
        length = len(running.log)
        running.publish(case)
        running.wait_for_log(words, after=length)
        (error,) = [line for line in running.log[length:].splitlines() if 'refused' in line]
        assert '[ERROR]' in error and f'{topic} refused: ' in error, case
        status = running.status_now('inputs')
        assert status['level'] == 2 and words in status['last_error'], case
        assert status['last_error'] in status['message']
    assert int(status['rejected']) == len(MALFORMED)
    for topic, count in Counter(topic for _, topic, _ in MALFORMED).items():
        assert int(status[f'rejected.{topic}']) == count
    before = running.worker.session.time
    running.run(1.0)
    assert running.worker.session.time > before
    running.newest('height', condition=lambda newest: newest['height']['wet'] > 0)


def test_pause_stops_publishing_and_step_advances_one_second(running):
    assert running.call('pause', True) == {'success': True, 'message': 'pausing'}
    running.at_rest(*GRIDS)
    seen = len(running.seen)
    running.jump(running.now + 10.0)
    status = running.status_now('simulation')
    assert status['state'] == 'paused'
    assert {item['topic'] for item in running.seen[seen:]} == {'diagnostics'}
    assert running.set(time_scale=30.0)['success']
    assert running.call('step') == {'success': True, 'message': 'advancing 30 s'}
    target = float(status['simulated_time_s']) + 30.0
    stepped = running.status_now(
        'simulation', lambda status: float(status['simulated_time_s']) > target - 1e-3
    )
    assert float(stepped['simulated_time_s']) == pytest.approx(target, abs=1e-3)
    assert stepped['state'] == 'paused'
    assert running.call('pause', False)['success']
    running.status_now('simulation', lambda status: status['state'] == 'running')
    assert not running.call('step')['success']


def test_bad_parameters_are_rejected_and_some_apply_later(running):
    for values, expected_words in (
        ({'lava__density': 0.0}, 'out of range'),
        ({'time_scale': 3}, 'type'),
        ({'device': 'cuda:0'}, 'read-only'),
        ({'effects_on': ['lava']}, "effects_on is 'lava', expected one of"),
    ):
        assert expected_words in running.set(**values)['message']
    for name, value in (('preset', 'standard'), ('lava.viscosity', 50.0)):
        assert running.set(**{name: value})['success']
        running.wait_for_log(f'{name}: the new value is used from the next start or reset on')


def test_changing_effects_does_not_stop_publishing(running):
    for values, effect, text in (
        ({'effects_on': ['helmholtz']}, 'helmholtz', 'on: forced'),
        ({'effects_on': [], 'effects_off': ['cover']}, 'cover', 'off: forced'),
        ({'effects_off': [''], 'horizon': 1e-3}, 'cover', 'off: heat lost = '),
        ({'horizon': 24.0}, 'cover', 'on: heat lost = '),
    ):
        assert running.set(**values)['success']
        running.status_now('effects', lambda status: status[effect].startswith(text))  # noqa: B023
        changed, before = running.now, running.worker.session.time
        running.run(1.0)
        assert running.worker.session.time > before
        grid = running.wait_for_topic('height', lambda grid: grid['stamp_ns'] > changed * 1e9)  # noqa: B023
        assert grid['wet'] > 0


def test_bag_has_inputs_scene_parameters_and_effects(flowing, tmp_path):
    node = flowing(record=True, bag_directory='bag')
    node.publish('click')
    assert node.set(effects_on=['helmholtz'])['success']
    node.status_now('effects', lambda status: status['helmholtz'] == 'on: forced')
    node.run(1.0)
    node.publish('vents')
    node.run_commands()
    assert node.call('record', False) == {'success': True, 'message': 'recorded bag'}
    status = node.status_now('recorder')
    assert (status['state'], status['level']) == ('off', 0)
    bag = BagReader(tmp_path / 'bag')
    topics = [item.topic for item in bag.messages()]
    assert {'/terrain', '/terrain_info', '/vents'} <= set(topics[:topics.index('/height')])
    for topic in GRIDS:
        assert bag.topics[f'/{topic}'].qos.durability == 'transient_local'
    scene = yaml.safe_load(bag.custom_data['scene'])
    assert scene['terrain']['shape'] == [30, 40]
    # vents that were opened by a click and replaced: the bag has the volume of each
    fluxes = [vent['discharge'] for vent in scene['vents']]
    assert 20.0 in [item if isinstance(item, float) else item[-1][1] for item in fluxes]
    assert yaml.safe_load(bag.custom_data['parameters'])['frame_id'] == 'map'
    effects = json.loads(bag.custom_data['effects'])
    assert effects[0]['effects']['cover'].startswith('on: ')
    assert len(effects[0]['effects']) > 10
    assert any(entry['effects'].get('helmholtz') == 'on: forced' for entry in effects[1:])
    assert bag.custom_data['device'] == 'cpu'
    assert bag.custom_data['version']
    refused = node.call('record', True)
    assert not refused['success']
    assert 'does not exist yet' in refused['message']


def test_late_subscribers_and_the_bag_have_the_published_grids(graph):
    bag = graph.directory / 'bag'
    node = graph.node(time_scale=60.0, device='cpu', record=True, bag_directory=str(bag))
    publisher, listener = graph.publisher(), graph.listener(*GRIDS)
    publisher.publish('vents', 'terrain_info', 'terrain')
    for topic in GRIDS:
        grid = listener.newest(topic, condition=lambda newest: newest[topic]['wet'] > 0)[topic]  # noqa: B023
        place = {name: grid[name] for name in ('frame_id', 'shape', 'resolution', 'origin')}
        assert list(place.values()) == ['map', [30, 40], 10.0, [0.0, 0.0]]
        assert grid['min'] == 0 and grid['max'] <= 100
    # Warp prints a warning if there is no GPU
    assert not [line for line in node.log.splitlines() if line.startswith('Warp ')]
    assert publisher.call('pause', True)['success']
    last = listener.at_rest(*GRIDS)
    assert graph.listener(*GRIDS).newest(*GRIDS) == last
    assert publisher.call('record', False) == {'success': True, 'message': f'recorded {bag}'}
    listener.hear()
    reader = BagReader(bag)
    recorded = {
        (item.topic, hashlib.sha256(bytes(item.data)).hexdigest()) for item in reader.messages()
    }
    received = [item for item in listener.seen if item['topic'] in GRIDS]
    received = {
        (f'/{item["topic"]}', item['sha256'])
        for item in received
        if item['stamp_ns'] <= reader.end_ns
    }
    assert {f'/{topic}' for topic in GRIDS} == {topic for topic, _ in received}
    assert received <= recorded
    assert node.end() == 0


def test_unknown_parameters_of_a_file_are_warnings(graph):
    values = {'device': 'cpu', 'discharge': 60.0, 'time_scales': 2.0, 'unheard_of': 1}
    file = graph.directory / 'for_all.yaml'
    file.write_text(json.dumps({'/**': {'ros__parameters': values}}), encoding='utf-8')
    words = ('-m', 'lava_ros.ros.node', '--ros-args', '--params-file', str(file))
    node = graph.node(aside=True, program=words)
    node.wait_for_log('active')
    assert node.end() == 0
    expected_words = [line for line in node.log.splitlines() if 'has no effect' in line]
    assert all('[WARN]' in line for line in expected_words)
    discharge, scale, unheard_of = expected_words
    assert "this node has no parameter 'discharge'" in discharge
    assert 'similar names: default_discharge; vents come by the scene file (scene)' in discharge
    assert "'time_scales'" in scale and 'vents' not in scale
    assert 'similar names: time_scale' in scale
    assert unheard_of.endswith("no parameter 'unheard_of': its value has no effect")
