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

from geometry_msgs.msg import Point
from nav_msgs.msg import MapMetaData, OccupancyGrid
import numpy as np
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from lava_ros.errors import LavaError
from lava_ros.maps.forecast import EnsembleForecast, Forecast
from lava_ros.maps.layers import IMAGE, Layer, OCCUPANCY_GRID, POINT_CLOUD, ZERO_CELSIUS
from lava_ros.ros import codec
from lava_ros.scene import Terrain, Vent
from lava_ros.simulation.snapshot import Snapshot


def message_class(layer: Layer) -> Any:
    """The class of a layer's message; LavaError where its package is not installed."""
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
        values = layer.grid_values(snapshot)
        added = [max(0, layer.min_cells - count) for count in values.shape]
        if any(added):
            values = _extend(values, added, info)
        return codec.occupancy_grid(values, info, message_header)
    if layer.message == IMAGE:
        return codec.float_image(layer.raw_values(snapshot), message_header)
    # all quantities side by side are those of the flow
    assert not isinstance(snapshot, EnsembleForecast)
    if layer.message == POINT_CLOUD:
        return codec.point_cloud(layer.points(snapshot), message_header)
    return codec.grid_map_message(layer.maps(snapshot), snapshot.terrain, message_header)


def _extend(values: np.ndarray, added: Sequence[int], info: MapMetaData) -> np.ndarray:
    """Surround a grid by so many rows and columns of -1 in all, and describe it so."""
    before = [count // 2 for count in added]
    origin = info.origin.position
    origin.y, origin.x = (
        start - info.resolution * count
        for start, count in zip((origin.y, origin.x), before, strict=True)
    )
    sides = [(first, count - first) for first, count in zip(before, added, strict=True)]
    result = np.pad(values, sides, constant_values=-1)
    info.height, info.width = result.shape
    return result


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
    names = ('x', 'y', 'z', 'discharge', 'temperature', 'radius', 'id')
    points = [
        (*row[:2], float(terrain.elevation[terrain.cell_at(*row[:2])]), *row[2:]) for row in rows
    ]
    columns = {name: [point[index] for point in points] for index, name in enumerate(names)}
    return codec.point_cloud(columns, codec.header(frame_id, stamp_ns))


#: Namespaces of the markers: the places where lava comes out, and what is written beside them.
PLACES, LABELS = 'vents', 'vent labels'

#: Colours of a vent that gives lava, one that gives none, and what is written [RGBA].
OPEN, CLOSED, WORDS = (1.0, 0.35, 0.0, 0.9), (0.5, 0.5, 0.5, 0.6), (1.0, 1.0, 1.0, 1.0)

#: Height of the letters over the terrain's shorter side, and of a vent's disc over its radius.
LETTERS, THICKNESS = 0.015, 0.1


def vent_markers(
    vents: Sequence[Vent], time: float, terrain: Terrain, *, frame_id: str, stamp_ns: int
) -> MarkerArray:
    """Make markers of the vents on the terrain, as they are at ``time``, simulated [s].

    Returns:
        A marker that deletes the earlier ones, then for each vent its disc, or the line of a
        fissure, and a label with its name, discharge [m3/s] and temperature [Celsius].
    """
    header = codec.header(frame_id, stamp_ns)
    letters = LETTERS * min(terrain.shape) * terrain.resolution
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for index, vent in enumerate(vents):
        discharge = vent.discharge_at(time)
        place = Marker(header=header, ns=PLACES, id=index, action=Marker.ADD)
        place.color = _color(*(OPEN if discharge > 0.0 else CLOSED))
        start = _point(vent.position, terrain)
        place.scale.x = 2.0 * vent.radius
        if vent.end is None:
            place.type = Marker.CYLINDER
            place.pose.position = start
            place.scale.y, place.scale.z = place.scale.x, THICKNESS * vent.radius
        else:
            place.type = Marker.LINE_STRIP
            place.points = [start, _point(vent.end, terrain)]
        label = Marker(header=header, ns=LABELS, id=index, action=Marker.ADD)
        label.type = Marker.TEXT_VIEW_FACING
        label.pose.position = Point(x=start.x, y=start.y, z=start.z + vent.radius + letters)
        label.scale.z = letters
        label.color = _color(*WORDS)
        celsius = vent.temperature - ZERO_CELSIUS
        label.text = f'{vent.name or index + 1}: {discharge:.3g} m3/s, {celsius:.0f} C'
        markers += [place, label]
    return MarkerArray(markers=markers)


def _point(position: tuple[float, float], terrain: Terrain) -> Point:
    x, y = position
    return Point(x=x, y=y, z=float(terrain.elevation[terrain.cell_at(x, y)]))


def _color(red: float, green: float, blue: float, alpha: float) -> ColorRGBA:
    return ColorRGBA(r=red, g=green, b=blue, a=alpha)
