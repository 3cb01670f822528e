# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Hostile messages for the inputs of the node, as bytes.

``messages(seed)`` never ends. It yields random bytes; valid messages that are damaged or sent as
another type; and well-formed messages with insane values.
"""

from collections.abc import Callable, Iterator
from functools import partial
import random
from typing import Any, NamedTuple

from rclpy.serialization import serialize_message

from fuzz.bags import change
from fuzz.mutations import damaged
from lava_ros.bag.georeference import read_georeference
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
    'terrain_georeference': lambda message, rules: read_georeference(message, rules.frame_id),
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
    'terrain_georeference': graph_publisher.georeference,
    'vents': graph_publisher.vents,
    'clicked_point': lambda: graph_publisher.click(100.0, 155.0),
}

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


def _damaged(chance: random.Random, topic: str, valid: dict[str, bytes]) -> bytes:
    return damaged(chance, valid[topic])


def _insane(chance: random.Random, topic: str, _: Any) -> bytes:
    message = _VALID[topic]()
    # one alone is hidden by no other
    for _ in range(chance.choice((1, 1, 2, 4, 30))):
        change(chance, message)
    if hasattr(message, 'width') and chance.random() < 0.2:
        message.width = message.height = chance.choice((2, 40, 32767, 2**31))
    return serialize_message(message)


_KINDS: dict[str, Callable[[random.Random, str, dict[str, bytes]], bytes]] = {
    'random bytes': _random_bytes, 'damaged': _damaged, 'insane values': _insane,
    'another type': lambda chance, _, valid: valid[chance.choice(list(valid))],
}
