# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Grid maps in the layout of grid_map_core.

The package is not on PyPI: the messages are stand-ins, and their transport is not tested.
"""

from concurrent.futures import Future
import sys
import types
from unittest.mock import Mock

from geometry_msgs.msg import Pose
import numpy as np
import pytest
from rclpy.clock import Clock
from rclpy.serialization import serialize_message
from std_msgs.msg import Float32MultiArray, Header, MultiArrayDimension

from lava_ros.errors import LavaError
from lava_ros.layers.layer import GRID_MAP
from lava_ros.layers.layer_files import layers_from_dict
from lava_ros.ros import codec, inputs, outputs
from lava_ros.ros.codec import decode, MAX_GRID_LAYERS
from lava_ros.ros.parameters import Settings
from lava_ros.ros.subscribers import InputSubscribers
from lava_ros.scene import Terrain
from layers.test_layers import EASTWARD as SNAPSHOT
from ros.graph_publisher import publication

#: A terrain of 3 rows and 4 columns with a different elevation in each cell.
TERRAIN = Terrain(np.arange(12.0).reshape(3, 4), 2.0, origin=(100.0, -50.0))


class GridMap:
    """Stand-in with the fields of grid_map_msgs/msg/GridMap and, in ``info``, of GridMapInfo."""

    def __init__(self):
        self.header = Header()
        self.info = types.SimpleNamespace(resolution=0.0, length_x=0.0, length_y=0.0, pose=Pose())
        self.layers, self.basic_layers, self.data = [], [], []
        self.outer_start_index = self.inner_start_index = 0


@pytest.fixture(autouse=True)
def installed(monkeypatch):
    for name in ('grid_map_msgs', 'grid_map_msgs.msg'):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    sys.modules['grid_map_msgs.msg'].GridMap = GridMap


@pytest.fixture
def absent(installed, monkeypatch):
    for name in ('grid_map_msgs', 'grid_map_msgs.msg'):
        monkeypatch.setitem(sys.modules, name, None)


def made(terrain=TERRAIN, **maps):
    maps = {'elevation': terrain.elevation, **maps}
    return codec.grid_map_message(maps, terrain, Header(frame_id='map'))


def moved(outer, inner, *, row_major=False, offset=0):
    """Return the same map with its circular buffer shifted, as in a map around a robot."""
    message = made()
    # along x, along y: index 0 is at the largest, and index i in the buffer at i + start
    matrix = TERRAIN.elevation.T[::-1, ::-1]
    matrix = np.roll(matrix, (outer, inner), axis=(0, 1)).astype(np.float32)
    rows, columns = matrix.shape
    array = Float32MultiArray()
    array.layout.data_offset = offset
    dimensions = [('column_index', columns), ('row_index', rows)]
    array.layout.dim = [
        MultiArrayDimension(label=label, size=size)
        for label, size in (dimensions[::-1] if row_major else dimensions)
    ]
    array.data = [-1.0] * offset + matrix.ravel('C' if row_major else 'F').tolist()
    message.data = [array]
    message.outer_start_index, message.inner_start_index = outer, inner
    return message


def test_grid_map_has_each_value_at_its_position():
    thickness = np.where(TERRAIN.elevation > 5.0, TERRAIN.elevation, np.nan)
    message = made(thickness=thickness)
    assert message.layers == ['elevation', 'thickness']
    assert message.basic_layers == ['elevation']
    for array, values in zip(message.data, (TERRAIN.elevation, thickness), strict=True):
        # rows along x and columns along y, both from the largest; Eigen stores by columns
        np.testing.assert_array_equal(array.data, values.T[::-1, ::-1].ravel('F'))
    info, place = message.info, message.info.pose
    assert (info.resolution, info.length_x, info.length_y) == (2.0, 8.0, 6.0)
    assert (place.position.x, place.position.y, place.position.z) == (104, -47, 0)
    assert place.orientation.w == 1.0
    assert message.header == Header(frame_id='map')
    assert (message.outer_start_index, message.inner_start_index) == (0, 0)
    array = message.data[0]
    # 4 cells along x are rows, 3 along y are columns
    dimensions = [(item.label, item.size, item.stride) for item in array.layout.dim]
    assert dimensions == [('column_index', 3, 12), ('row_index', 4, 4)]
    assert array.layout.data_offset == 0
    # the first value is at the largest x and y, the second at the next smaller x
    assert list(array.data[:5]) == [11.0, 10.0, 9.0, 8.0, 7.0]


@pytest.mark.parametrize('start', [(0, 0), (1, 0), (0, 2), (3, 1)])
@pytest.mark.parametrize('row_major', [False, True])
@pytest.mark.parametrize('offset', [0, 5])
def test_terrain_does_not_depend_on_the_layout_of_the_buffer(start, row_major, offset):
    message = moved(*start, row_major=row_major, offset=offset)
    settings = Settings(epsg=32633, offset_easting=5e5, offset_northing=4e6)
    terrain = inputs.terrain_from_grid(message, settings)
    np.testing.assert_array_equal(terrain.elevation, TERRAIN.elevation)
    assert (terrain.origin, terrain.resolution) == (TERRAIN.origin, TERRAIN.resolution)
    assert (terrain.epsg, terrain.offset) == (32633, (5e5, 4e6))
    assert terrain.sea_level is None
    level = float(np.median(TERRAIN.elevation))
    terrain = inputs.terrain_from_grid(message, Settings(sea_level=level))
    np.testing.assert_array_equal(terrain.is_sea, TERRAIN.elevation <= level)


def spoilt(**changes):
    """Return a map with fields replaced; ``_`` in a name separates nested fields."""
    message = moved(1, 1)
    for path, value in changes.items():
        *parts, name = path.split('__')
        target = message
        for part in parts:
            target = target[int(part)] if part.isdigit() else getattr(target, part)
        setattr(target, name, value)
    return message


@pytest.mark.parametrize(
    ('changes', 'message_start'),
    [
        ({'header__frame_id': 'odom'}, "header.frame_id is 'odom'"),
        ({'layers': ['height']}, "layers is ['height'], expected a list with the layer"),
        ({'layers': ['elevation', 'more']}, "data is '1 arrays', expected 2 arrays"),
        ({'outer_start_index': 4}, 'outer_start_index is 4, expected 0 to 3'),
        ({'inner_start_index': 3}, 'inner_start_index is 3, expected 0 to 2'),
        ({'info__resolution': 0.0}, 'info.resolution is 0'),
        ({'info__resolution': float('nan')}, 'info.resolution is nan'),
        ({'info__length_x': 6.0}, 'info.length_x is 6.0, expected 8 m: 4 cells'),
        ({'info__length_y': float('nan')}, 'info.length_y is nan, expected 6 m'),
        ({'info__pose__position__x': float('inf')}, 'info.pose.position.x is inf'),
        ({'info__pose__position__z': 3.0}, 'info.pose.position.z is 3'),
        ({'info__pose__orientation__w': 0.5}, 'info.pose.orientation is'),
        ({'data__0__data': [1.0]}, "data[0].data is '1 values', expected data_off"),
        ({'data__0__layout__dim': []}, 'data[0].layout.dim is []'),
        ({'data__0__layout__dim__0__label': 'x'}, "data[0].layout.dim is ['x', 'ro"),
        ({'data__0__layout__dim__0__size': 0}, 'data[0].layout.dim is [0, 4]'),
        ({'data__0__data': [float('inf')] * 12}, 'data is inf'),
        ({'data__0__data': [1.0] * 11 + [float('nan')]}, "data is '1 of 12 cells"),
    ],
)
def test_rejects_an_inconsistent_grid_map(changes, message_start):
    with pytest.raises(LavaError) as caught:
        inputs.terrain_from_grid(spoilt(**changes), Settings())
    assert str(caught.value).startswith(f'terrain_grid.{message_start}')


def test_rejects_a_grid_map_with_too_many_cells():
    with pytest.raises(LavaError, match='max_terrain_cells'):
        inputs.terrain_from_grid(made(), Settings(max_terrain_cells=11))


def layer(**changes):
    data = {'source': 'lava', 'message': 'grid_map_msgs/GridMap', 'threshold': 0.01, **changes}
    return layers_from_dict({'layers': {'lava_grid_map': data}})[0]


def test_layer_has_elevation_and_unscaled_quantities():
    assert outputs.message_class(layer()) is GridMap
    message = outputs.layer_message(layer(), SNAPSHOT, codec.header('map', 3_000_000_004))
    assert message.layers == ['elevation', 'thickness', 'temperature', 'hazard']
    assert (message.header.frame_id, message.header.stamp.nanosec) == ('map', 4)
    for source in ('thickness', 'temperature', 'hazard'):
        alone = layer(source=source, message='sensor_msgs/Image')
        again = codec.layer_values(message, source, 'lava_grid_map')
        np.testing.assert_array_equal(again, alone.raw_values(SNAPSHOT))
    ground = codec.layer_values(message, 'elevation', 'lava_grid_map')
    np.testing.assert_array_equal(ground, SNAPSHOT.terrain.elevation.astype(np.float32))


def test_hazard_limits_apply_to_the_grid_map():
    milder = {'lethal_thickness': 1e3, 'safe_temperature': 1e3, 'lethal_temperature': 1e4}
    messages = [
        outputs.layer_message(item, SNAPSHOT, codec.header('map', 0))
        for item in (layer(), layer(hazard=milder))
    ]
    lethal = [(codec.layer_values(item, 'hazard', 'map') == 100.0).sum() for item in messages]
    # a cell with unknown temperature is unchanged
    assert lethal[0] > lethal[1] == 1


def test_layer_without_the_package_is_an_error(absent):
    with pytest.raises(LavaError) as caught:
        outputs.message_class(layer())
    sentence = str(caught.value)
    assert sentence.startswith(f"layers.lava_grid_map.message is '{GRID_MAP}', expected a message")
    assert 'grid-map-msgs' in sentence
    assert "layers_off: ['lava_grid_map']" in sentence
    assert '\n' not in sentence


def subscribed(**changes):
    entities, worker = Mock(), Mock()
    entities.other_publishers.return_value = []
    entities.node.get_clock().now().nanoseconds = 1
    worker.set_terrain.return_value = Future()
    InputSubscribers(entities, worker, settings=lambda: Settings(**changes), steady=Clock())
    made = [call.args[1:] for call in entities.create.call_args_list]
    topics = {words[1]: (words[0], *words[2:]) for words in made if len(words) == 4}
    return topics, worker.set_terrain, entities.node.get_logger().error


def test_no_subscription_to_grid_maps_without_the_package(absent):
    usual = {
        'terrain', 'terrain_info', 'terrain_cloud', 'terrain_georeference', 'vents',
        'clicked_point',
    }
    assert set(subscribed()[0]) == usual
    assert set(subscribed(clicked_point_enabled=False)[0]) == usual - {'clicked_point'}


def test_grid_map_becomes_the_terrain(monkeypatch):
    topics, set_terrain, error = subscribed()
    kind, take, profile = topics['terrain_grid']
    assert kind is GridMap
    assert profile == topics['terrain'][2]
    monkeypatch.setattr('lava_ros.ros.subscribers.decode', lambda *_, **__: moved(1, 2))
    take(b'', publication(1))
    (terrain,) = set_terrain.call_args.args
    np.testing.assert_array_equal(terrain.elevation, TERRAIN.elevation)
    refused = spoilt(layers=['height'])
    monkeypatch.setattr('lava_ros.ros.subscribers.decode', lambda *_, **__: refused)
    take(b'', publication(2))
    set_terrain.assert_called_once()
    (((message_start,), _),) = error.call_args_list
    assert message_start.startswith('terrain_grid refused: terrain_grid.layers is')


def wire(message, *, layers=None, arrays=None):
    """Serialise a grid map to CDR from its parts; counts may be wrong."""
    assert codec.serialise(Header())[1] == 1
    body = bytearray()

    def pad(size):
        body.extend(bytes(-len(body) % size))

    def put(*values):
        for value in values:
            pad(4)
            text = f'{value}\0'.encode() if isinstance(value, str) else b''
            body.extend(int(len(text) or value).to_bytes(4, 'little') + text)

    info = message.info
    body += serialize_message(message.header)[4:]
    pad(8)
    body += np.array([info.resolution, info.length_x, info.length_y], '<f8').tobytes()
    body += serialize_message(info.pose)[4:]
    put(len(message.layers) if layers is None else layers, *message.layers)
    put(len(message.basic_layers), *message.basic_layers)
    put(len(message.data) if arrays is None else arrays)
    for array in message.data:
        put(len(array.layout.dim))
        for item in array.layout.dim:
            put(item.label, item.size, item.stride)
        put(array.layout.data_offset, len(array.data))
        body += np.asarray(array.data, '<f4').tobytes()
    return b'\0\1\0\0' + bytes(body)


@pytest.mark.parametrize(
    ('counts', 'dimensions', 'sentence'),
    [
        ({}, 2, ''),
        ({'layers': 2**31}, 2, 'terrain_grid.layers is 2147483648, expected at most'),
        ({'arrays': MAX_GRID_LAYERS + 1}, 2, 'terrain_grid.data is 257, expected at most 256'),
        ({}, 3, 'terrain_grid.data.layout.dim is 3, expected at most 2'),
    ],
)
def test_rejects_excessive_counts_before_decoding(monkeypatch, counts, dimensions, sentence):
    message = made(thickness=TERRAIN.elevation)
    layout = message.data[1].layout
    layout.dim = [*layout.dim, MultiArrayDimension(label='more', size=1)][:dimensions]
    monkeypatch.setattr('lava_ros.ros.codec.deserialize_message', lambda *_: 'read')
    data = wire(message, **counts)
    if not sentence:
        assert decode(data, GridMap, 'terrain_grid', max_bytes=1000) == 'read'
        return
    with pytest.raises(LavaError) as caught:
        decode(data, GridMap, 'terrain_grid', max_bytes=1000)
    assert str(caught.value).startswith(sentence)
