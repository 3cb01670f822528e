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

"""Layers of ensembles: files of msg_configs/, and the values they make."""

from pathlib import Path

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.maps.forecast import HazardMaps, Outlook
from lava_ros.maps.layer_files import layers_from_dict, load_layers
from lava_ros.maps.layers import ENSEMBLE_SOURCES
from lava_ros.scene import Terrain

CONFIGS = Path(__file__).parents[2] / 'msg_configs'

NAN = np.nan


def _array(*rows):
    return np.array(rows, dtype=np.float32)


#: surely, likely, hardly; never, never, outside
OUTLOOK = Outlook(
    time=500.0,
    horizon=100.0,
    threshold=0.01,
    terrain=Terrain(np.array([[1.0, 1.0, 1.0], [1.0, 1.0, NAN]]), 10.0),
    maps=HazardMaps(
        probability=_array([100.0, 60.0, 0.2], [0.0, 0.0, NAN]),
        arrival={
            0.1: _array([0.0, 25.0, NAN], [NAN, NAN, NAN]),
            0.5: _array([0.0, 50.0, NAN], [NAN, NAN, NAN]),
            0.9: _array([10.0, NAN, NAN], [NAN, NAN, NAN]),
        },
        thickness=_array([5.0, 2.0, 0.01], [0.0, 0.0, NAN]),
        members=500,
        effective_members=500.0,
        arrival_error=5.0,
    ),
    asked=500,
    is_done=True,
    outlines=0,
    duration=1.0,
)


def _layer(source, message='nav_msgs/OccupancyGrid', **changes):
    data = {'source': source, 'message': message, 'threshold': 0.01, **changes}
    return layers_from_dict({'layers': {'one': data}})[0]


def test_probability():
    """0 only where it comes in none, 100 only where in all, -1 where nothing is known."""
    layer = _layer('inundation_probability')
    assert layer.values(OUTLOOK).tolist() == [[100, 60, 1], [0, 0, -1]]
    assert set(layer.values(OUTLOOK.withdrawn()).ravel()) == {-1}
    step = _layer('inundation_probability', step=50.0, outside=100)
    assert step.values(OUTLOOK).tolist() == [[100, 100, 0], [0, 0, 100]]
    classes = _layer('inundation_probability', classes=[10.0, 60.0])
    assert classes.values(OUTLOOK).tolist() == [[100, 100, 33], [0, 0, -1]]
    assert set(classes.values(OUTLOOK.withdrawn()).ravel()) == {-1}
    wide = _layer('inundation_probability', step=50.0, margin=10.0)
    assert wide.values(OUTLOOK).tolist() == [[100, 100, 100], [100, 100, -1]]
    image = _layer('inundation_probability', 'sensor_msgs/Image').values(OUTLOOK)
    np.testing.assert_array_equal(image, OUTLOOK.maps.probability)


@pytest.mark.parametrize(
    ('source', 'grid', 'image'),
    [
        ('arrival_p10', [[100, 75, 0], [0, 0, -1]], [[0, 25, NAN], [NAN, NAN, -1]]),
        ('arrival_p50', [[100, 50, 0], [0, 0, -1]], [[0, 50, NAN], [NAN, NAN, -1]]),
        ('arrival_p90', [[90, 0, 0], [0, 0, -1]], [[10, NAN, NAN], [NAN, NAN, -1]]),
    ],
)
def test_arrivals(source, grid, image):
    """As the arrival of a forecast, by a share of the members; masks of it too."""
    assert _layer(source).values(OUTLOOK).tolist() == grid
    values = _layer(source, 'sensor_msgs/Image').values(OUTLOOK)
    np.testing.assert_array_equal(values, _array(*image))
    soon = _layer(source, step=30.0).values(OUTLOOK)
    # unknown is -1 in the one and in the other, and not soon
    np.testing.assert_array_equal(soon == 100, (values >= 0.0) & (values <= 30.0))
    assert set(_layer(source, 'sensor_msgs/Image').values(OUTLOOK.withdrawn()).ravel()) == {-1.0}


def test_expected_thickness():
    """Metres, unknown outside."""
    values = _layer('expected_thickness', 'sensor_msgs/Image', threshold=0.0).values(OUTLOOK)
    np.testing.assert_array_equal(values, OUTLOOK.maps.thickness)
    grid = _layer('expected_thickness', range=[0.0, 10.0], threshold=0.1)
    assert grid.values(OUTLOOK).tolist() == [[50, 20, 0], [0, 0, -1]]


def test_the_file_has_every_source():
    """Each is there, recorded, and of an ensemble; the others are not."""
    layers = load_layers(CONFIGS / 'forecast.yaml')
    found = [layer for layer in layers if layer.is_ensemble]
    assert {layer.source for layer in found} == set(ENSEMBLE_SOURCES)
    assert all(layer.is_forecast and layer.enabled and layer.record for layer in found)
    assert not any(item.is_ensemble for item in load_layers(CONFIGS / 'default.yaml'))


@pytest.mark.parametrize(
    ('changes', 'field'),
    [
        ({'range': [0, 50]}, 'range'),
        ({'scale': [0, 50]}, 'scale'),
        ({'margin': 5.0}, 'margin'),
        ({'message': 'sensor_msgs/Image', 'step': 5.0}, 'step'),
    ],
)
def test_wrong_layers_are_refused(changes, field):
    """A probability has a scale of its own."""
    with pytest.raises(LavaError) as caught:
        _layer('inundation_probability', **changes)
    assert caught.value.field == f'layers.one.{field}'
