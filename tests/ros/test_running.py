# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Services, optional layers, markers and parameters of a running node."""

from dataclasses import replace

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import MapMetaData, OccupancyGrid
import numpy as np
import pytest
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2

from lava_ros.bag import BagReader
from lava_ros.bag.checkpoints import newest_checkpoint
from lava_ros.live.worker_status import WorkerState
from lava_ros.ros import subscribers
from ros.graph_publisher import elevation
from ros.local_node import PLAIN

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


def started(local, *, pause=False, **parameters):
    """Start an active node with a vent; ``pause`` holds time."""
    node = local(scene='scene.yaml', checkpoint_period=0.0, **parameters)
    np.savez(node.directory / 'slope.npz', elevation=elevation(), resolution=10.0)
    (node.directory / 'scene.yaml').write_text(SCENE, encoding='utf-8')
    assert node.change('configure'), node.log
    if pause:
        assert node.call('pause', True)['success']
    assert node.change('activate'), node.log
    node.run_commands()
    node.newest('height')
    return node


@pytest.fixture(scope='module')
def paused(module_local):
    return started(module_local, pause=True)


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


def test_markers_follow_the_discharge_up_to_the_end_time(local):
    node = started(local)
    assert labels(node) == ['north: 20 m3/s, 1087 C']
    node.run(3.0)
    assert labels(node, lambda texts: ' 0 m3/s' in texts[0]) == ['north: 0 m3/s, 1087 C']
    published = [item for item in node.seen if item['topic'] == 'vents_markers']
    assert len(published) == 2
    assert node.set(end_time=70.0)['success']
    node.run_commands()
    node.run(1.0)
    status = node.status_now('simulation', lambda status: status['state'] == 'finished')
    assert float(status['simulated_time_s']) == 70.0
    assert node.set(end_time=0.0)['success']
    node.status_now('simulation', lambda status: status['state'] == 'running')
    node.run(0.5)
    assert node.simulated == pytest.approx(80.0)


def test_layers_are_switched_on_and_off_and_saved(local):
    node = started(local, layers_on=list(OPTIONAL), layers_off=['temperature'])
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

    assert node.call('pause', True)['success']
    for topic, published in node.at_rest('height', 'hazard').items():
        answer = node.map(topic)
        assert answer == {name: published[name] for name in ('stamp_ns', 'shape', 'cells')}

    first, second = (saved(node.call('save')) for _ in range(2))
    assert first != second
    for name in (first, second):
        bag = BagReader(node.directory / name)
        assert not bag.recovered
        topics = [message.topic for message in bag.messages()]
        scene = topics[: topics.index('/height')]
        assert {'/terrain', '/terrain_info', '/vents'} <= set(scene)
        assert {f'/{topic}' for topic in ('height', 'hazard', *OPTIONAL)} <= set(topics)
        # although checkpoint_period is 0
        found = newest_checkpoint(node.directory / name).checkpoint
        assert found.time == node.worker.session.time
        assert found.scene.vents[0].name == 'north'
    state = node.status_now('recorder')
    assert (state['state'], state['level']) == ('off', 0)


def test_particles_are_published_to_subscribers_only(local):
    node = started(local)
    node.run(2.0)
    publisher = next(
        item for item in node.node.publishers if item.topic_name == '/lava_particles'
    )
    publisher.get_subscription_count = lambda: 1
    node.hear()
    assert 'lava_particles' not in {item['topic'] for item in node.seen}
    node.run(1.0)
    newest = node.newest('lava_particles', 'height', condition=lambda newest: (
        newest['lava_particles']['stamp_ns'] == newest['height']['stamp_ns']
    ))
    cloud = newest['lava_particles']
    status = node.status_now('simulation', lambda status: int(status['particles']) > 3)
    assert 3 < cloud['points'] <= int(status['particles'])
    mean = cloud['mean']
    assert list(mean) == ['x', 'y', 'z', 'temperature']
    assert 300.0 < mean['temperature'] < 1150.0
    assert 460.0 < mean['z'] < 512.0 and 0.0 < mean['x'] < 400.0


def test_method_changes_at_a_reset(local):
    node = started(local, effects_off=PLAIN)

    def reset(method):
        assert node.set(method=method)['success']
        assert 'method: the new value is used from the next start or reset' in node.log
        assert node.call('reset')['success']
        node.run_commands()
        node.run(2.0)

    def has_particles():
        return '/lava_particles' in {item.topic_name for item in node.node.publishers}

    assert has_particles()
    reset('auto')
    status = node.status_now('simulation', lambda status: 'cells_with_lava' in status)
    assert (status['method'], 'particles' in status) == ('cells', False)
    assert int(status['cells_with_lava']) > 3 and float(status['cells_across']) > 1.0
    assert f'method: cells, because {status["method_reason"]}' in node.log
    assert not has_particles()
    # an effect that cells do not have: refused by the simulation, or with the parameter
    assert node.set(effects_on=['merging'])['success']
    node.wait_for_log('effects refused: The simulation runs on cells, which have no merging. Set')
    answer = node.set(method='cells')
    assert not answer['success'] and "effects_on is 'merging', expected" in answer['message']
    assert node.set(effects_on=[''], method='particles')['success']
    reset('particles')
    status = node.status_now('simulation', lambda status: 'particles' in status)
    assert (status['method'], 'method_reason' in status) == ('particles', False)
    assert has_particles()


def test_recording_parameters_can_be_changed(local):
    node = started(local)
    values = {'bag_directory': 'bags/split', 'bag_max_duration': 0.4}
    assert node.set(**values)['success']
    assert node.call('record', True)['success']
    node.run(1.0)
    status = node.status_now('recorder', lambda item: int(item['files']) > 1)
    assert 'checkpoints' not in status
    assert node.set(checkpoint_period=0.1)['success']
    node.status_now('recorder', lambda item: 'checkpoints' in item)
    assert node.call('record', False)['success']
    assert len(BagReader(node.directory / 'bags/split').topics) > 5


def test_save_during_a_recording_uses_its_bag(paused):
    assert paused.set(bag_directory='bags/run')['success']
    assert paused.call('record', True)['success']
    assert saved(paused.call('save')) == 'bags/run'
    assert newest_checkpoint(paused.directory / 'bags/run').checkpoint.time == 0.0
    before = paused.status_now('recorder')
    assert (before['state'], before['checkpoints']) == ('recording', '1')
    assert paused.call('record', False)['message'] == 'recorded bags/run'
    topics = [message.topic for message in BagReader(paused.directory / 'bags/run').messages()]
    # at the start and at the save
    assert topics.count('/height') == topics.count('/hazard') == 2
    # an existing bag is not changed
    answer = paused.call('save')
    assert not answer['success']
    assert "run', expected a folder that does not exist yet" in answer['message']


def test_markers_follow_their_vents_and_clicks_the_parameters(paused):
    paused.publish('vents')
    labels(paused, lambda texts: texts == ['vent 0: 20 m3/s, 1100 C'])
    paused.publish('click')
    labels(paused, lambda texts: len(texts) == 2)
    paused.publish('no_vents')
    labels(paused, lambda texts: not texts)
    values = {'default_discharge': 7.0, 'default_temperature': 900.0, 'default_radius': 25.0}
    assert paused.set(**values)['success']
    paused.publish('click')
    (text,) = labels(paused, lambda texts: len(texts) == 1 and 'click' in texts[0])
    assert text.endswith(': 7 m3/s, 900 C')
    # kelvin instead of Celsius is refused
    assert 'Celsius' not in paused.log
    paused.publish('kelvin_vents')
    paused.wait_for_log('vents[0].temperature is 1360 Celsius, 273 K above lava.reference_')
    assert '1360 K would be 1086.85 Celsius' in paused.log


@pytest.mark.parametrize(
    ('state', 'age', 'is_repeated'),
    [
        (WorkerState.RUNNING, 30.0, True),
        (WorkerState.RUNNING, 31.0, False),
        (WorkerState.STARTING, 31.0, False),
        (WorkerState.FAILED, 0.0, False),
        (WorkerState.PAUSED, 0.0, True),
    ],
)
def test_heartbeats_stop_while_the_state_is_stale(paused, monkeypatch, state, age, is_repeated):
    output = next(
        item for item in paused.node.runtime._layers._outputs if item.layer.name == 'hazard'
    )
    paused.hear()
    count = len(paused.seen)
    status = replace(paused.worker.status, state=state, age=age, max_age=30.0)
    with monkeypatch.context() as patch:
        patch.setattr(type(paused.worker), 'status', status)
        output.heartbeat.callback()
    paused.hear()
    repeated = [item['topic'] for item in paused.seen[count:]]
    assert repeated == ['hazard'] * is_repeated


def test_input_limits_can_be_changed(paused):
    paused.publish('vents')
    paused.run_commands()
    for name, limit, case, words in (
        ('max_vents', 1, 'click', 'already has 1 vents'),
        ('max_terrain_cells', 1199, 'terrain', '40 x 30'),
        ('max_input_bytes', 4799, 'terrain', '4800 bytes'),
    ):
        before = int(paused.status_now('inputs')['accepted'])
        assert paused.set(**{name: limit})['success']
        paused.publish(case)
        status = paused.status_now('inputs')
        assert words in status['last_error'] and name in status['last_error']
        assert paused.set(**{name: 100_000})['success']
        paused.publish(case, 'terrain_info')
        paused.status_now('inputs', lambda item: int(item['accepted']) > before)  # noqa: B023


def test_terrain_parameters_apply_to_the_next_terrain(paused):
    paused.publish('terrain_info', 'nan_hole')
    assert 'cells without data' in paused.status_now('inputs')['last_error']
    values = {'terrain_allow_holes': True, 'terrain_cloud_resolution': 20.0}
    assert paused.set(**values)['success']
    text = f'{", ".join(values)}: the new value is used for the next terrain from a topic'
    assert text in paused.log
    paused.publish('terrain_info', 'nan_hole')
    paused.wait_for_topic('height', lambda grid: grid['min'] == -1)
    paused.publish('terrain_cloud')
    grid = paused.wait_for_topic('height', lambda grid: grid['resolution'] == 20.0)
    assert grid['shape'] == [16, 21]


def test_accuracy_and_material_apply_at_the_next_reset(paused):
    values = {'lava__density': 2000.0, 'preset': 'draft', 'spacing': 5.0, 'bag_directory': ''}
    assert paused.set(**values)['success']
    place = {'epsg': 32633, 'offset_easting': 499000.0, 'offset_northing': 4180000.0}
    assert paused.set(**place)['success']
    paused.wait_for_log('spacing, lava.density: the new value is used from the next start')
    paused.publish('terrain_info', 'terrain')
    assert paused.call('reset')['success']
    paused.run_commands()
    checkpoint = newest_checkpoint(paused.directory / saved(paused.call('save'))).checkpoint
    assert checkpoint.accuracy.spacing == 5.0
    assert checkpoint.scene.lava.density == 2000.0
    terrain = checkpoint.scene.terrain
    assert (terrain.epsg, terrain.offset) == (32633, (499000.0, 4180000.0))


@pytest.mark.parametrize(
    ('name', 'topics', 'warning'),
    [
        ('tracker', ['vents'], ''),
        ('tracker', ['vents', 'vents'], 'several publishers of vents (/tracker)'),
        ('tracker', ['clicked_point', 'clicked_point'], ''),
        ('tracker', ['terrain', 'terrain_info'], ''),
        ('tracker', ['terrain', 'terrain'], 'several publishers of terrain and'),
        ('player', ['/diagnostics'], ''),
        ('player', ['hazard', 'height'], '/player also publishes /hazard, /height'),
        ('lava', ['hazard'], 'killed up to 20 s ago) also publishes /hazard'),
    ],
)
def test_nodes_that_publish_the_same_are_reported(paused, monkeypatch, name, topics, warning):
    monkeypatch.setattr(subscribers, 'RIVALS_PERIOD', 0.0)
    kinds = {
        'clicked_point': PointStamped, 'terrain_info': MapMetaData, 'terrain': Image,
        'vents': PointCloud2, '/diagnostics': DiagnosticArray,
    }
    context, before = Context(), len(paused.log)
    context.init(args=[], domain_id=paused.node.context.get_domain_id())
    other = Node(name, context=context, use_global_arguments=False, enable_rosout=False)

    def count(topic):
        ends = paused.node.get_publishers_info_by_topic(paused.node.resolve_topic_name(topic))
        return sum(end.node_name == name for end in ends)

    counts = {topic: count(topic) + topics.count(topic) for topic in topics}
    for topic in topics:
        other.create_publisher(kinds.get(topic, OccupancyGrid), topic, 10)
    # the names of nodes are discovered after their publishers
    paused.wait_until(lambda: all(count(topic) == counts[topic] for topic in topics))
    message = paused.status_now('inputs')['message']
    words = ('also publishes', 'several publishers of')
    assert any(word in message for word in words) == bool(warning)
    assert warning in message and warning in paused.log[before:]
    other.destroy_node()
    context.shutdown()
    paused.status_now('inputs', lambda item: not any(word in item['message'] for word in words))


def test_reset_and_lava_that_the_simulation_refuses_fail(running):
    # a value that only the start of a simulation refuses
    assert running.set(spacing=1e-5)['success']
    answer = running.call('reset')
    assert not answer['success'] and 'spacing is 1e-05, expected' in answer['message']
    answer = running.set(lava__solidus=1400.0)
    assert not answer['success'] and 'solid' in answer['message']
    assert running.status_now('simulation')['state'] == 'running'
