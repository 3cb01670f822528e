# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Fast conversion of arrays to message fields, messages to bytes, and grid maps to arrays.

Images and point clouds are converted to arrays in lava_ros/bag/decoding.py.
"""

import array
from collections.abc import Mapping
from contextlib import suppress
import importlib
import struct
from typing import Any

from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid
import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float32MultiArray, Header, MultiArrayDimension, MultiArrayLayout

from lava_ros.bag import messages
from lava_ros.bag.encoding import Message
from lava_ros.errors import LavaError, refusing
from lava_ros.layers.layer import GRID_MAP
from lava_ros.scene import Terrain


def time_message(stamp_ns: int) -> Time:
    """Convert nanoseconds to a time message."""
    return Time(sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000)


def nanoseconds(stamp: Time) -> int:
    """Convert a time message to nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def header(frame_id: str, stamp_ns: int) -> Header:
    """Make a message header."""
    return Header(frame_id=frame_id, stamp=time_message(stamp_ns))


def message_array(values: np.ndarray, typecode: str) -> 'array.array[int]':
    """Copy an array's bytes to an ``array.array``, 100 times faster than via a list."""
    result: array.array[int] = array.array(typecode)
    # An empty view cannot be cast.
    if values.size:
        result.frombytes(np.ascontiguousarray(values).data.cast('B'))
    return result


def plain(message_header: Header) -> messages.Plain:
    """Return the fields of a header as plain data (``bag.messages``)."""
    return messages.header_fields(message_header.frame_id, nanoseconds(message_header.stamp))


def made(message: Message) -> Any:
    """Make a ROS message from one in plain data (``bag.encoding``)."""
    result = message_class(message.kind)()
    _fill(result, message.fields)
    return result


def _fill(target: Any, values: Mapping[str, Any]) -> None:
    """Set the fields of a message."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            _fill(getattr(target, name), value)
        elif isinstance(value, np.ndarray):
            setattr(target, name, message_array(value, value.dtype.char))
        elif isinstance(value, list):
            kind = target.get_fields_and_field_types()[name].removeprefix('sequence<')[:-1]
            items = [message_class(kind.replace('/', '/msg/'))() for _ in value]
            for item, fields in zip(items, value, strict=True):
                _fill(item, fields)
            setattr(target, name, items)
        else:
            setattr(target, name, value)


def occupancy_grid(values: np.ndarray, terrain: Terrain, message_header: Header) -> OccupancyGrid:
    """Make an occupancy grid from a value for each cell of a terrain, -1 if it is unknown."""
    fields = plain(message_header)
    info = messages.map_metadata(terrain, fields['stamp']).fields
    return made(messages.occupancy_grid(values, info, fields))


def point_cloud(columns: Mapping[str, Any], message_header: Header) -> PointCloud2:
    """Make an unorganised cloud of FLOAT32 fields from columns of equal length, by field name."""
    return made(messages.point_cloud(columns, plain(message_header)))


def serialise(message: Any) -> bytes:
    """Serialise a message to CDR, for publishing and for a bag."""
    return bytes(serialize_message(message))


def message_class(message_type: str) -> Any:
    """Import the class of a type such as ``nav_msgs/msg/OccupancyGrid``.

    Raises:
        LavaError: If the type is not installed.
    """
    package, _, name = message_type.partition('/msg/')
    if not package.isidentifier() or not name.isidentifier():
        raise LavaError('message_type', message_type, 'a name such as nav_msgs/msg/OccupancyGrid')
    expected = 'an installed type'
    with refusing('message_type', message_type, expected, ImportError, AttributeError):
        return getattr(importlib.import_module(f'{package}.msg'), name)


def type_name(message_class: Any) -> str:
    """Return the name of a message class, such as ``nav_msgs/msg/OccupancyGrid``."""
    return '/'.join([*message_class.__module__.split('.')[:2], message_class.__name__])


#: Maximum size of a message without its data: header, names, lengths [bytes].
OVERHEAD = 65_536

#: Maximum number of fields of a point cloud.
MAX_CLOUD_FIELDS = 1024

#: Maximum number of layers of a grid map.
MAX_GRID_LAYERS = 256

#: Number of dimensions of a grid map layer.
GRID_DIMENSIONS = 2

_ENCAPSULATION = 4


def decode(data: bytes, message_class: Any, topic: str, *, max_bytes: int) -> Any:
    """Deserialise a message of ``message_class`` from CDR; errors name ``topic``.

    Raises:
        LavaError: If the message is larger than ``max_bytes``, or is not of this class.
    """
    if len(data) > max_bytes + OVERHEAD:
        raise LavaError(topic, f'{len(data)} bytes', f'at most {max_bytes} (max_input_bytes)')
    is_cloud = message_class is PointCloud2
    if is_cloud or message_class.__name__ == 'GridMap':
        # a truncated message is refused below
        with suppress(struct.error):
            _check_counts(data, topic, is_cloud=is_cloud)
    try:
        return deserialize_message(data, message_class)
    # For undecodable bytes, rclpy raises a RuntimeError without a public name.
    except (RuntimeError, ValueError, MemoryError, SystemError) as error:
        expected = f'a serialised {type_name(message_class)}'
        raise LavaError(topic, f'{len(data)} bytes', expected) from error


class _Parts:
    """Steps through a serialised message (CDR) with aligned numbers, strings and lists."""

    def __init__(self, data: bytes) -> None:
        order = '<' if len(data) > 1 and data[1] & 1 else '>'
        self._number = struct.Struct(f'{order}I')
        self._body = memoryview(data)[_ENCAPSULATION:]
        self._place = 0

    def skip(self, size: int, *, alignment: int = 4) -> None:
        """Skip bytes that begin at a multiple of an alignment."""
        self._place = -(-self._place // alignment) * alignment + size

    def number(self) -> int:
        """Return the next uint32: a length or a number of elements."""
        self.skip(4)
        (value,) = self._number.unpack_from(self._body, self._place - 4)
        return int(value)

    def skip_text(self) -> None:
        """Skip a string."""
        self.skip(self.number(), alignment=1)

    def count(self, field: str, maximum: int, unit: str = '') -> range:
        """Return a range over the elements of a field; raise LavaError above ``maximum``."""
        count = self.number()
        if count > maximum:
            raise LavaError(field, f'{count} {unit}' if unit else count, f'at most {maximum}')
        return range(count)


def _check_counts(data: bytes, topic: str, *, is_cloud: bool) -> None:
    """Check the element counts of a point cloud or grid map before allocating memory."""
    parts = _Parts(data)
    parts.skip(8)
    parts.skip_text()
    if is_cloud:
        parts.skip(8)
        parts.count(f'{topic}.fields', MAX_CLOUD_FIELDS, 'fields')
        return
    # resolution, two lengths and the pose: float64 values
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
# `inner_start_index`. The map's position is its centre. Sources: grid_map_core (GridMapMath) and
# grid_map_ros (GridMapRosConverter). grid_map_msgs is not on PyPI and not imported here: any
# object with its fields is accepted.

#: Labels of the layout's dimensions; their order defines how the matrix is stored.
COLUMN, ROW = 'column_index', 'row_index'

#: Layer of the ground. A cell without a value in this layer is not part of the map.
ELEVATION = 'elevation'

#: Maximum difference between a length and its number of cells, as a fraction of a cell.
LENGTH_TOLERANCE = 0.01


def grid_map_message(
    maps: Mapping[str, np.ndarray], terrain: Terrain, message_header: Header
) -> Any:
    """Make a grid map from values by layer, shape [rows, columns], row 0 at the smallest y."""
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
    # Transpose: a row of the terrain is a column of the matrix.
    columns, rows = values.shape
    layout = MultiArrayLayout()
    layout.dim = [
        MultiArrayDimension(label=COLUMN, size=columns, stride=columns * rows),
        MultiArrayDimension(label=ROW, size=rows, stride=rows),
    ]
    turned = values[::-1, ::-1].astype(np.float32, copy=False)
    return Float32MultiArray(layout=layout, data=message_array(turned, 'f'))


def layer_values(message: Any, layer: str, name: str) -> np.ndarray:
    """Read a layer of a grid map; errors refer to the message as ``name``.

    Returns:
        float32, shape [rows, columns], row 0 at the smallest y, column 0 at the smallest x.

    Raises:
        LavaError: If there is no such layer, or names, layout, data and lengths disagree.
    """
    layers = list(message.layers)
    if len(layers) != len(message.data):
        expected = f'{len(layers)} arrays, one for each layer'
        raise LavaError(f'{name}.data', f'{len(message.data)} arrays', expected)
    if layer not in layers:
        raise LavaError(f'{name}.layers', layers, f'a list with the layer {layer!r}')
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
            expected = f'{size * info.resolution:g} m: {size} cells of {info.resolution:g} m'
            raise LavaError(f'{name}.info.length_{key}', length, expected)
    unwrapped = np.roll(matrix, (-starts[0], -starts[1]), axis=(0, 1))
    return np.ascontiguousarray(unwrapped[::-1, ::-1].T)


def _matrix(array: Any, name: str) -> np.ndarray:
    """Return the matrix of a layer as stored: rows along x, columns along y."""
    layout = array.layout
    labels = [item.label for item in layout.dim]
    if sorted(labels) != [COLUMN, ROW]:
        raise LavaError(f'{name}.layout.dim', labels, f'{COLUMN}, {ROW}')
    sizes = [int(item.size) for item in layout.dim]
    if min(sizes) < 1:
        raise LavaError(f'{name}.layout.dim', sizes, 'sizes of at least one cell')
    cells = sizes[0] * sizes[1]
    if len(array.data) != layout.data_offset + cells:
        expected = f'data_offset + {sizes[0]} x {sizes[1]} = {layout.data_offset + cells}'
        raise LavaError(f'{name}.data', f'{len(array.data)} values', expected)
    stored = np.asarray(array.data, dtype=np.float32)[layout.data_offset :].reshape(sizes)
    return stored if labels[0] == ROW else stored.T
