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

"""Maps as grid_map has them (grid_map_msgs/GridMap), to arrays and back.

A layer is a matrix whose row index grows from the largest x to the smallest and whose column index
from the largest y to the smallest. It is sent column after column: dimension 0 of the layout is
`column_index`, dimension 1 `row_index`. The matrix is a circular buffer: the cell at the largest x
and y is in row `outer_start_index` and column `inner_start_index`. The map's position is its
centre. So say grid_map_core (GridMapMath) and grid_map_ros (GridMapRosConverter).

The package is not on PyPI, and nothing here needs it: messages are objects with its fields.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from std_msgs.msg import Float32MultiArray, Header, MultiArrayDimension, MultiArrayLayout

from lava_ros.errors import LavaError
from lava_ros.maps.layers import GRID_MAP
from lava_ros.ros import codec
from lava_ros.scene import Terrain

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
    message = codec.message_class(GRID_MAP)()
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
    return Float32MultiArray(layout=layout, data=codec.message_array(turned, 'f'))


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
