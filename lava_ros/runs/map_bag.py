# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags of maps, written without ROS, like those of a node with the default name."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import lava_ros
from lava_ros.bag import BagReader, BagWriter, LATCHED, messages, QosProfile
from lava_ros.bag.encoding import encode, Message
from lava_ros.bag.messages import header_fields
from lava_ros.bag.recorded_node import DEFAULT_NODE, described_node, RecordedNode
from lava_ros.bag.status_values import snapshot_values
from lava_ros.files.resources import share_path
from lava_ros.files.yaml import dump_yaml
from lava_ros.layers.forecast import EnsembleForecast
from lava_ros.layers.layer import ARRIVED, GRID_MAP, INUNDATED, Layer
from lava_ros.layers.layer_files import load_layers
from lava_ros.layers.messages import layer_message, SceneMessages
from lava_ros.scene import Scene, scene_to_dict
from lava_ros.scene.onset import Onset
from lava_ros.simulation.output.snapshot import Snapshot

#: ROS time of simulated time 0 [ns]: 2001-09-09T01:46:40Z, a round number of seconds.
START_NS = 1_000_000_000 * 10**9

#: Layers of a run.
LAYERS = 'msg_configs/default.yaml'

_FRAME = 'map'


def stamp_at(time: float) -> int:
    """Return the ROS time of a simulated time [ns]."""
    return START_NS + round(time * 1e9)


class MapBag(BagWriter):
    """A bag that contains only one node.

    Attributes:
        node: The node, with the topics written so far.
    """

    def __init__(
        self, path: Path, scene: Scene, data: Mapping[str, str], *, namespace: str = ''
    ) -> None:
        """Create the bag.

        Args:
            path: Its directory.
            scene: The scene, which the description contains.
            data: Further parts of the description.
            namespace: Namespace of the node.

        Raises:
            LavaError: If the bag exists or cannot be created.
            OSError: If its first file cannot be written.
        """
        onset = Onset.of(scene)
        self._data = {
            'scene': dump_yaml(scene_to_dict(scene)), 'version': lava_ros.__version__,
            'frame_id': _FRAME, **({} if onset is None else {'onset': onset.text}), **data,
        }
        self.node = RecordedNode(f'{namespace}{DEFAULT_NODE}', namespace or '/', {})
        super().__init__(path, custom_data=self._described())
        self._messages = SceneMessages()

    def describe(self, data: Mapping[str, str]) -> None:
        """Replace parts of the description."""
        self._data |= data
        self.set_custom_data(self._described())

    def _described(self) -> dict[str, str]:
        return {**self._data, **self.node.description}

    def put(
        self, topic: str, message: Message, stamp_ns: int, qos: QosProfile = LATCHED
    ) -> None:
        """Write a message on a topic of the node."""
        name = self.node.topic(topic)
        if topic not in self.node.topics:
            self.node = replace(self.node, topics={**self.node.topics, topic: name})
            self.set_custom_data(self._described())
        self.write(name, message.kind, encode(message), stamp_ns, qos=qos)

    def put_scene(self, scene: Scene, time: float, stamp_ns: int) -> None:
        """Write the terrain and the vents at a simulated time [s], if they have changed."""
        header = header_fields(_FRAME, stamp_ns)
        for topic, message in self._messages.update(scene, time, header).items():
            self.put(topic, message, stamp_ns)

    def put_layer(self, layer: Layer, shown: Snapshot | EnsembleForecast, stamp_ns: int) -> None:
        """Write a layer."""
        message = layer_message(layer, shown, header_fields(_FRAME, stamp_ns))
        self.put(layer.topic, message, stamp_ns, layer.qos)

    def put_status(self, values: Mapping[str, object], stamp_ns: int) -> None:
        """Write the status of the simulation."""
        task = f'{self.node.name.strip("/")}: simulation'
        self.put('diagnostics', messages.diagnostics(task, 'finished', values, stamp_ns), stamp_ns)


class RunBag(MapBag):
    """A bag with the maps of a run; its ROS time is simulated time after ``START_NS``."""

    def __init__(self, path: Path, scene: Scene, data: Mapping[str, str]) -> None:
        """Create the bag; arguments and errors as for ``MapBag``."""
        config = share_path(LAYERS)
        self.layers = [
            item for item in load_layers(config) if item.enabled and item.message != GRID_MAP
        ]
        self._known: tuple[float, dict[str, object]] = (-1.0, {})
        text = config.read_text(encoding='utf-8')
        super().__init__(path, scene, {'msg_config': text, **data})

    def put_snapshot(
        self, scene: Scene, snapshot: Snapshot, values: Mapping[str, object]
    ) -> None:
        """Write a frame: the scene if it has changed, all layers, and the status.

        Args:
            scene: The scene at that time.
            snapshot: The flow.
            values: Values of the status in addition to those of the snapshot.
        """
        stamp = stamp_at(snapshot.time)
        self.put_scene(scene, snapshot.time, stamp)
        for layer in self.layers:
            if layer.source not in (ARRIVED, INUNDATED) or snapshot.arrived is not None:
                self.put_layer(layer, snapshot, stamp)
        known = {**values, **snapshot_values(snapshot, stamp)}
        self._known = snapshot.time, known
        self.put_status(known, stamp)
        self.flush()

    def put_error(self, values: Mapping[str, object]) -> None:
        """Write the status of the last frame again, with the numerical error."""
        time, known = self._known
        self.put_status({**known, **values}, stamp_at(time))

    def copy(self, bag: Path, until: float) -> None:
        """Copy the frames of an interrupted run up to a simulated time [s].

        Raises:
            LavaError: If the bag cannot be read.
        """
        source, end = BagReader(bag), stamp_at(until)
        for message in source.messages():
            if message.publish_ns <= end:
                topic = source.topics[message.topic]
                self.write(
                    topic.name, topic.message_type, message.data, message.publish_ns,
                    qos=topic.qos, schema=topic.schema, log_time_ns=message.stamp_ns,
                )
        known = described_node(source.custom_data)
        assert known is not None
        self.node = known
        self.set_custom_data(self._described())
        self.flush()

    @property
    def layer_topics(self) -> dict[str, str]:
        """Full names of the topics of the layers, by the names of the layers."""
        return {layer.name: self.node.topic(layer.topic) for layer in self.layers}
