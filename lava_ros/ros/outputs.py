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

"""What the simulation shows -> messages."""

from collections.abc import Sequence
import math
from typing import Any

from nav_msgs.msg import MapMetaData, OccupancyGrid
import numpy as np
from sensor_msgs.msg import Image, PointCloud2

from lava_ros.errors import LavaError
from lava_ros.maps.forecast import EnsembleForecast, Forecast
from lava_ros.maps.layers import IMAGE, Layer, OCCUPANCY_GRID, POINT_CLOUD, ZERO_CELSIUS
from lava_ros.ros import codec, grid_map
from lava_ros.scene import Terrain, Vent
from lava_ros.simulation.snapshot import Snapshot


def message_class(layer: Layer) -> Any:
    """The class of a layer's message.

    Raises:
        LavaError: Its package is not installed.
    """
    try:
        return codec.message_class(layer.message)
    except LavaError as error:
        right = 'a message whose package is installed: install ros-jazzy-grid-map-msgs, '
        right += f"or switch the layer off (layers_off: ['{layer.name}'])"
        raise LavaError(f'layers.{layer.name}.message', layer.message, right) from error


def layer_message(
    layer: Layer, snapshot: Snapshot | Forecast | EnsembleForecast, *, frame_id: str, stamp_ns: int
) -> Any:
    """Make the message of a layer."""
    message_header = codec.header(frame_id, stamp_ns)
    if layer.message == OCCUPANCY_GRID:
        info = codec.map_metadata(snapshot.terrain, stamp_ns)
        return codec.occupancy_grid(layer.grid_values(snapshot), info, message_header)
    if layer.message == IMAGE:
        return codec.float_image(layer.raw_values(snapshot), message_header)
    # all quantities side by side are those of the flow
    assert not isinstance(snapshot, EnsembleForecast)
    if layer.message == POINT_CLOUD:
        return codec.point_cloud(layer.points(snapshot), message_header)
    return grid_map.grid_map_message(layer.maps(snapshot), snapshot.terrain, message_header)


def terrain_messages(
    terrain: Terrain, *, frame_id: str, stamp_ns: int
) -> dict[str, Image | MapMetaData]:
    """Make the image and its description that stand for a terrain, by their topics."""
    image = codec.float_image(terrain.elevation, codec.header(frame_id, stamp_ns))
    return {'terrain': image, 'terrain_info': codec.map_metadata(terrain, stamp_ns)}


def relief_message(terrain: Terrain, *, frame_id: str, stamp_ns: int) -> OccupancyGrid:
    """Make the grid that shows a terrain: 0 in the light to 100 in the shade, -1 without data.

    The light is from the north-west, 45 degrees high, as on printed maps.
    """
    north, east = np.gradient(terrain.elevation, terrain.resolution)
    facing = 0.5 * (east - north) + math.sqrt(0.5)
    shade = 100.0 * (1.0 - np.clip(facing / np.sqrt(1.0 + east**2 + north**2), 0.0, 1.0))
    cells = np.rint(np.where(np.isfinite(shade), shade, -1.0)).astype(np.int8)
    info = codec.map_metadata(terrain, stamp_ns)
    return codec.occupancy_grid(cells, info, codec.header(frame_id, stamp_ns))


def vent_rows(vents: Sequence[Vent], time: float) -> list[tuple[float, ...]]:
    """List the vents as they are at a simulated time [s].

    Returns:
        (x, y, discharge [m3/s], temperature [Celsius], radius [m], id) of each vent; a fissure
        is its two ends with half the discharge each.
    """
    rows: list[tuple[float, ...]] = []
    for index, vent in enumerate(vents):
        places = [vent.position] if vent.end is None else [vent.position, vent.end]
        celsius = vent.temperature - ZERO_CELSIUS
        rows += [
            (x, y, vent.discharge_at(time) / len(places), celsius, vent.radius, float(index))
            for x, y in places
        ]
    return rows


def vents_message(
    rows: Sequence[tuple[float, ...]], terrain: Terrain, *, frame_id: str, stamp_ns: int
) -> PointCloud2:
    """Make the cloud that stands for rows of ``vent_rows``, at the height of the terrain."""
    names = ('x', 'y', 'discharge', 'temperature', 'radius', 'id')
    columns = {name: [row[index] for row in rows] for index, name in enumerate(names)}
    heights = [float(terrain.elevation[terrain.cell_at(*row[:2])]) for row in rows]
    columns = {'x': columns.pop('x'), 'y': columns.pop('y'), 'z': heights, **columns}
    return codec.point_cloud(columns, codec.header(frame_id, stamp_ns))
