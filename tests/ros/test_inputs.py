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

"""Messages that come in: what is taken, and what is refused with which error."""

import array
from dataclasses import replace
from operator import attrgetter
import tracemalloc
from types import SimpleNamespace

from geometry_msgs.msg import PointStamped
from nav_msgs.msg import MapMetaData
import numpy as np
import pytest
from sensor_msgs.msg import Image, PointField

from lava_ros.errors import LavaError
from lava_ros.ros import codec, inputs
from lava_ros.ros.parameters import Settings
from lava_ros.scene import Vent

RULES = Settings()
#: Lengths that no cell has [m].
RESOLUTIONS = (0.0, -1.0, np.nan, 1e30, 1e-30)

ELEVATION = np.arange(12, dtype=np.float32).reshape(3, 4) + 100.0


def _header():
    return codec.header('map', 0)



def _pair(elevation=ELEVATION, resolution=10.0, origin=(5.0, -7.0)):
    rows, columns = np.shape(elevation)
    image = codec.float_image(np.asarray(elevation, np.float32), _header())
    info = MapMetaData(width=columns, height=rows, resolution=resolution)
    info.origin.position.x, info.origin.position.y = origin
    return image, info


def _with(value, place=(1, 1)):
    elevation = ELEVATION.copy()
    elevation[place] = value
    return elevation


def test_terrain_from_image():
    """Elevation, resolution, origin and the offset of the map arrive as they are."""
    rules = replace(RULES, epsg=32633, offset_easting=5e5, offset_northing=4.17e6)
    image, info = _pair(resolution=0.1)
    terrain = inputs.terrain_from_image(image, info, rules)
    np.testing.assert_array_equal(terrain.elevation, ELEVATION)
    assert terrain.resolution == 0.1
    assert terrain.origin == (5.0, -7.0)
    assert (terrain.epsg, terrain.offset) == (32633, (500000.0, 4170000.0))


def test_terrain_from_16_bit_image():
    """16UC1 becomes metres by scale and offset, in both byte orders."""
    rules = replace(RULES, terrain_scale=0.1, terrain_offset=-100.0)
    for mark in '<>':
        image, info = _pair()
        image.encoding, image.step, image.is_bigendian = '16UC1', 8, int(mark == '>')
        image.data = codec.message_array((ELEVATION * 10.0).astype(mark + 'u2'), 'B')
        terrain = inputs.terrain_from_image(image, info, rules)
        np.testing.assert_allclose(terrain.elevation, ELEVATION - 100.0, atol=1e-4)


def test_holes_are_taken_on_request():
    """NaN cells are refused unless the parameter allows them."""
    pair = _pair(_with(np.nan))
    with pytest.raises(LavaError, match=r'1 of 12 cells without data.*terrain_allow_holes'):
        inputs.terrain_from_image(*pair, RULES)
    terrain = inputs.terrain_from_image(*pair, replace(RULES, terrain_allow_holes=True))
    assert np.isnan(terrain.elevation[1, 1])


@pytest.mark.parametrize(
    ('path', 'value', 'field'),
    [
        ('image.encoding', '8UC1', 'terrain.encoding'),
        ('image.step', 15, 'terrain.step'),
        ('image.step', 17, 'terrain.data'),
        ('image.data', array.array('B', b'1234'), 'terrain.data'),
        ('image.width', 0, 'terrain.size'),
        ('image.height', 40000, 'terrain.size'),
        ('image.header.frame_id', 'odom', 'terrain.header.frame_id'),
        ('image.header.frame_id', '', 'terrain.header.frame_id'),
        ('info.width', 5, 'terrain_info.size'),
        ('info.height', 0, 'terrain_info.size'),
        *(('info.resolution', value, 'terrain_info.resolution') for value in RESOLUTIONS),
        ('info.origin.position.y', -1e308, 'terrain_info.origin.position.y'),
        ('info.origin.position.x', np.inf, 'terrain_info.origin.position.x'),
        ('info.origin.position.z', 1.0, 'terrain_info.origin.position.z'),
        ('info.origin.orientation.z', 0.1, 'terrain_info.origin.orientation'),
        ('info.origin.orientation.w', np.nan, 'terrain_info.origin.orientation'),
    ],
)
def test_malformed_terrain_is_refused(path, value, field):
    """Each thing that can be wrong with a terrain is named."""
    pair = SimpleNamespace(**dict(zip(('image', 'info'), _pair(), strict=True)))
    owner, _, name = path.rpartition('.')
    setattr(attrgetter(owner)(pair), name, value)
    with pytest.raises(LavaError) as caught:
        inputs.terrain_from_image(pair.image, pair.info, RULES)
    assert caught.value.field == field


@pytest.mark.parametrize('value', [np.inf, -np.inf])
def test_infinite_elevation_is_refused(value):
    """Infinity is never an elevation, holes allowed or not."""
    with pytest.raises(LavaError, match=r'terrain\.data is inf'):
        inputs.terrain_from_image(*_pair(_with(value)), replace(RULES, terrain_allow_holes=True))


def test_terrain_without_data_is_refused():
    """All holes is no terrain."""
    pair = _pair(np.full((3, 4), np.nan))
    with pytest.raises(LavaError, match='at least one cell with data'):
        inputs.terrain_from_image(*pair, replace(RULES, terrain_allow_holes=True))


@pytest.mark.parametrize(
    ('limit', 'field'),
    [('max_terrain_cells', 'terrain.size'), ('max_input_bytes', 'terrain.data')],
)
def test_too_large_a_terrain_is_refused(limit, field):
    """The limits are parameters, and the error names the one that was hit."""
    with pytest.raises(LavaError, match=limit) as caught:
        inputs.terrain_from_image(*_pair(), replace(RULES, **{limit: 11}))
    assert caught.value.field == field


def _cloud(x, y, z):
    columns = {'x': np.ravel(x), 'y': np.ravel(y), 'z': np.ravel(z)}
    return codec.point_cloud(columns, _header())


def test_terrain_from_regular_cloud():
    """Points on a grid of the cells' size are cell centres, also with inexact coordinates."""
    rules = replace(RULES, terrain_cloud_resolution=0.1)
    y, x = np.mgrid[0:3, 0:4] * 0.1
    terrain = inputs.terrain_from_cloud(_cloud(x + 7.0, y - 2.0, ELEVATION), rules)
    np.testing.assert_array_equal(terrain.elevation, ELEVATION)
    assert terrain.origin == pytest.approx((6.95, -2.05))


def test_terrain_from_scattered_cloud():
    """A cell gets the mean of its points; points with NaN are absent."""
    x = [0.0, 1.0, 10.0, 0.0, 10.0, 5.0]
    y = [0.0, 1.0, 0.0, 10.0, 10.0, 5.0]
    z = [100.0, 200.0, 10.0, 20.0, 30.0, np.nan]
    terrain = inputs.terrain_from_cloud(_cloud(x, y, z), RULES)
    assert terrain.elevation.tolist() == [[150.0, 10.0], [20.0, 30.0]]
    assert terrain.origin == (-5.0, -5.0)


@pytest.mark.parametrize(
    ('x', 'y', 'z', 'rules', 'field'),
    [
        ([0, 20, 0, 20], [0, 0, 20, 20], [1, 2, 3, 4], {}, 'terrain_cloud.data'),
        ([0, 10, 0, 10], [0, 0, 10, 10], [1, 2, 3, np.inf], {}, 'terrain_cloud.z'),
        ([0, 10, 0, np.inf], [0, 0, 10, 10], [1, 2, 3, 4], {}, 'terrain_cloud.x'),
        ([0, 10, 0, 10], [0, -2e9, 10, 10], [1, 2, 3, 4], {}, 'terrain_cloud.y'),
        ([0, 10], [0, 0], [1, 2], {}, 'terrain_cloud.size'),
        ([np.nan], [0], [1], {}, 'terrain_cloud.size'),
        ([], [], [], {}, 'terrain_cloud.size'),
        ([0, 1e8], [0, 1e8], [1, 2], {}, 'terrain_cloud.size'),
        (
            [0, 1e4],
            [0, 1e4],
            [1, 2],
            {'max_terrain_cells': 100, 'terrain_allow_holes': True},
            'terrain_cloud.size',
        ),
        ([0, 10], [0, 10], [1, 2], {'frame_id': 'world'}, 'terrain_cloud.header.frame_id'),
    ],
)
def test_malformed_terrain_cloud_is_refused(x, y, z, rules, field):
    """Holes, infinities, a cloud too small or too wide, and the wrong frame are errors."""
    with pytest.raises(LavaError) as caught:
        inputs.terrain_from_cloud(_cloud(x, y, z), replace(RULES, **rules))
    assert caught.value.field == field


@pytest.mark.parametrize('axis', ['x', 'y', 'z'])
def test_numbers_of_a_cloud_are_bounded_before_they_are_used(axis):
    """FLOAT64 may have any number: a spread or a mean of such is none, or another one's."""
    columns = {'x': [0.0, 10.0, 10.0], 'y': [0.0, 10.0, 10.0], 'z': [1.0, 2.0, 3.0]}
    columns[axis][1:] = [1e308, -1e308]
    points = np.array(list(columns.values())).T
    cloud = codec.point_cloud(columns, _header())
    for index, item in enumerate(cloud.fields):
        item.datatype, item.offset = PointField.FLOAT64, 8 * index
    cloud.point_step, cloud.row_step = 24, 72
    cloud.data = array.array('B', points.tobytes())
    with pytest.raises(LavaError, match=rf'terrain_cloud\.{axis} is 1e\+308, expected at most'):
        inputs.terrain_from_cloud(cloud, RULES)


def test_cloud_holes_are_taken_on_request():
    """Cells without points stay NaN when holes are allowed."""
    cloud = _cloud([0, 20, 0, 20], [0, 0, 10, 10], [1, 2, 3, 4])
    terrain = inputs.terrain_from_cloud(cloud, replace(RULES, terrain_allow_holes=True))
    np.testing.assert_array_equal(terrain.elevation, [[1, np.nan, 2], [3, np.nan, 4]])


VENT = {'x': 1.0, 'y': 2.0, 'z': 0.0, 'discharge': 5.0, 'temperature': 1100.0, 'radius': 8.0}


def _vents(*changes, **extra):
    rows = [{**VENT, **extra, **change} for change in changes]
    names = list(rows[0]) if rows else list(VENT)
    return codec.point_cloud({name: [row[name] for row in rows] for name in names}, _header())


def test_vents_from_cloud():
    """Vents arrive in kelvin, named by their id or their place in the message."""
    first, second = inputs.vents_from_cloud(_vents({}, {'x': 9.0}), RULES)
    assert first == Vent((1.0, 2.0), 5.0, temperature=1373.15, radius=8.0, name='vent 0')
    assert (second.position, second.name) == ((9.0, 2.0), 'vent 1')
    assert inputs.vents_from_cloud(_vents({}, id=7.0), RULES)[0].name == 'vent 7'


def test_a_vent_with_a_schedule():
    """Points of one id and place with times are one vent; the ends of a fissure are two."""
    points = [
        {'time': time, 'discharge': discharge, 'x': x}
        for x in (1.0, 9.0)
        for time, discharge in ((0.0, 5.0), (60.0, 2.0), (600.0, 0.0))
    ]
    first, second = inputs.vents_from_cloud(_vents(*points, id=7.0), RULES)
    assert (first.position, second.position) == ((1.0, 2.0), (9.0, 2.0))
    assert first.series == second.series == ((0.0, 5.0), (60.0, 2.0), (600.0, 0.0))
    assert first.name == 'vent 7'
    with pytest.raises(LavaError, match='missing: id'):
        inputs.vents_from_cloud(_vents(*points), RULES)
    with pytest.raises(LavaError, match="'vent 7'.radius is 9.0, expected 8 as at its first time"):
        inputs.vents_from_cloud(_vents(points[0], {**points[1], 'radius': 9.0}, id=7.0), RULES)
    with pytest.raises(LavaError, match="'vent 7'.discharge"):
        inputs.vents_from_cloud(_vents(points[1], points[0], id=7.0), RULES)
    assert inputs.vents_from_cloud(_vents(), RULES) == ()


@pytest.mark.parametrize(
    ('changes', 'field'),
    [
        ({'discharge': -1.0}, "vent 'vent 0'.discharge"),
        ({'discharge': np.nan}, "vent 'vent 0'.discharge"),
        ({'radius': 0.0}, "vent 'vent 0'.radius"),
        ({'temperature': 100.0}, "vent 'vent 0'.temperature"),
        ({'temperature': np.inf}, "vent 'vent 0'.temperature"),
        ({'x': np.nan}, "vent 'vent 0'.position[0]"),
    ],
)
def test_a_malformed_vent_is_refused(changes, field):
    """Each thing that can be wrong with a vent is named."""
    with pytest.raises(LavaError) as caught:
        inputs.vents_from_cloud(_vents(changes), RULES)
    assert caught.value.field == field


@pytest.mark.parametrize('name', list(VENT))
def test_vents_need_their_fields(name):
    """A cloud that lacks a field is refused, and the error lists what is missing."""
    cloud = _vents({})
    cloud.fields = [item for item in cloud.fields if item.name != name]
    with pytest.raises(LavaError, match=f'missing: {name}$'):
        inputs.vents_from_cloud(cloud, RULES)


@pytest.mark.parametrize(
    ('rules', 'field'),
    [
        ({'max_vents': 1}, 'vents.size'),
        ({'max_input_bytes': 47}, 'vents.data'),
        ({'frame_id': 'world'}, 'vents.header.frame_id'),
    ],
)
def test_a_malformed_vents_message_is_refused(rules, field):
    """Too many vents, too many bytes and the wrong frame are errors."""
    with pytest.raises(LavaError) as caught:
        inputs.vents_from_cloud(_vents({}, {}), replace(RULES, **rules))
    assert caught.value.field == field


def test_vents_of_other_types():
    """The id may be an integer, the rest doubles."""
    dtype = np.dtype([('id', '<i4'), *((name, '<f8') for name in VENT)])
    points = np.array([(42, *VENT.values())], dtype)
    cloud = codec.point_cloud(VENT_COLUMNS, _header())
    cloud.fields = [
        PointField(
            name=name,
            offset=dtype.fields[name][1],
            datatype=PointField.INT32 if name == 'id' else PointField.FLOAT64,
            count=1,
        )
        for name in dtype.names
    ]
    cloud.point_step = cloud.row_step = dtype.itemsize
    cloud.data = array.array('B', points.tobytes())
    (vent,) = inputs.vents_from_cloud(cloud, RULES)
    assert (vent.name, vent.discharge, vent.position) == ('vent 42', 5.0, (1.0, 2.0))


VENT_COLUMNS = {name: [value] for name, value in VENT.items()}


def test_vent_from_point():
    """A click opens a vent with the defaults, whatever its stamp; its frame counts."""
    settings = Settings(default_discharge=3.0, default_temperature=1000.0, default_radius=4.0)
    point = PointStamped(header=codec.header('map', 10**18))
    point.point.x, point.point.y = 6.0, 7.0
    vent = inputs.vent_from_point(point, settings, name='click 1')
    assert vent == Vent((6.0, 7.0), 3.0, temperature=1273.15, radius=4.0, name='click 1')
    point.header.frame_id = 'base_link'
    with pytest.raises(LavaError, match=r'clicked_point\.header\.frame_id'):
        inputs.vent_from_point(point, settings, name='click 1')


def _info(width=4):
    return MapMetaData(width=width, height=3)


def _plain_image():
    return Image(width=4, height=3)


@pytest.mark.parametrize('image_first', [True, False])
def test_pairing_in_either_order(image_first):
    """Two new halves of one size are a pair at once, whichever comes first."""
    pairing, image, info = inputs.TerrainPairing(), _plain_image(), _info()
    pairing.add(image if image_first else info, 0.0)
    assert pairing.poll(0.0) is None
    pairing.add(info if image_first else image, 0.0)
    assert pairing.poll(0.0) == (image, info)
    assert pairing.poll(0.0) is None


def test_pairing_waits_for_the_partner_of_a_new_half():
    """A new half of the old size takes the old partner only when no new one comes."""
    pairing, info = inputs.TerrainPairing(), _info()
    pairing.add(_plain_image(), 0.0)
    pairing.add(info, 0.0)
    assert pairing.poll(0.0)
    second, third, moved = _plain_image(), _plain_image(), _info()
    pairing.add(second, 10.0)
    assert pairing.poll(10.4) is None
    assert pairing.poll(10.5) == (second, info)
    pairing.add(third, 20.0)
    pairing.add(moved, 20.1)
    result = pairing.poll(20.1)
    assert result[0] is third
    assert result[1] is moved


def test_pairing_reports_a_mismatch_once():
    """Halves of different sizes are reported once, after the patience, and can still be mended."""
    pairing = inputs.TerrainPairing()
    pairing.add(_plain_image(), 0.0)
    pairing.add(_info(5), 0.0)
    assert pairing.poll(1.9) is None
    with pytest.raises(LavaError, match=r"terrain_info\.size is '5 x 3', expected.*4 x 3"):
        pairing.poll(2.0)
    assert pairing.poll(3.0) is None
    mended = _info()
    pairing.add(mended, 4.0)
    assert pairing.poll(4.0)[1] is mended


@pytest.mark.parametrize(
    ('half', 'field'),
    [(Image(width=4, height=3), 'terrain_info'), (MapMetaData(width=4, height=3), 'terrain')],
)
def test_pairing_reports_a_lonely_half_once(half, field):
    """A half whose partner never comes is reported once, later than one of another size."""
    pairing = inputs.TerrainPairing()
    pairing.add(half, 0.0)
    assert pairing.poll(9.9) is None
    with pytest.raises(LavaError) as caught:
        pairing.poll(10.0)
    assert caught.value.field == field
    assert pairing.poll(20.0) is None


@pytest.mark.parametrize('lie', [False, True])
def test_what_is_too_large_costs_nothing(lie):
    """A terrain beyond the limit, or larger by its own word than it is, is refused before work."""
    rules = replace(RULES, max_terrain_cells=15_999_999)
    image = Image(header=_header(), width=4000, height=4000, encoding='32FC1', step=16_000)
    if not lie:
        image.data.frombytes(bytes(64_000_000))
    tracemalloc.start()
    try:
        with pytest.raises(LavaError, match=r"'4000 x 4000', expected at most 15999999 cells"):
            inputs.check_image(image, rules)
        if lie:
            with pytest.raises(LavaError, match='step x height = 64000000 bytes'):
                inputs.check_image(image, RULES)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 100_000
