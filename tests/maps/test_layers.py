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

"""Layers: files of msg_configs/, and the values they make of a snapshot."""

import copy
import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml

from lava_ros.bag import LATCHED
from lava_ros.errors import LavaError
from lava_ros.maps.layer_files import layers_from_dict, load_layers, switched
from lava_ros.maps.layers import GRID_MAP, hazard, HazardLimits, IMAGE, OCCUPANCY_GRID, POINT_CLOUD
from lava_ros.scene import Terrain
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


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        # 1..100 where wet, 0 where dry, -1 outside; a wet cell is never 0
        ({'range': [0.0, 100.0]}, [[0, 0, 1], [5, 50, -1]]),
        ({'range': [0.0, 10.0]}, [[0, 0, 1], [50, 100, -1]]),
        ({'range': [5.0, 6.0]}, [[0, 0, 1], [1, 100, -1]]),
        ({'threshold': 1.0, 'outside': 100}, [[0, 0, 0], [5, 50, 100]]),
        # from a bound on the next class, evenly up to 100
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
    ],
)
def test_grids(changes, expected):
    """Ranges, classes and limits of the file decide, in metres and Celsius."""
    values = _layer(**changes).values(SNAPSHOT)
    assert values.dtype == np.int8
    assert values.tolist() == expected


def test_raw_images():
    """Images carry metres and Celsius unscaled, NaN where there is nothing to say."""
    height = _layer(message='sensor_msgs/Image', range=None, threshold=0.0)
    np.testing.assert_array_equal(height.values(SNAPSHOT), SNAPSHOT.thickness)
    temperature = _layer(source='temperature', message='sensor_msgs/Image', range=None)
    np.testing.assert_allclose(
        temperature.values(SNAPSHOT), [[np.nan, np.nan, 60.0], [600.0, 2000.0, np.nan]], rtol=1e-6
    )
    assert temperature.values(SNAPSHOT).dtype == np.float32


def test_default_file():
    """The default file has the four grids, unrounded thickness and arrivals on, all latched."""
    layers = {layer.name: layer for layer in load_layers(CONFIGS / 'default.yaml')}
    enabled = [name for name, layer in layers.items() if layer.enabled]
    assert enabled == ['height', 'temperature', 'hazard', 'depth_class', 'height_raw', 'arrived']
    assert all(layers[name].message == OCCUPANCY_GRID for name in enabled[:4])
    assert layers['height_raw'].message == layers['temperature_raw'].message == IMAGE
    assert layers['lava_points'].message == POINT_CLOUD
    assert layers['lava_grid_map'].message == GRID_MAP
    # err on the safe side, with the same limits
    assert layers['lava_grid_map'].threshold == layers['hazard'].threshold
    assert layers['lava_grid_map'].hazard == layers['hazard'].hazard
    assert {layer.qos for layer in layers.values()} == {LATCHED}


def test_a_changed_file_changes_the_values(tmp_path):
    """Editing the YAML changes what is published, without touching code."""
    data = yaml.safe_load((CONFIGS / 'default.yaml').read_text())
    data['layers']['height'].update(range=[0.0, 100.0], outside=0, topic='lava/depth', rate=5.0)
    path = tmp_path / 'changed.yaml'
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    before, after = load_layers(CONFIGS / 'default.yaml')[0], load_layers(path)[0]
    assert before.values(SNAPSHOT).tolist() == [[0, 0, 1], [50, 100, -1]]
    assert after.values(SNAPSHOT).tolist() == [[0, 0, 1], [5, 50, 0]]
    assert (after.topic, after.rate) == ('lava/depth', 5.0)


def test_every_example_file_loads():
    """All files of msg_configs/ are valid, and the monitoring example differs as it says."""
    for path in CONFIGS.glob('*.yaml'):
        assert load_layers(path)
    monitoring = {layer.name: layer for layer in load_layers(CONFIGS / 'monitoring.yaml')}
    assert monitoring['height_raw'].message == IMAGE
    assert monitoring['hazard'].outside == 100
    assert monitoring['hazard'].hazard.lethal_temperature == pytest.approx(373.15)


def test_points_stand_on_the_wet_cells():
    """There is a point for each wet cell alone, at its centre, on the surface of the lava."""
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


def test_points_are_where_the_map_is():
    """Origin and resolution of the terrain are those of the points."""
    ground = Terrain([[3.0, 4.0], [5.0, 6.0]], 2.5, origin=(-10.0, 20.0))
    snapshot = _snapshot([[0.0, 0.0], [0.0, 1.5]], np.full((2, 2), np.nan))
    snapshot = dataclasses.replace(snapshot, terrain=ground)
    layer = _layer(source='lava', message='sensor_msgs/PointCloud2', range=None)
    (point,) = np.stack(list(layer.points(snapshot).values()), axis=-1)
    assert point.tolist()[:4] == [-6.25, 23.75, 7.5, 1.5]
    assert np.isnan(point[4])


def test_maps_are_the_ground_and_every_quantity():
    """Beside the elevation there is what an image of each source would show."""
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
    """Named layers go on or off; all others stay as the file has them."""
    layers = load_layers(CONFIGS / 'default.yaml')
    enabled = {layer.name for layer in layers if layer.enabled}
    off = ['temperature', 'temperature_raw']
    changed = switched(layers, on=['lava_points', 'height'], off=off)
    now = {layer.name for layer in changed if layer.enabled}
    assert now == enabled - {'temperature'} | {'lava_points'}
    assert [layer.name for layer in changed] == [layer.name for layer in layers]
    assert switched(layers, on=[], off=[]) == list(layers)


@pytest.mark.parametrize(
    ('on', 'off', 'sentence'),
    [
        (['points'], [], "layers_on is 'points', expected one of height, temperature, hazard,"),
        ([], ['Height'], "layers_off is 'Height', expected one of height, temperature, hazard,"),
        (['height'], ['height'], "layers_off is 'height', expected a layer that is not in"),
    ],
)
def test_a_wrong_switch_is_refused(on, off, sentence):
    """A name the file lacks is answered with those it has."""
    with pytest.raises(LavaError) as caught:
        switched(load_layers(CONFIGS / 'default.yaml'), on=on, off=off)
    assert str(caught.value).startswith(sentence)
    if 'not in' not in sentence:
        assert 'lava_points' in str(caught.value)


@pytest.mark.parametrize(
    ('changes', 'field', 'words'),
    [
        ({'source': 'lava'}, 'source', 'one of thickness, temperature, hazard'),
        ({'message': 'sensor_msgs/PointCloud2'}, 'source', 'expected one of lava'),
        ({'message': 'grid_map_msgs/GridMap'}, 'source', 'expected one of lava'),
        ({'source': 'lava', 'message': 'sensor_msgs/PointCloud2'}, 'range', 'absent'),
        (
            {'source': 'lava', 'message': 'sensor_msgs/PointCloud2', 'range': None, 'hazard': {}},
            'hazard',
            'absent unless',
        ),
        ({'source': 'depth'}, 'source', 'thickness, temperature, hazard'),
        ({'source': None}, 'source', 'required'),
        ({'message': 'std_msgs/String'}, 'message', 'nav_msgs/OccupancyGrid'),
        ({'message': None}, 'message', 'required'),
        ({'range': None}, 'range', '[low, high] m'),
        ({'range': [1.0, 1.0]}, 'range[1]', 'above 1'),
        ({'range': [0.0, float('nan')]}, 'range[1]', 'finite'),
        ({'range': 3.0}, 'range', 'two numbers'),
        ({'threshold': -0.1}, 'threshold', 'at least 0 m'),
        ({'outside': 101}, 'outside', '-1 to 100'),
        ({'outside': 'unknown'}, 'outside', '-1 to 100'),
        ({'enabled': 1}, 'enabled', 'true or false'),
        ({'record': 'sometimes'}, 'record', 'true or false'),
        ({'rate': 0.0}, 'rate', 'Hz'),
        ({'rate': 1000}, 'rate', 'at most 50'),
        ({'topic': '/absolute'}, 'topic', 'relative'),
        ({'topic': 'with space'}, 'topic', 'relative'),
        ({'qos': {'reliability': 'best'}}, 'qos.reliability', 'reliable, best_effort'),
        ({'qos': {'durability': 'latched'}}, 'qos.durability', 'transient_local, volatile'),
        ({'qos': {'depth': 0}}, 'qos.depth', '1 to 1000'),
        ({'qos': {'history': 'keep_all'}}, 'qos.history', 'reliability, durability, depth'),
        ({'hazard': {}}, 'hazard', 'source is hazard'),
        ({'colour': 'red'}, 'colour', 'topic, source, message'),
        ({'message': 'sensor_msgs/Image'}, 'range', 'absent'),
        ({'step': 1.0}, 'range', 'absent beside step'),
        ({'step': 1.0, 'range': None, 'scale': [0, 100]}, 'scale', 'absent beside step'),
        ({'step': 'any', 'range': None}, 'step', 'finite number m'),
        ({'scale': [0, 0]}, 'scale', 'above 0'),
        ({'scale': [0, 101]}, 'scale[1]', '0 to 100'),
        ({'scale': 50}, 'scale', 'two whole numbers'),
        ({'margin': -1.0}, 'margin', 'at least 0 m'),
        ({'margin': 1e6}, 'margin', 'at most 1000 m'),
        ({**MASK, 'message': 'sensor_msgs/Image'}, 'step', 'absent'),
        ({'message': 'sensor_msgs/Image', 'range': None, 'margin': 1.0}, 'margin', 'absent'),
        ({**CLASSES, 'classes': []}, 'classes', '1 to 19 numbers m'),
        ({**CLASSES, 'classes': 2.0}, 'classes', '1 to 19 numbers m'),
        ({**CLASSES, 'classes': [2.0, 1.0]}, 'classes[1]', 'above 2'),
        ({**CLASSES, 'margin': 5.0}, 'margin', 'absent beside'),
        ({**CLASSES, 'step': 1.0}, 'classes', 'absent'),
        ({**CLASSES, 'message': 'sensor_msgs/Image'}, 'classes', 'only a grid'),
        ({**HAZARD, 'hazard': {'lethal_thickness': 0.0}}, 'hazard.lethal_thickness', 'above 0'),
        (
            {**HAZARD, 'hazard': {'safe_temperature': 300.0, 'lethal_temperature': 300.0}},
            'hazard.lethal_temperature',
            'above 300',
        ),
        ({**HAZARD, 'hazard': {'safe_temperature': -300.0}}, 'hazard.safe_temperature', 'least'),
        ({**HAZARD, 'hazard': {'deadly': 1}}, 'hazard.deadly', 'lethal_thickness'),
    ],
)
def test_a_wrong_layer_is_refused(changes, field, words):
    """The error names the key and says what is allowed."""
    with pytest.raises(LavaError) as caught:
        _layer(**changes)
    assert caught.value.field == f'layers.one.{field}'
    assert words in str(caught.value)


@pytest.mark.parametrize('data', [None, [], {'layers': {}}, {'layers': None}, {'layer': {}}, 'x'])
def test_a_file_without_layers_is_refused(data):
    """What is not a mapping of layers is an error."""
    with pytest.raises(LavaError):
        layers_from_dict(data)


def test_two_layers_need_two_topics():
    """One topic cannot carry two layers."""
    one = {'source': 'hazard', 'message': 'nav_msgs/OccupancyGrid', 'topic': 'same'}
    with pytest.raises(LavaError, match='layer a has this one'):
        layers_from_dict({'layers': {'a': one, 'b': copy.deepcopy(one)}})


def test_an_unreadable_file_is_refused(tmp_path):
    """A missing file and broken YAML are errors that name the file."""
    with pytest.raises(LavaError, match=r'missing\.yaml'):
        load_layers(tmp_path / 'missing.yaml')
    broken = tmp_path / 'broken.yaml'
    broken.write_text('layers: [')
    with pytest.raises(LavaError, match=r'broken\.yaml'):
        load_layers(broken)


def _one(thickness, temperature, **limits):
    values = hazard(np.array([[thickness]]), np.array([[temperature]]), HazardLimits(**limits))
    return float(values[0, 0])


@pytest.mark.parametrize(
    ('thickness', 'celsius', 'expected'),
    [
        (0.25, 20.0, 50.0),
        (0.5, 20.0, 100.0),
        (5.0, 20.0, 100.0),
        (0.25, 175.0, 75.0),
        (0.05, 175.0, 55.0),
        (0.01, 1100.0, 100.0),
        (1e-4, 20.0, 1.0),
        # lava of unknown temperature counts as hot
        (0.1, np.nan, 100.0),
    ],
)
def test_combines_burial_and_heat(thickness, celsius, expected):
    """Burial and heat strike independently, and a wet cell is never below 1."""
    assert _one(thickness, celsius + 273.15) == pytest.approx(expected, abs=1e-3)


def test_dry_and_outside():
    """No lava is 0, outside the terrain is NaN."""
    values = hazard(np.array([[0.0, np.nan]]), np.array([[np.nan, np.nan]]))
    assert values.dtype == np.float32
    assert values[0, 0] == 0.0
    assert np.isnan(values[0, 1])


def test_is_monotone():
    """Thicker or hotter lava is never less dangerous."""
    thickness, temperature = np.meshgrid(
        np.linspace(0.0, 1.0, 101), np.linspace(280.0, 700.0, 101), indexing='ij'
    )
    values = hazard(thickness, temperature)
    assert (np.diff(values, axis=0) >= 0.0).all()
    assert (np.diff(values, axis=1) >= 0.0).all()
    assert values.min() == 0.0
    assert values.max() == 100.0


def test_limits_are_arguments():
    """Each limit moves the hazard."""
    assert _one(0.5, 293.15, lethal_thickness=1.0) == pytest.approx(50.0)
    assert _one(1e-3, 450.0, safe_temperature=400.0, lethal_temperature=500.0) == pytest.approx(
        50.1, abs=0.01
    )
