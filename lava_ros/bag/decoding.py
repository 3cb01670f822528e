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

"""Decodes messages of a bag by the definitions the bag itself holds; grids become arrays."""

from collections.abc import Callable
from dataclasses import dataclass
import re
import struct
from typing import Any

import numpy as np

from lava_ros.bag.reader import BagMessage, BagReader
from lava_ros.errors import LavaError
from lava_ros.files.optional import require

# A list of a fixed length takes memory for as many values as its definition asks for, whatever the
# message holds.
_FIXED = re.compile(rb'^\s*[^#\s]+\[\d', re.MULTILINE)

_CDR_HEADER = 4


class Decoder:
    """Turns the messages of one bag into objects with the fields of their type."""

    def __init__(self, bag: BagReader) -> None:
        """Take the definitions of a bag.

        Raises:
            LavaError: mcap-ros2-support is not installed.
        """
        require('mcap_ros2.decoder', 'bag', str(bag.path))
        from mcap.records import Schema
        from mcap_ros2.decoder import DecoderFactory

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

    def decode(self, message: BagMessage, take: Callable[[Any], Any] | None = None) -> Any:
        """Decode a message.

        Args:
            message: The message.
            take: Makes the result of the message, where that is not the message itself.

        Raises:
            LavaError: It is not what its definition says, or that lacks what ``take`` looks for.
        """
        schema = self._schemas[message.topic]
        if _FIXED.search(schema.data):
            right = 'without lists of a fixed length: no message that is read here has one'
            raise LavaError(f'definition of {schema.name}', schema.data.decode(), right)
        try:
            decode = self._factory.decoder_for('cdr', schema)
            assert decode is not None
            decoded = decode(message.data)
            return decoded if take is None else take(decoded)
        except LavaError:
            raise
        # a definition from anywhere is parsed by a library, and its fields are of any type
        except Exception as error:
            raise LavaError(
                f'message on {message.topic}',
                f'{len(message.data)} bytes',
                f'a {schema.name} ({type(error).__name__}: {error})',
            ) from error


@dataclass(frozen=True, eq=False)
class Grid:
    """A nav_msgs/OccupancyGrid.

    Attributes:
        resolution: Side of a cell [m].
        origin: Position (x, y) [m] of the lower-left corner of cell [0, 0].
        cells: Values, int8, shape [rows, columns].
    """

    resolution: float
    origin: tuple[float, float]
    cells: np.ndarray


def read_grid(message: BagMessage) -> Grid:
    """Read the grid that a message carries, without the Python number a cell that decoders make.

    Raises:
        LavaError: The message is cut off or is not such a grid.
    """
    body = memoryview(message.data)[_CDR_HEADER:]
    try:
        order = '<' if message.data[1] & 1 else '>'
        # The header: a stamp of 8 bytes, the length of the frame's name and the name.
        (length,) = struct.unpack_from(f'{order}I', body, 8)
        start = _aligned(12 + length, 4)
        # Its load time, 8 bytes, comes before the rest of the description.
        resolution, columns, rows = struct.unpack_from(f'{order}f2I', body, start + 8)
        pose = _aligned(start + 20, 8)
        x, y = struct.unpack_from(f'{order}2d', body, pose)
        (count,) = struct.unpack_from(f'{order}I', body, pose + 56)
        cells = np.frombuffer(body, np.int8, count, pose + 60)
        return Grid(resolution, (x, y), cells.reshape(rows, columns))
    except (IndexError, struct.error, ValueError) as error:
        raise LavaError(
            f'message on {message.topic}', f'{len(message.data)} bytes', f'a grid ({error})'
        ) from error


def _aligned(position: int, size: int) -> int:
    return -(-position // size) * size
