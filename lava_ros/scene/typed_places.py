# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Places that users type: easting and northing, or longitude and latitude."""

from contextlib import suppress
import math

from lava_ros.errors import LavaError
from lava_ros.files.columns import angle
from lava_ros.scene.likely_places import likely_place
from lava_ros.scene.projection import in_degrees, projected
from lava_ros.scene.terrain import Terrain


def place_as_typed(
    option: str, text: str, terrain: Terrain, *, on_terrain: bool = False
) -> tuple[float, float]:
    """Return easting and northing of a place, given as such or as longitude and latitude.

    Raises:
        LavaError: If the text is not a place, or with ``on_terrain`` is off the terrain.
    """
    x, y = _coordinates(option, text)
    is_geographic = in_degrees(terrain, (x, y))
    place = projected(terrain, x, y) if is_geographic else (x, y)
    if on_terrain and not terrain.covers(*terrain.to_map(*place)):
        expected = f'a place {terrain.bounds(projected=True)}'
        if is_geographic:
            expected += '; this is easting {:.0f}, northing {:.0f}'.format(*place)
        expected += likely_place(terrain, x, y)
        raise LavaError(option, text.strip(), expected)
    return place


def _coordinates(option: str, text: str) -> tuple[float, float]:
    """Return the two numbers of a place; degrees with hemispheres may be in either order."""
    first, _, second = text.partition(',')
    try:
        x, y = float(first), float(second)
        if math.isfinite(x + y):
            return x, y
    except ValueError:
        if first.strip()[-1:].upper() in ('N', 'S') or first.strip()[:1].upper() in ('N', 'S'):
            first, second = second, first
        with suppress(LavaError):
            return angle('', first, 'longitude'), angle('', second, 'latitude')
    expected = 'longitude,latitude [degrees] or easting,northing [m]'
    parts = text.split(',')
    if len(parts) == 4 and all(part.strip(' +-').isdecimal() for part in parts):
        expected += ', with decimal points: {}.{},{}.{}'.format(*map(str.strip, parts))
    raise LavaError(option, text.strip(), expected)
