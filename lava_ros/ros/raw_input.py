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

"""Bytes from the wire -> message, or a LavaError that says why not.

A subscription that decodes by itself drops what it cannot read, and nobody is told. It also takes
a message's word for how many parts it has: each field of a point cloud costs some 80 bytes of
memory for the one byte that announces it.
"""

import struct
from typing import Any

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from lava_ros.errors import LavaError

#: Bytes a message may have beside its data: header, names, sizes.
OVERHEAD = 65_536

#: Most fields of a point cloud.
MAX_CLOUD_FIELDS = 1024

#: Most layers of a grid map.
MAX_GRID_LAYERS = 256

#: Dimensions of a layer of a grid map.
GRID_DIMENSIONS = 2

_ENCAPSULATION = 4


def decode(data: bytes, message_class: Any, topic: str, *, max_bytes: int) -> Any:
    """Read a message.

    Args:
        data: The message as it came, serialised to CDR.
        message_class: Its class.
        topic: What it is called in errors.
        max_bytes: Most bytes of data it may have.

    Raises:
        LavaError: It is too large, or cannot be read as a message of this class.
    """
    if len(data) > max_bytes + OVERHEAD:
        raise LavaError(topic, f'{len(data)} bytes', f'at most {max_bytes} (max_input_bytes)')
    if message_class is PointCloud2:
        _check_fields(data, topic)
    elif message_class.__name__ == 'GridMap':
        _check_layers(data, topic)
    try:
        return deserialize_message(data, message_class)
    # What rclpy raises for undecodable bytes is a RuntimeError without a public name.
    except (RuntimeError, ValueError, MemoryError, SystemError) as error:
        name = '/'.join([*message_class.__module__.split('.')[:2], message_class.__name__])
        raise LavaError(topic, f'{len(data)} bytes', f'a serialised {name}') from error


class _Parts:
    """Walks over the parts of a serialised message: numbers, texts and lists are aligned."""

    def __init__(self, data: bytes) -> None:
        order = '<' if len(data) > 1 and data[1] & 1 else '>'
        self._number = struct.Struct(f'{order}I')
        self._body = memoryview(data)[_ENCAPSULATION:]
        self._place = 0

    def skip(self, size: int, *, alignment: int = 4) -> None:
        """Pass over bytes that begin at a multiple of an alignment."""
        self._place = -(-self._place // alignment) * alignment + size

    def number(self) -> int:
        """The next number: a length, or how many parts follow."""
        self.skip(4)
        (value,) = self._number.unpack_from(self._body, self._place - 4)
        return int(value)

    def skip_text(self) -> None:
        """Pass over a text."""
        self.skip(self.number(), alignment=1)


def _check_fields(data: bytes, topic: str) -> None:
    """Check how many fields a point cloud announces, before memory is taken for them."""
    parts = _Parts(data)
    try:
        parts.skip(8)
        parts.skip_text()
        parts.skip(8)
        count = parts.number()
    except struct.error:
        return
    if count > MAX_CLOUD_FIELDS:
        raise LavaError(f'{topic}.fields', f'{count} fields', f'at most {MAX_CLOUD_FIELDS}')


def _check_layers(data: bytes, topic: str) -> None:
    """Check how many layers and dimensions a grid map announces, as for a cloud's fields."""
    parts = _Parts(data)
    try:
        parts.skip(8)
        parts.skip_text()
        # resolution and two lengths, then the pose: all of them 8 bytes long
        parts.skip(10 * 8, alignment=8)
        for name in ('layers', 'basic_layers'):
            for _ in range(_count(parts, f'{topic}.{name}', MAX_GRID_LAYERS)):
                parts.skip_text()
        for _ in range(_count(parts, f'{topic}.data', MAX_GRID_LAYERS)):
            for _ in range(_count(parts, f'{topic}.data.layout.dim', GRID_DIMENSIONS)):
                parts.skip_text()
                parts.skip(8)
            parts.skip(4)
            parts.skip(4 * parts.number())
    except struct.error:
        return


def _count(parts: _Parts, field: str, most: int) -> int:
    count = parts.number()
    if count > most:
        raise LavaError(field, count, f'at most {most}')
    return count
