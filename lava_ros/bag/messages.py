# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages of grids, images, clouds and statuses as plain data (``bag.encoding``)."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lava_ros.bag.encoding import Message
from lava_ros.bag.georeference import MESSAGE as TRANSFORM
from lava_ros.scene import Georeference, Terrain

#: numpy's types of floats and bytes in messages.
_FLOAT = np.dtype('<f4')

#: datatype of a FLOAT32 in sensor_msgs/PointField.
_POINT_FLOAT32 = 7

Plain = Mapping[str, Any]


def stamp_fields(stamp_ns: int) -> Plain:
    """Return the fields of a time in nanoseconds."""
    return {'sec': stamp_ns // 10**9, 'nanosec': stamp_ns % 10**9}


def header_fields(frame_id: str, stamp_ns: int) -> Plain:
    """Return the fields of a header."""
    return {'stamp': stamp_fields(stamp_ns), 'frame_id': frame_id}


def map_metadata(terrain: Terrain, stamp: Plain) -> Message:
    """Return the grid of a terrain: size, resolution and origin."""
    rows, columns = terrain.shape
    x, y = terrain.origin
    return Message('nav_msgs/msg/MapMetaData', {
        'map_load_time': stamp,
        'resolution': terrain.resolution,
        'width': columns,
        'height': rows,
        'origin': {'position': {'x': x, 'y': y}},
    })


def occupancy_grid(values: np.ndarray, info: Plain, header: Plain) -> Message:
    """Make an occupancy grid from int8 values, shape [rows, columns], row 0 at the smallest y."""
    cells = np.ascontiguousarray(values, np.int8).ravel()
    return Message(
        'nav_msgs/msg/OccupancyGrid', {'header': header, 'info': info, 'data': cells}
    )


def float_image(values: np.ndarray, header: Plain) -> Message:
    """Make a 32FC1 image from float values, shape [rows, columns], row 0 at the smallest y."""
    rows, columns = values.shape
    pixels = np.ascontiguousarray(values, _FLOAT)
    return Message('sensor_msgs/msg/Image', {
        'header': header,
        'height': rows,
        'width': columns,
        'encoding': '32FC1',
        'is_bigendian': 0,
        'step': _FLOAT.itemsize * columns,
        'data': pixels.view(np.uint8).ravel(),
    })


def point_cloud(columns: Mapping[str, Any], header: Plain) -> Message:
    """Make an unorganised cloud of FLOAT32 fields from columns of equal length, by field name."""
    points = np.stack([np.asarray(values, _FLOAT) for values in columns.values()], axis=-1)
    size = _FLOAT.itemsize * len(columns)
    return Message('sensor_msgs/msg/PointCloud2', {
        'header': header,
        'height': 1,
        'width': len(points),
        'fields': [
            {'name': name, 'offset': _FLOAT.itemsize * index, 'datatype': _POINT_FLOAT32,
             'count': 1}
            for index, name in enumerate(columns)
        ],
        'is_bigendian': False,
        'point_step': size,
        'row_step': size * len(points),
        'data': np.ascontiguousarray(points).view(np.uint8).ravel(),
        'is_dense': bool(np.isfinite(points).all()),
    })


def georeference(stated: Georeference, header: Plain) -> Message:
    """Make the message of a georeference for the terrain with the same header."""
    x, y = stated.offset
    return Message(TRANSFORM, {
        'header': {**header, 'frame_id': stated.system or ''},
        'child_frame_id': header['frame_id'],
        'transform': {'translation': {'x': x, 'y': y}, 'rotation': {'w': 1.0}},
    })


def diagnostics(
    name: str, message: str, values: Mapping[str, object], stamp_ns: int
) -> Message:
    """Make diagnostics with one status of level OK; ``name`` is the name of its task."""
    status = {
        'name': name,
        'message': message,
        'values': [{'key': key, 'value': str(value)} for key, value in values.items()],
    }
    return Message(
        'diagnostic_msgs/msg/DiagnosticArray',
        {'header': header_fields('', stamp_ns), 'status': [status]},
    )
