# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ground around a vent: the places at which its lava may come out.

A vent that is narrower than the particle spacing is widened to it, and any vent may extend beyond
the map. Lava comes out only on the map. Outside the vent's own radius it comes out only where it
could have flowed: the ground on the way there rises by no more than the thickness of the flow.
"""

import math
from typing import NamedTuple

import numpy as np

from lava_ros.scene import Terrain, Vent

#: Minimum number of places over which the particles of a vent are spread.
MIN_PLACES = 64

#: Factors by which places move towards the vent's centre or line until there are enough.
_FACTORS = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.0)


class VentShape(NamedTuple):
    """Position and size of a vent; attributes as those of ``Vent``."""

    position: tuple[float, float]
    radius: float
    end: tuple[float, float] | None


def is_open(vent: Vent, reach: float, terrain: Terrain, rise: float) -> bool:
    """Return True if lava may come out everywhere within a distance of a vent.

    All ground there has data, and outside the vent's own radius it is not much higher than the
    vent.

    Args:
        vent: The vent.
        reach: Distance from its centre or line [m].
        terrain: The ground.
        rise: Maximum height above the vent of ground outside the vent's own radius [m].
    """
    ends = np.array([vent.position, vent.end or vent.position])
    low = (ends.min(axis=0) - reach - terrain.origin) // terrain.resolution
    high = (ends.max(axis=0) + reach - terrain.origin) // terrain.resolution + 1
    if low.min() < 0 or (high > terrain.shape[::-1]).any():
        return False
    (left, bottom), (right, top) = low.astype(int), high.astype(int)
    window = np.s_[bottom:top, left:right]
    if not terrain.has_data[window].all():
        return False
    if reach <= vent.radius:
        return True
    count = 2 + math.ceil(math.dist(*ends) / terrain.resolution)
    line = ends[0] + np.linspace(0.0, 1.0, count)[:, None] * (ends[1] - ends[0])
    return bool(terrain.elevation[window].max() <= terrain.elevations_at(line).min() + rise)


def permitted_places(
    vent: Vent | VentShape, places: np.ndarray, terrain: Terrain, rise: float
) -> np.ndarray:
    """Return the places around a vent at which lava may come out.

    If there are fewer than ``MIN_PLACES``, all places are moved towards the vent's centre or line.

    Args:
        vent: The vent, whose position and end are on the terrain.
        places: Places (x, y) of the map [m], shape [count, 2].
        terrain: The ground.
        rise: Maximum rise of the ground outside the vent's own radius [m].

    Returns:
        At least one place (x, y) [m], shape [number, 2].
    """
    start = np.asarray(vent.position)
    along = np.asarray(vent.end or vent.position) - start
    fraction = (places - start) @ along / max(float(along @ along), 1e-300)
    base = start + np.clip(fraction, 0.0, 1.0)[:, None] * along
    for factor in _FACTORS:
        moved = base + factor * (places - base)
        found = moved[_is_permitted(vent.radius, base, moved, terrain, rise)]
        if len(found) >= MIN_PLACES:
            return found
    return found if len(found) else start[None]


def _is_permitted(
    radius: float, base: np.ndarray, places: np.ndarray, terrain: Terrain, rise: float
) -> np.ndarray:
    """Mark the places that lava can reach from the points ``base``; bool, shape [count]."""
    permitted = terrain.covered(places)
    distance = np.linalg.norm(places - base, axis=1)
    outside = np.flatnonzero(permitted & (distance > radius))
    if len(outside):
        base, offset, distance = base[outside], (places - base)[outside], distance[outside]
        count = 2 + math.ceil(2.0 * distance.max() / terrain.resolution)
        fractions = np.linspace(0.0, 1.0, count)
        ground = terrain.elevations_at(base[:, None] + fractions[:, None] * offset[:, None])
        is_own = fractions * distance[:, None] <= radius
        highest = np.where(is_own, ground, -np.inf).max(axis=1)
        # ground without data is NaN and compares as False
        permitted[outside] = (is_own | (ground <= highest[:, None] + rise)).all(axis=1)
    return permitted
