# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Conversion of valid input messages, and errors of invalid ones."""

import array
from collections import Counter
from dataclasses import replace
from functools import partial
from operator import attrgetter
import tracemalloc
from types import SimpleNamespace

from geometry_msgs.msg import PointStamped
from nav_msgs.msg import MapMetaData
import numpy as np
import pytest
from sensor_msgs.msg import Image

from lava_ros.errors import LavaError
from lava_ros.ros import codec, inputs
from lava_ros.ros.parameters import Settings
from lava_ros.scene import Terrain, Vent
from ros.graph_publisher import cloud_of
from ros_messages import float_image

RULES = Settings()

_header = partial(codec.header, 'map', 0)

#: Invalid sides of a cell [m].
RESOLUTIONS = (0.0, -1.0, np.nan, 1e30, 1e-30)

ELEVATION = np.arange(12, dtype=np.float32).reshape(3, 4) + 100.0

ALLOWED = {'terrain_allow_holes': True}


def _pair(resolution=10.0):
    info = MapMetaData(width=4, height=3, resolution=resolution)
    info.origin.position.x, info.origin.position.y = 5.0, -7.0
    return float_image(ELEVATION, _header()), info


def _image(value, place=...):
    elevation = ELEVATION.copy()
    elevation[place] = value
    return float_image(elevation, _header())


def _cloud(x, y, z):
    return codec.point_cloud({'x': np.ravel(x), 'y': np.ravel(y), 'z': np.ravel(z)}, _header())


def test_image_becomes_terrain():
    rules = replace(RULES, epsg=32633, offset_easting=5e5, offset_northing=4.17e6)
    terrain = inputs.terrain_from_image(*_pair(resolution=0.1), rules)
    np.testing.assert_array_equal(terrain.elevation, ELEVATION)
    assert (terrain.resolution, terrain.origin) == (0.1, (5.0, -7.0))
    assert (terrain.epsg, terrain.offset) == (32633, (500000.0, 4170000.0))


def test_16_bit_image_is_converted_to_metres():
    rules = replace(RULES, terrain_scale=0.1, terrain_offset=-100.0)
    for mark in '<>':
        image, info = _pair()
        image.encoding, image.step, image.is_bigendian = '16UC1', 8, int(mark == '>')
        image.data = codec.message_array((ELEVATION * 10.0).astype(mark + 'u2'), 'B')
        terrain = inputs.terrain_from_image(image, info, rules)
        np.testing.assert_allclose(terrain.elevation, ELEVATION - 100.0, atol=1e-4)


@pytest.mark.parametrize(
    ('path', 'value', 'rules', 'message_start'),
    [
        ('image.encoding', '8UC1', {}, 'terrain.encoding is'),
        ('image.step', 15, {}, 'terrain.step is'),
        ('image.step', 17, {}, 'terrain.data is'),
        ('image.data', array.array('B', b'1234'), {}, 'terrain.data is'),
        ('image.width', 0, {}, 'terrain.size is'),
        ('image.height', 40000, {}, 'terrain.size is'),
        ('image.header.frame_id', 'odom', {}, 'terrain.header.frame_id is'),
        ('image.header.frame_id', '', {}, 'terrain.header.frame_id is'),
        ('info.width', 5, {}, 'terrain_info.size is'),
        ('info.height', 0, {}, 'terrain_info.size is'),
        ('info.width', 2**32 - 1, {}, "terrain_info.size is '4294967295 x 3', expected 2 to 3"),
        *(('info.resolution', value, {}, 'terrain_info.resolution is') for value in RESOLUTIONS),
        ('info.origin.position.y', -1e308, {}, 'terrain_info.origin.position.y is'),
        ('info.origin.position.x', np.inf, {}, 'terrain_info.origin.position.x is'),
        ('info.origin.position.z', 1.0, {}, 'terrain_info.origin.position.z is'),
        ('info.origin.orientation.z', 0.1, {}, 'terrain_info.origin.orientation is'),
        ('info.origin.orientation.w', np.nan, {}, 'terrain_info.origin.orientation is'),
        ('image', _image(np.nan, (1, 1)), {}, 'terrain.data is .1 of 12 cells without.*holes'),
        # infinity is not an elevation; terrain needs a cell with data
        ('image', _image(np.inf, (1, 1)), ALLOWED, 'terrain.data is inf'),
        ('image', _image(-np.inf, (1, 1)), ALLOWED, 'terrain.data is inf'),
        ('image', _image(np.nan), ALLOWED, 'terrain.data is .*at least one cell with data'),
        ('image.width', 4, {'max_terrain_cells': 11}, 'terrain.size is .*max_terrain_cells'),
        ('image.width', 4, {'max_input_bytes': 11}, 'terrain.data is .*max_input_bytes'),
    ],
)
def test_rejects_malformed_terrain(path, value, rules, message_start):
    pair = SimpleNamespace(**dict(zip(('image', 'info'), _pair(), strict=True)))
    owner, _, name = path.rpartition('.')
    setattr(attrgetter(owner)(pair) if owner else pair, name, value)
    with pytest.raises(LavaError, match=f'^{message_start}'):
        inputs.terrain_from_image(pair.image, pair.info, replace(RULES, **rules))


@pytest.mark.parametrize('value', [-999.0, -9999.0, 32767.0, 0.0])
def test_rejects_a_value_that_may_mean_missing_data(value):
    ground = 500.0 + np.add.outer(np.arange(20.0), np.arange(20.0))
    ground[4:8, 4:8] = value
    x, y = np.meshgrid(10.0 * np.arange(20.0), 10.0 * np.arange(20.0))
    image = float_image(ground.astype(np.float32), _header())
    info = MapMetaData(width=20, height=20, resolution=10.0)
    rules = replace(RULES, terrain_cloud_resolution=10.0)
    for given in (
        lambda: inputs.terrain_from_image(image, info, rules),
        lambda: inputs.terrain_from_cloud(_cloud(x.ravel(), y.ravel(), ground.ravel()), rules),
    ):
        message_start = f'is .{value:g} in 16 cells.*NaN in place of {value:g}'
        with pytest.raises(LavaError, match=message_start):
            given()


def test_cells_without_data_are_accepted_on_request():
    rules = replace(RULES, **ALLOWED)
    terrain = inputs.terrain_from_image(_image(np.nan, (1, 1)), _pair()[1], rules)
    assert np.argwhere(np.isnan(terrain.elevation)).tolist() == [[1, 1]]
    cloud = _cloud([0, 20, 0, 20], [0, 0, 10, 10], [1, 2, 3, 4])
    terrain = inputs.terrain_from_cloud(cloud, rules)
    np.testing.assert_array_equal(terrain.elevation, [[1, np.nan, 2], [3, np.nan, 4]])


def test_terrain_cells_are_points_or_means_of_points():
    rules = replace(RULES, terrain_cloud_resolution=0.1)
    y, x = np.mgrid[0:3, 0:4] * 0.1
    terrain = inputs.terrain_from_cloud(_cloud(x + 7.0, y - 2.0, ELEVATION), rules)
    np.testing.assert_array_equal(terrain.elevation, ELEVATION)
    assert terrain.origin == pytest.approx((6.95, -2.05))
    x = [0.0, 1.0, 10.0, 0.0, 10.0, 5.0]
    y = [0.0, 1.0, 0.0, 10.0, 10.0, 5.0]
    z = [100.0, 200.0, 10.0, 20.0, 30.0, np.nan]
    terrain = inputs.terrain_from_cloud(_cloud(x, y, z), RULES)
    assert terrain.elevation.tolist() == [[150.0, 10.0], [20.0, 30.0]]
    assert terrain.origin == (-5.0, -5.0)


#: The corners of a cell.
EAST, NORTH = [0, 10, 0, 10], [0, 0, 10, 10]


@pytest.mark.parametrize(
    ('x', 'y', 'z', 'rules', 'field'),
    [
        ([0, 20, 0, 20], [0, 0, 20, 20], [1, 2, 3, 4], {}, 'data'),
        (EAST, NORTH, [1, 2, 3, np.inf], {}, 'z'),
        ([0, 10, 0, np.inf], NORTH, [1, 2, 3, 4], {}, 'x'),
        (EAST, [0, -2e9, 10, 10], [1, 2, 3, 4], {}, 'y'),
        ([0, 10], [0, 0], [1, 2], {}, 'size'),
        ([np.nan], [0], [1], {}, 'size'),
        ([], [], [], {}, 'size'),
        ([0, 1e8], [0, 1e8], [1, 2], {}, 'size'),
        ([0, 1e4], [0, 1e4], [1, 2], {'max_terrain_cells': 100, **ALLOWED}, 'size'),
        ([0, 10], [0, 10], [1, 2], {'frame_id': 'world'}, 'header.frame_id'),
    ],
)
def test_rejects_a_malformed_terrain_cloud(x, y, z, rules, field):
    with pytest.raises(LavaError, match=f'^terrain_cloud.{field} is'):
        inputs.terrain_from_cloud(_cloud(x, y, z), replace(RULES, **rules))


def _wide_cloud(columns, **kinds):
    """Return a point cloud of float64 columns, or of given kinds."""
    dtype = np.dtype([(name, kinds.get(name, '<f8')) for name in columns])
    return cloud_of(np.array([*zip(*columns.values(), strict=True)], dtype)[None])


@pytest.mark.parametrize('axis', ['x', 'y', 'z'])
def test_rejects_cloud_values_whose_range_overflows(axis):
    columns = {'x': [0.0, 10.0, 10.0], 'y': [0.0, 10.0, 10.0], 'z': [1.0, 2.0, 3.0]}
    columns[axis][1:] = [1e308, -1e308]
    with pytest.raises(LavaError, match=rf'terrain_cloud\.{axis} is 1e\+308, expected at most'):
        inputs.terrain_from_cloud(_wide_cloud(columns), RULES)


VENT = {'x': 1.0, 'y': 2.0, 'z': 0.0, 'discharge': 5.0, 'temperature': 1100.0, 'radius': 8.0}


def _vents(*changes, **extra):
    rows = [{**VENT, **extra, **change} for change in changes]
    names = list(rows[0]) if rows else list(VENT)
    return codec.point_cloud({name: [row[name] for row in rows] for name in names}, _header())


def test_cloud_becomes_vents():
    first, second = inputs.vents_from_cloud(_vents({}, {'x': 9.0}), RULES)
    assert first == Vent((1.0, 2.0), 5.0, temperature=1373.15, radius=8.0, name='vent 0')
    # errors of later checks have the unit of the message
    assert 'is 1100.0 Celsius, expected' in str(LavaError('it', first.temperature, 'hotter lava'))
    assert (second.position, second.name) == ((9.0, 2.0), 'vent 1')
    numbers = 7.0, 0.5, 16777215.0, 16777216.0
    vents = inputs.vents_from_cloud(_vents(*({'id': number} for number in numbers)), RULES)
    names = [vent.name for vent in vents]
    assert names == ['vent 7', 'vent 0.5', 'vent 16777215', 'vent 16777216']
    for time in ({}, {'time': 0.0}):
        with pytest.raises(LavaError, match=r'^vents\.id is nan'):
            inputs.vents_from_cloud(_vents({**time, 'id': np.nan}), RULES)
    assert inputs.vents_from_cloud(_vents(), RULES) == ()
    # the id may be an integer, and the other fields doubles
    columns = {name: [value] for name, value in {'id': 42, **VENT}.items()}
    (vent,) = inputs.vents_from_cloud(_wide_cloud(columns, id='<i4'), RULES)
    assert vent == replace(first, name='vent 42')


@pytest.mark.parametrize(('fields', 'words'), [
    ({}, ''), ({'id': 1.0, 'x_end': 3.0, 'y_end': 4.0, 'velocity_x': 0.0, 'velocity_y': 0.0}, ''),
    ({'id': 1.0, 'time': 0.0}, ''), ({'width': 3.0}, 'unknown fields are ignored: width (of a'),
    ({'rate': 3.0, 'end': 0.0}, 'unknown fields are ignored: rate, end (of a vent: x, y, z, dis'),
])
def test_unknown_fields_of_vents_are_named(fields, words):
    cloud = _vents(fields)
    assert len(inputs.vents_from_cloud(cloud, RULES)) == 1
    assert inputs.ignored_fields(cloud).startswith(words)
    assert bool(inputs.ignored_fields(cloud)) is bool(words)


def test_points_with_times_are_one_vent_with_a_series():
    points = [
        {'time': time, 'discharge': discharge, 'x': x}
        for x in (1.0, 9.0)
        for time, discharge in ((0.0, 5.0), (60.0, 2.0), (600.0, 0.0))
    ]
    first, second = inputs.vents_from_cloud(_vents(*points, id=7.0), RULES)
    assert (first.position, second.position) == ((1.0, 2.0), (9.0, 2.0))
    assert first.series == second.series == ((0.0, 5.0), (60.0, 2.0), (600.0, 0.0))
    assert first.name == 'vent 7'
    for end in ((20.0, 5.0), (np.nan, np.nan)):
        fissures = inputs.vents_from_cloud(
            _vents(*points, id=7.0, **dict(zip(('x_end', 'y_end'), end, strict=True))), RULES
        )
        expected = None if np.isnan(end).all() else end
        assert [vent.end for vent in fissures] == [expected, expected]
        assert fissures[0].series == first.series
    for cloud, message_start in (
        (_vents(*points), 'missing: id'),
        (
            _vents(points[0], {**points[1], 'radius': 9.0}, id=7.0),
            "'vent 7'.radius is 9.0, expected 8 as at its first time",
        ),
        (_vents(points[1], points[0], id=7.0), "'vent 7'.discharge"),
    ):
        with pytest.raises(LavaError, match=message_start):
            inputs.vents_from_cloud(cloud, RULES)


@pytest.mark.parametrize(
    ('changes', 'rules', 'field'),
    [
        ({'discharge': -1.0}, {}, "vent 'vent 0'.discharge"),
        ({'discharge': np.nan}, {}, "vent 'vent 0'.discharge"),
        ({'radius': 0.0}, {}, "vent 'vent 0'.radius"),
        ({'temperature': 100.0}, {}, "vent 'vent 0'.temperature"),
        ({'temperature': np.inf}, {}, "vent 'vent 0'.temperature"),
        ({'x': np.nan}, {}, "vent 'vent 0'.position[0]"),
        ({'x_end': 5.0}, {}, "vent 'vent 0'.end[1]"),
        ({}, {'max_vents': 1}, 'vents.size'),
        ({}, {'max_input_bytes': 47}, 'vents.data'),
        ({}, {'frame_id': 'world'}, 'vents.header.frame_id'),
    ],
)
def test_rejects_malformed_vents(changes, rules, field):
    with pytest.raises(LavaError) as caught:
        inputs.vents_from_cloud(_vents(changes, changes), replace(RULES, **rules))
    assert caught.value.field == field
    # the value is that of the message, not one converted to kelvin
    assert 'temperature' not in changes or caught.value.value == changes['temperature']


@pytest.mark.parametrize('name', list(VENT))
def test_rejects_vents_without_a_field(name):
    cloud = _vents({})
    cloud.fields = [item for item in cloud.fields if item.name != name]
    with pytest.raises(LavaError, match=f'missing: {name}$'):
        inputs.vents_from_cloud(cloud, RULES)


def test_click_opens_a_vent_with_default_values():
    settings = Settings(default_discharge=3.0, default_temperature=1000.0, default_radius=4.0)
    point = PointStamped(header=codec.header('map', 10**18))
    point.point.x, point.point.y = 6.0, 7.0
    vent = inputs.vent_from_point(point, settings, name='click 1')
    assert vent == Vent((6.0, 7.0), 3.0, temperature=1273.15, radius=4.0, name='click 1')
    point.header.frame_id = 'base_link'
    with pytest.raises(LavaError, match=r'clicked_point\.header\.frame_id'):
        inputs.vent_from_point(point, settings, name='click 1')


_plain_image, _info = partial(Image, width=4, height=3), partial(MapMetaData, width=4, height=3)


def _pairing(*halves):
    result = inputs.TerrainPairing()
    for half in halves:
        result.add(half, 0.0)
    return result


def test_terrain_image_and_info_are_paired():
    image, info = _plain_image(), _info()
    for halves in ((image, info), (info, image)):
        pairing = _pairing(halves[0])
        assert pairing.poll(0.0) is None
        pairing.add(halves[1], 0.0)
        assert pairing.poll(0.0) == (image, info)
        assert pairing.poll(100.0) is None
    second, third, moved = _plain_image(), _plain_image(), _info()
    pairing.add(second, 10.0)
    assert pairing.poll(10.4) is None
    assert pairing.poll(10.5) == (second, info)
    pairing.add(third, 20.0)
    pairing.add(moved, 20.1)
    result = pairing.poll(20.1)
    assert result[0] is third and result[1] is moved


@pytest.mark.parametrize('make', [_plain_image, _info])
@pytest.mark.parametrize(('width', 'pairs', 'errors'), [(4, 7, 0), (5, 0, 2)])
def test_pairing_follows_a_half_that_is_published_ten_times_a_second(make, width, pairs, errors):
    pairing, found = _pairing(_plain_image(), _info()), Counter()
    assert pairing.poll(0.0)
    for tick in range(1, 43):
        pairing.add(make(width=width), 0.1 * tick)
        try:
            found['pair'] += pairing.poll(0.1 * tick) is not None
        except LavaError:
            found['error'] += 1
    assert (found['pair'], found['error']) == (pairs, errors)


@pytest.mark.parametrize('stray', [[], [Image], [MapMetaData], [Image, MapMetaData]])
@pytest.mark.parametrize('lost', [None, Image, MapMetaData])
@pytest.mark.parametrize('order', [(Image, MapMetaData), (MapMetaData, Image)])
def test_pairing_keeps_elevations_at_the_position_of_their_time(stray, lost, order):
    """A map of 10 Hz moves with a robot; an earlier half is left over, and one is lost."""
    pairing, pairs = inputs.TerrainPairing(), []

    def add(kind, tick):
        stamp = codec.time_message(tick)
        half = (
            _plain_image(header=codec.header('map', tick)) if kind is Image
            else _info(map_load_time=stamp)
        )
        pairing.add(half, 0.1 * tick)
        pairs.append(pairing.poll(0.1 * tick))

    for kind in stray:
        add(kind, 1)
    for tick in range(2, 30):
        for kind in order:
            if (tick, kind) != (10, lost):
                add(kind, tick)
    found = [(image.header.stamp, info.map_load_time) for image, info in filter(None, pairs)]
    assert len(found) >= 27 and all(one == other for one, other in found)


@pytest.mark.parametrize('stamps', [(5, 5), (0, 5), (5, 0), (0, 0)])
@pytest.mark.parametrize('is_first', [True, False])
@pytest.mark.parametrize('has_older', [True, False])
@pytest.mark.parametrize('refused', [Image, MapMetaData])
def test_partner_of_a_refused_half_waits_for_another_one(refused, has_older, is_first, stamps):
    image = _plain_image(header=codec.header('map', stamps[0]))
    info = _info(map_load_time=codec.time_message(stamps[1]))
    bad, good = (image, info) if refused is Image else (info, image)
    pairing = _pairing(*[_plain_image(), _info()] * has_older)
    pairing.poll(0.0)
    for half in (bad, good) if is_first else (good, bad):
        (pairing.refuse if half is bad else pairing.add)(half, 20.0)
    # neither a pair with the older half, nor an error about a missing one
    assert [pairing.poll(time) for time in (20.0, 20.6, 23.0, 31.0)] == 4 * [None]
    pairing.add(bad, 40.0)
    assert pairing.poll(40.6) == (image, info)


@pytest.mark.parametrize(
    ('halves', 'patience', 'message_start'),
    [
        ([_plain_image(), _info(width=5)], 2.0, r"terrain_info\.size is '5 x 3', expected.*4 x 3"),
        ([_plain_image()], 10.0, 'terrain_info is missing'),
        ([_info()], 10.0, 'terrain is missing'),
    ],
)
def test_pairing_reports_a_missing_or_wrong_half_once(halves, patience, message_start):
    pairing = _pairing(*halves)
    assert pairing.poll(patience - 0.1) is None
    with pytest.raises(LavaError, match=f'^{message_start}'):
        pairing.poll(patience)
    assert pairing.poll(2.0 * patience) is None
    mended = _plain_image(), _info()
    for half in mended:
        pairing.add(half, 30.0)
    assert pairing.poll(30.0) == mended


@pytest.mark.parametrize('lie', [False, True])
def test_rejects_a_large_terrain_without_allocating_memory(lie):
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


def seen(cells, resolution=10.0, origin=(100.0, 50.0)):
    ground = Terrain(np.zeros(np.shape(cells)), resolution, origin=origin)
    return codec.occupancy_grid(np.array(cells), ground, codec.header('map', 5))


def test_mask_has_the_lava_and_the_observed_cells_of_a_grid():
    mask = inputs.mask_from_grid(seen([[100, 49, -1], [50, 0, 100]]), RULES)
    assert mask.lava.tolist() == [[True, False, False], [True, False, True]]
    assert mask.known.tolist() == [[True, True, False], [True, True, True]]
    assert (mask.resolution, mask.origin) == (10.0, (100.0, 50.0))


@pytest.mark.parametrize(
    ('path', 'value', 'field'),
    [
        ('header.frame_id', 'odom', 'header.frame_id'),
        ('data', array.array('b', [100, 0, 0]), 'data'),
        ('data', array.array('b', [101, 0, 0, 0]), 'data'),
        ('info.origin.orientation.z', 0.7, 'info.origin.orientation'),
        ('info.resolution', 0.0, 'info.resolution'),
        ('info.origin.position.x', 1e308, 'info.origin.position.x'),
    ],
)
def test_rejects_an_invalid_mask(path, value, field):
    message = seen([[100, 0], [0, 0]])
    owner, _, name = path.rpartition('.')
    setattr(attrgetter(owner)(message) if owner else message, name, value)
    with pytest.raises(LavaError) as caught:
        inputs.mask_from_grid(message, RULES)
    assert caught.value.field == f'observed.{field}'
