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

"""Messages for the node's inputs that nobody means well with, as bytes.

``messages(seed)`` goes on for ever: random bytes, valid messages cut short, with bits flipped,
spliced together, sent as another type, and well-formed ones with insane values.
"""

from collections.abc import Callable, Iterator
import math
import random
from typing import NamedTuple

from geometry_msgs.msg import PointStamped
from nav_msgs.msg import MapMetaData
import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, PointCloud2

from fuzz.files import change
from ros import graph_publisher

#: Every topic the node takes messages on, and their class.
TOPICS = {
    'terrain': Image,
    'terrain_info': MapMetaData,
    'terrain_cloud': PointCloud2,
    'vents': PointCloud2,
    'clicked_point': PointStamped,
}

_VALID = {
    'terrain': graph_publisher.image,
    'terrain_info': graph_publisher.info,
    'terrain_cloud': lambda: graph_publisher.cloud(graph_publisher.points()),
    'vents': graph_publisher.vents,
    'clicked_point': lambda: graph_publisher.click(100.0, 155.0),
}

_FLOATS = (
    *(0.0, -0.0, 1.0, -1.0, 0.5, 10.0, 100.0, 155.0, 1100.0, -273.15, -273.16, 1e-3, 1e3),
    *(math.nan, math.inf, -math.inf, 1e-45, 1e-30, 1e6, 1e12, -1e12, 3e38, -3e38),
)
_DOUBLES = (*_FLOATS, 5e-324, 1e-300, 1e300, 1.7e308, -1.7e308)


class FuzzMessage(NamedTuple):
    """A message to try.

    Attributes:
        topic: Where to send it.
        kind: How it was made.
        data: Its bytes.
    """

    topic: str
    kind: str
    data: bytes


def messages(seed: int) -> Iterator[FuzzMessage]:
    """Yield messages, the same ones for the same seed."""
    chance = random.Random(seed)
    valid = {topic: serialize_message(make()) for topic, make in _VALID.items()}
    kinds: dict[str, Callable[[random.Random, str, dict[str, bytes]], bytes]] = {
        'random bytes': _random_bytes,
        'cut short': _cut_short,
        'bits flipped': _bits_flipped,
        'spliced': _spliced,
        'another type': _another_type,
        'insane values': _insane,
        'one insane value': _one_insane,
    }
    while True:
        topic = chance.choice(list(TOPICS))
        kind = chance.choice(list(kinds))
        yield FuzzMessage(topic, kind, kinds[kind](chance, topic, valid))


def _random_bytes(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    # A type of bounded size has a largest message; rclpy does not send more.
    most = len(valid[topic]) if topic == 'terrain_info' else 3000
    body = chance.randbytes(chance.randrange(1, most))
    if chance.random() < 0.7:
        body = (bytes([0, chance.choice((0, 1, 1, 1, 3, 7)), 0, 0]) + body)[:most]
    return body


def _cut_short(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    data = valid[topic]
    return data[: chance.randrange(1, len(data))]


def _bits_flipped(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    data = bytearray(valid[topic])
    # Half of them where the sizes and names are.
    end = chance.choice((len(data), min(len(data), 200)))
    for _ in range(chance.choice((1, 1, 2, 5, 20))):
        data[chance.randrange(end)] ^= 1 << chance.randrange(8)
    return bytes(data)


def _spliced(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    data = valid[topic]
    start, end = sorted(chance.randrange(1, len(data)) for _ in range(2))
    spliced = data[:end] + data[start:]
    return spliced[: len(data)] if topic == 'terrain_info' else spliced


def _another_type(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    data = valid[chance.choice(list(valid))]
    return data[: len(valid[topic])] if topic == 'terrain_info' else data


def _one_insane(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    """A valid message with one value replaced, so that the others do not hide it."""
    message = _VALID[topic]()
    if topic in ('terrain', 'terrain_cloud'):
        values = np.frombuffer(message.data, np.float32).copy()
        values[chance.randrange(len(values))] = chance.choice(_FLOATS)
        message.data = type(message.data)('B', values.tobytes())
    elif topic == 'vents':
        key = chance.choice(('x', 'y', 'discharge', 'temperature', 'radius'))
        message = graph_publisher.vents(**{key: chance.choice(_FLOATS)})
    elif topic == 'terrain_info':
        if chance.random() < 0.5:
            message.resolution = chance.choice(_FLOATS)
        else:
            message.origin.position.x = chance.choice(_DOUBLES)
    else:
        message.point.x = chance.choice(_DOUBLES)
    return serialize_message(message)


def _insane(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    """A message of which some fields, at any depth, have other values and lengths."""
    message = _VALID[topic]()
    for _ in range(chance.choice((1, 2, 4, 30))):
        change(chance, message)
    if hasattr(message, 'width') and chance.random() < 0.2:
        message.width = message.height = chance.choice((2, 40, 32767, 2**31))
    return serialize_message(message)
