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

"""Decodes messages of a bag by the definitions the bag itself holds. Needs no ROS."""

import struct
from typing import Any

from lava_ros.bag.reader import BagMessage, BagReader
from lava_ros.errors import LavaError


class Decoder:
    """Turns the messages of one bag into objects with the fields of their type."""

    def __init__(self, bag: BagReader) -> None:
        """Take the definitions of a bag.

        Raises:
            LavaError: mcap-ros2-support is not installed.
        """
        try:
            from mcap.records import Schema
            from mcap_ros2.decoder import DecoderFactory
        except ImportError as error:
            raise LavaError(
                'bag',
                str(bag.path),
                "mcap-ros2-support to decode it: pip install 'lava_ros[plot]'",
            ) from error
        self._factory = DecoderFactory()
        self._schemas = {
            name: Schema(
                id=index,
                name=topic.message_type,
                encoding='ros2msg',
                data=topic.schema.text.encode(),
            )
            for index, (name, topic) in enumerate(bag.topics.items(), start=1)
        }

    def decode(self, message: BagMessage) -> Any:
        """Decode a message.

        Raises:
            LavaError: It is not what its definition says.
        """
        decode = self._factory.decoder_for('cdr', self._schemas[message.topic])
        assert decode is not None
        try:
            return decode(message.data)
        except (EOFError, IndexError, struct.error, ValueError) as error:
            raise LavaError(
                f'message on {message.topic}',
                f'{len(message.data)} bytes',
                f'a {self._schemas[message.topic].name} ({error})',
            ) from error
