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

"""Two nodes of other names in one graph: namespaces, remaps, bags; neither disturbs the other."""

import signal

import numpy as np
import pytest

from lava_ros.bag import BagReader

ETNA, HEKLA = '/etna/lava', '/hekla/lava2'


def terrain(path, rows, columns):
    """A slope in a file."""
    _, x = np.mgrid[0:rows, 0:columns]
    np.savez(path, elevation=(300.0 - x).astype(np.float32), resolution=10.0)
    return str(path)


class Two:
    """Two volcanoes, with someone who clicks on one of them and someone who hears both."""

    def __init__(self, graph):
        self.directory = graph.directory
        common = {'device': 'cpu', 'time_scale': 20.0, 'record': True}
        self.etna = graph.node(
            remap=['__ns:=/etna', 'hazard:=/map', 'clicked_point:=/rviz/click'],
            terrain_file=terrain(graph.directory / 'etna.npz', 20, 30),
            **common,
        )
        self.hekla = graph.node(
            remap=['__ns:=/hekla', '__node:=lava2'],
            terrain_file=terrain(graph.directory / 'hekla.npz', 16, 24),
            **common,
        )
        self.client = graph.client()
        self.publisher = graph.publisher(remap=['clicked_point:=/rviz/click'])
        self.listener = graph.listener('/etna/height', '/map', '/hekla/height', '/hekla/hazard')

    def simulation(self, node, condition=lambda _: True):
        """The status of a node's simulation that comes next and fulfils a condition."""
        self.listener.hear()
        return self.listener.wait_for_status(
            'simulation', condition, node=node.strip('/'), timeout=60.0
        )


@pytest.fixture(scope='module')
def two(graph):
    """Two nodes for all tests here."""
    return Two(graph)


def test_each_has_its_own_map(two):
    """Topics follow namespaces and remaps; terrain and lava of one are not the other's."""
    for topic, shape in (
        ('/etna/height', [20, 30]),
        ('/map', [20, 30]),
        ('/hekla/height', [16, 24]),
        ('/hekla/hazard', [16, 24]),
    ):
        assert two.listener.wait_for_topic(topic, timeout=90.0)['shape'] == shape
    two.publisher.publish('click')
    two.listener.wait_for_topic('/etna/height', lambda grid: grid['wet'] > 0, timeout=60.0)
    assert two.listener.wait_for_topic('/map', lambda grid: grid['max'] > 0)['shape'] == [20, 30]
    two.simulation(HEKLA)
    hekla = [item for item in two.listener.seen if item['topic'].startswith('/hekla')]
    assert {item['max'] for item in hekla} == {0}


def test_names(two):
    """Everything that is relative lies in the node's namespace, all that is remapped elsewhere."""
    etna, hekla = (set(two.client.names(node=node)) for node in (ETNA, HEKLA))
    assert {'/map', '/rviz/click', '/etna/terrain', '/etna/lava/step', '/diagnostics'} < etna
    assert not {'/etna/hazard', '/etna/clicked_point', '/hazard', '/terrain'} & etna
    assert {'/hekla/hazard', '/hekla/terrain', '/hekla/lava2/step'} < hekla
    ours = {name for name in etna & hekla if not name.startswith(('/rosout', '/parameter'))}
    assert ours == {'/diagnostics'}


def test_commands_reach_one_alone(two):
    """A pause, a parameter or a transition of one leaves the other as it was."""
    assert two.client.call('pause', True, node=ETNA)['success']
    assert two.client.set({'time_scale': 7.0}, node=ETNA)['success']
    two.simulation(ETNA, lambda status: status['state'] == 'paused')
    before = two.simulation(HEKLA)
    after = two.simulation(HEKLA)
    assert after['state'] == 'running'
    passed = float(after['simulated_time_s']) - float(before['simulated_time_s'])
    assert passed > 10.0
    assert two.client.change('deactivate', node=ETNA)
    assert two.simulation(ETNA)['message'] == 'inactive: paused'
    assert two.simulation(HEKLA)['message'] == 'running'
    assert two.client.state(node=HEKLA) == 'active'


def test_bags_are_each_nodes_own(two):
    """Named by the same second they are two, each with what its node has said."""
    for node in (two.etna, two.hekla):
        assert node.end(signal.SIGINT) == 0
        assert 'ERROR' not in node.log
    bags = sorted((two.directory / 'bags').iterdir(), key=lambda bag: bag.name[19:])
    assert [bag.name[19:] for bag in bags] == ['_etna_lava', '_hekla_lava2']
    etna, hekla = map(BagReader, bags)
    assert not etna.recovered
    assert not hekla.recovered
    assert {'/map', '/etna/height', '/etna/terrain', '/diagnostics'} <= set(etna.topics)
    assert {'/hekla/hazard', '/hekla/terrain', '/diagnostics'} <= set(hekla.topics)
    assert not [topic for topic in etna.topics if topic.startswith('/hekla')]
    assert not [topic for topic in hekla.topics if topic.startswith(('/etna', '/map'))]


def test_two_of_one_name_in_one_second(graph):
    """Recordings that begin within a second go to bags of their own."""
    node = graph.node(aside=True, device='cpu', bag_root='quick', terrain_file='hekla.npz')
    client = graph.client(aside=True)
    node.wait_for_log('simulation running', timeout=90.0)
    names = set()
    for _ in range(3):
        answer = client.call('save')
        assert answer['success'], answer
        names.add(answer['message'])
    assert len(names) == 3
    assert node.end() == 0
    assert all(not BagReader(bag).recovered for bag in (graph.directory / 'quick').iterdir())
