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

"""Two nodes of other names in one graph: namespaces, remaps, terrain, bags; each is its own."""

import signal

import numpy as np
import pytest

from lava_ros.bag import BagReader

ETNA, HEKLA = '/etna/lava', '/hekla/lava2'


def terrain(path, rows, columns):
    """A slope with a hole in a file; a terrain image would be refused for it."""
    _, x = np.mgrid[0:rows, 0:columns]
    ground = (300.0 - x).astype(np.float32)
    ground[-1, -1] = np.nan
    np.savez(path, elevation=ground, resolution=10.0)
    return str(path)


class Two:
    """Two volcanoes, with someone who clicks on one of them and someone who hears both."""

    def __init__(self, graph):
        self.graph, self.directory = graph, graph.directory
        common = {'device': 'cpu', 'time_scale': 20.0, 'record': True}
        self.etna = graph.node(
            remap=['__ns:=/etna', 'hazard:=/map', 'clicked_point:=/rviz/click'],
            terrain_file=terrain(graph.directory / 'etna.npz', 20, 30),
            **common,
        )
        self.hekla = graph.node(
            remap=['__ns:=/hekla', '__node:=lava2'],
            terrain_file=terrain(graph.directory / 'hekla.npz', 16, 24),
            # of images alone: what it publishes of its own terrain comes back to it
            terrain_scale=2.0,
            **common,
        )
        topics = ('terrain', 'terrain_info')
        self.publisher = graph.publisher(
            remap=['clicked_point:=/rviz/click', *(f'{name}:=/hekla/{name}' for name in topics)]
        )
        self.listener = graph.listener('/etna/height', '/map', '/hekla/height', '/hekla/hazard')

    def status(self, node, condition=lambda _: True, task='simulation'):
        """The status of a node's task that is told from now on and fulfils a condition."""
        return self.listener.status_now(task, condition, node=node.strip('/'))


@pytest.fixture(scope='module')
def two(graph):
    """Two nodes for all tests here."""
    return Two(graph)


def test_each_has_its_own_map(two):
    """Topics follow namespaces and remaps; terrain and lava of one are not the other's."""
    found = two.listener.newest('/etna/height', '/map', '/hekla/height', '/hekla/hazard')
    assert {topic: item['shape'] for topic, item in found.items()} == {
        '/etna/height': [20, 30],
        '/map': [20, 30],
        '/hekla/height': [16, 24],
        '/hekla/hazard': [16, 24],
    }
    two.publisher.publish('click')
    two.listener.newest(
        '/etna/height',
        '/map',
        condition=lambda newest: newest['/etna/height']['wet'] > 0 and newest['/map']['max'] > 0,
    )
    two.status(HEKLA)
    hekla = [item for item in two.listener.seen if item['topic'].startswith('/hekla')]
    assert {item['max'] for item in hekla} == {0}


def test_the_terrain_of_a_file_is_there_for_who_comes_late(two):
    """One that comes by the topics takes its place, and then it alone is there."""
    topics = ('/hekla/terrain:image', '/hekla/relief')
    first = two.graph.listener(*topics).newest('/hekla/terrain', '/hekla/relief')
    seen, relief = first['/hekla/terrain'], first['/hekla/relief']
    assert (seen['shape'], seen['encoding']) == ([16, 24], '32FC1')
    assert seen['max'] == pytest.approx(300.0)
    # by the hole there is no slope; elsewhere light and shade
    assert relief['shape'] == [16, 24] and relief['min'] == -1 and 0 < relief['max'] <= 100
    # it has come back to the node by now, and is no news
    inputs = two.status(HEKLA, task='inputs')
    assert (inputs['accepted'], inputs['rejected']) == ('1', '0'), inputs
    two.publisher.publish('terrain_info', 'terrain')
    two.listener.wait_for_topic('/hekla/height', lambda grid: grid['shape'] == [30, 40])
    second = two.graph.listener(*topics)
    # what is heard has a relief as well
    second.newest(
        '/hekla/terrain',
        '/hekla/relief',
        condition=lambda newest: newest['/hekla/relief']['shape'] == [30, 40],
    )
    two.status(HEKLA)
    second.hear()
    assert seen['sha256'] not in {item['sha256'] for item in second.seen}


def test_names(two):
    """Everything that is relative lies in the node's namespace, all that is remapped elsewhere."""
    expected = (
        {'/map', '/rviz/click', '/etna/terrain', '/etna/lava/step', '/diagnostics'},
        {'/hekla/hazard', '/hekla/terrain', '/hekla/lava2/step', '/diagnostics'},
    )
    etna, hekla = (
        set(two.publisher.names(names, node=node))
        for node, names in zip((ETNA, HEKLA), expected, strict=True)
    )
    assert expected[0] < etna and expected[1] < hekla
    assert not {'/etna/hazard', '/etna/clicked_point', '/hazard', '/terrain'} & etna
    ours = {name for name in etna & hekla if not name.startswith(('/rosout', '/parameter'))}
    assert ours == {'/diagnostics'}


def test_commands_reach_one_alone(two):
    """A pause, a parameter or a transition of one leaves the other as it was."""
    assert two.publisher.call('pause', True, node=ETNA)['success']
    assert two.publisher.set(time_scale=7.0, node=ETNA)['success']
    two.status(ETNA, lambda status: status['state'] == 'paused')
    before = float(two.status(HEKLA)['simulated_time_s'])
    two.status(HEKLA, lambda status: float(status['simulated_time_s']) > before)
    assert two.publisher.change('deactivate', node=ETNA)
    # beside what each has to say of its last map, or of a machine that is too slow for it
    etna, hekla = (two.status(node) for node in (ETNA, HEKLA))
    assert (etna['lifecycle'], etna['state']) == ('inactive', 'paused')
    assert etna['message'].startswith('inactive: ')
    assert (hekla['lifecycle'], hekla['state']) == ('active', 'running')
    assert two.publisher.state(node=HEKLA) == 'active'


def test_bags_are_each_nodes_own(two):
    """Named by the same second they are two, each with what its node has said."""
    for node in (two.etna, two.hekla):
        assert node.end(signal.SIGINT) == 0
        assert 'ERROR' not in node.log and 'Traceback' not in node.log
    bags = sorted((two.directory / 'bags').iterdir(), key=lambda bag: bag.name[19:])
    assert [bag.name[19:] for bag in bags] == ['_etna_lava', '_hekla_lava2']
    etna, hekla = map(BagReader, bags)
    assert not etna.recovered
    assert not hekla.recovered
    assert {'/map', '/etna/height', '/etna/terrain', '/diagnostics'} <= set(etna.topics)
    assert {'/hekla/hazard', '/hekla/terrain', '/diagnostics'} <= set(hekla.topics)
    assert not [topic for topic in etna.topics if topic.startswith('/hekla')]
    assert not [topic for topic in hekla.topics if topic.startswith(('/etna', '/map'))]
