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

"""Arrays to message fields, fast, and messages to bytes; back: lava_ros/bag/decoding.py."""

import array
from collections.abc import Mapping
import importlib
import struct
import sys
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose
from nav_msgs.msg import MapMetaData, OccupancyGrid
import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_msgs.msg import Header

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain


def time_message(stamp_ns: int) -> Time:
    """Turn nanoseconds into a message."""
    return Time(sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000)


def nanoseconds(stamp: Time) -> int:
    """Turn a message into nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def header(frame_id: str, stamp_ns: int) -> Header:
    """Make a message header."""
    return Header(frame_id=frame_id, stamp=time_message(stamp_ns))


def message_array(values: np.ndarray, typecode: str) -> 'array.array[int]':
    """Copy an array's bytes to an array of a field's typecode: 100 times faster than a list."""
    result: array.array[int] = array.array(typecode)
    # A view of no elements cannot be cast.
    if values.size:
        result.frombytes(np.ascontiguousarray(values).data.cast('B'))
    return result


def map_metadata(terrain: Terrain, stamp_ns: int) -> MapMetaData:
    """Describe the terrain's cells."""
    rows, columns = terrain.shape
    origin = Pose()
    origin.position.x, origin.position.y = terrain.origin
    return MapMetaData(
        map_load_time=time_message(stamp_ns),
        resolution=terrain.resolution,
        width=columns,
        height=rows,
        origin=origin,
    )


def occupancy_grid(values: np.ndarray, info: MapMetaData, message_header: Header) -> OccupancyGrid:
    """Make an occupancy grid from int8 values, shape [rows, columns], row 0 at the smallest y."""
    grid = OccupancyGrid(header=message_header, info=info)
    grid.data = message_array(values, 'b')
    return grid


def float_image(values: np.ndarray, message_header: Header) -> Image:
    """Make a 32FC1 image from float values, shape [rows, columns], row 0 at the smallest y."""
    rows, columns = values.shape
    image = Image(header=message_header, height=rows, width=columns, encoding='32FC1')
    image.is_bigendian = int(sys.byteorder == 'big')
    image.step = 4 * columns
    image.data = message_array(values.astype(np.float32, copy=False), 'B')
    return image


def point_cloud(columns: Mapping[str, Any], message_header: Header) -> PointCloud2:
    """Make an unorganised cloud of FLOAT32 fields from columns of equal length, by field name."""
    points = np.stack([np.asarray(values, '<f4') for values in columns.values()], axis=-1)
    cloud = PointCloud2(header=message_header, height=1, width=len(points))
    cloud.fields = [
        PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
        for index, name in enumerate(columns)
    ]
    cloud.point_step = 4 * len(columns)
    cloud.row_step = cloud.point_step * cloud.width
    cloud.is_dense = bool(np.isfinite(points).all())
    cloud.data = message_array(points, 'B')
    return cloud


def serialise(message: Any) -> bytes:
    """Turn a message into the bytes that go over the wire, and into a bag."""
    data: bytes = serialize_message(message)
    return data


def message_class(message_type: str) -> Any:
    """Import the class of a message type such as ``nav_msgs/msg/OccupancyGrid``.

    Raises:
        LavaError: The name is not that of a message type, or the type is not installed.
    """
    package, _, name = message_type.partition('/msg/')
    if not package.isidentifier() or not name.isidentifier():
        raise LavaError('message_type', message_type, 'a name such as nav_msgs/msg/OccupancyGrid')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError) as error:
        right = f'a type that is installed here ({error})'
        raise LavaError('message_type', message_type, right) from error


def type_name(message_class: Any) -> str:
    """Name of a message class, such as ``nav_msgs/msg/OccupancyGrid``."""
    return '/'.join([*message_class.__module__.split('.')[:2], message_class.__name__])


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
    """Deserialise a message of ``message_class`` from CDR; errors name ``topic``.

    Raises:
        LavaError: The message is larger than ``max_bytes``, or is not of this class.
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
        right = f'a serialised {type_name(message_class)}'
        raise LavaError(topic, f'{len(data)} bytes', right) from error


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
