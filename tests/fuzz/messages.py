# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Hostile messages for the inputs of the node, as bytes.

``messages(seed)`` never ends. It yields random bytes; valid messages that are truncated, spliced,
sent as another type or have flipped bits; and well-formed messages with insane values.
"""

from collections.abc import Callable, Iterator
from functools import partial
import math
import random
from typing import Any, NamedTuple

import numpy as np
from rclpy.serialization import serialize_message

from fuzz.bags import change
from lava_ros.errors import LavaError
from lava_ros.ros import inputs
from lava_ros.ros.codec import decode
from lava_ros.ros.parameters import Settings
from ros import graph_publisher

#: Function that reads the messages of each input topic.
CHECKS: dict[str, Callable[..., Any]] = {
    'terrain': inputs.check_image,
    'terrain_info': inputs.check_info,
    'terrain_cloud': inputs.terrain_from_cloud,
    'vents': inputs.vents_from_cloud,
    'clicked_point': partial(inputs.vent_from_point, name='click'),
}

#: Message class of each topic.
TOPICS = {topic: graph_publisher.TYPES[topic][0] for topic in CHECKS}

_RULES = Settings()

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
    """A message to try: its topic, how it was made, and its bytes."""

    topic: str
    kind: str
    data: bytes

    def error(self) -> LavaError | None:
        """Return the error of the message by itself, whatever the terrain."""
        try:
            message = decode(self.data, TOPICS[self.topic], self.topic, max_bytes=10**9)
            CHECKS[self.topic](message, _RULES)
        except LavaError as error:
            return error
        return None


def messages(seed: int) -> Iterator[FuzzMessage]:
    """Yield messages, the same ones for the same seed."""
    chance = random.Random(seed)
    valid = {topic: serialize_message(make()) for topic, make in _VALID.items()}
    while True:
        topic = chance.choice(list(TOPICS))
        kind = chance.choice(list(_KINDS))
        # rclpy does not send more than the maximum size of a bounded type
        limit = len(valid[topic]) if topic == 'terrain_info' else None
        yield FuzzMessage(topic, kind, _KINDS[kind](chance, topic, valid)[:limit])


def _random_bytes(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    limit = len(valid[topic]) if topic == 'terrain_info' else 3000
    body = chance.randbytes(chance.randrange(1, limit))
    if chance.random() < 0.7:
        body = bytes([0, chance.choice((0, 1, 1, 1, 3, 7)), 0, 0]) + body
    return body


def _cut_short(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    return valid[topic][: chance.randrange(1, len(valid[topic]))]


def _bits_flipped(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    data = bytearray(valid[topic])
    # half of the flips are among the sizes and names
    end = chance.choice((len(data), min(len(data), 200)))
    for _ in range(chance.choice((1, 1, 2, 5, 20))):
        data[chance.randrange(end)] ^= 1 << chance.randrange(8)
    return bytes(data)


def _spliced(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    data = valid[topic]
    start, end = sorted(chance.randrange(1, len(data)) for _ in range(2))
    return data[:end] + data[start:]


def _one_insane(chance: random.Random, topic: str, _: Any) -> bytes:
    """Replace one value of a valid message, so that no other value hides it."""
    message = _VALID[topic]()
    if topic in ('terrain', 'terrain_cloud'):
        values = np.frombuffer(message.data, np.float32).copy()
        values[chance.randrange(len(values))] = chance.choice(_FLOATS)
        message.data = type(message.data)('B', values.tobytes())
    elif topic == 'vents':
        key = chance.choice(('x', 'y', 'discharge', 'temperature', 'radius'))
        message = graph_publisher.vents(**{key: chance.choice(_FLOATS)})
    elif topic == 'clicked_point':
        message.point.x = chance.choice(_DOUBLES)
    elif chance.random() < 0.5:
        message.resolution = chance.choice(_FLOATS)
    else:
        message.origin.position.x = chance.choice(_DOUBLES)
    return serialize_message(message)


def _insane(chance: random.Random, topic: str, _: Any) -> bytes:
    message = _VALID[topic]()
    for _ in range(chance.choice((1, 2, 4, 30))):
        change(chance, message)
    if hasattr(message, 'width') and chance.random() < 0.2:
        message.width = message.height = chance.choice((2, 40, 32767, 2**31))
    return serialize_message(message)


_KINDS: dict[str, Callable[[random.Random, str, dict[str, bytes]], bytes]] = {
    'random bytes': _random_bytes, 'cut short': _cut_short, 'bits flipped': _bits_flipped,
    'spliced': _spliced, 'insane values': _insane, 'one insane value': _one_insane,
    'another type': lambda chance, _, valid: valid[chance.choice(list(valid))],
}
