# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages of scenes, snapshots and forecasts as plain data (``bag.encoding``)."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import count
import math
import re
from typing import Any

import numpy as np

from lava_ros.bag import messages
from lava_ros.bag.encoding import Message
from lava_ros.bag.georeference import TOPIC
from lava_ros.bag.messages import Plain
from lava_ros.layers.forecast import EnsembleForecast, Forecast
from lava_ros.layers.layer import IMAGE, Layer, OCCUPANCY_GRID, POINT_CLOUD, ZERO_CELSIUS
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation.output.snapshot import Snapshot

#: Values of visualization_msgs/Marker.
_ADD, _DELETE_ALL, _CYLINDER, _LINE_STRIP, _TEXT = 0, 3, 3, 4, 9

def layer_message(
    layer: Layer, snapshot: Snapshot | Forecast | EnsembleForecast, header: Plain
) -> Message:
    """Make the message of a layer, except of a grid map."""
    if layer.message == OCCUPANCY_GRID:
        info = dict(messages.map_metadata(snapshot.terrain, header['stamp']).fields)
        values = layer.grid_values(snapshot)
        border = layer.border(values.shape)
        if np.any(border):
            values = _extend(values, border, info)
        return messages.occupancy_grid(values, info, header)
    if layer.message == IMAGE:
        return messages.float_image(layer.raw_values(snapshot), header)
    # point clouds contain quantities of one flow, not of an ensemble
    assert layer.message == POINT_CLOUD and not isinstance(snapshot, EnsembleForecast)
    return messages.point_cloud(layer.points(snapshot), header)


def _extend(
    values: np.ndarray, border: Sequence[tuple[int, int]], info: dict[str, Any]
) -> np.ndarray:
    """Surround a grid by rows and columns of -1 (``Layer.border``), and update ``info``."""
    (below, _), (left, _) = border
    place, cell = info['origin']['position'], info['resolution']
    # the messages have float64 positions and float32 resolutions
    cell = float(np.float32(cell))
    info['origin'] = {'position': {'x': place['x'] - cell * left, 'y': place['y'] - cell * below}}
    result = np.pad(values, border, constant_values=-1)
    info['height'], info['width'] = result.shape
    return result


def terrain_messages(terrain: Terrain, header: Plain) -> dict[str, Message]:
    """Make the messages of a terrain, by topic."""
    image = messages.float_image(terrain.elevation, header)
    return {'terrain': image, 'terrain_info': messages.map_metadata(terrain, header['stamp'])}


def relief_message(terrain: Terrain, header: Plain) -> Message:
    """Make the hillshade of a terrain: 0 for lit to 100 for shaded cells, -1 without data.

    The light is from the north-west, 45 degrees above the horizon.
    """
    info = messages.map_metadata(terrain, header['stamp'])
    return messages.occupancy_grid(_shade(terrain), info.fields, header)


# cached, because 25 million cells take a second, and both publisher and bag need the cells
@lru_cache(maxsize=1)
def _shade(terrain: Terrain) -> np.ndarray:
    north, east = np.gradient(terrain.elevation, terrain.resolution)
    facing = 0.5 * (east - north) + math.sqrt(0.5)
    shade = 100.0 * (1.0 - np.clip(facing / np.sqrt(1.0 + east**2 + north**2), 0.0, 1.0))
    return np.rint(np.where(np.isfinite(shade), shade, -1.0)).astype(np.int8)


# Names that ``vent_name`` returns.
_NUMBERED = re.compile(r'vent (-?\d+(?:\.\d+)?(?:e[+-]\d+)?)')

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
            number, *(vent.end or (math.nan, math.nan)), *vent.velocity,
        )
        for number, vent in zip(_ids(vents), vents, strict=True)
    ]


def vent_name(number: float) -> str:
    """Return the name of a vent with an id in a message."""
    # all digits, because vents with one name continue each other
    return f'vent {number:.15g}'


def _ids(vents: Sequence[Vent]) -> list[float]:
    """Return the id in the name of each vent (``vent_name``), otherwise an unused whole number."""
    found = [_NUMBERED.fullmatch(vent.name) for vent in vents]
    given = [None if match is None else float(match[1]) for match in found]
    free = (float(number) for number in count() if number not in given)
    return [next(free) if number is None else number for number in given]


def vents_message(
    rows: Sequence[tuple[float, ...]], terrain: Terrain, header: Plain
) -> Message:
    """Make the cloud of rows of ``vent_rows``; z is the elevation of the terrain."""
    columns = {name: [row[index] for row in rows] for index, name in enumerate(_ROW)}
    heights = [_elevation(terrain, *row[:2]) for row in rows]
    ordered = {'x': columns.pop('x'), 'y': columns.pop('y'), 'z': heights, **columns}
    return messages.point_cloud(ordered, header)


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
    vents: Sequence[Vent], time: float, terrain: Terrain, header: Plain
) -> Message:
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
    markers: list[Plain] = [{'header': header, 'action': _DELETE_ALL}]
    for index, vent in enumerate(vents):
        discharge = vent.discharge_at(time)
        width = max(2.0 * vent.radius, letters)
        thickness = min(THICKNESS * width, MAX_THICKNESS)
        ends = [vent.position] if vent.end is None else [vent.position, vent.end]
        on_map = [_point(x, y) for x, y in ends]
        on_ground = [_point(x, y, _elevation(terrain, x, y)) for x, y in ends]
        x, y = max(ends, key=lambda end: end[1])
        color = _color(OPEN if discharge > 0.0 else CLOSED)
        if vent.end is None:
            shape = {
                'type': _CYLINDER, 'pose': {'position': on_map[0]},
                'scale': _point(width, width, thickness),
            }
        else:
            shape = {'type': _LINE_STRIP, 'points': on_map, 'scale': _point(width)}
        celsius = vent.temperature - ZERO_CELSIUS
        # RViz draws each byte as a character, so ³ and ° would each appear as two wide blanks
        text = f'{vent.name or index + 1}: {discharge:.3g} m3/s, {celsius:.0f} C'
        markers += [
            _marker(header, PLACES, index, color=color, **shape),
            _marker(
                header, LABELS, index, type=_TEXT, text=text, color=_color(WORDS),
                pose={'position': _point(x, y + 0.5 * width + letters, thickness)},
                scale=_point(z=letters),
            ),
            _marker(
                header, ELEVATIONS, index, type=_LINE_STRIP, color=color,
                points=[on_map[0], *on_ground, *on_map[1:]], scale=_point(THICKNESS * width),
            ),
        ]
    for index, crest in enumerate(terrain.barriers):
        places = np.subtract(crest, terrain.offset).tolist()
        markers.append(_marker(
            header, BARRIERS, index, type=_LINE_STRIP, color=_color(CREST),
            points=[_point(x, y) for x, y in places], scale=_point(THICKNESS * letters),
        ))
    return Message('visualization_msgs/msg/MarkerArray', {'markers': markers})


class SceneMessages:
    """Makes the messages of a scene, each only when its content has changed.

    The node publishes these messages, and every bag contains them.
    """

    def __init__(self) -> None:
        """Initialize without any messages."""
        self.forget()

    def forget(self) -> None:
        """Force the next ``update`` to make all messages again."""
        self._ground: Terrain | None = None
        self._vents: object = None

    def update(
        self, scene: Scene, time: float, header: Plain, *, ground: Terrain | None = None
    ) -> dict[str, Message]:
        """Make the messages that have changed since the last call.

        Args:
            scene: The scene.
            time: Simulated time of the vents [s].
            header: Header of the messages.
            ground: Current terrain under the flow; None for the terrain of the scene.

        Returns:
            Messages by topic: ``terrain_georeference``, ``terrain``, ``terrain_info`` and
            ``relief`` for new ground, ``vents`` and ``vents_markers`` for new ground or changed
            vents. Topics that are also inputs of the node come first.
        """
        ground = scene.terrain if ground is None else ground
        inputs: dict[str, Message] = {}
        pictures: dict[str, Message] = {}
        if ground is not self._ground:
            inputs[TOPIC] = messages.georeference(ground.georeference, header)
            inputs |= terrain_messages(ground, header)
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


def _point(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Plain:
    return {'x': x, 'y': y, 'z': z}


def _marker(header: Plain, namespace: str, index: int, **fields: Any) -> Plain:
    # locked to its frame, so that RViz with the fixed frame odom keeps it on the map at any age
    own = {'header': header, 'ns': namespace, 'id': index, 'action': _ADD, 'frame_locked': True}
    return own | fields


def _color(color: tuple[float, ...]) -> Mapping[str, float]:
    return dict(zip('rgba', color, strict=True))
