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

"""Vents as markers: what RViz and Foxglove draw of them (visualization_msgs/MarkerArray)."""

from collections.abc import Sequence

from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from lava_ros.layers import ZERO_CELSIUS
from lava_ros.ros import codec
from lava_ros.scene import Terrain, Vent

#: Namespaces of the markers: the places where lava comes out, and what is written beside them.
PLACES, LABELS = 'vents', 'vent labels'

#: Colours of a vent that gives lava, one that gives none, and what is written [RGBA].
OPEN, CLOSED, WORDS = (1.0, 0.35, 0.0, 0.9), (0.5, 0.5, 0.5, 0.6), (1.0, 1.0, 1.0, 1.0)

#: Height of the letters over the terrain's shorter side, and of a vent's disc over its radius.
LETTERS, THICKNESS = 0.015, 0.1


def vent_markers(
    vents: Sequence[Vent], time: float, terrain: Terrain, *, frame_id: str, stamp_ns: int
) -> MarkerArray:
    """Draw the vents as they are at a simulated time.

    Args:
        vents: The vents, each on the terrain.
        time: Simulated time, for their discharge [s].
        terrain: The ground they are on.
        frame_id: Frame of the markers.
        stamp_ns: Their stamp [ns].

    Returns:
        A marker that clears what was there, then for each vent its disc, or a fissure's line, and
        its name, discharge [m3/s] and temperature [Celsius].
    """
    header = codec.header(frame_id, stamp_ns)
    letters = LETTERS * min(terrain.shape) * terrain.resolution
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for index, vent in enumerate(vents):
        discharge = vent.discharge_at(time)
        place = Marker(header=header, ns=PLACES, id=index, action=Marker.ADD)
        place.color = _color(OPEN if discharge > 0.0 else CLOSED)
        place.pose.orientation.w = 1.0
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
        label.pose.orientation.w = 1.0
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
