# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Places that users type, and slips in coordinates that explain why one is not on a terrain."""

from collections.abc import Iterator
from contextlib import suppress
import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.files.columns import angle
from lava_ros.scene.projection import (
    DEGREES,
    in_degrees,
    is_degrees,
    on_terrain,
    projected,
    system_name,
)
from lava_ros.scene.terrain import Terrain

#: Distances from a terrain at which a place is near it, or of another place, in its extents.
NEAR, FAR = 0.5, 10.0


def place_as_typed(
    option: str, text: str, terrain: Terrain, *, must_be_covered: bool = False
) -> tuple[float, float]:
    """Return easting and northing of a place, given as such or as longitude and latitude.

    Raises:
        LavaError: If the text is not a place, or with ``must_be_covered`` is off the terrain.
    """
    x, y = _coordinates(option, text)
    is_geographic = in_degrees(terrain, (x, y))
    place = projected(terrain, x, y) if is_geographic else (x, y)
    if must_be_covered and not terrain.covers(*terrain.to_map(*place)):
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


def likely_place(terrain: Terrain, x: float, y: float, system: str | None = None) -> str:
    """Describe the slips after which a place that is not on a terrain would be on it.

    Args:
        terrain: The terrain.
        x: Longitude [degrees] or easting [m].
        y: Latitude [degrees] or northing [m].
        system: Coordinate system of the place in a file that states it, if any.

    Returns:
        A phrase that follows an error; empty without an explanation.
    """
    if system is not None and terrain.covers(*terrain.to_map(x, y)):
        own = system_name(terrain.epsg, terrain.wkt)
        return f': in {own}, not in {system}, that of the file, it would be on the terrain'
    if system not in (None, DEGREES):
        return ''
    found = [(_distance(terrain, place), words) for words, place in _slips(terrain, x, y)]
    distance, words = min(found, default=(math.inf, ''))
    if distance == 0.0:
        return f': {words}, it would be on the terrain'
    if distance < NEAR * max(terrain.shape) * terrain.resolution < _distance(
        terrain, terrain.to_map(x, y)
    ):
        return f': {words}, it would be {distance:.0f} m from the terrain'
    if is_degrees((x, y)) and sum(map(abs, terrain.offset)) > 1e3:
        hint = ': these are degrees of another place (longitude comes first), or the elevation '
        return hint + 'has no coordinate system (epsg)'
    if _distance(terrain, terrain.to_map(x, y)) > FAR * max(terrain.shape) * terrain.resolution:
        return ': these are coordinates of another system, or another place'
    return ''


def _distance(terrain: Terrain, place: tuple[float, float]) -> float:
    """Return the distance of a place in the map frame from the cells of a terrain [m]."""
    if terrain.covers(*place):
        return 0.0
    x0, y0, x1, y1 = terrain.extent
    nearest = np.clip(place, (x0, y0), (x1, y1))
    # a place on the border or on a cell without data is not on the terrain
    return max(math.dist(place, nearest), 0.01)


def _slips(terrain: Terrain, x: float, y: float) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield slips, and the place in the map frame without them."""
    swapped = 'with longitude first (longitude and latitude are swapped)'
    for words, place in (
        (swapped, (y, x)),
        ('in the western hemisphere', (-x, y)),
        ('in the southern hemisphere', (x, -y)),
        ('in the western and southern hemispheres', (-x, -y)),
        (f'{swapped} in the western hemisphere', (-y, x)),
        (f'{swapped} in the southern hemisphere', (y, -x)),
        (f'{swapped} in the western and southern hemispheres', (-y, -x)),
    ):
        if terrain.has_system and is_degrees(place):
            yield from _transformed(words, terrain, DEGREES, place)
    is_far = terrain.has_system or sum(map(abs, terrain.offset)) > 1e3
    if is_far and (is_degrees((x, y)) or is_degrees((y, x))):
        return
    west, south = terrain.corner
    for words, place in (
        ('with easting first (easting and northing are swapped)', (y, x)),
        ('in kilometres', (1e3 * x, 1e3 * y)),
        ('in feet', (0.3048 * x, 0.3048 * y)),
        ('with the northing of the southern hemisphere', (x, y + 1e7)),
        ('with the northing of the northern hemisphere', (x, y - 1e7)),
        ('counted from the lower-left corner of the terrain', (x + west, y + south)),
    ):
        yield words, terrain.to_map(*place)
    group, number = divmod(terrain.epsg or 0, 100)
    # WGS 84 / UTM north and south, ETRS89 / UTM
    if group in (326, 327) or (group == 258 and 28 <= number <= 38):
        for zone in (number - 1, number + 1):
            code = f'EPSG:{100 * group + zone}'
            yield from _transformed(f'in the neighbouring zone, {code}', terrain, code, (x, y))


def _transformed(
    words: str, terrain: Terrain, system: str, place: tuple[float, float]
) -> Iterator[tuple[str, tuple[float, float]]]:
    try:
        ((x, y),) = on_terrain(terrain, np.array([place]), system, '', place)
    except LavaError:
        return
    yield words, terrain.to_map(float(x), float(y))
