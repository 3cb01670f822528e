# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""RViz and Foxglove show terrain, hazard and vents of a node and of all bags."""

from collections.abc import Callable
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import Marker
import yaml

from lava_ros.bag import BagReader, LATCHED
from lava_ros.maps.layer_files import load_layers
from lava_ros.ros import codec, outputs
from lava_ros.ros.codec import message_class
from lava_ros.ros.publishers import LayerPublishers, NodeGraph
from lava_ros.ros.recording import SceneRecording
from lava_ros.ros.snapshot_bags import write_snapshots
from lava_ros.scene import Lava, Scene, Terrain, Vent
from recording import growing, snapshot_at

ROOT = Path(__file__).parents[2]
RVIZ = yaml.safe_load((ROOT / 'rviz/lava.rviz').read_text(encoding='utf-8'))
FOXGLOVE = json.loads((ROOT / 'foxglove/lava.json').read_text(encoding='utf-8'))
DISPLAYS = {
    item['Topic']['Value']: item
    for item in RVIZ['Visualization Manager']['Displays']
    if 'Topic' in item
}

#: Topics that the views draw, all of them in the map frame.
DRAWN = {f'/{topic}' for topic in DISPLAYS} | set(FOXGLOVE['configById']['3D!lava']['topics'])

#: Height of the camera in RViz's top-down view [m], a constant of RViz.
CAMERA = 500.0

TERRAIN = Terrain(2000.0 + np.add.outer(np.arange(30.0), 2.0 * np.arange(40.0)), 5.0)
VENTS = (
    Vent((7.5, 75.0), ((0.0, 10.0), (500.0, 2.0)), 1423.0, name='north'),
    Vent((120.0, 20.0), 5.0, 1423.0, end=(160.0, 60.0), name='fissure'),
)
SCENE = Scene(TERRAIN, VENTS, lava=Lava())
SNAPSHOTS = [snapshot_at(time, growing(time, TERRAIN), TERRAIN) for time in (200.0, 600.0)]


def record_node(directory: Path) -> Path:
    node: Any = SimpleNamespace(resolve_topic_name='/{}'.format, get_namespace=lambda: '/')
    graph: Any = NodeGraph(node, 'map')
    recorder = graph.recorder
    recording = SceneRecording(graph, configs={}, parameters=dict)

    def create(kind: str, message: Any, topic: str, given: Any) -> Any:
        return SimpleNamespace(publish=lambda data: None, topic_name=f'/{topic}')

    enabled = [layer for layer in load_layers(ROOT / 'msg_configs/default.yaml') if layer.enabled]
    graph.create = create
    layers: Any = LayerPublishers(graph, enabled)
    recorder.arm(directory)
    for snapshot in SNAPSHOTS:
        stamp = int(snapshot.time * 1e9)
        eruption = SimpleNamespace(
            scene=SCENE, effects={}, schedule=VENTS, origin=None, device='cpu'
        )
        recording.write(eruption, snapshot, stamp)
        layers.publish(snapshot, stamp, also_not_due=True, repeat=False)
    recorder.stop()
    return directory


def record_hindcast(directory: Path) -> Path:
    write_snapshots(directory, SCENE, SNAPSHOTS, custom_data={})
    return directory


def sample(directory: Path) -> Path:
    return ROOT / 'bags/sample'


MAKERS = (record_node, record_hindcast, sample)


@pytest.mark.parametrize('make', MAKERS)
def test_bags_have_the_topics_of_the_views(make: Callable[[Path], Path], tmp_path: Path) -> None:
    bag = BagReader(make(tmp_path / 'bag'))
    first: dict[str, Any] = {}
    for item in bag.messages():
        kind = message_class(bag.topics[item.topic].message_type)
        first.setdefault(item.topic, (item.stamp_ns, deserialize_message(item.data, kind)))
    assert set(first) >= DRAWN
    for topic in DRAWN:
        assert bag.topics[topic].qos == LATCHED, topic
    stamp_ns, hazard = first['/hazard']
    for topic in ('/relief', '/vents_markers'):
        assert first[topic][0] <= stamp_ns
    relief = first['/relief'][1]
    for name in ('width', 'height', 'resolution', 'origin'):
        assert getattr(relief.info, name) == getattr(hazard.info, name)
    drawn = [item for item in first['/vents_markers'][1].markers if item.action == Marker.ADD]
    labels = [item.text.partition(':')[0] for item in drawn if item.text]
    assert labels in (['north', 'fissure'], ['crater'])
    assert {item.header.frame_id for item in drawn} == {relief.header.frame_id} == {'map'}


@pytest.mark.parametrize('elevation', [-50.0, 450.0, 2500.0, 8000.0])
@pytest.mark.parametrize('resolution', [0.01, 30.0, 1000.0])
def test_vents_are_below_the_camera(elevation: float, resolution: float) -> None:
    view = RVIZ['Visualization Manager']['Views']['Current']
    assert view['Class'] == 'rviz_default_plugins/TopDownOrtho'
    terrain = Terrain(np.full((20, 30), elevation), resolution)
    x, y = 10.0 * resolution, 5.0 * resolution
    vents = (
        Vent((x, y), 1.0, 1423.0, radius=min(resolution, 1e4)),
        Vent((x, y), 1.0, 1423.0, radius=0.1, end=(2.0 * x, y)),
    )
    _, *markers = outputs.vent_markers(vents, 0.0, terrain, codec.header('map', 0)).markers
    for item in markers:
        if item.ns == outputs.ELEVATIONS:
            assert max(point.z for point in item.points) == max(elevation, 0.0)
            continue
        heights = [item.pose.position.z, *(point.z for point in item.points)]
        assert 0.0 <= min(heights) <= max(heights) <= 1.0 < CAMERA
        # RViz draws translucent maps above translucent markers
        assert item.color.a == 1.0


def test_maps_are_transparent_above_the_relief() -> None:
    for topic, display in DISPLAYS.items():
        if 'Color Scheme' in display:
            is_ground = topic == 'relief'
            assert display['Draw Behind'] is is_ground
            assert display['Color Scheme'] == ('map' if is_ground else 'costmap')
            assert 0.4 <= display['Alpha'] < 1.0
    topics = FOXGLOVE['configById']['3D!lava']['topics']
    modes = {name: item['colorMode'] for name, item in topics.items() if 'colorMode' in item}
    assert {name for name, mode in modes.items() if mode == 'map'} == {'/relief'}
    assert {mode for name, mode in modes.items() if name != '/relief'} == {'costmap'}
