# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Serialisation of messages without rclpy, compared with rclpy's."""

import json
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from lava_ros.bag import messages, schemas
from lava_ros.bag.encoding import encode, Message
from lava_ros.bag.messages import header_fields
from lava_ros.bag.schemas import message_schema
from lava_ros.files.resources import share_path
from lava_ros.layers.layer import GRID_MAP
from lava_ros.layers.layer_files import load_layers
from lava_ros.layers.messages import layer_message, SceneMessages
from lava_ros.ros import codec
from lava_ros.scene import Lava, Scene, Vent
from recording import growing, snapshot_at, TERRAIN

HEADER = header_fields('map', 1_790_000_000_000_000_123)
FISSURE = Vent((20.0, 95.0), 3.0, name='Südspalte', end=(40.0, 95.0))


def samples() -> dict[str, Message]:
    """Return the messages of a run, and some with fields of odd lengths."""
    scene = Scene(TERRAIN, (Vent((-47.5, 95.0), 10.0), FISSURE), lava=Lava.paper())
    found = dict(SceneMessages().update(scene, 10.0, HEADER))
    snapshot = snapshot_at(400.0, growing(400.0), TERRAIN)
    for layer in load_layers(share_path('msg_configs/default.yaml')):
        if layer.message != GRID_MAP:
            found[layer.name] = layer_message(layer, snapshot, HEADER)
    for length in range(4):
        values = {'k' * length: 'v', 'frame_stamp_ns': length}
        found[f'status {length}'] = messages.diagnostics('lava: simulation', 'ok', values, 7)
        found[f'image {length}'] = messages.float_image(np.zeros((1, length)), HEADER)
    found['empty'] = Message('geometry_msgs/msg/TransformStamped', {})
    found['covariance'] = Message('geometry_msgs/msg/PoseWithCovariance', {})
    return found


@pytest.mark.parametrize('name', samples())
def test_rclpy_reads_the_message(name):
    message = samples()[name]
    filled, data = codec.made(message), encode(message)
    # rclpy's padding has any value, so that bytes may differ; their number may not
    expected = serialize_message(filled)
    assert -(-len(data) // 4) == -(-len(expected) // 4)
    kind = type(filled)
    assert deserialize_message(data, kind) == deserialize_message(expected, kind)


def test_types_of_a_run_are_known_without_ros(monkeypatch):
    path = Path(schemas.__file__).with_name('interfaces.json')
    packaged = json.loads(path.read_text(encoding='utf-8'))
    assert {message.kind for message in samples().values()} <= {
        *packaged, 'geometry_msgs/msg/PoseWithCovariance'
    }
    for name, known in packaged.items():
        installed = message_schema(name)
        assert known == {'text': installed.text, 'type_hash': installed.type_hash}
        with monkeypatch.context() as without:
            without.setattr(schemas, '_prefixes', tuple)
            assert message_schema(name) == installed
