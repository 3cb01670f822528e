# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Every output of a node with a remapped topic: recorded, replayed and exported."""

from collections import Counter

import numpy as np
import pytest
import rasterio

from lava_ros.bag import BagReader, BagWriter
from lava_ros.bag.recorded_node import described_node
from lava_ros.clients import player
from lava_ros.layers.recording import Recording
from lava_ros.live.worker_status import WorkerState
from lava_ros.products.export import export_bag
from ros.graph_publisher import elevation
from ros.test_contract import MISSING, OPTIONAL, PACKAGES, rows

SCENE = """
terrain: {file: slope.npz}
vents: [{position: [60.0, 155.0], discharge: 20.0, radius: 12.0}]
lava: {viscosity: 1.0e4}
uncertainty: {discharge: {distribution: loguniform, low: 0.5, high: 2.0}}
"""

#: Outputs that rclpy makes, and the one that is not recorded.
UNRECORDED = {'/rosout', '/parameter_events', '~/transition_event', 'lava_particles'}

#: Names of all recorded topics in the table, in the order of their new names.
OUTPUTS = [
    name for name, way, *_ in rows('Topics')
    if way == 'out' and name not in UNRECORDED
    and PACKAGES.get(name) not in MISSING
]


#: All recorded topics; vents are an input.
RECORDED = [*OUTPUTS, 'vents']

NODE = '/etna/lava2'


def moved(name):
    """Return the full name of a topic after remapping, which has nothing of its own name."""
    return f'/moved/to/t{RECORDED.index(name)}'


def plain(name):
    """Return the full name of a topic without remapping."""
    return name if name.startswith('/') else f'/etna/{name}'


@pytest.fixture(scope='module')
def bag(module_local, tmp_path_factory):
    """A bag of a node with all outputs, each remapped."""
    node = module_local(
        remap=['__ns:=/etna', '__node:=lava2', *(f'{name}:={moved(name)}' for name in RECORDED)],
        scene='scene.yaml', spacing=0.0,
        layers_on=OPTIONAL, forecast_horizon=200.0 / 3600.0, ensemble_members=2,
        places=['places.csv'], record=True, bag_directory='bag',
    )
    np.savez(node.directory / 'slope.npz', elevation=elevation(), resolution=10.0, epsg=32633)
    (node.directory / 'places.csv').write_text('name,x,y\npost,500,155\n')
    (node.directory / 'scene.yaml').write_text(SCENE, encoding='utf-8')
    assert node.change('configure', NODE) and node.change('activate', NODE), node.log
    node.wait_until(lambda: node.worker.status.state is WorkerState.RUNNING)
    node.run(3.0)
    # forecasts and ensembles take some time; the listener has no messages without a header
    without = ('terrain_info', '/tf_static')
    node.newest(*(moved(name).removeprefix('/') for name in OUTPUTS if name not in without))
    assert node.change('shutdown', NODE), node.log
    return BagReader(node.directory / 'bag')


@pytest.fixture(scope='module')
def published(bag):
    """Number of messages of each topic that a replay in another namespace publishes."""
    counts = Counter()
    with pytest.MonkeyPatch.context() as patch:
        publish = player._Player.publish

        def note(self, step):
            before = self.published
            publish(self, step)
            if self.published > before:
                counts[self._publishers[step.message.topic].topic_name] += 1

        patch.setattr(player._Player, 'publish', note)
        arguments = ['--ros-args', '-r', '__ns:=/robot']
        player.play(bag, node=NODE, rate=1e9, ros_arguments=arguments)
    return counts


@pytest.mark.parametrize('name', RECORDED)
def test_remapped_output_is_recorded_and_replayed(bag, published, name):
    topic = moved(name)
    assert bag.topics[topic].count > 0
    assert described_node(bag.custom_data).topics[name.lstrip('/')] == topic
    # also in another namespace, because it was remapped out of that of the node
    assert published[topic] == bag.topics[topic].count


def test_no_other_topic_is_recorded_or_replayed(bag, published):
    stated = described_node(bag.custom_data)
    assert (stated.name, stated.namespace) == (NODE, '/etna')
    assert set(bag.topics) == set(published) == {moved(name) for name in RECORDED}


def test_maps_of_remapped_topics_are_exported(bag, tmp_path):
    names = {moved(name): plain(name) for name in RECORDED}
    with BagWriter(tmp_path / 'plain', custom_data={}) as writer:
        for item in bag.messages():
            kind, name = bag.topics[item.topic], names[item.topic]
            writer.write(name, kind.message_type, item.data, item.stamp_ns, qos=kind.qos)
    found, expected = Recording(bag.path), Recording(tmp_path / 'plain')
    assert {names[topic] for topic in found.layers} == set(expected.layers)
    assert found.places == expected.places == {'post': (500.0, 155.0)}
    files = {}
    for recording, folder in ((found, tmp_path / 'found'), (expected, tmp_path / 'expected')):
        done = export_bag(recording.bag.path, folder, epsg=32633)
        files[folder.name] = {path.name: path for path in done.files}
    assert files['found'].keys() == files['expected'].keys() == {
        'thickness.tif', 'temperature.tif', 'hazard.tif', 'arrival.tif', 'inundated.tif',
        'peak_thickness.tif',
    }
    for name, path in files['found'].items():
        with rasterio.open(path) as moved_map, rasterio.open(files['expected'][name]) as known:
            np.testing.assert_array_equal(moved_map.read(), known.read())
            assert moved_map.read(1, masked=True).count() > 0
