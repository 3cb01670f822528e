# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Georeference of the map frame: its topic, its static transform, and its terrains."""

from collections.abc import Iterable
from contextlib import suppress
from typing import Any
from weakref import WeakKeyDictionary

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from std_msgs.msg import Header

from lava_ros.bag import messages, QosProfile
from lava_ros.bag.georeference import read_georeference, StampedGeoreference, TOPIC
from lava_ros.bag.schemas import message_schema
from lava_ros.errors import LavaError
from lava_ros.ros import codec
from lava_ros.scene import Georeference, Terrain
from lava_ros.scene.map_frame import pose_of_map
from lava_ros.scene.projection import system_name

#: Topic of static transforms, and type of its messages, whose package is not on PyPI.
TF_STATIC, TF_MESSAGE = '/tf_static', 'tf2_msgs/msg/TFMessage'

#: Subscription to static transforms, of which each publisher keeps one message.
TF_LISTENER = QosProfile(depth=100, durability='transient_local')


def georeference_message(georeference: Georeference, header: Header) -> TransformStamped:
    """Make the message of a georeference for the terrain with the same header."""
    return codec.made(messages.georeference(georeference, codec.plain(header)))


def transform_message(terrain: Terrain, header: Header) -> TransformStamped | None:
    """Make the transform from ``utm`` or ``earth`` to the frame of a header, for ``/tf_static``.

    Returns:
        The transform; None without a coordinate system, and if the frame is its own parent.

    Raises:
        LavaError: If the terrain has no such transform.
    """
    pose = pose_of_map(terrain)
    if pose is None or pose.parent == header.frame_id:
        return None
    message = TransformStamped(child_frame_id=header.frame_id)
    message.header = Header(stamp=header.stamp, frame_id=pose.parent)
    message.transform.translation = Vector3(**dict(zip('xyz', pose.translation, strict=True)))
    message.transform.rotation = Quaternion(**dict(zip('xyzw', pose.rotation, strict=True)))
    return message


def static_transform(*, is_wanted: bool) -> 'StaticTransform | None':
    """Return the static transform if it is wanted and the package of its message is installed."""
    with suppress(LavaError):
        return StaticTransform(codec.message_class(TF_MESSAGE)) if is_wanted else None
    return None


def recorded_transform(logger: Any, *, is_wanted: bool) -> 'StaticTransform | None':
    """Return the static transform of a bag, which also needs the definition of the message."""
    result = static_transform(is_wanted=is_wanted)
    if result is not None:
        try:
            message_schema(TF_MESSAGE)
        except LavaError as error:
            logger.warning(f'bags are without {TF_STATIC}: {error}')
            return None
    return result


class StaticTransform:
    """Makes the messages of ``/tf_static``, and compares messages of other nodes with them.

    ``problem`` is the reason why there is no transform, empty if there is one or none is needed.
    """

    def __init__(self, message_class: Any) -> None:
        """Initialize without a transform, for messages of a class such as TFMessage."""
        self.message_class = message_class
        self.problem = ''
        self._own: TransformStamped | None = None
        self._last: TransformStamped | None = None

    def update(self, terrain: Terrain, header: Header) -> Any:
        """Return the message for a terrain; None if there is nothing to publish or to withdraw."""
        former, self.problem = self._own, ''
        try:
            self._own = transform_message(terrain, header)
        except LavaError as error:
            self._own, self.problem = None, f'no transform to {header.frame_id}: {error}'
        if self._own is None and former is None:
            return None
        return self.message_class(transforms=[self._own] if self._own else [])

    def receive(self, transforms: Iterable[TransformStamped], frame_id: str) -> None:
        """Store the newest transform to the map frame, which is the one that tf2 uses."""
        for item in transforms:
            if item.child_frame_id.lstrip('/') == frame_id:
                self._last = item

    def warning(self) -> str:
        """Return the problem, or a warning if the newest transform to the map frame differs."""
        own, last = self._own, self._last
        if own is None or last is None:
            return self.problem
        if (own.header.frame_id, own.transform) == (last.header.frame_id, last.transform):
            return ''
        shown, expected = (
            f'{item.header.frame_id} ({item.transform.translation.x:.10g}, '
            f'{item.transform.translation.y:.10g}, {item.transform.translation.z:.10g})'
            for item in (last, own)
        )
        return (
            f'another node publishes a transform to {own.child_frame_id}, from {shown}, not '
            f'{expected}: give this node another frame_id, set publish_tf to false, or remap '
            f'{TF_STATIC}'
        )


class TerrainGeoreferences:
    """Assigns the georeference to each terrain of a topic; either may arrive first.

    A georeference with a stamp belongs to the terrain with this stamp, and one with the stamp 0 to
    every terrain of a topic. It replaces the georeference of the parameters if it has a coordinate
    system. A terrain of a file has the georeference of its file.

    ``ground`` is the newest terrain of a topic, with its georeference, and ``topic`` that topic.
    """

    def __init__(self) -> None:
        """Initialize without terrain and georeference."""
        self.ground: Terrain | None = None
        self.topic = ''
        self._newest: StampedGeoreference | None = None
        # stamps of the ground, and its georeference without a message
        self._stamps, self._given = frozenset[int](), Georeference()
        self._topics: WeakKeyDictionary[Terrain, str] = WeakKeyDictionary()

    def add_terrain(self, terrain: Terrain, topic: str, *stamps: Time) -> bool:
        """Store a terrain of a topic with its stamps; return True if its georeference is known."""
        self.ground, self.topic, self._given = terrain, topic, terrain.georeference
        self._stamps = frozenset(map(codec.nanoseconds, stamps))
        return self._update()

    def add_georeference(self, message: TransformStamped, frame_id: str) -> bool:
        """Store a georeference; return True if it belongs to the newest terrain.

        Raises:
            LavaError: If the message is not a georeference of the map frame ``frame_id``.
        """
        self._newest = read_georeference(message, frame_id)
        return self._update()

    def topic_of(self, terrain: Terrain) -> str | None:
        """Return the topic on which a terrain was received, None for one of a file."""
        return self._topics.get(terrain)

    def warning(self, terrain: Terrain) -> str:
        """Return a warning if the newest message contradicts the ``terrain`` in use."""
        if self._newest is None:
            return ''
        (stated, stamp_ns), own = self._newest, terrain.georeference
        shown, expected = map(_words, (stated, own))
        if shown == expected:
            given = _words(self._given)
            is_replaced = self._given.system and self._belongs() and given != expected
            return f'{TOPIC} ({shown}) replaces epsg ({given})' if is_replaced else ''
        if self.topic_of(terrain) is None:
            return f'{TOPIC} ({shown}) is not used: the terrain is of a file ({expected})'
        if self._belongs():
            return ''
        return (
            f'{TOPIC} ({shown}) is not used: its stamp {1e-9 * stamp_ns:.3f} s is not that of the '
            f'terrain ({expected}), nor 0 for every terrain'
        )

    def _belongs(self) -> bool:
        return self._newest is not None and self._newest.belongs_to(self._stamps)

    def _update(self) -> bool:
        """Assign the georeference to the ground; return True if a message contains it."""
        if self.ground is None:
            return False
        wanted = self._given
        if self._newest is not None and self._belongs():
            stated = self._newest.georeference
            wanted = stated if stated.system or not self._given.system else self._given
        if self.ground.georeference != wanted:
            self.ground = self.ground.with_georeference(wanted)
        self._topics[self.ground] = self.topic
        return self._belongs()


def _words(georeference: Georeference) -> str:
    easting, northing = georeference.offset
    system = system_name(georeference.epsg, georeference.wkt)
    return f'{system}, offset {easting:.12g} {northing:.12g}'
