# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Services, optional layers, markers and parameters of a running node."""

import numpy as np
import pytest

from lava_ros.bag import BagReader
from lava_ros.bag.checkpoints import newest_checkpoint
from ros.graph_publisher import elevation

#: Layers that are off by default.
OPTIONAL = ('height_raw', 'temperature_raw', 'lava_points')
#: Actions of a marker.
ADD, DELETEALL = 0, 3

SCENE = """
terrain: {file: slope.npz}
vents:
  - position: [60.0, 155.0]
    discharge: [[0.0, 20.0], [40.0, 0.0]]
    radius: 12.0
    name: north
lava: {viscosity: 1.0e4}
"""


@pytest.fixture
def start(local, tmp_path):
    """Return a function that starts an active node with a vent; ``pause`` holds time."""
    np.savez(tmp_path / 'slope.npz', elevation=elevation(), resolution=10.0)
    (tmp_path / 'scene.yaml').write_text(SCENE, encoding='utf-8')

    def start_node(*, pause=False, **parameters):
        node = local(scene='scene.yaml', checkpoint_period=0.0, **parameters)
        assert node.change('configure'), node.log
        if pause:
            assert node.call('pause', True)['success']
        assert node.change('activate'), node.log
        node.run_commands()
        node.newest('height')
        return node

    return start_node


def labels(node, condition=bool):
    """Return the labels of the vents once they fulfil a condition."""

    def texts(newest):
        return [item['text'] for item in newest['vents_markers']['markers'] if item['text']]

    newest = node.newest('vents_markers', condition=lambda newest: condition(texts(newest)))
    markers = newest['vents_markers']['markers']
    assert markers[0]['action'] == DELETEALL
    assert {item['action'] for item in markers[1:]} <= {ADD}
    return texts(newest)


def saved(answer):
    """Return the bag named in a response of ~/save."""
    assert answer['success'], answer
    assert answer['message'].startswith('saved in ')
    return answer['message'].removeprefix('saved in ')


def test_inactive_node_returns_a_map_without_cells(local):
    node = local()
    assert node.change('configure')
    assert node.map('height')['shape'] == [0, 0]


def test_markers_follow_the_discharge(start):
    node = start()
    assert labels(node) == ['north: 20 m3/s, 1087 C']
    node.run(3.0)
    assert labels(node, lambda texts: ' 0 m3/s' in texts[0]) == ['north: 0 m3/s, 1087 C']
    published = [item for item in node.seen if item['topic'] == 'vents_markers']
    assert len(published) == 2
    # an inactive node holds time without a pause
    assert node.change('deactivate')
    node.status_now('simulation', lambda status: status['state'] == 'paused')
    node.wait_for_log('inactive')
    assert node.change('activate')
    node.wait_for_log('simulation running')
    assert 'paused' not in node.log


def test_layers_can_be_switched_on_and_off(start):
    node = start(layers_on=list(OPTIONAL), layers_off=['temperature'])
    node.run(2.0)
    newest = node.newest(
        *OPTIONAL,
        condition=lambda newest: (
            newest['height_raw']['max'] > 0.0 and newest['lava_points']['points'] > 3
        ),
    )
    assert newest['height_raw']['encoding'] == '32FC1'
    mean = newest['lava_points']['mean']
    assert list(mean) == ['x', 'y', 'z', 'thickness', 'temperature']
    assert 0.1 <= mean['thickness'] < 50.0
    assert 300.0 < mean['temperature'] < 1150.0
    # the terrain falls from 500 m by 40 m, and rises by up to 12 m towards the sides
    assert 460.0 < mean['z'] - mean['thickness'] < 512.0
    assert 0.0 < mean['x'] < 400.0
    assert 100.0 < mean['y'] < 200.0
    assert 'temperature' not in {item['topic'] for item in node.seen}


def test_get_map_returns_the_published_map(start):
    node = start()
    node.run(2.0)
    assert node.call('pause', True)['success']
    for topic, published in node.at_rest('height', 'hazard').items():
        answer = node.map(topic)
        names = ('stamp_ns', 'shape', 'cells')
        assert answer == {name: published[name] for name in names}


def test_save_writes_a_bag_of_the_current_state(start, tmp_path):
    node = start(layers_on=list(OPTIONAL))
    node.run(1.0)
    first, second = (saved(node.call('save')) for _ in range(2))
    assert first != second
    for name in (first, second):
        bag = BagReader(tmp_path / name)
        assert not bag.recovered
        topics = [message.topic for message in bag.messages()]
        scene = topics[: topics.index('/height')]
        assert {'/terrain', '/terrain_info', '/vents'} <= set(scene)
        assert {f'/{topic}' for topic in ('height', 'hazard', *OPTIONAL)} <= set(topics)
        # although checkpoint_period is 0
        found = newest_checkpoint(tmp_path / name).checkpoint
        assert found.time == node.worker.session.time
        assert found.scene.vents[0].name == 'north'
    state = node.status_now('recorder')
    assert (state['state'], state['level']) == ('off', 0)


def test_save_during_a_recording_uses_its_bag(start, tmp_path):
    node = start(pause=True, bag_directory='run')
    assert node.call('record', True)['success']
    assert saved(node.call('save')) == 'run'
    assert newest_checkpoint(tmp_path / 'run').checkpoint.time == 0.0
    before = node.status_now('recorder')
    assert (before['state'], before['checkpoints']) == ('recording', '1')
    assert node.call('record', False)['message'] == 'recorded run'
    topics = [message.topic for message in BagReader(tmp_path / 'run').messages()]
    # at the start and at the save
    assert topics.count('/height') == topics.count('/hazard') == 2
    # an existing bag is not changed
    answer = node.call('save')
    assert not answer['success']
    assert "run', expected a folder that does not exist yet" in answer['message']


def test_removed_bag_is_reported_by_diagnostics_log_and_service(start, tmp_path):
    node = start(bag_directory='gone')
    bag, outside = tmp_path / 'gone', tmp_path / 'outside'
    outside.mkdir()
    assert node.call('record', True)['success']
    bag.rename(tmp_path / 'moved')
    bag.symlink_to(outside)
    status = node.status_now('recorder', lambda status: status['level'] == 2)
    assert status['state'] == 'off'
    reason = f'recording to gone stopped: {bag} was removed, moved or replaced'
    assert status['message'] == reason
    answer = node.call('record', False)
    assert not answer['success']
    assert reason in answer['message']
    errors = [line for line in node.log.splitlines() if reason in line]
    assert len(errors) == 1 and '[ERROR]' in errors[0], errors
    assert list(outside.iterdir()) == []


def test_markers_follow_their_vents(start):
    node = start(pause=True)
    node.publish('click')
    assert len(labels(node, lambda texts: len(texts) == 2)) == 2
    node.publish('vents')
    assert labels(node, lambda texts: len(texts) == 1) == ['vent 0: 20 m3/s, 1100 C']
    node.publish('no_vents')
    assert labels(node, lambda texts: not texts) == []


def test_click_opens_a_vent_with_the_values_of_the_parameters(start):
    node = start(pause=True)
    node.publish('no_vents')
    values = {'default_discharge': 7.0, 'default_temperature': 900.0, 'default_radius': 25.0}
    assert node.set(**values)['success']
    node.publish('click')
    (text,) = labels(node, lambda texts: len(texts) == 1 and 'click' in texts[0])
    assert text.endswith(': 7 m3/s, 900 C')
    # kelvin instead of Celsius is refused
    assert 'Celsius' not in node.log
    node.publish('kelvin_vents')
    node.wait_for_log('vents[0].temperature is 1360 Celsius, 273 K above lava.reference_')
    assert '1360 K would be 1086.85 Celsius' in node.log


@pytest.mark.parametrize(
    ('name', 'limit', 'case', 'words'),
    [
        ('max_vents', 1, 'click', 'one more vent'),
        ('max_terrain_cells', 1199, 'terrain', '40 x 30'),
        ('max_input_bytes', 4799, 'terrain', '4800 bytes'),
    ],
)
def test_input_limits_can_be_changed(start, name, limit, case, words):
    node = start(pause=True)
    before = node.status_now('inputs')
    assert node.set(**{name: limit})['success']
    node.publish(case)
    status = node.status_now('inputs')
    assert words in status['last_error'] and name in status['last_error']
    assert node.set(**{name: 100_000})['success']
    node.publish(case, 'terrain_info')
    node.status_now('inputs', lambda item: int(item['accepted']) > int(before['accepted']))


def test_terrain_parameters_apply_to_the_next_terrain(start):
    node = start(pause=True)
    node.publish('terrain_info', 'nan_hole')
    assert 'cells without data' in node.status_now('inputs')['last_error']
    values = {'terrain_allow_holes': True, 'terrain_cloud_resolution': 20.0}
    assert node.set(**values)['success']
    node.publish('terrain_info', 'nan_hole')
    node.wait_for_topic('height', lambda grid: grid['min'] == -1)
    node.publish('terrain_cloud')
    grid = node.wait_for_topic('height', lambda grid: grid['resolution'] == 20.0)
    assert grid['shape'] == [16, 21]


def test_accuracy_and_material_apply_at_the_next_reset(start, tmp_path):
    node = start(pause=True)
    values = {'lava__density': 2000.0, 'preset': 'draft', 'spacing': 5.0}
    assert node.set(**values)['success']
    place = {'epsg': 32633, 'offset_easting': 499000.0, 'offset_northing': 4180000.0}
    assert node.set(**place)['success']
    node.publish('terrain_info', 'terrain')
    assert node.call('reset')['success']
    node.run_commands()
    checkpoint = newest_checkpoint(tmp_path / saved(node.call('save'))).checkpoint
    assert checkpoint.accuracy.spacing == 5.0
    assert checkpoint.scene.lava.density == 2000.0
    terrain = checkpoint.scene.terrain
    assert (terrain.epsg, terrain.offset) == (32633, (499000.0, 4180000.0))


def test_end_time_can_be_changed(start):
    node = start()
    assert node.set(end_time=10.0)['success']
    node.run_commands()
    node.run(1.0)
    status = node.status_now('simulation', lambda status: status['state'] == 'finished')
    assert float(status['simulated_time_s']) == 10.0
    assert node.set(end_time=0.0)['success']
    node.status_now('simulation', lambda status: status['state'] == 'running')
    node.run(0.5)
    assert node.worker.session.time == pytest.approx(20.0)


def test_recording_parameters_can_be_changed(start, tmp_path):
    node = start()
    values = {'bag_directory': 'bags/split', 'bag_max_duration': 0.4}
    assert node.set(**values)['success']
    assert node.call('record', True)['success']
    node.run(1.0)
    status = node.status_now('recorder', lambda item: int(item['files']) > 1)
    assert 'checkpoints' not in status
    assert node.set(checkpoint_period=0.1)['success']
    node.status_now('recorder', lambda item: 'checkpoints' in item)
    assert node.call('record', False)['success']
    assert len(BagReader(tmp_path / 'bags/split').topics) > 5


def test_frequent_saves_are_rejected(start, tmp_path):
    node = start()
    answers = [node.call('save')]
    # slow saves gain allowance, but less than they use
    while len(answers) < 30 and answers[-1]['success']:
        answers.append(node.call('save'))
    assert 'one more each' in answers[-1]['message'], answers[-1]
    assert len(list(tmp_path.rglob('*.mcap'))) == len(answers) - 1
    status = node.status_now('recorder')
    assert (status['state'], status['level']) == ('off', 0)
    assert 'Traceback' not in node.log
