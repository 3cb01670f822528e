# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node in the process of the test: inputs, log, topics and bags."""

from collections import Counter
import json
import re

import pytest
import yaml

from lava_ros.bag import BagReader
from ros.conftest import start_flow

#: Topics of the grids that are published by default.
GRIDS = ('height', 'temperature', 'hazard')


def check_advance(node):
    before, now = node.worker.session.time, node.now
    node.run(2.0)
    assert node.worker.session.time > before
    grid = node.wait_for_topic('height', lambda grid: grid['stamp_ns'] > now * 1e9)
    assert grid['wet'] > 0 and grid['min'] == 0
    assert float(node.status_now('simulation')['volume_error']) < 1e-5


#: A rejected message of each topic, and the text of its error.
MALFORMED = (
    ('nan_hole', 'terrain', '1 of 1200 cells without data'),
    ('cloud_with_hole', 'terrain_cloud', '1 of 1200 cells without data'),
    ('vents_without_fields', 'vents', 'missing: discharge, radius'),
    ('click_off_map', 'clicked_point', 'a place on the terrain'),
)


def test_malformed_input_is_logged_and_counted(running):
    before = running.status_now('inputs')
    for case, topic, words in MALFORMED:
        length = len(running.log)
        running.publish(case)
        running.wait_for_log(words, after=length)
        (error,) = [line for line in running.log[length:].splitlines() if 'refused' in line]
        assert '[ERROR]' in error and f'{topic} refused: ' in error, case
        status = running.status_now('inputs')
        assert status['level'] == 2 and words in status['last_error'], case
        assert status['last_error'] in status['message']
    assert int(status['rejected']) == int(before['rejected']) + len(MALFORMED)
    for topic, count in Counter(topic for _, topic, _ in MALFORMED).items():
        assert int(status[f'rejected.{topic}']) == int(before.get(f'rejected.{topic}', 0)) + count
    check_advance(running)


def test_pause_stops_publishing_and_step_advances_one_second(running):
    assert running.call('pause', True) == {'success': True, 'message': 'paused'}
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


def test_flow_continues_on_new_terrain(running):
    for size, names in ((48, ('higher', 'higher_info')), (40, ('terrain', 'terrain_info'))):
        running.publish(*names)
        running.run_commands()
        check_advance(running)
        assert running.newest('height')['height']['shape'] == [30, size]
    before = int(running.status_now('inputs')['rejected'])
    running.publish('away', 'terrain')
    status = running.status_now('inputs', lambda item: int(item['rejected']) > before)
    assert 'position' in status['last_error']
    check_advance(running)
    assert running.newest('height')['height']['origin'] == [0.0, 0.0]


def test_log_has_each_event_once_and_the_bag_inputs_scene_and_effects(local, tmp_path):
    node = start_flow(local, record=True, bag_directory='bag')
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

    assert node.set(effects_on=['helmholtz'])['success']
    node.status_now('effects', lambda status: status['helmholtz'] == 'on: forced')
    node.run(1.0)
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
    assert yaml.safe_load(bag.custom_data['parameters'])['frame_id'] == 'map'
    effects = json.loads(bag.custom_data['effects'])
    assert any(entry['effects'].get('helmholtz') == 'on: forced' for entry in effects[1:])
    assert bag.custom_data['device'] == 'cpu'
    assert bag.custom_data['version']
    refused = node.call('record', True)
    assert not refused['success']
    assert 'does not exist yet' in refused['message']
