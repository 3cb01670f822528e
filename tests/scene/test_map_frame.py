# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Pose of the map frame in ``utm`` and ``earth``, compared with PROJ."""

import numpy as np
import pytest
from rasterio.crs import CRS
from rasterio.warp import transform

from lava_ros.errors import LavaError
from lava_ros.scene import Georeference, Terrain
from lava_ros.scene.map_frame import pose_of_map

ELEVATION = np.zeros((200, 300))

#: A transverse Mercator projection around Etna, as for a system without an EPSG code.
LOCAL = CRS.from_proj4('+proj=tmerc +lat_0=37.75 +lon_0=15 +k=1 +ellps=WGS84 +units=m').to_wkt()

#: Systems with the position of the map origin in them, and the scale of the projection there.
SYSTEMS = {
    'ETRS89 / UTM zone 33N': (25833, None, (499_123.25, 4_180_734.5), 0.9996),
    'ED50 / UTM zone 33N': (23033, None, (499_200.0, 4_180_900.0), 0.9996),
    'ETRS89 / LAEA Europe': (3035, None, (4_321_000.0, 3_210_000.0), 1.0),
    'New Zealand': (2193, None, (1_750_000.0, 5_900_000.0), 1.0),
    'local': (None, LOCAL, (-3000.0, 2000.0), 1.0),
}


def rotated(rotation, vectors):
    """Turn vectors, shape [count, 3], by a quaternion."""
    *axis, w = rotation
    twice = 2.0 * np.cross(axis, vectors)
    return vectors + w * twice + np.cross(axis, twice)


def in_earth(system, places):
    """Return the positions of projected coordinates on the ellipsoid in ECEF [m], by PROJ."""
    degrees = transform(system, 'EPSG:4326', *places.T)
    return np.array(transform('EPSG:4979', 'EPSG:4978', *degrees, np.zeros(len(places)))).T


@pytest.mark.parametrize('name', SYSTEMS)
def test_earth_frame_has_the_map_where_proj_has_it(name):
    epsg, wkt, offset, scale = SYSTEMS[name]
    terrain = Terrain(ELEVATION, 10.0, (200.0, -100.0), epsg, offset, wkt=wkt)
    pose = pose_of_map(terrain)
    assert pose.parent == 'earth'
    places = np.array([(0.0, 0.0), (0.0, 1000.0), (1000.0, 0.0), (3000.0, 1900.0)])
    system = wkt or f'EPSG:{epsg}'
    expected = in_earth(system, places + offset)
    np.testing.assert_allclose(pose.translation, expected[0], atol=1e-3)
    on_map = np.column_stack([places, np.zeros(len(places))])
    found = rotated(pose.rotation, on_map) + pose.translation
    # a rigid frame has the curvature of the Earth, 1 m at 3.6 km, and the scale as its error
    shift = np.linalg.norm(found - expected, axis=1)
    assert shift.max() < 3.0
    along = np.linalg.norm(expected[1:] - expected[0], axis=1)
    np.testing.assert_allclose(along * scale, np.linalg.norm(places[1:], axis=1), rtol=2e-4)
    up = rotated(pose.rotation, np.array([[0.0, 0.0, 1.0]]))[0]
    assert up @ expected[0] / np.linalg.norm(expected[0]) > 0.99999


def test_utm_frame_is_the_offset_exactly():
    for epsg in (32601, 32633, 32660, 32701, 32740, 32760):
        terrain = Terrain(ELEVATION, 10.0, (7.0, 8.0), epsg, (499_123.1, 4_180_734.7))
        pose = pose_of_map(terrain)
        assert pose == ('utm', (499_123.1, 4_180_734.7, 0.0), (0.0, 0.0, 0.0, 1.0))


def test_terrain_without_a_coordinate_system_has_no_pose():
    assert pose_of_map(Terrain(ELEVATION, 10.0, offset=(5e5, 4e6))) is None


@pytest.mark.parametrize(('epsg', 'offset', 'origin', 'words'), [
    # the scale of Web Mercator is 1.27 at Etna
    (3035, (4.65e6, 1.65e6), (0.0, 0.0), 'a map origin near the terrain'),
    (3857, (1.67e6, 4.54e6), (0.0, 0.0), 'a map origin near the terrain'),
    (31467, (0.0, 0.0), (3_600_000.0, 5_400_000.0), 'a map origin near the terrain'),
    (3035, (9e8, 9e8), (0.0, 0.0), 'an offset inside EPSG:3035'),
])
def test_pose_that_a_rigid_frame_cannot_have_is_refused(epsg, offset, origin, words):
    with pytest.raises(LavaError, match=words):
        pose_of_map(Terrain(ELEVATION, 10.0, origin, epsg, offset))


def test_georeference_keeps_map_positions():
    crest = ((500_010.0, 4_180_020.0), (500_030.0, 4_180_040.0))
    before = Terrain(
        ELEVATION, 10.0, (5.0, 6.0), 32633, (5e5, 4.18e6), source='x', barriers=(crest,)
    )
    after = before.with_georeference(Georeference(25833, (6e5, 4e6)))
    assert after.georeference == (25833, (6e5, 4e6), None)
    assert (after.origin, after.resolution, after.source) == ((5.0, 6.0), 10.0, 'x')
    shown = [np.subtract(item.barriers[0], item.offset).tolist() for item in (before, after)]
    assert shown[0] == shown[1]
    np.testing.assert_array_equal(before.elevation, after.elevation)
