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

"""Services, optional layers, markers and parameters of a node that runs in a real graph."""

import numpy as np
import pytest

from lava_ros.bag import BagReader
from lava_ros.bag.checkpoints import newest_checkpoint
from ros.graph_publisher import elevation

GRIDS = ('height', 'temperature', 'hazard')
OPTIONAL = ('height_raw', 'temperature_raw', 'lava_points')

#: visualization_msgs/Marker actions.
ADD, DELETEALL = 0, 3

#: Simulated seconds in a second.
SCALE = 20.0

SCENE = """
terrain: {file: slope.npz}
vents:
  - position: [60.0, 155.0]
    discharge: [[0.0, 20.0], [40.0, 0.0]]
    radius: 12.0
    name: north
lava: {viscosity: 1.0e4}
"""


class Running:
    """A node with the optional layers, which waits to be activated."""

    def __init__(self, graph):
        self.graph = graph
        self.bags = graph.directory / 'bags'
        np.savez(graph.directory / 'slope.npz', elevation=elevation(), resolution=10.0)
        (graph.directory / 'scene.yaml').write_text(SCENE, encoding='utf-8')
        self.node = graph.node(
            autostart=False,
            device='cpu',
            time_scale=SCALE,
            scene='scene.yaml',
            layers_on=list(OPTIONAL),
            layers_off=['temperature'],
            checkpoint_period=0.0,
            bag_root=str(self.bags),
        )
        self.publisher = graph.publisher()
        self.listener = graph.listener(
            *GRIDS, 'height_raw:image', 'temperature_raw:image', 'lava_points:cloud',
            'vents_markers:markers',
        )

    def recorder(self, condition=lambda _: True):
        """The recorder's status that is told from now on and fulfils a condition."""
        return self.listener.status_now('recorder', condition)

    def labels(self, condition):
        """What is written beside the vents once that fulfils a condition."""

        def texts(message):
            return [item['text'] for item in message['markers'] if item['text']]

        message = self.listener.wait_for_topic(
            'vents_markers', lambda message: condition(texts(message))
        )
        assert message['markers'][0]['action'] == DELETEALL
        assert {item['action'] for item in message['markers'][1:]} <= {ADD}
        return texts(message)


@pytest.fixture(scope='module')
def running(graph):
    """One node for all tests here, one after the other."""
    return Running(graph)


def test_services_of_an_inactive_node(running):
    """Before it is active a node has no map to give and nothing to save, and says so."""
    assert running.publisher.change('configure'), running.node.log
    assert running.publisher.map('height')['shape'] == [0, 0]
    for service in ('save', 'step'):
        answer = running.publisher.call(service)
        assert not answer['success']
        assert answer['message'].startswith(f"{service} is 'inactive', expected an active node")


def test_markers_follow_the_discharge(running):
    """Markers are there from the start, and told again when the discharge of a vent changes."""
    # who listens hears the first of them only when it is there before
    running.listener.wait_for_topic('diagnostics')
    assert running.publisher.change('activate'), running.node.log
    assert running.labels(bool) == ['north: 20 m3/s, 1087 C']
    assert running.labels(lambda texts: ' 0 m3/s' in texts[0]) == ['north: 0 m3/s, 1087 C']
    heard = [item for item in running.listener.seen if item['topic'] == 'vents_markers']
    # once for each discharge, not with every map
    assert len(heard) == 2
    # an inactive node holds time: nobody has paused it
    assert running.publisher.change('deactivate'), running.node.log
    running.listener.status_now('simulation', lambda status: status['state'] == 'paused')
    running.node.wait_for_log('inactive')
    assert running.publisher.change('activate'), running.node.log
    running.node.wait_for_log('simulation running')
    assert 'paused' not in running.node.log


def test_optional_layers_are_switched_on_and_off(running):
    """Named layers are published beside those of the file, and others are not."""
    newest = running.listener.newest(
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
    # the ground falls from 500 m by 40 m, and rises by up to 12 m towards the sides
    assert 460.0 < mean['z'] - mean['thickness'] < 512.0
    assert 0.0 < mean['x'] < 400.0
    assert 100.0 < mean['y'] < 200.0
    assert 'temperature' not in {item['topic'] for item in running.listener.seen}


def test_get_map_gives_what_is_published(running):
    """A latecomer gets the newest map, cell for cell the one on the topic."""
    assert running.publisher.call('pause', True)['success']
    for topic, published in running.listener.at_rest('height', 'hazard').items():
        answer = running.publisher.map(topic)
        names = ('stamp_ns', 'shape', 'cells')
        assert answer == {name: published[name] for name in names}


def saved(answer):
    """The bag that an answer of ~/save names."""
    assert answer['success'], answer
    assert answer['message'].startswith('saved in ')
    return answer['message'].removeprefix('saved in ')


def test_save_makes_a_bag_of_this_moment(running):
    """The bag has terrain, vents, maps and a checkpoint, and each call makes another."""
    first, second = (saved(running.publisher.call('save')) for _ in range(2))
    assert first != second
    status = running.listener.status_now('simulation')
    for name in (first, second):
        bag = BagReader(running.graph.directory / name)
        assert not bag.recovered
        topics = [message.topic for message in bag.messages()]
        assert topics[:3] == ['/terrain', '/terrain_info', '/vents']
        assert {f'/{topic}' for topic in ('height', 'hazard', *OPTIONAL)} <= set(topics)
        # checkpoint_period is 0 here: this one was asked for
        found = newest_checkpoint(running.graph.directory / name).checkpoint
        assert found.time == pytest.approx(float(status['simulated_time_s']))
        assert found.scene.vents[0].name == 'north'
    state = running.recorder()
    assert (state['state'], state['level']) == ('off', 0)


def test_save_while_recording_goes_into_that_bag(running):
    """The recording has maps and a checkpoint of that moment, and goes on until it is ended."""
    bag = running.bags / 'run'
    assert running.publisher.set(bag_directory=str(bag))['success']
    assert running.publisher.call('record', True)['success']
    assert saved(running.publisher.call('save')) == str(bag)
    # a killed node would leave what was saved
    assert newest_checkpoint(bag).checkpoint.particle_count > 0
    before = running.recorder()
    assert (before['state'], before['checkpoints']) == ('recording', '1')
    assert running.publisher.call('record', False)['message'] == f'recorded {bag}'
    topics = [message.topic for message in BagReader(bag).messages()]
    # at the start of the recording, and when it was saved
    assert topics.count('/height') == topics.count('/lava_points') == 2
    # a bag that exists is not written into
    answer = running.publisher.call('save')
    assert not answer['success']
    assert "run', expected a folder that does not exist yet" in answer['message']


def test_a_bag_that_is_gone_while_it_is_recorded(running):
    """Diagnostics, log and the service say so; nothing goes where a link in its place leads."""
    bag, outside = running.bags / 'gone', running.graph.directory / 'outside'
    outside.mkdir()
    assert running.publisher.set(bag_directory=str(bag))['success']
    assert running.publisher.call('record', True)['success']
    bag.rename(running.bags / 'moved')
    bag.symlink_to(outside)
    status = running.recorder(lambda status: status['level'] == 2)
    assert status['state'] == 'off'
    reason = f'recording to {bag} stopped: {bag} was removed, moved or replaced'
    assert status['message'] == reason
    answer = running.publisher.call('record', False)
    assert not answer['success']
    assert reason in answer['message']
    running.node.wait_for_log(reason)
    said = [line for line in running.node.log.splitlines() if reason in line]
    assert len(said) == 1 and '[ERROR]' in said[0], said
    assert list(outside.iterdir()) == []
    assert running.publisher.set(bag_directory='')['success']


def test_markers_go_with_their_vents(running):
    """Vents that open, change and are removed are told, in a paused simulation too."""
    running.publisher.publish('click')
    assert len(running.labels(lambda texts: len(texts) == 2)) == 2
    running.publisher.flood(2, 10.0, 33.0)
    assert running.labels(lambda texts: '33' in texts[0]) == ['vent 0: 33 m3/s, 1100 C']
    running.publisher.publish('no_vents')
    message = running.listener.wait_for_topic(
        'vents_markers', lambda message: len(message['markers']) == 1
    )
    assert message['markers'][0]['action'] == DELETEALL


def test_what_a_click_opens_can_be_changed(running):
    """The next click opens a vent as the parameters say then."""
    values = {'default_discharge': 7.0, 'default_temperature': 900.0, 'default_radius': 25.0}
    assert running.publisher.set(**values)['success']
    running.publisher.publish('click')
    (text,) = running.labels(lambda texts: len(texts) == 1)
    assert text.endswith(': 7 m3/s, 900 C')
    # kelvin in place of Celsius does not go unnoticed
    assert 'Celsius' not in running.node.log
    running.publisher.publish('kelvin_vents')
    running.node.wait_for_log('vents[0].temperature is 1360 Celsius, 273 K above lava.reference_')
    assert '1360 K would be 1086.85 Celsius' in running.node.log


def test_how_inputs_are_read_can_be_changed(running):
    """What is beyond a limit that has just been set is refused, and taken again after that.

    Holes of the next terrain, and cells of the next cloud, are as the parameters say then.
    """

    def is_refused(*words):
        running.listener.wait_for_status(
            'inputs', lambda status: all(word in status['last_error'] for word in words)
        )

    for name, limit, case, words in (
        ('max_vents', 1, 'click', 'one more vent'),
        ('max_terrain_cells', 1199, 'terrain', '40 x 30'),
        ('max_input_bytes', 4799, 'terrain', '4800 bytes'),
    ):
        assert running.publisher.set(**{name: limit})['success']
        running.publisher.publish(case)
        is_refused(words, name)
        assert running.publisher.set(**{name: 100_000})['success']
    # the marker of the click before stays until something else is taken
    newest = running.listener.newest('vents_markers')['vents_markers']
    assert len([item for item in newest['markers'] if item['text']]) == 1
    running.publisher.publish('vents', 'nan_hole')
    is_refused('cells without data')
    values = {'terrain_allow_holes': True, 'terrain_cloud_resolution': 20.0}
    assert running.publisher.set(**values)['success']
    running.publisher.publish('terrain_info', 'nan_hole')
    running.listener.wait_for_topic('height', lambda grid: grid['min'] == -1)
    running.publisher.publish('terrain_cloud')
    grid = running.listener.wait_for_topic('height', lambda grid: grid['resolution'] == 20.0)
    assert grid['shape'] == [16, 21]


def test_accuracy_material_and_place_can_be_changed(running):
    """Spacing and lava are those of the next reset, the projected system of the next terrain."""
    values = {'lava__density': 2000.0, 'preset': 'draft', 'spacing': 4.0}
    assert running.publisher.set(**values)['success']
    place = {'epsg': 32633, 'offset_easting': 499000.0, 'offset_northing': 4180000.0}
    assert running.publisher.set(**place)['success']
    running.publisher.publish('terrain_info', 'terrain')
    assert running.publisher.call('reset')['success']
    running.listener.wait_for_topic('height', lambda grid: grid['shape'] == [30, 40])
    found = newest_checkpoint(running.graph.directory / saved(running.publisher.call('save')))
    checkpoint = found.checkpoint
    assert checkpoint.accuracy.spacing == 4.0
    assert checkpoint.scene.lava.density == 2000.0
    terrain = checkpoint.scene.terrain
    assert (terrain.epsg, terrain.offset) == (32633, (499000.0, 4180000.0))


def test_the_end_can_be_changed(running):
    """A simulation ends at a time that is set while it runs, and goes on when that is lifted."""
    assert running.publisher.set(end_time=10.0)['success']
    assert running.publisher.call('pause', False)['success']
    status = running.listener.wait_for_status(
        'simulation', lambda status: status['state'] == 'finished'
    )
    assert float(status['simulated_time_s']) == 10.0
    assert running.publisher.set(end_time=0.0)['success']
    running.listener.wait_for_status(
        'simulation', lambda status: float(status['simulated_time_s']) > 10.0
    )


def test_how_bags_are_written_can_be_changed(running):
    """Limits of a bag's files hold for the next one, the period of checkpoints at once."""
    bag = running.bags / 'split'
    values = {'bag_directory': str(bag), 'bag_max_duration': 0.1}
    assert running.publisher.set(**values)['success']
    assert running.publisher.call('record', True)['success']
    status = running.recorder(lambda item: int(item['files']) > 1)
    assert 'checkpoints' not in status
    assert running.publisher.set(checkpoint_period=0.1)['success']
    running.recorder(lambda item: 'checkpoints' in item)
    assert running.publisher.call('record', False)['success']
    assert len(BagReader(bag).topics) > 5


def test_a_storm_of_saves_is_bounded(running):
    """What comes too often is refused with the reason, and makes no bag.

    It is the last test of this node: it leaves nothing of the allowance to others, whose five
    saves fit into it at whatever speed they come.
    """
    assert running.publisher.set(bag_directory='', bag_max_duration=0.0)['success']
    before = set(running.graph.directory.rglob('*.mcap'))
    answers = [running.publisher.call('save')]
    # where saves are slow their allowance grows meanwhile, and less than they take of it
    while len(answers) < 30 and answers[-1]['success']:
        answers.append(running.publisher.call('save'))
    assert 'one more each' in answers[-1]['message'], answers[-1]
    made = set(running.graph.directory.rglob('*.mcap')) - before
    assert len(made) == len(answers) - 1
    status = running.recorder()
    assert (status['state'], status['level']) == ('off', 0)
    assert 'Traceback' not in running.node.log
