# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Georeference of the map frame in messages: the transform from a coordinate system to the frame.

The parent frame of the transform is the coordinate system (``EPSG:32633``, or WKT without a code),
its child frame the map frame, and its translation the offset [m].
"""

from collections.abc import Collection, Mapping
import math
from typing import Any, NamedTuple

from lava_ros.bag.decoding import Decoder
from lava_ros.bag.reader import BagMessage, BagReader
from lava_ros.errors import LavaError
from lava_ros.files.optional import is_installed
from lava_ros.scene import Georeference, MAX_COORDINATE
from lava_ros.scene.projection import coordinate_system
from lava_ros.scene.terrain import check_epsg, MAX_WKT

#: Name and type of the topic.
TOPIC, MESSAGE = 'terrain_georeference', 'geometry_msgs/msg/TransformStamped'

_EPSG = 'EPSG:'


class StampedGeoreference(NamedTuple):
    """A georeference with the stamp of its message [ns].

    It belongs to the terrain with the same stamp or, with the stamp 0, to every terrain.
    """

    georeference: Georeference
    stamp_ns: int

    def belongs_to(self, stamps: Collection[int]) -> bool:
        """Return True if it belongs to a terrain whose messages have some stamps [ns]."""
        return self.stamp_ns in (0, *stamps)


def read_georeference(message: Any, frame_id: str | None = None) -> StampedGeoreference:
    """Read the message of the map frame ``frame_id`` or, with None, of any frame.

    Raises:
        LavaError: If the message is of another frame, its coordinate system is not a projected one
            in metres, or its transform is not a shift along the axes x and y.
    """
    if frame_id not in (None, message.child_frame_id):
        expected = f'{frame_id!r}: messages are not transformed'
        raise LavaError(f'{TOPIC}.child_frame_id', message.child_frame_id, expected)
    place, turn = message.transform.translation, message.transform.rotation
    for axis, value in (('x', place.x), ('y', place.y)):
        # NaN compares as False
        if not abs(value) <= MAX_COORDINATE:
            expected = f'metres, at most {MAX_COORDINATE:g} from 0'
            raise LavaError(f'{TOPIC}.transform.translation.{axis}', value, expected)
    if place.z != 0.0:
        expected = '0: the elevations carry the height'
        raise LavaError(f'{TOPIC}.transform.translation.z', place.z, expected)
    if not (max(abs(turn.x), abs(turn.y), abs(turn.z)) < 1e-6 and abs(abs(turn.w) - 1.0) < 1e-6):
        expected = '(0, 0, 0, 1): x points along the eastings and y along the northings'
        found = turn.x, turn.y, turn.z, turn.w
        raise LavaError(f'{TOPIC}.transform.rotation', found, expected)
    stamp = message.header.stamp
    georeference = _with_system(message.header.frame_id, (place.x, place.y))
    return StampedGeoreference(georeference, stamp.sec * 10**9 + stamp.nanosec)


def _with_system(text: str, offset: tuple[float, float]) -> Georeference:
    """Return a georeference with the coordinate system of a text, which may be empty."""
    field, shown = f'{TOPIC}.header.frame_id', text[:40]
    expected = 'a projected coordinate system in metres: EPSG:32633, or WKT, or empty for none'
    code = text.removeprefix(_EPSG)
    if not text:
        return Georeference(offset=offset)
    if code != text and code.isascii() and code.isdigit() and len(code) < 11:
        check_epsg(field, int(code))
        result = Georeference(int(code), offset)
    elif '[' in text and len(text) <= MAX_WKT:
        result = Georeference(None, offset, text)
    else:
        raise LavaError(field, shown, expected)
    # without GDAL, the definition is checked by the program that uses it
    if is_installed('rasterio'):
        try:
            system = coordinate_system(result.epsg, result.wkt)
        except LavaError:
            raise LavaError(field, shown, expected) from None
        if system.is_geographic or not math.isclose(system.linear_units_factor[1], 1.0):
            raise LavaError(field, shown, expected)
    return result


def recorded_georeference(
    bag: BagReader, decoder: Decoder, item: BagMessage
) -> StampedGeoreference | None:
    """Read a message of a bag; None, reported as damage, if it is not valid."""
    result: StampedGeoreference | None = None
    try:
        result = decoder.decode(item, read_georeference)
    except LavaError as error:
        bag.report_damage(f'{item.topic} is left out: {error}')
    return result


def georeferenced(
    scene: Mapping[str, Any], georeference: Georeference
) -> Mapping[str, Any]:
    """Return a scene, in the form of ``scene_to_dict``, with another georeference."""
    known = scene.get('terrain') or {}
    stated = georeference._asdict()
    # the scene may also have the vertical datum; its georeference is checked when it is used
    if stated['epsg'] is not None and stated['epsg'] == known.get('epsg'):
        del stated['wkt']
    return {**scene, 'terrain': {**known, **stated}}
