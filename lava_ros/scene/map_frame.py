# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Pose of the map frame in the frames ``utm`` and ``earth`` of REP 105.

The frame ``utm`` has the eastings and northings of a UTM zone of WGS 84; the map frame is shifted
in it by the offset. The frame ``earth`` is the ECEF of WGS 84, with its origin at the centre of
the Earth and z through the pole; the map frame lies on the ellipsoid, with z up and y along the
northings of the coordinate system.
"""

import math
from typing import NamedTuple

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene.projection import coordinate_system, DEGREES, system_name, transformed
from lava_ros.scene.terrain import Terrain

#: EPSG codes of the UTM zones of WGS 84, north and south. Zones of an older datum, such as ED50,
#: are shifted by 100 m and more in ``utm``.
UTM_CODES = frozenset((*range(32601, 32661), *range(32701, 32761)))

#: Semi-major axis [m] and squared eccentricity of the ellipsoid of WGS 84.
SEMI_MAJOR_AXIS, ECCENTRICITY_SQUARED = 6378137.0, 6.69437999014e-3

#: Half of the baseline along which the direction of north is measured [m].
BASELINE = 100.0

#: Maximum horizontal error of the pose at a corner of the terrain, over the diagonal. The scale of
#: a UTM zone is an error of up to a thousandth.
MAX_ERROR = 0.002


class FramePose(NamedTuple):
    """Pose of the map frame in a parent frame.

    Attributes:
        parent: ``utm`` or ``earth``.
        translation: Position of the map frame's origin (x, y, z) [m].
        rotation: Quaternion (x, y, z, w) that turns vectors of the map frame to the parent frame.
    """

    parent: str
    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


def pose_of_map(terrain: Terrain) -> FramePose | None:
    """Return the pose of the map frame of a terrain, None without a coordinate system.

    Elevations count as heights above the ellipsoid: the height of the geoid is not added.

    Raises:
        LavaError: If rasterio is needed and missing, the map origin is outside the domain of the
            coordinate system, or a rigid frame cannot represent it.
    """
    if terrain.epsg in UTM_CODES:
        return FramePose('utm', (*terrain.offset, 0.0), (0.0, 0.0, 0.0, 1.0))
    if not terrain.has_system:
        return None
    x, y = terrain.offset
    x0, y0, x1, y1 = terrain.extent
    corners = np.array([(x0, y0), (x1, y0), (x0, y1), (x1, y1)])
    along = np.array([(x, y), (x, y - BASELINE), (x, y + BASELINE)])
    try:
        places = _in_degrees(terrain, np.concatenate([along, corners + terrain.offset]))
    except ValueError as error:
        expected = f'an offset inside {system_name(terrain.epsg, terrain.wkt)}: {error}'
        raise LavaError('terrain.offset', terrain.offset, expected) from error
    on_ellipsoid = _ecef(places)
    origin, south, north, *at_corners = on_ellipsoid
    longitude, latitude = np.radians(places[0])
    level = math.cos(latitude)
    up = np.array([level * math.cos(longitude), level * math.sin(longitude), math.sin(latitude)])
    ahead = north - south
    ahead -= (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    axes = np.stack([np.cross(ahead, up), ahead, up])
    shift = np.linalg.norm((at_corners - origin) @ axes[:2].T - corners, axis=1)
    limit = MAX_ERROR * math.hypot(x1 - x0, y1 - y0)
    if shift.max() > limit:
        expected = f'a map origin near the terrain: a frame in earth is {shift.max():.3g} m off '
        raise LavaError('terrain.offset', terrain.offset, f'{expected}at a corner of the terrain')
    return FramePose('earth', tuple(origin.tolist()), _quaternion(axes.T))


def _in_degrees(terrain: Terrain, places: np.ndarray) -> np.ndarray:
    """Return longitudes and latitudes of WGS 84 of projected coordinates, shape [count, 2]."""
    system = coordinate_system(terrain.epsg, terrain.wkt)
    return transformed(system, DEGREES, *places.T.tolist()).T


def _ecef(places: np.ndarray) -> np.ndarray:
    """Return the positions of longitudes and latitudes on the ellipsoid [m], shape [count, 3]."""
    longitude, latitude = np.radians(places).T
    radius = SEMI_MAJOR_AXIS / np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    return np.stack([
        radius * np.cos(latitude) * np.cos(longitude),
        radius * np.cos(latitude) * np.sin(longitude),
        (1.0 - ECCENTRICITY_SQUARED) * radius * np.sin(latitude),
    ], axis=-1)


def _quaternion(matrix: np.ndarray) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w) of a rotation, of which one element is at least 1/2."""
    xx, yy, zz = np.diag(matrix)
    squared = np.array([
        1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz, 1.0 + xx + yy + zz,
    ])
    # the products of the quaternion's elements, times 4
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = matrix
    products = np.array([
        [squared[0], xy + yx, xz + zx, zy - yz],
        [xy + yx, squared[1], yz + zy, xz - zx],
        [xz + zx, yz + zy, squared[2], yx - xy],
        [zy - yz, xz - zx, yx - xy, squared[3]],
    ])
    found = products[squared.argmax()]
    x, y, z, w = (found / np.linalg.norm(found)).tolist()
    return x, y, z, w
