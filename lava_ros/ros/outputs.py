# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS messages of scenes, snapshots and forecasts."""

from collections.abc import Sequence
from typing import Any

from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from lava_ros.errors import LavaError
from lava_ros.layers import messages
from lava_ros.layers.forecast import EnsembleForecast, Forecast
from lava_ros.layers.layer import GRID_MAP, Layer, ZERO_CELSIUS
from lava_ros.ros import codec
from lava_ros.ros.codec import made, plain
from lava_ros.ros.georeference import StaticTransform, TF_STATIC
from lava_ros.scene import Scene, Terrain
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
    if layer.message == GRID_MAP:
        # grid maps contain quantities of one flow, not of an ensemble
        assert not isinstance(snapshot, EnsembleForecast)
        return codec.grid_map_message(layer.maps(snapshot), snapshot.terrain, header)
    return made(messages.layer_message(layer, snapshot, plain(header)))


def particle_message(sample: ParticleSample, snapshot: Snapshot, header: Header) -> PointCloud2:
    """Make a cloud of at most ``MAX_PARTICLES`` particles, on the surface of the lava."""
    # the particles are sorted by position, so every n-th particle covers all of the lava
    chosen = slice(None, None, len(sample.volume) // MAX_PARTICLES + 1)
    place, terrain = sample.position[chosen], snapshot.terrain
    columns = {
        'x': place[:, 0],
        'y': place[:, 1],
        'z': terrain.values_at(terrain.elevation + snapshot.thickness, place),
        'temperature': sample.temperature[chosen] - ZERO_CELSIUS,
    }
    return codec.point_cloud(columns, header)


def terrain_messages(terrain: Terrain, header: Header) -> dict[str, Any]:
    """Make the messages of a terrain, by topic."""
    found = messages.terrain_messages(terrain, plain(header))
    return {topic: made(message) for topic, message in found.items()}


def vents_message(
    rows: Sequence[tuple[float, ...]], terrain: Terrain, header: Header
) -> PointCloud2:
    """Make the cloud of the rows that ``vent_rows`` returns; z is the elevation of the terrain."""
    return made(messages.vents_message(rows, terrain, plain(header)))


class SceneMessages:
    """Makes the messages of a scene, each only when its content has changed.

    The node publishes these messages, and its bags contain them.
    """

    def __init__(self, transform: StaticTransform | None = None) -> None:
        """Initialize without any messages; ``transform`` makes the messages of ``/tf_static``."""
        self._transform, self._messages = transform, messages.SceneMessages()

    def forget(self) -> None:
        """Force the next ``update`` to make all messages again."""
        self._messages.forget()

    def update(
        self, scene: Scene, time: float, header: Header, *, ground: Terrain | None = None
    ) -> dict[str, Any]:
        """Make the messages that have changed since the last call (``layers.messages``).

        New ground also has a message on ``/tf_static``, if there is a transform.
        """
        found = self._messages.update(scene, time, plain(header), ground=ground)
        result = {topic: made(message) for topic, message in found.items()}
        if self._transform and 'terrain' in found:
            terrain = scene.terrain if ground is None else ground
            if message := self._transform.update(terrain, header):
                result[TF_STATIC] = message
        return result
