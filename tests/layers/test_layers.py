# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Layers: configuration files, values of a snapshot, and masks in Nav2."""

import copy
import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml

from lava_ros.bag import LATCHED
from lava_ros.bag.messages import header_fields
from lava_ros.errors import LavaError
from lava_ros.layers import layer as kinds
from lava_ros.layers.forecast import Forecast
from lava_ros.layers.layer import hazard, HazardLimits, within
from lava_ros.layers.layer_files import layers_from_dict, load_layers, switched
from lava_ros.layers.messages import SceneMessages
from lava_ros.scene import Lava, Scene, Terrain, Vent
from recording import snapshot_at

CONFIGS = Path(__file__).parents[2] / 'msg_configs'


def _snapshot(thickness, celsius):
    thickness = np.array(thickness, dtype=np.float32)
    elevation = np.where(np.isnan(thickness), np.nan, 100.0)
    temperature = np.array(celsius, dtype=np.float32) + np.float32(273.15)
    snapshot = snapshot_at(1.0, thickness, Terrain(elevation, 10.0))
    return dataclasses.replace(snapshot, temperature=temperature)


# dry, thinner than the threshold, just wet, thick, thicker than the range, outside
SNAPSHOT = _snapshot(
    [[0.0, 0.09, 0.1], [5.0, 50.0, np.nan]], [[np.nan, 900.0, 60.0], [600.0, 2000.0, np.nan]]
)


#: Parts of layers.
MASK, CLASSES = {'step': 1.0, 'range': None}, {'classes': [1.0], 'range': None}
HAZARD = {'source': 'hazard'}


def _layer(**changes):
    data = {'source': 'thickness', 'message': 'nav_msgs/OccupancyGrid', 'range': [0.0, 100.0]}
    data.update(changes)
    data = {key: value for key, value in data.items() if value is not None}
    return layers_from_dict({'layers': {'one': data}})[0]


LIMITS = {'lethal_thickness': 1.0, 'safe_temperature': 40.0, 'lethal_temperature': 80.0}


@pytest.mark.parametrize(('changes', 'expected'), [
    # 1..100 where wet, 0 where dry, -1 outside; a wet cell is never 0
    ({'range': [0.0, 100.0]}, [[0, 0, 1], [5, 50, -1]]),
    ({'range': [0.0, 10.0]}, [[0, 0, 1], [50, 100, -1]]),
    ({'range': [5.0, 6.0]}, [[0, 0, 1], [1, 100, -1]]),
    ({'threshold': 1.0, 'outside': 100}, [[0, 0, 0], [5, 50, 100]]),
    # a bound is in the next class; values are evenly spaced up to 100
    ({'range': None, 'classes': [0.5, 5.0, 20.0]}, [[0, 0, 25], [75, 100, -1]]),
    (
        {'range': None, 'source': 'temperature', 'classes': [600.0]},
        [[0, 0, 50], [100, 100, -1]],
    ),
    ({'source': 'temperature', 'range': [0.0, 1200.0]}, [[0, 0, 5], [50, 100, -1]]),
    ({**HAZARD, 'range': None, 'threshold': 0.0}, [[0, 100, 23], [100, 100, -1]]),
    (
        {**HAZARD, 'range': None, 'threshold': 0.0, 'hazard': LIMITS},
        [[0, 100, 55], [100, 100, -1]],
    ),
])
def test_grids_are_scaled_by_the_configuration(changes, expected):
    values = _layer(**changes).values(SNAPSHOT)
    assert values.dtype == np.int8
    assert values.tolist() == expected


@pytest.mark.parametrize(('changes', 'expected'), [
    ({'range': None}, [[50, 50, 100], [100, 0, -1]]),
    # a mask closes inundated ground, and a margin goes around it
    ({**MASK, 'threshold': 0.01}, [[100, 100, 100], [100, 0, -1]]),
    ({**MASK, 'margin': 5.0}, [[100, 100, 100], [100, 100, -1]]),
    ({'scale': [50, 10]}, [[30, 30, 10], [10, 0, -1]]),
    # 60 is above the value of drained ground
    ({**MASK, 'step': 60.0}, [[0, 0, 100], [100, 0, -1]]),
])
@pytest.mark.parametrize('kind', ['snapshot', 'forecast'])
def test_the_hazard_of_inundated_ground_is_never_0(kind, changes, expected):
    thickness = np.array([[0.0, 0.005, 3.0], [0.2, 0.0, np.nan]], np.float32)
    times = np.array([[1.0, 1.0, 1.0], [np.nan, np.nan, np.nan]], np.float32)
    shown = _snapshot(thickness, np.where(thickness > 0.0, 900.0, np.nan))
    source = 'hazard'
    if kind == 'snapshot':
        shown = dataclasses.replace(shown, arrived=times)
    else:
        source = 'peak_hazard'
        shown = Forecast(
            0.0, 10.0, 0.1, shown.terrain, times, times, thickness, shown.temperature, 1.0, 1
        )
    changes = {'range': [0.0, 100.0], 'threshold': 0.01, **changes}
    layer = _layer(source='hazard', **changes)
    if kind == 'forecast':
        layer = dataclasses.replace(layer, source=source)
    assert layer.values(shown).tolist() == expected
    height = _layer(threshold=0.1).values(shown)
    assert height.tolist() == [[0, 0, 3], [1, 0, -1]]


def test_holes_of_the_terrain_close_no_ground_around_them():
    thickness = np.array([[0.0, np.nan], [0.0, 0.0]], np.float32)
    arrived = np.where(np.isnan(thickness), 1.0, np.nan).astype(np.float32)
    shown = dataclasses.replace(_snapshot(thickness, thickness), arrived=arrived)
    layer = _layer(source='hazard', threshold=0.01, margin=20.0, **MASK)
    assert layer.values(shown).tolist() == [[0, -1], [0, 0]]


def test_images_are_unscaled():
    height = _layer(message='sensor_msgs/Image', range=None, threshold=0.0)
    np.testing.assert_array_equal(height.values(SNAPSHOT), SNAPSHOT.thickness)
    temperature = _layer(source='temperature', message='sensor_msgs/Image', range=None)
    np.testing.assert_allclose(
        temperature.values(SNAPSHOT), [[np.nan, np.nan, 60.0], [600.0, 2000.0, np.nan]], rtol=1e-6
    )
    assert temperature.values(SNAPSHOT).dtype == np.float32


def test_default_configuration_enables_grids_thickness_and_arrivals():
    layers = {layer.name: layer for layer in load_layers(CONFIGS / 'default.yaml')}
    enabled = [name for name, layer in layers.items() if layer.enabled]
    grids = ['height', 'temperature', 'hazard', 'depth_class']
    assert enabled == [*grids, 'height_raw', 'arrived', 'inundated']
    assert all(layers[name].message == kinds.OCCUPANCY_GRID for name in enabled[:4])
    assert layers['height_raw'].message == layers['temperature_raw'].message == kinds.IMAGE
    assert layers['lava_points'].message == kinds.POINT_CLOUD
    assert layers['lava_grid_map'].message == kinds.GRID_MAP
    # limits equal those of the hazard layer
    assert layers['lava_grid_map'].threshold == layers['hazard'].threshold
    assert layers['lava_grid_map'].hazard == layers['hazard'].hazard
    assert {layer.qos for layer in layers.values()} == {LATCHED}


def test_monitoring_and_edited_files_have_other_layers(tmp_path):
    for path in CONFIGS.glob('*.yaml'):
        assert load_layers(path)
    monitoring = {layer.name: layer for layer in load_layers(CONFIGS / 'monitoring.yaml')}
    assert monitoring['height_raw'].message == kinds.IMAGE
    assert monitoring['hazard'].outside == 100
    assert monitoring['hazard'].hazard.lethal_temperature == pytest.approx(373.15)
    data = yaml.safe_load((CONFIGS / 'default.yaml').read_text())
    data['layers']['height'].update(range=[0.0, 100.0], outside=0, topic='lava/depth', rate=5.0)
    (tmp_path / 'changed.yaml').write_text(yaml.safe_dump(data, sort_keys=False))
    before, *_ = load_layers(CONFIGS / 'default.yaml')
    after, *_ = load_layers(tmp_path / 'changed.yaml')
    assert before.values(SNAPSHOT).tolist() == [[0, 0, 1], [50, 100, -1]]
    assert after.values(SNAPSHOT).tolist() == [[0, 0, 1], [5, 50, 0]]
    assert (after.topic, after.rate) == ('lava/depth', 5.0)


def test_points_are_on_the_lava_surface():
    layer = _layer(source='lava', message='sensor_msgs/PointCloud2', range=None, threshold=0.09)
    points = layer.points(SNAPSHOT)
    assert list(points) == ['x', 'y', 'z', 'thickness', 'temperature']
    assert {column.dtype for column in points.values()} == {np.dtype(np.float32)}
    rows = np.stack(list(points.values()), axis=-1)
    np.testing.assert_allclose(
        rows,
        [
            [15.0, 5.0, 100.09, 0.09, 900.0],
            [25.0, 5.0, 100.1, 0.1, 60.0],
            [5.0, 15.0, 105.0, 5.0, 600.0],
            [15.0, 15.0, 150.0, 50.0, 2000.0],
        ],
        rtol=1e-6,
    )
    above = dataclasses.replace(layer, threshold=1.0).points(SNAPSHOT)
    assert above['thickness'].tolist() == [5.0, 50.0]
    none = dataclasses.replace(layer, threshold=1e3).points(SNAPSHOT)
    assert {len(column) for column in none.values()} == {0}
    # points use origin and resolution of the terrain
    ground = Terrain([[3.0, 4.0], [5.0, 6.0]], 2.5, origin=(-10.0, 20.0))
    snapshot = _snapshot([[0.0, 0.0], [0.0, 1.5]], np.full((2, 2), np.nan))
    snapshot = dataclasses.replace(snapshot, terrain=ground)
    layer = _layer(source='lava', message='sensor_msgs/PointCloud2', range=None)
    (point,) = np.stack(list(layer.points(snapshot).values()), axis=-1)
    assert point.tolist()[:4] == [-6.25, 23.75, 7.5, 1.5]
    assert np.isnan(point[4])


def test_maps_are_the_ground_and_every_quantity():
    layer = _layer(source='lava', message='grid_map_msgs/GridMap', range=None, hazard={})
    maps = layer.maps(SNAPSHOT)
    assert list(maps) == ['elevation', 'thickness', 'temperature', 'hazard']
    np.testing.assert_array_equal(maps.pop('elevation'), SNAPSHOT.terrain.elevation)
    for source, values in maps.items():
        image = _layer(source=source, message='sensor_msgs/Image', range=None)
        np.testing.assert_array_equal(values, image.raw_values(SNAPSHOT))
    with pytest.raises(LavaError, match='one of thickness, temperature, hazard'):
        layer.values(SNAPSHOT)


def test_layers_are_switched_by_name():
    layers = load_layers(CONFIGS / 'default.yaml')
    enabled = {layer.name for layer in layers if layer.enabled}
    off = ['temperature', 'temperature_raw']
    changed = switched(layers, on=['lava_points', 'height'], off=off)
    now = {layer.name for layer in changed if layer.enabled}
    assert now == enabled - {'temperature'} | {'lava_points'}
    assert [layer.name for layer in changed] == [layer.name for layer in layers]
    assert switched(layers, on=[], off=[]) == list(layers)


@pytest.mark.parametrize(('on', 'off', 'sentence'), [
    (['points'], [], "layers_on is 'points', expected one of height, temperature, hazard,"),
    ([], ['Height'], "layers_off is 'Height', expected one of height, temperature, hazard,"),
    (['height'], ['height'], 'height in layers_on and height in layers_off exclude each other'),
])
def test_rejects_an_unknown_or_contradictory_switch(on, off, sentence):
    with pytest.raises(LavaError) as caught:
        switched(load_layers(CONFIGS / 'default.yaml'), on=on, off=off)
    assert str(caught.value).startswith(sentence)
    if 'exclude' not in sentence:
        assert 'lava_points' in str(caught.value)


@pytest.mark.parametrize(('changes', 'field', 'words'), [
    ({'source': 'lava'}, 'source', 'one of thickness, temperature, hazard'),
    ({'message': 'sensor_msgs/PointCloud2'}, 'source', 'expected one of lava'),
    ({'source': 'lava', 'message': 'sensor_msgs/PointCloud2'}, 'range', 'does not apply'),
    (
        {'source': 'lava', 'message': 'sensor_msgs/PointCloud2', 'range': None, 'hazard': {}},
        'hazard',
        'does not apply unless',
    ),
    ({'message': 'std_msgs/String'}, 'message', 'nav_msgs/OccupancyGrid'),
    ({'message': None}, 'message', 'required'),
    ({'range': None}, 'range', '[low, high] m'),
    ({'range': [1.0, 1.0]}, 'range[1]', 'above 1'),
    ({'range': 3.0}, 'range', 'two numbers'),
    ({'enabled': 1}, 'enabled', 'true or false'),
    ({'topic': '/absolute'}, 'topic', 'relative'),
    ({'qos': {'reliability': 'best'}}, 'qos.reliability', 'reliable, best_effort'),
    ({'qos': {'history': 'keep_all'}}, 'qos.history', 'reliability, durability, depth'),
    ({'hazard': {}}, 'hazard', 'source is hazard'),
    ({'colour': 'red'}, 'colour', 'topic, source, message'),
    ({'message': 'sensor_msgs/Image'}, 'range', 'does not apply'),
    ({'step': 1.0}, 'range', 'does not apply if step is set'),
    ({'step': 1.0, 'range': None, 'scale': [0, 100]}, 'scale', 'does not apply if step is set'),
    ({'scale': [0, 0]}, 'scale', 'above 0'),
    (
        {'message': 'sensor_msgs/Image', 'range': None, 'min_cells': 9},
        'min_cells',
        'only a grid',
    ),
    ({'heartbeat': 0.05}, 'heartbeat', '0 s for none, or 0.1 to 3600 s'),
    ({**MASK, 'source': 'arrival', 'heartbeat': 5.0}, 'heartbeat', 'never repeated'),
    ({**MASK, 'message': 'sensor_msgs/Image'}, 'step', 'does not apply'),
    ({'message': 'sensor_msgs/Image', 'range': None, 'margin': 1.0}, 'margin', 'does not apply'),
    ({**CLASSES, 'classes': []}, 'classes', '1 to 19 numbers m'),
    ({**CLASSES, 'classes': [2.0, 1.0]}, 'classes[1]', 'above 2'),
    ({**CLASSES, 'margin': 5.0}, 'margin', 'does not apply if'),
    ({**CLASSES, 'step': 1.0}, 'classes', 'does not apply'),
    ({**CLASSES, 'message': 'sensor_msgs/Image'}, 'classes', 'only a grid'),
    ({**HAZARD, 'hazard': {'lethal_thickness': 0.0}}, 'hazard.lethal_thickness', 'above 0'),
    (
        {**HAZARD, 'hazard': {'safe_temperature': 300.0, 'lethal_temperature': 300.0}},
        'hazard.lethal_temperature',
        'above 300',
    ),
    ({**HAZARD, 'hazard': {'deadly': 1}}, 'hazard.deadly', 'lethal_thickness'),
])
def test_rejects_an_invalid_layer(changes, field, words):
    with pytest.raises(LavaError) as caught:
        _layer(**changes)
    assert caught.value.field == f'layers.one.{field}'
    assert words in str(caught.value)


def test_rejects_an_invalid_configuration(tmp_path):
    for data in (None, [], {'layers': {}}, {'layers': None}, {'layer': {}}, 'x'):
        with pytest.raises(LavaError):
            layers_from_dict(data)
    one = {'source': 'hazard', 'message': 'nav_msgs/OccupancyGrid', 'topic': 'same'}
    with pytest.raises(LavaError, match='layer a has this one'):
        layers_from_dict({'layers': {'a': one, 'b': copy.deepcopy(one)}})
    (tmp_path / 'broken.yaml').write_text('layers: [')
    for name in ('missing.yaml', 'broken.yaml'):
        with pytest.raises(LavaError, match=name):
            load_layers(tmp_path / name)


def test_hazard_combines_burial_and_heat():
    thickness, celsius, expected = np.array([
        (0.25, 20.0, 50.0),
        (0.5, 20.0, 100.0),
        (5.0, 20.0, 100.0),
        (0.25, 175.0, 75.0),
        (0.05, 175.0, 55.0),
        (0.01, 1100.0, 100.0),
        (1e-4, 20.0, 1.0),
        # lava of unknown temperature counts as hot
        (0.1, np.nan, 100.0),
        # no lava, and outside the terrain
        (0.0, np.nan, 0.0),
        (np.nan, np.nan, np.nan),
    ]).T
    values = hazard(thickness, celsius + 273.15)
    assert values.dtype == np.float32
    np.testing.assert_allclose(values, expected, atol=1e-3)
    one = hazard(np.array([0.5]), np.array([293.15]), HazardLimits(lethal_thickness=1.0))
    assert one == pytest.approx(50.0)
    limits = HazardLimits(safe_temperature=400.0, lethal_temperature=500.0)
    assert hazard(np.array([1e-3]), np.array([450.0]), limits) == pytest.approx(50.1, abs=0.01)


#: Cost of an obstacle in Nav2, and minimum cost of a collision.
LETHAL, INSCRIBED = 254, 253


def keepout_cost(value: int, cost: int) -> int:
    """Return the cost of a cell after Nav2's KeepoutFilter, by its documentation."""
    return cost if value == -1 else max(cost, round(2.54 * value))


def speed_limit(value: int, last: float, base: float = 0.0, multiplier: float = 1.0) -> float:
    """Return the limit after Nav2's SpeedFilter [percent], 0.0 for none, by its documentation."""
    if value == -1:
        return last
    limit = 0.0 if value == 0 else base + multiplier * value
    return limit if 0.0 <= limit <= 100.0 else 0.0


def _eastward():
    """Return a row of cells with lava at 40 to 49, thicker and hotter to the east."""
    thickness, celsius = np.zeros((3, 60)), np.full((3, 60), np.nan)
    thickness[1, 40:50] = [0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0, 5.0]
    celsius[1, 40:50] = [50.0, 60.0, 100.0, 150.0, 200.0, 300.0, 500.0, 800.0, 1000.0, np.nan]
    thickness[:, 58:] = np.nan
    return _snapshot(thickness, celsius)


EASTWARD = _eastward()
WET, OUTSIDE = EASTWARD.thickness > 0.0, np.isnan(EASTWARD.thickness)
ROWS, COLUMNS = np.indices(WET.shape)
#: Distance between the edges of a cell and of the nearest cell with lava [m]; 0 if they touch.
DISTANCE = 10.0 * np.min(
    [
        np.hypot(np.maximum(abs(ROWS - row) - 1, 0), np.maximum(abs(COLUMNS - column) - 1, 0))
        for row, column in np.argwhere(WET)
    ],
    axis=0,
)


def _mask(file: str, name: str) -> np.ndarray:
    (layer,) = [layer for layer in load_layers(CONFIGS / file) if layer.name == name]
    assert (layer.topic, layer.enabled) == (name, True)
    assert (layer.qos.reliability, layer.qos.durability) == ('reliable', 'transient_local')
    return layer.values(EASTWARD)


@pytest.mark.parametrize('file', ['nav2_keepout.yaml', 'nav2_speed.yaml'])
def test_keepout_mask_is_lethal_or_free(file):
    """Lava cells, their margin and the outside are lethal in Nav2; other cells are unchanged."""
    mask = _mask(file, 'keepout_mask')
    assert set(np.unique(mask)) == {0, 100}
    forbidden = (DISTANCE < 20.0) | OUTSIDE
    np.testing.assert_array_equal(mask == 100, forbidden)
    costs = np.vectorize(keepout_cost)(mask, 7)
    np.testing.assert_array_equal(costs == LETHAL, forbidden)
    assert (costs[~forbidden] == 7).all()
    # the reason for the mask: Nav2 treats a hazard below 100 as passable, and -1 as free
    (layer,) = [item for item in load_layers(CONFIGS / 'default.yaml') if item.name == 'hazard']
    values = layer.values(EASTWARD)
    costs = np.vectorize(keepout_cost)(values, 0)
    assert (costs[WET] < INSCRIBED).any()
    assert (costs[OUTSIDE] == 0).all()


def test_speed_mask_limits_speed_near_lava():
    """The limit is 50 % of full speed near lava and 10 to 50 % in it; far away there is none."""
    mask = _mask('nav2_speed.yaml', 'speed_mask')
    assert (mask >= 0).all()
    limits = np.vectorize(speed_limit)(mask, np.nan)
    near = (DISTANCE < 100.0) & ~WET & ~OUTSIDE
    far = (DISTANCE >= 100.0) & ~OUTSIDE
    assert far.any()
    assert (limits[near] == 50.0).all()
    assert (limits[far] == 0.0).all()
    assert (limits[OUTSIDE] == 10.0).all()
    assert ((limits[WET] >= 10.0) & (limits[WET] <= 50.0)).all()
    assert (np.diff(limits[1, 40:50]) <= 0.0).all()
    assert limits[1, 48] == 10.0
    # lava of unknown temperature has the lowest limit
    assert np.isnan(EASTWARD.temperature[1, 49])
    assert mask[1, 49] == 10
    assert _mask('nav2_keepout.yaml', 'keepout_mask')[1, 49] == 100


def test_mask_is_100_at_or_above_its_step():
    values = _layer(step=0.5, range=None).values(EASTWARD)
    assert values[1, 40:50].tolist() == [0, 0, 0, 0, 0, 100, 100, 100, 100, 100]
    values = _layer(source='temperature', range=None, step=300.0, threshold=0.0).values(EASTWARD)
    # the last temperature is unknown
    assert values[1, 40:50].tolist() == [0] * 5 + [100] * 5
    values = _layer(step=0.5, range=None, margin=10.0).values(EASTWARD)
    assert values[1, 40:52].tolist() == [0] * 4 + [100] * 7 + [0]


def test_scales_increase_or_decrease():
    up = _layer(range=[0.0, 5.0], scale=[20, 80], threshold=0.0).values(EASTWARD)
    assert up[1, 40] == 20 and up[1, 46] == 32 and up[1, 48] == 80
    down = _layer(range=[0.0, 5.0], scale=[100, 0], threshold=0.0).values(EASTWARD)
    assert down[1, 40] == 100 and down[1, 46] == 80 and down[1, 48] == 1
    assert (up[0] == down[0])[:58].all()
    heat = _layer(source='temperature', range=[0.0, 2000.0], scale=[0, 60]).values(EASTWARD)
    assert heat[1, 48:50].tolist() == [30, 60]


@pytest.mark.parametrize('distance', [0.0, 0.9, 1.0, 1.5, 2.0, 3.7, 40.0])
@pytest.mark.parametrize('fraction', [0.0, 0.01, 0.2, 1.0])
def test_within_agrees_with_all_pairs_of_cells(distance, fraction):
    """A cell is near if the distance of its edge from a marked cell is smaller."""
    marked = np.random.default_rng(1).random((17, 23)) < fraction
    rows, columns = np.indices(marked.shape)
    expected = marked.copy()
    for row, column in np.argwhere(marked):
        gaps = (np.maximum(abs(at - own) - 1, 0) for at, own in ((rows, row), (columns, column)))
        expected |= np.hypot(*gaps) < distance
    before = marked.copy()
    np.testing.assert_array_equal(within(marked, distance), expected)
    np.testing.assert_array_equal(marked, before)


def test_messages_of_a_scene_are_made_only_when_it_changes():
    ground, vent = Terrain(np.zeros((4, 5)), 10.0), Vent((25.0, 15.0), 2.0)
    scene, made = Scene(ground, (vent,), lava=Lava.paper()), SceneMessages()

    def topics(scene, **options):
        return set(made.update(scene, 0.0, header_fields('map', 1), **options))

    vents = {'vents', 'vents_markers'}
    everything = vents | {'terrain_georeference', 'terrain', 'terrain_info', 'relief'}
    assert topics(scene) == everything
    assert topics(scene) == set()
    moved = dataclasses.replace(scene, vents=(dataclasses.replace(vent, name='moved'),))
    assert topics(moved) == vents
    flooded = dataclasses.replace(ground, elevation=ground.elevation + 1.0)
    assert topics(moved, ground=flooded) == everything
    made.forget()
    assert topics(moved, ground=flooded) == everything
