# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Outgoing messages: arrays in fields, layers, terrain, vents and markers."""

from array import array
from dataclasses import replace

from geometry_msgs.msg import Pose
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image, PointField
from visualization_msgs.msg import Marker

from lava_ros.bag.decoding import cloud_columns, image_array
from lava_ros.errors import LavaError
from lava_ros.layers.layer_files import layers_from_dict
from lava_ros.layers.messages import (
    BARRIERS,
    CLOSED,
    ELEVATIONS,
    LABELS,
    LETTERS,
    OPEN,
    PLACES,
    relief_message,
    vent_rows,
)
from lava_ros.ros import codec, inputs, outputs
from lava_ros.ros.outputs import SceneMessages
from lava_ros.ros.parameters import Settings
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.snapshot import ParticleSample, Snapshot, StepReport
from ros.graph_publisher import cloud_of
from ros_messages import float_image, vent_markers

VALUES = np.array([[1.5, -2.0, 3.0], [4.0, 5.0, np.nan]])


def _image(values, encoding, dtype, *, padding=0, is_bigendian=False):
    rows, columns = values.shape
    data = values.astype(np.dtype(dtype).newbyteorder('>' if is_bigendian else '<'))
    lines = [line.tobytes() + b'\xff' * padding for line in data]
    return Image(
        height=rows, width=columns, encoding=encoding, is_bigendian=int(is_bigendian),
        step=columns * data.itemsize + padding, data=array('B', b''.join(lines)),
    )


@pytest.mark.parametrize('is_bigendian', [False, True])
@pytest.mark.parametrize('padding', [0, 6])
@pytest.mark.parametrize(('encoding', 'dtype'), [('32FC1', 'f4'), ('16UC1', 'u2')])
def test_image_is_read_in_any_encoding_and_byte_order(encoding, dtype, padding, is_bigendian):
    values = np.arange(6.0).reshape(2, 3) + 1000.0
    image = _image(values, encoding, dtype, padding=padding, is_bigendian=is_bigendian)
    np.testing.assert_array_equal(image_array(image, 'terrain'), values)


def _cloud(order, kinds, *, rows, padding, is_bigendian):
    """Return points with fields in any order and padding between them."""
    names = {'x': 1.0, 'y': 2.0, 'z': 3.0}
    formats = [('>' if is_bigendian else '<') + kind for kind in kinds]
    sizes = [np.dtype(item).itemsize + padding for item in formats]
    offsets = [padding + sum(sizes[:index]) for index in range(3)]
    size = padding + sum(sizes)
    dtype = np.dtype({'names': order, 'formats': formats, 'offsets': offsets, 'itemsize': size})
    points = np.zeros((rows, 3), dtype)
    for name in order:
        points[name] = names[name] + 10.0 * np.arange(rows * 3).reshape(rows, 3)
    return cloud_of(points, is_bigendian, padding)


@pytest.mark.parametrize('order', [['x', 'y', 'z'], ['z', 'x', 'y']])
@pytest.mark.parametrize('rows', [1, 2])
@pytest.mark.parametrize('padding', [0, 3])
@pytest.mark.parametrize('is_bigendian', [False, True])
@pytest.mark.parametrize('kinds', [('f4', 'f4', 'f4'), ('f8', 'f4', 'f8')])
def test_cloud_is_read_in_any_layout(order, rows, padding, is_bigendian, kinds):
    cloud = _cloud(order, kinds, rows=rows, padding=padding, is_bigendian=is_bigendian)
    columns = cloud_columns(cloud, 'cloud', ('x', 'y', 'z'), optional=('id',))
    steps = 10.0 * np.arange(rows * 3)
    for name, first in (('x', 1.0), ('y', 2.0), ('z', 3.0)):
        np.testing.assert_array_equal(columns[name], first + steps)
    assert set(columns) == {'x', 'y', 'z'}


@pytest.mark.parametrize(
    ('changes', 'field'),
    [
        ({'row_step': 35}, 'cloud.row_step'),
        ({'row_step': 40}, 'cloud.data'),
        ({'height': 2}, 'cloud.data'),
        ({'width': 0}, 'cloud.data'),
        ({'fields': []}, 'cloud.fields'),
        ({'point_step': 11}, 'cloud.fields.z.offset'),
        (
            {'fields': [PointField(name=name, datatype=9, count=1) for name in 'xyz']},
            'cloud.fields.x',
        ),
        (
            {'fields': [PointField(name=name, datatype=7, count=2) for name in 'xyz']},
            'cloud.fields.x',
        ),
    ],
)
def test_rejects_a_malformed_cloud(changes, field):
    cloud = _cloud(['x', 'y', 'z'], ['f4'] * 3, rows=1, padding=0, is_bigendian=False)
    for name, value in changes.items():
        setattr(cloud, name, value)
    with pytest.raises(LavaError) as caught:
        cloud_columns(cloud, 'cloud', ('x', 'y', 'z'))
    assert caught.value.field == field


def test_image_and_cloud_survive_a_round_trip():
    image = float_image(VALUES, codec.header('map', 1_500_000_002))
    assert (image.header.stamp.sec, image.header.stamp.nanosec) == (1, 500_000_002)
    again = deserialize_message(codec.serialise(image), Image)
    np.testing.assert_array_equal(image_array(again, 'x'), VALUES.astype(np.float32))
    for x, ids in (([1.0, 2.0], [3.0, 4.0]), ([], [])):
        cloud = codec.point_cloud({'x': x, 'id': ids}, codec.header('map', 0))
        columns = cloud_columns(cloud, 'cloud', ('x',), optional=('id',))
        assert columns['x'].tolist() == x
        assert columns.get('id', np.empty(0)).tolist() == ids


TERRAIN = Terrain(np.arange(6.0).reshape(2, 3), 10.0, origin=(100.0, 200.0))
SNAPSHOT = Snapshot(
    time=5.0, terrain=TERRAIN,
    thickness=np.array([[0.0, 1.0, 2.0], [3.0, np.nan, 0.05]], np.float32),
    temperature=np.full((2, 3), 1273.15, np.float32), budget=VolumeBudget(1.0, 1.0),
    particle_count=1, steps=StepReport(1, 1, 1, 1.0, 'diffusion'),
)


def _message(**layer):
    (made,) = layers_from_dict({'layers': {'one': {'source': 'thickness'} | layer}})
    return outputs.layer_message(made, SNAPSHOT, codec.header('map', 3_000_000_004))


def test_grid_and_image_have_place_and_values_of_the_layer():
    grid = _message(message='nav_msgs/OccupancyGrid', range=[0.0, 100.0])
    assert isinstance(grid.data, array) and grid.data.typecode == 'b'
    assert list(grid.data) == [0, 1, 2, 3, -1, 0]
    stamp = grid.header.stamp
    assert (grid.header.frame_id, stamp.sec, stamp.nanosec) == ('map', 3, 4)
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (3, 2, 10.0)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (100.0, 200.0)
    assert grid.info.origin.orientation == Pose().orientation
    image = _message(message='sensor_msgs/Image', threshold=0.0)
    np.testing.assert_array_equal(image_array(image, 'height'), SNAPSHOT.thickness)


def test_cloud_has_a_point_for_each_wet_cell():
    cloud = _message(source='lava', message='sensor_msgs/PointCloud2', threshold=0.05)
    names = ['x', 'y', 'z', 'thickness', 'temperature']
    assert [field.name for field in cloud.fields] == names
    assert (cloud.header.frame_id, cloud.header.stamp.sec) == ('map', 3)
    assert (cloud.height, cloud.width, cloud.is_dense) == (1, 4, True)
    columns = cloud_columns(cloud, 'lava_points', names)
    assert columns['x'].tolist() == [115.0, 125.0, 105.0, 125.0]
    assert columns['y'].tolist() == [205.0, 205.0, 215.0, 215.0]
    assert columns['z'].tolist() == pytest.approx([2.0, 4.0, 6.0, 5.05])
    assert columns['thickness'].tolist() == pytest.approx([1.0, 2.0, 3.0, 0.05])
    assert columns['temperature'].tolist() == pytest.approx([1000.0] * 4)
    cloud = _message(source='lava', message='sensor_msgs/PointCloud2', threshold=100.0)
    assert (cloud.width, len(cloud.data), len(cloud.fields)) == (0, 0, 5)


def test_vents_message_has_the_current_discharge_and_elevation():
    series = ((0.0, 4.0), (10.0, 8.0), (20.0, 0.0))
    vents = (
        Vent((105.0, 205.0), series, temperature=1300.0, radius=3.0),
        Vent((125.0, 215.0), 6.0, 1423.0, end=(115.0, 205.0), velocity=(2.0, -1.0)),
    )
    rows = vent_rows(vents, 15.0)
    assert [row[2] for row in rows] == [8.0, 6.0]
    assert [row[2] for row in vent_rows(vents, -1.0)] == [0.0, 6.0]
    cloud = outputs.vents_message(rows, TERRAIN, codec.header('map', 0))
    assert cloud_columns(cloud, 'vents', ('z',))['z'].tolist() == [0.0, 5.0]
    cloud = outputs.vents_message([], TERRAIN, codec.header('map', 0))
    assert inputs.vents_from_cloud(cloud, Settings()) == ()


@pytest.mark.parametrize('end', [None, (115.0, 205.0)])
@pytest.mark.parametrize('velocity', [(0.0, 0.0), (2.0, -1.0)])
def test_vents_message_has_every_property_of_a_vent_but_its_name(end, velocity):
    vent = Vent((105.0, 215.0), 6.0, 1273.15, radius=3.0, end=end, velocity=velocity)
    rows = vent_rows((vent,), 0.0)
    cloud = outputs.vents_message(rows, TERRAIN, codec.header('map', 0))
    (again,) = inputs.vents_from_cloud(cloud, Settings())
    assert replace(again, name='') == vent


@pytest.mark.parametrize('ids', [[7.0, 5.0], [0.0, 1e6], [-2.0, 0.1], [3e38, 1e-30]])
def test_vents_of_a_bag_have_the_ids_that_were_published(ids):
    values = {name: np.full(2, 900.0) for name in (*inputs.VENT_FIELDS, 'id')}
    values['x'], values['y'], values['id'] = np.array([105.0, 125.0]), np.full(2, 205.0), ids
    cloud = codec.point_cloud(values, codec.header('map', 0))
    published = inputs.vents_from_cloud(cloud, Settings())
    named = Vent((115.0, 215.0), 6.0, 1273.15, radius=3.0, name='summit')
    # a vent that closes does not give its id to another one
    for vents in (published, published[1:], (named, *published)):
        rows = vent_rows(vents, 0.0)
        again = outputs.vents_message(rows, TERRAIN, codec.header('map', 0))
        names = [vent.name for vent in inputs.vents_from_cloud(again, Settings())]
        assert len(set(names)) == len(vents)
        expected = [vent.name for vent in vents if vent is not named]
        assert names[-len(expected):] == expected


def test_relief_is_lit_from_the_north_west():
    y, x = np.mgrid[0:5, 0:5] * 10.0

    def shade(elevation):
        message = relief_message(Terrain(elevation, 10.0), codec.plain(codec.header('map', 1)))
        return message.fields['data'].reshape(5, 5)

    facing, flat, away = shade(0.5 * (x - y)), shade(0.0 * x), shade(0.5 * (y - x))
    assert facing.max() < flat.min() == flat.max() == 29 < away.min()
    hole = 0.0 * x
    hole[0, 0] = np.nan
    assert shade(hole)[0, 0] == -1 and shade(hole)[4, 4] == 29


HILL = Terrain(np.arange(600.0).reshape(20, 30), 10.0, origin=(100.0, 200.0))
VENTS = (
    Vent((105.0, 205.0), ((0.0, 4.0), (20.0, 0.0)), temperature=1373.15, radius=3.0, name='north'),
    Vent((125.0, 215.0), 6.0, 1423.0, end=(115.0, 205.0), radius=2.0),
)


def points(marker):
    return [(item.x, item.y, item.z) for item in marker.points]


def test_vent_has_a_marker_a_label_and_a_line_to_the_ground():
    first, *others = vent_markers(VENTS, 10.0, HILL, codec.header('map', 0)).markers
    assert first.action == Marker.DELETEALL
    assert {item.action for item in others} == {Marker.ADD}
    assert len({(item.ns, item.id) for item in others}) == len(others) == 6
    assert {(item.header.frame_id, item.frame_locked) for item in others} == {('map', True)}
    disc, fissure = (item for item in others if item.ns == PLACES)
    assert disc.type == Marker.CYLINDER
    at = disc.pose.position
    assert (at.x, at.y, at.z) == (105.0, 205.0, 0.0)
    assert (disc.scale.x, disc.scale.y) == (6.0, 6.0)
    assert fissure.type == Marker.LINE_STRIP
    assert points(fissure) == [(125.0, 215.0, 0.0), (115.0, 205.0, 0.0)]
    # narrower than the letters
    assert fissure.scale.x == LETTERS * 200.0 > 4.0
    assert disc.pose.orientation.w == fissure.pose.orientation.w == 1.0
    one, two = (item for item in others if item.ns == LABELS)
    assert one.pose.position.y > 208.0 and one.scale.z > 0.0
    assert two.text.startswith('2: 6 m3/s')
    pole, frame = (item for item in others if item.ns == ELEVATIONS)
    assert pole.type == frame.type == Marker.LINE_STRIP
    assert points(pole) == [(105.0, 205.0, 0.0), (105.0, 205.0, 0.0)]
    # below RViz's camera, which is at 500 m, and opaque: it draws translucent maps above them
    for item in others:
        heights = [item.pose.position.z, *(point.z for point in item.points)]
        assert item.ns == ELEVATIONS or (0.0 <= min(heights) and max(heights) <= 1.0)
        assert item.ns == ELEVATIONS or item.color.a == 1.0
    assert points(frame) == [
        (125.0, 215.0, 0.0), (125.0, 215.0, 32.0), (115.0, 205.0, 1.0), (115.0, 205.0, 0.0)
    ]
    (only,) = vent_markers((), 0.0, HILL, codec.header('map', 0)).markers
    assert only.action == Marker.DELETEALL


def test_barrier_is_a_line_on_the_map():
    crest = ((500_110.0, 4_180_210.0), (500_120.0, 4_180_215.0), (500_130.0, 4_180_215.0))
    ground = replace(HILL, offset=(500_000.0, 4_180_000.0), barriers=(crest,))
    _, line = vent_markers((), 0.0, ground, codec.header('map', 0)).markers
    assert (line.ns, line.type, line.action) == (BARRIERS, Marker.LINE_STRIP, Marker.ADD)
    assert points(line) == [(110.0, 210.0, 0.0), (120.0, 215.0, 0.0), (130.0, 215.0, 0.0)]
    assert line.scale.x > 0.0 and line.color.a == line.pose.orientation.w == 1.0


@pytest.mark.parametrize(
    ('time', 'color', 'words'),
    [(10.0, OPEN, 'north: 4 m3/s, 1100 C'), (30.0, CLOSED, 'north: 0 m3/s, 1100 C')],
)
def test_label_and_color_show_the_current_discharge(time, color, words):
    _, disc, label, *_ = vent_markers(VENTS, time, HILL, codec.header('map', 0)).markers
    assert (disc.color.r, disc.color.g, disc.color.b, disc.color.a) == pytest.approx(color)
    assert label.text == words


def test_particles_are_on_the_surface_and_few(monkeypatch):
    monkeypatch.setattr(outputs, 'MAX_PARTICLES', 3)
    position = np.column_stack([100.0 + np.arange(8.0), np.full(8, 215.0)])
    sample = ParticleSample(
        position, np.ones(8), np.full(8, 1273.15), np.ones(8), np.zeros((8, 2)),
    )
    cloud = outputs.particle_message(sample, SNAPSHOT, codec.header('map', 7))
    found = cloud_columns(cloud, 'lava_particles', ('x', 'y', 'z', 'temperature'))
    assert found['x'].tolist() == [100.0, 103.0, 106.0]
    # the ground is at 3 m there, below 3 m of lava
    assert set(found['z']) == {6.0} and set(found['temperature']) == {1000.0}


GROUND = {'terrain_georeference', 'terrain', 'terrain_info', 'relief'}
SPRINGS = {'vents', 'vents_markers'}


@pytest.mark.parametrize(
    ('change', 'time', 'expected'),
    [
        ({}, 10.0, set()),
        # the discharge of the first vent changes
        ({}, 20.0, SPRINGS),
        ({'vents': (replace(VENTS[0], name='south'), VENTS[1])}, 10.0, SPRINGS),
        ({'vents': VENTS[:1]}, 10.0, SPRINGS),
        # the elevation of the vents changes too
        ({'terrain': replace(HILL, elevation=HILL.elevation + 1.0)}, 10.0, GROUND | SPRINGS),
    ],
)
def test_scene_messages_are_only_those_that_changed(change, time, expected):
    scene, messages = Scene(HILL, VENTS, lava=Lava.paper()), SceneMessages()
    assert set(messages.update(scene, 10.0, codec.header('map', 1))) == GROUND | SPRINGS
    changed = messages.update(replace(scene, **change), time, codec.header('map', 2))
    assert set(changed) == expected
    messages.forget()
    again = messages.update(replace(scene, **change), time, codec.header('map', 3))
    assert set(again) == GROUND | SPRINGS
    assert again['relief'].header.stamp.nanosec == 3


def test_scene_messages_have_the_terrain_of_the_flow():
    scene, messages = Scene(HILL, VENTS, lava=Lava.paper()), SceneMessages()
    old = Terrain(np.zeros((4, 5)), 10.0)
    shown = messages.update(scene, 10.0, codec.header('map', 1), ground=old)
    assert (shown['terrain'].height, shown['relief'].info.width) == (4, 5)
    assert set(messages.update(scene, 10.0, codec.header('map', 2))) == GROUND | SPRINGS
