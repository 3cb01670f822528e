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

"""The scene's own topics: terrain, relief and the markers of vents."""

from collections.abc import Sequence
from hashlib import sha256
from typing import Any

from geometry_msgs.msg import Point
from nav_msgs.msg import MapMetaData, OccupancyGrid
from sensor_msgs.msg import Image
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from lava_ros.maps.layers import ZERO_CELSIUS
from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.entities import Entities
from lava_ros.scene import Scene, Terrain, Vent


class ScenePublisher:
    """Publishes relief and vents, latched, and a terrain of the node's own on its input topics."""

    def __init__(self, entities: Entities, *, frame_id: str) -> None:
        """Create the publishers."""
        self._entities = entities
        self._frame_id = frame_id
        self._shown: Terrain | None = None
        self._marked: object = None
        self._sent: dict[str, bytes] = {}
        self._publishers = self._create()
        latched = qos.ros_profile(qos.LATCHED)
        self._relief = entities.create('publisher', OccupancyGrid, 'relief', latched)
        self._markers = entities.create('publisher', MarkerArray, 'vents_markers', latched)

    def publish(self, scene: Scene, time: float, stamp_ns: int, *, is_heard: bool) -> None:
        """Publish the vents and the terrain if they have changed.

        Once a terrain is received from elsewhere (``is_heard``), the one published here is
        withdrawn. ``time`` is the simulated time of the discharges [s], ``stamp_ns`` the ROS time
        [ns].
        """
        terrain, vents = scene.terrain, scene.vents
        options: dict[str, Any] = {'frame_id': self._frame_id, 'stamp_ns': stamp_ns}
        is_new, self._shown = terrain is not self._shown, terrain
        # what is written beside the vents is all that changes of them
        marked = vents, [vent.discharge_at(time) for vent in vents]
        if is_new or marked != self._marked:
            self._marked = marked
            self._markers.publish(vent_markers(vents, time, terrain, **options))
        if is_new:
            self._publish_terrain(terrain, options, is_heard=is_heard)

    def _publish_terrain(
        self, terrain: Terrain, options: dict[str, Any], *, is_heard: bool
    ) -> None:
        self._relief.publish(codec.serialise(outputs.relief_message(terrain, **options)))
        if is_heard:
            self._take_back()
            return
        for topic, message in outputs.terrain_messages(terrain, **options).items():
            data = codec.serialise(message)
            self._sent[topic] = sha256(data).digest()
            self._publishers[topic].publish(data)

    def is_own(self, topic: str, data: bytes) -> bool:
        """Whether a message is the one that was published here."""
        return topic in self._sent and sha256(data).digest() == self._sent[topic]

    def _take_back(self) -> None:
        """Let nobody who comes late get an old terrain beside the one that was heard."""
        if self._sent:
            self._sent = {}
            for publisher in self._publishers.values():
                self._entities.drop(publisher)
            self._publishers = self._create()

    def _create(self) -> dict[str, Any]:
        latched = qos.ros_profile(qos.LATCHED)
        return {
            topic: self._entities.create('publisher', kind, topic, latched)
            for topic, kind in (('terrain', Image), ('terrain_info', MapMetaData))
        }


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

    ``stamp_ns`` is the ROS time of the markers [ns].

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
        place.color = _color(OPEN if discharge > 0.0 else CLOSED)
        start = _point(vent.position, terrain)
        if vent.end is None:
            place.type = Marker.CYLINDER
            place.pose.position = start
            place.scale.x = place.scale.y = 2.0 * vent.radius
            place.scale.z = THICKNESS * vent.radius
        else:
            place.type = Marker.LINE_STRIP
            place.points = [start, _point(vent.end, terrain)]
            place.scale.x = 2.0 * vent.radius
        label = Marker(header=header, ns=LABELS, id=index, action=Marker.ADD)
        label.type = Marker.TEXT_VIEW_FACING
        label.pose.position = Point(x=start.x, y=start.y, z=start.z + vent.radius + letters)
        label.scale.z = letters
        label.color = _color(WORDS)
        celsius = vent.temperature - ZERO_CELSIUS
        label.text = f'{vent.name or index + 1}: {discharge:.3g} m3/s, {celsius:.0f} C'
        markers += [place, label]
    return MarkerArray(markers=markers)


def _point(position: tuple[float, float], terrain: Terrain) -> Point:
    x, y = position
    return Point(x=x, y=y, z=float(terrain.elevation[terrain.cell_at(x, y)]))


def _color(rgba: tuple[float, float, float, float]) -> ColorRGBA:
    red, green, blue, alpha = rgba
    return ColorRGBA(r=red, g=green, b=blue, a=alpha)
