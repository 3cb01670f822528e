# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Two nodes with different names in one graph have separate topics, terrain and bags."""

import heapq

import numpy as np
import pytest
import rasterio

from lava_ros.bag import BagReader, BagWriter
from lava_ros.clients.player import play
from lava_ros.products.export import export_bag
from lava_ros.ros.publishers import ScenePublisher

ETNA, HEKLA = '/etna/lava', '/hekla/lava2'

#: Arguments of each node.
REMAPS = {
    ETNA: ['__ns:=/etna', 'hazard:=/map', 'clicked_point:=/rviz/click'],
    HEKLA: ['__ns:=/hekla', '__node:=lava2'],
}

#: Rows and columns of the terrain of each.
SHAPES = {ETNA: [20, 30], HEKLA: [16, 24]}

#: Names that each node has in the graph, and names that it does not have.
NAMES = {
    ETNA: (
        {'/map', '/rviz/click', '/etna/terrain', '/etna/lava/step', '/diagnostics'},
        {'/etna/hazard', '/etna/clicked_point', '/hazard', '/terrain'},
    ),
    HEKLA: (
        {'/hekla/hazard', '/hekla/clicked_point', '/hekla/lava2/step', '/diagnostics'},
        {'/map', '/rviz/click', '/hazard', '/terrain', '/hekla/lava/step'},
    ),
}

MAPS = {ETNA: ('etna/height', 'map'), HEKLA: ('hekla/height', 'hekla/hazard')}


def terrain(directory, name):
    """Write a slope with a hole, which would be refused in a terrain image."""
    rows, columns = SHAPES[name]
    _, x = np.mgrid[0:rows, 0:columns]
    ground = (300.0 - x).astype(np.float32)
    ground[-1, -1] = np.nan
    path = directory / f'{name.rpartition("/")[2]}.npz'
    np.savez(path, elevation=ground, resolution=10.0)
    return str(path)


@pytest.fixture
def start(local, tmp_path):
    """Return a function that starts an active node by name."""

    def start_node(name, **parameters):
        path = terrain(tmp_path, name)
        node = local(remap=REMAPS[name], terrain_file=path, **parameters)
        assert node.change('configure', name) and node.change('activate', name), node.log
        node.run_commands()
        return node

    return start_node


def test_each_node_has_its_own_names_vents_and_bag(start, tmp_path):
    nodes = {name: start(name, record=True) for name in NAMES}
    for name, node in nodes.items():
        expected, others = NAMES[name]
        assert expected < node.names()
        assert not others & node.names()
        space = name.rpartition('/')[0]
        outside = {item for item in node.names() if not item.startswith(f'{space}/')}
        assert outside - expected == {'/clock', '/parameter_events'}
        newest = node.newest(*MAPS[name])
        assert {tuple(item['shape']) for item in newest.values()} == {tuple(SHAPES[name])}
    etna, hekla = nodes.values()
    etna.publish('click')
    etna.run_commands()
    for node in nodes.values():
        node.run(6.0)
    assert etna.newest('map', condition=lambda newest: newest['map']['max'] > 0)
    hekla.hear()
    assert {item['max'] for item in hekla.seen if item['topic'] in MAPS[HEKLA]} == {0}
    for name, node in nodes.items():
        assert node.change('shutdown', name)
        assert 'ERROR' not in node.log
    bags = sorted((tmp_path / 'bags').iterdir(), key=lambda bag: bag.name[19:])
    assert [bag.name[19:] for bag in bags] == ['_etna_lava', '_hekla_lava2']
    readers = [BagReader(bag) for bag in bags]
    assert not any(reader.recovered for reader in readers)
    etnas, heklas = (set(reader.topics) for reader in readers)
    assert {'/map', '/etna/height', '/etna/terrain', '/diagnostics'} <= etnas
    assert {'/hekla/hazard', '/hekla/terrain', '/diagnostics'} <= heklas
    assert not [topic for topic in etnas if topic.startswith('/hekla')]
    assert not [topic for topic in heklas if topic.startswith(('/etna', '/map'))]
    check_exports(dict(zip(NAMES, readers, strict=True)), tmp_path)


def check_exports(readers, folder):
    """Check that a node's maps are the same from its own bag and from a bag of the graph."""
    with BagWriter(folder / 'graph', custom_data={}) as writer:
        for item in heapq.merge(
            *(reader.messages() for reader in readers.values()), key=lambda item: item.stamp_ns
        ):
            topic = next(
                reader.topics[item.topic] for reader in readers.values()
                if item.topic in reader.topics
            )
            writer.write(item.topic, topic.message_type, item.data, item.stamp_ns, qos=topic.qos)
    areas = {}
    for name, reader in readers.items():
        place = folder / f'maps{name.replace("/", "_")}'
        own, of_graph = (
            {path.name: path for path in export_bag(path, place / key, node=name).files}
            for key, path in (('own', reader.path), ('graph', folder / 'graph'))
        )
        # rosbag2 does not record that hazard is /map
        assert own.keys() - of_graph.keys() == ({'hazard.tif'} if name == ETNA else set())
        for file, path in of_graph.items():
            with rasterio.open(path) as found, rasterio.open(own[file]) as expected:
                assert list(found.shape) == SHAPES[name]
                np.testing.assert_array_equal(found.read(), expected.read())
        with rasterio.open(own['hazard.tif']) as file:
            areas[name] = int((file.read(1, masked=True).filled(0) > 0).sum())
    assert areas[ETNA] > 0 == areas[HEKLA]
    assert play(BagReader(folder / 'graph'), node=HEKLA, rate=1e9) == readers[HEKLA].message_count


def test_terrain_of_the_node_is_no_input(start, monkeypatch):
    is_echo, received = ScenePublisher.is_echo, []

    def note(publisher, topic, data):
        received.append((topic, is_echo(publisher, topic, data)))
        return received[-1][1]

    monkeypatch.setattr(ScenePublisher, 'is_echo', note)
    # as an input, the terrain would be scaled, and refused for its hole
    node = start(HEKLA, terrain_scale=2.0)
    node.wait_until(lambda: len(received) == 3)
    topics = 'terrain', 'terrain_georeference', 'terrain_info'
    assert sorted(received) == [(topic, True) for topic in topics]
    status = node.status_now('inputs', node='hekla/lava2')
    # the one accepted input is the terrain of the file
    assert (status['accepted'], status['rejected']) == ('1', '0')
    node.publish('terrain_info', 'terrain')
    node.wait_for_log('terrain: 40 x 30 cells of 10 m')
