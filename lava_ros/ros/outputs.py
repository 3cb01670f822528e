# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages made from scenes, snapshots and forecasts."""

from collections.abc import Sequence
from functools import lru_cache
import math
from typing import Any

from geometry_msgs.msg import Point
from nav_msgs.msg import MapMetaData, OccupancyGrid
import numpy as np
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from lava_ros.bag.georeference import TOPIC
from lava_ros.errors import LavaError
from lava_ros.maps.forecast import EnsembleForecast, Forecast
from lava_ros.maps.layers import IMAGE, Layer, OCCUPANCY_GRID, POINT_CLOUD, ZERO_CELSIUS
from lava_ros.ros import codec
from lava_ros.ros.georeference import georeference_message, StaticTransform, TF_STATIC
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation.output.snapshot import ParticleSample, Snapshot

#: Maximum number of particles in a message.
MAX_PARTICLES = 20_000


def message_class(layer: Layer) -> Any:
    """Return the class of a layer's message.

    Raises:
        LavaError: If the package of the message is not installed.
    """
    try:
        return codec.message_class(layer.message)
    except LavaError as error:
        expected = 'a message whose package is installed: install ros-jazzy-grid-map-msgs, '
        expected += f"or switch the layer off (layers_off: ['{layer.name}'])"
        raise LavaError(f'layers.{layer.name}.message', layer.message, expected) from error


def layer_message(
    layer: Layer, snapshot: Snapshot | Forecast | EnsembleForecast, header: Header
) -> Any:
    """Make the message of a layer."""
    if layer.message == OCCUPANCY_GRID:
        info = codec.map_metadata(snapshot.terrain, header.stamp)
        values = layer.grid_values(snapshot)
        border = layer.border(values.shape)
        if np.any(border):
            values = _extend(values, border, info)
        return codec.occupancy_grid(values, info, header)
    if layer.message == IMAGE:
        return codec.float_image(layer.raw_values(snapshot), header)
    # point clouds and grid maps contain quantities of one flow, not of an ensemble
    assert not isinstance(snapshot, EnsembleForecast)
    if layer.message == POINT_CLOUD:
        return codec.point_cloud(layer.points(snapshot), header)
    return codec.grid_map_message(layer.maps(snapshot), snapshot.terrain, header)


def particle_message(sample: ParticleSample, snapshot: Snapshot, header: Header) -> PointCloud2:
    """Make a cloud of at most ``MAX_PARTICLES`` particles, on the surface of the lava."""
    # the particles are sorted by place, so that every n-th one shows all of the lava
    chosen = slice(None, None, len(sample.volume) // MAX_PARTICLES + 1)
    place, terrain = sample.position[chosen], snapshot.terrain
    columns = {
        'x': place[:, 0],
        'y': place[:, 1],
        'z': terrain.values_at(terrain.elevation + snapshot.thickness, place),
        'temperature': sample.temperature[chosen] - ZERO_CELSIUS,
    }
    return codec.point_cloud(columns, header)


def _extend(
    values: np.ndarray, border: Sequence[tuple[int, int]], info: MapMetaData
) -> np.ndarray:
    """Surround a grid by rows and columns of -1 (``Layer.border``), and update ``info``."""
    (below, _), (left, _) = border
    origin = info.origin.position
    origin.y -= info.resolution * below
    origin.x -= info.resolution * left
    result = np.pad(values, border, constant_values=-1)
    info.height, info.width = result.shape
    return result


def terrain_messages(terrain: Terrain, header: Header) -> dict[str, Image | MapMetaData]:
    """Make the messages of a terrain, by topic."""
    image = codec.float_image(terrain.elevation, header)
    return {'terrain': image, 'terrain_info': codec.map_metadata(terrain, header.stamp)}


def relief_message(terrain: Terrain, header: Header) -> OccupancyGrid:
    """Make the hillshade of a terrain: 0 for lit to 100 for shaded cells, -1 without data.

    The light is from the north-west, 45 degrees above the horizon.
    """
    info = codec.map_metadata(terrain, header.stamp)
    return codec.occupancy_grid(_shade(terrain), info, header)


# cached: 25 million cells take a second, and publisher and bag need the same cells
@lru_cache(maxsize=1)
def _shade(terrain: Terrain) -> np.ndarray:
    north, east = np.gradient(terrain.elevation, terrain.resolution)
    facing = 0.5 * (east - north) + math.sqrt(0.5)
    shade = 100.0 * (1.0 - np.clip(facing / np.sqrt(1.0 + east**2 + north**2), 0.0, 1.0))
    return np.rint(np.where(np.isfinite(shade), shade, -1.0)).astype(np.int8)


#: Fields of a cloud of vents, in the order of the values of ``vent_rows``.
_ROW = ('x', 'y', 'discharge', 'temperature', 'radius', 'id', 'x_end', 'y_end', 'velocity_x',
        'velocity_y')


def vent_rows(vents: Sequence[Vent], time: float) -> list[tuple[float, ...]]:
    """Return a row for each vent at a simulated time [s].

    Returns:
        (x, y, discharge [m3/s], temperature [Celsius], radius [m], id, x and y of the other end of
        a fissure or NaN, velocity along x and y [m/s]).
    """
    return [
        (
            *vent.position, vent.discharge_at(time), vent.temperature - ZERO_CELSIUS, vent.radius,
            float(index), *(vent.end or (math.nan, math.nan)), *vent.velocity,
        )
        for index, vent in enumerate(vents)
    ]


def vents_message(
    rows: Sequence[tuple[float, ...]], terrain: Terrain, header: Header
) -> PointCloud2:
    """Make the cloud of rows of ``vent_rows``; z is the elevation of the terrain."""
    columns = {name: [row[index] for row in rows] for index, name in enumerate(_ROW)}
    heights = [_elevation(terrain, *row[:2]) for row in rows]
    ordered = {'x': columns.pop('x'), 'y': columns.pop('y'), 'z': heights, **columns}
    return codec.point_cloud(ordered, header)


#: Namespaces of the markers: vents, their labels, lines from z = 0 to the ground, and the crests
#: of barriers.
PLACES, LABELS, ELEVATIONS, BARRIERS = 'vents', 'vent labels', 'vent elevations', 'barriers'

#: Colours of active vents, of inactive vents, of labels and of crests [RGBA]. They are opaque
#: because RViz draws a translucent map over a translucent marker.
OPEN, CLOSED, WORDS = (1.0, 0.35, 0.0, 1.0), (0.4, 0.65, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0)
CREST = (0.24, 0.17, 0.12, 1.0)

#: Height of the letters as a fraction of the terrain's shorter side. Thickness of a vent's disc as
#: a fraction of its width, and its maximum [m].
LETTERS, THICKNESS, MAX_THICKNESS = 0.028, 0.1, 1.0


def vent_markers(
    vents: Sequence[Vent], time: float, terrain: Terrain, header: Header
) -> MarkerArray:
    """Make markers of the vents at a simulated ``time`` [s] and of the barriers.

    Viewers draw grids at z = 0, and the camera of RViz is at z = 500 m: a vent at the elevation of
    a mountain would be drawn away from its lava, or not at all. The markers are therefore at
    z = 0, and a line from there to the ground shows the elevation. The minimum width of a marker
    is the height of the letters.

    Returns:
        A marker that deletes the earlier ones. Then for each vent a disc, or for a fissure a line;
        a label with its name, discharge [m3/s] and temperature [Celsius]; and a line to the
        ground. Then the crest of each barrier.
    """
    letters = LETTERS * min(terrain.shape) * terrain.resolution
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for index, vent in enumerate(vents):
        discharge = vent.discharge_at(time)
        width = max(2.0 * vent.radius, letters)
        thickness = min(THICKNESS * width, MAX_THICKNESS)
        ends = [vent.position] if vent.end is None else [vent.position, vent.end]
        on_map = [Point(x=x, y=y) for x, y in ends]
        on_ground = [Point(x=x, y=y, z=_elevation(terrain, x, y)) for x, y in ends]
        place, label, elevation = (
            _marker(header, namespace, index) for namespace in (PLACES, LABELS, ELEVATIONS)
        )
        place.color = elevation.color = _color(*(OPEN if discharge > 0.0 else CLOSED))
        place.scale.x = width
        if vent.end is None:
            place.type = Marker.CYLINDER
            place.pose.position = on_map[0]
            place.scale.y, place.scale.z = width, thickness
        else:
            place.type = Marker.LINE_STRIP
            place.points = on_map
        label.type = Marker.TEXT_VIEW_FACING
        x, y = max(ends, key=lambda end: end[1])
        label.pose.position = Point(x=x, y=y + 0.5 * width + letters, z=thickness)
        label.scale.z = letters
        label.color = _color(*WORDS)
        celsius = vent.temperature - ZERO_CELSIUS
        # RViz draws each byte as a character, so that ³ and ° would be two wide blanks each
        label.text = f'{vent.name or index + 1}: {discharge:.3g} m3/s, {celsius:.0f} C'
        elevation.type = Marker.LINE_STRIP
        elevation.scale.x = THICKNESS * width
        elevation.points = [on_map[0], *on_ground, *on_map[1:]]
        markers += [place, label, elevation]
    for index, crest in enumerate(terrain.barriers):
        line = _marker(header, BARRIERS, index)
        line.type = Marker.LINE_STRIP
        line.points = [Point(x=x, y=y) for x, y in np.subtract(crest, terrain.offset).tolist()]
        line.scale.x, line.color = THICKNESS * letters, _color(*CREST)
        markers.append(line)
    return MarkerArray(markers=markers)


class SceneMessages:
    """Makes the messages of a scene, each only when its content has changed.

    The node publishes these messages, and every bag contains them.
    """

    def __init__(self, transform: StaticTransform | None = None) -> None:
        """Initialize without any messages made; ``transform`` makes those of ``/tf_static``."""
        self._transform = transform
        self.forget()

    def forget(self) -> None:
        """Force the next ``update`` to make all messages again."""
        self._ground: Terrain | None = None
        self._vents: object = None

    def update(
        self, scene: Scene, time: float, header: Header, *, ground: Terrain | None = None
    ) -> dict[str, Any]:
        """Make the messages that have changed since the last call.

        Args:
            scene: The scene.
            time: Simulated time of the vents [s].
            header: Header of the messages.
            ground: Current terrain under the flow; None for that of the scene.

        Returns:
            Messages by topic: ``terrain_georeference``, ``terrain``, ``terrain_info``, ``relief``
            and with a transform ``/tf_static`` for new ground, ``vents`` and ``vents_markers`` for
            new ground or changed vents. Topics that are also inputs of the node come first.
        """
        ground = scene.terrain if ground is None else ground
        inputs: dict[str, Any] = {}
        pictures: dict[str, Any] = {}
        if ground is not self._ground:
            inputs[TOPIC] = georeference_message(ground.georeference, header)
            inputs |= terrain_messages(ground, header)
            if self._transform and (message := self._transform.update(ground, header)):
                pictures[TF_STATIC] = message
            pictures['relief'] = relief_message(ground, header)
            self._ground, self._vents = ground, None
        rows = vent_rows(scene.vents, time)
        shown = rows, [vent.name for vent in scene.vents]
        if shown != self._vents:
            inputs['vents'] = vents_message(rows, scene.terrain, header)
            pictures['vents_markers'] = vent_markers(scene.vents, time, scene.terrain, header)
            self._vents = shown
        return inputs | pictures


def _elevation(terrain: Terrain, x: float, y: float) -> float:
    return float(terrain.elevation[terrain.cell_at(x, y)])


def _marker(header: Header, namespace: str, index: int) -> Marker:
    # locked, so that RViz with the fixed frame odom keeps it on the map, however old its stamp is
    return Marker(header=header, ns=namespace, id=index, action=Marker.ADD, frame_locked=True)


def _color(red: float, green: float, blue: float, alpha: float) -> ColorRGBA:
    return ColorRGBA(r=red, g=green, b=blue, a=alpha)
