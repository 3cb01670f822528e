# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrays to message fields, fast, and messages to bytes; grid maps back to arrays.

Images and clouds become arrays in lava_ros/bag/decoding.py.
"""

import array
from collections.abc import Mapping
from contextlib import suppress
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
from std_msgs.msg import Float32MultiArray, Header, MultiArrayDimension, MultiArrayLayout

from lava_ros.errors import LavaError
from lava_ros.maps.layers import GRID_MAP
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
    return bytes(serialize_message(message))


def message_class(message_type: str) -> Any:
    """Import the class of a type such as ``nav_msgs/msg/OccupancyGrid``; LavaError if missing."""
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
    is_cloud = message_class is PointCloud2
    if is_cloud or message_class.__name__ == 'GridMap':
        # what ends too soon is refused below
        with suppress(struct.error):
            _check_counts(data, topic, is_cloud=is_cloud)
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

    def count(self, field: str, most: int, unit: str = '') -> range:
        """As many turns as parts of a field follow; LavaError where they are too many."""
        count = self.number()
        if count > most:
            raise LavaError(field, f'{count} {unit}' if unit else count, f'at most {most}')
        return range(count)


def _check_counts(data: bytes, topic: str, *, is_cloud: bool) -> None:
    """Check what a cloud or a grid map announces, before memory is taken for it."""
    parts = _Parts(data)
    parts.skip(8)
    parts.skip_text()
    if is_cloud:
        parts.skip(8)
        parts.count(f'{topic}.fields', MAX_CLOUD_FIELDS, 'fields')
        return
    # resolution and two lengths, then the pose: all of them 8 bytes long
    parts.skip(10 * 8, alignment=8)
    for name in ('layers', 'basic_layers'):
        for _ in parts.count(f'{topic}.{name}', MAX_GRID_LAYERS):
            parts.skip_text()
    for _ in parts.count(f'{topic}.data', MAX_GRID_LAYERS):
        for _ in parts.count(f'{topic}.data.layout.dim', GRID_DIMENSIONS):
            parts.skip_text()
            parts.skip(8)
        parts.skip(4)
        parts.skip(4 * parts.number())


# A layer of a grid map (grid_map_msgs/GridMap) is a matrix whose row index grows from the largest
# x to the smallest and whose column index from the largest y to the smallest. It is sent column
# after column: dimension 0 of the layout is `column_index`, dimension 1 `row_index`. The matrix is
# a circular buffer: the cell at the largest x and y is in row `outer_start_index` and column
# `inner_start_index`. The map's position is its centre. So say grid_map_core (GridMapMath) and
# grid_map_ros (GridMapRosConverter). The package is not on PyPI, and nothing here needs it:
# messages are objects with its fields.

#: Labels of the layout's dimensions; which comes first says how the matrix is stored.
COLUMN, ROW = 'column_index', 'row_index'

#: Layer of the ground, which a cell has to have a value in to be one of the map.
ELEVATION = 'elevation'

#: Most a length may differ from that of the cells it stands for, as a part of a cell.
LENGTH_TOLERANCE = 0.01


def grid_map_message(
    maps: Mapping[str, np.ndarray], terrain: Terrain, message_header: Header
) -> Any:
    """Make a map from values by layer, shape [rows, columns], row 0 at the smallest y."""
    rows, columns = terrain.shape
    message = message_class(GRID_MAP)()
    info = message.info
    info.resolution = terrain.resolution
    info.length_x, info.length_y = columns * terrain.resolution, rows * terrain.resolution
    info.pose.position.x = terrain.origin[0] + 0.5 * info.length_x
    info.pose.position.y = terrain.origin[1] + 0.5 * info.length_y
    message.header = message_header
    message.layers = list(maps)
    message.basic_layers = [ELEVATION] if ELEVATION in maps else []
    message.data = [_multi_array(values) for values in maps.values()]
    return message


def _multi_array(values: np.ndarray) -> Float32MultiArray:
    # A row of the terrain is a column of the matrix.
    columns, rows = values.shape
    layout = MultiArrayLayout()
    layout.dim = [
        MultiArrayDimension(label=COLUMN, size=columns, stride=columns * rows),
        MultiArrayDimension(label=ROW, size=rows, stride=rows),
    ]
    turned = values[::-1, ::-1].astype(np.float32, copy=False)
    return Float32MultiArray(layout=layout, data=message_array(turned, 'f'))


def layer_values(message: Any, layer: str, name: str) -> np.ndarray:
    """Read a layer of a map; errors name the message by ``name``.

    Returns:
        float32, shape [rows, columns], row 0 at the smallest y, column 0 at the smallest x.

    Raises:
        LavaError: There is no such layer, or names, layout, data and lengths disagree.
    """
    layers = list(message.layers)
    if len(layers) != len(message.data):
        right = f'as many as layers, {len(layers)}'
        raise LavaError(f'{name}.data', f'{len(message.data)} arrays', right)
    if layer not in layers:
        raise LavaError(f'{name}.layers', layers, f'with the layer {layer!r}')
    matrix = _matrix(message.data[layers.index(layer)], f'{name}.data[{layers.index(layer)}]')
    starts = (message.outer_start_index, message.inner_start_index)
    for key, start, size in zip(('outer', 'inner'), starts, matrix.shape, strict=True):
        if not 0 <= start < size:
            raise LavaError(f'{name}.{key}_start_index', start, f'0 to {size - 1}, inside the map')
    info = message.info
    if not info.resolution > 0.0:
        raise LavaError(f'{name}.info.resolution', info.resolution, 'above 0 m')
    for key, length, size in zip('xy', (info.length_x, info.length_y), matrix.shape, strict=True):
        # The negation also catches NaN.
        if not abs(length / info.resolution - size) <= LENGTH_TOLERANCE:
            right = f'{size * info.resolution:g} m: {size} cells of {info.resolution:g} m'
            raise LavaError(f'{name}.info.length_{key}', length, right)
    unwrapped = np.roll(matrix, (-starts[0], -starts[1]), axis=(0, 1))
    return np.ascontiguousarray(unwrapped[::-1, ::-1].T)


def _matrix(array: Any, name: str) -> np.ndarray:
    """The matrix of a layer as it is stored: rows along x, columns along y."""
    layout = array.layout
    labels = [item.label for item in layout.dim]
    if sorted(labels) != [COLUMN, ROW]:
        raise LavaError(f'{name}.layout.dim', labels, f'{COLUMN}, {ROW}')
    sizes = [int(item.size) for item in layout.dim]
    if min(sizes) < 1:
        raise LavaError(f'{name}.layout.dim', sizes, 'sizes of at least one cell')
    cells = sizes[0] * sizes[1]
    if len(array.data) != layout.data_offset + cells:
        right = f'data_offset + {sizes[0]} x {sizes[1]} = {layout.data_offset + cells}'
        raise LavaError(f'{name}.data', f'{len(array.data)} values', right)
    stored = np.asarray(array.data, dtype=np.float32)[layout.data_offset :].reshape(sizes)
    return stored if labels[0] == ROW else stored.T
