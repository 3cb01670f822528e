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

"""Layers of forecasts and of ensembles: files of msg_configs/, and the values they make."""

from pathlib import Path

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.maps.forecast import EnsembleForecast, Forecast, HazardMaps
from lava_ros.maps.layer_files import layers_from_dict, load_layers
from lava_ros.maps.layers import ENSEMBLE_SOURCES, IMAGE, OCCUPANCY_GRID
from lava_ros.scene import Terrain

CONFIGS = Path(__file__).parents[2] / 'msg_configs'

NAN = np.nan

#: there already, in 25 s, in 99 s, at the horizon, never, outside
FORECAST = Forecast(
    time=500.0,
    horizon=100.0,
    threshold=0.01,
    terrain=Terrain(np.array([[1.0, 1.0, 1.0], [1.0, 1.0, NAN]]), 10.0),
    arrival=np.array([[0.0, 25.0, 99.0], [100.0, NAN, NAN]], dtype=np.float32),
    thickness=np.array([[5.0, 2.0, 0.05], [0.3, 0.0, NAN]], dtype=np.float32),
    temperature=np.array([[1400.0, 1300.0, 900.0], [800.0, NAN, NAN]], dtype=np.float32),
    duration=1.0,
    particle_count=3,
)


def _layer(**changes):
    data = {'source': 'arrival', 'message': 'nav_msgs/OccupancyGrid', **changes}
    return layers_from_dict({'layers': {'one': data}})[0]


def test_arrival_grid():
    """100 is now, 1 just within the horizon, 0 not within it, -1 unknown."""
    assert _layer().values(FORECAST).tolist() == [[100, 75, 1], [1, 0, -1]]
    assert _layer(outside=100).values(FORECAST).tolist() == [[100, 75, 1], [1, 0, 100]]


def test_arrival_grid_with_a_range_of_its_own():
    """Beyond it a cell that is reached is still no less than 1."""
    assert _layer(range=[0.0, 50.0]).values(FORECAST).tolist() == [[100, 50, 1], [1, 0, -1]]


def test_arrival_classes():
    """The sooner the worse: up to a bound is within it."""
    values = _layer(classes=[25.0, 50.0, 99.0]).values(FORECAST).tolist()
    assert values == [[100, 100, 50], [25, 0, -1]]


def test_arrival_mask():
    """With a step a cell is 100 where lava comes up to then; a margin goes around it."""
    assert _layer(step=99.0).values(FORECAST).tolist() == [[100, 100, 100], [0, 0, -1]]
    assert _layer(step=20.0).values(FORECAST).tolist() == [[100, 0, 0], [0, 0, -1]]
    values = _layer(step=20.0, margin=10.0).values(FORECAST).tolist()
    assert values == [[100, 100, 0], [100, 0, -1]]
    with pytest.raises(LavaError, match='margin'):
        _layer(margin=10.0)


def test_arrival_image():
    """Seconds, NaN for never, -1 for unknown: nobody takes what is not known for safe."""
    values = _layer(message='sensor_msgs/Image').values(FORECAST)
    assert values.dtype == np.float32
    np.testing.assert_array_equal(values, [[0.0, 25.0, 99.0], [100.0, NAN, -1.0]])


def test_withdrawn():
    """Nothing is known of any cell, on any layer."""
    gone = FORECAST.withdrawn()
    assert (_layer().values(gone) == -1).all()
    assert (_layer(message='sensor_msgs/Image').values(gone) == -1.0).all()
    peak = {'source': 'peak_thickness', 'range': [0.0, 10.0]}
    assert (_layer(**peak).values(gone) == -1).all()
    peak = _layer(source='peak_thickness', message='sensor_msgs/Image')
    assert np.isnan(peak.values(gone)).all()


def test_peaks():
    """They are scaled as what they are the peak of, with thresholds of their own."""
    height = _layer(source='peak_thickness', range=[0.0, 10.0])
    assert height.values(FORECAST).tolist() == [[50, 20, 0], [3, 0, -1]]
    temperature = _layer(source='peak_temperature', range=[0.0, 1200.0])
    assert temperature.values(FORECAST).tolist() == [[94, 86, 0], [44, 0, -1]]
    hazard = _layer(source='peak_hazard', threshold=0.0)
    assert hazard.values(FORECAST).tolist() == [[100, 100, 100], [100, 0, -1]]
    raw = _layer(source='peak_temperature', message='sensor_msgs/Image').values(FORECAST)
    np.testing.assert_allclose(raw[0, :2], [1126.85, 1026.85], rtol=1e-6)
    with pytest.raises(LavaError, match='range'):
        _layer(source='peak_thickness')


def test_the_file():
    """Five layers beside those of ensembles, of a forecast and latched; none of now among them."""
    layers = [item for item in load_layers(CONFIGS / 'forecast.yaml') if not item.is_ensemble]
    shown = {layer.topic: (layer.source, layer.message) for layer in layers}
    assert shown == {
        'arrival_time': ('arrival', IMAGE),
        'arrival': ('arrival', OCCUPANCY_GRID),
        'arrival_class': ('arrival', OCCUPANCY_GRID),
        'peak_height': ('peak_thickness', OCCUPANCY_GRID),
        'peak_temperature': ('peak_temperature', OCCUPANCY_GRID),
    }
    for layer in layers:
        assert layer.is_forecast and layer.enabled and layer.record
        assert layer.qos.durability == 'transient_local'
        assert layer.values(FORECAST).shape == (2, 3)
    assert not any(layer.is_forecast for layer in load_layers(CONFIGS / 'default.yaml'))


def _array(*rows):
    return np.array(rows, dtype=np.float32)


#: surely, likely, hardly; never, never, outside
ENSEMBLE = EnsembleForecast(
    time=500.0,
    horizon=100.0,
    threshold=0.01,
    terrain=FORECAST.terrain,
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


def _ensemble_layer(source, message='nav_msgs/OccupancyGrid', **changes):
    return _layer(source=source, message=message, **{'threshold': 0.01, **changes})


def test_probability_layers():
    """0 only where it comes in none, 100 only where in all, -1 where nothing is known."""
    layer = _ensemble_layer('inundation_probability')
    assert layer.values(ENSEMBLE).tolist() == [[100, 60, 1], [0, 0, -1]]
    assert set(layer.values(ENSEMBLE.withdrawn()).ravel()) == {-1}
    step = _ensemble_layer('inundation_probability', step=50.0, outside=100)
    assert step.values(ENSEMBLE).tolist() == [[100, 100, 0], [0, 0, 100]]
    classes = _ensemble_layer('inundation_probability', classes=[10.0, 60.0])
    assert classes.values(ENSEMBLE).tolist() == [[100, 100, 33], [0, 0, -1]]
    assert set(classes.values(ENSEMBLE.withdrawn()).ravel()) == {-1}
    wide = _ensemble_layer('inundation_probability', step=50.0, margin=10.0)
    assert wide.values(ENSEMBLE).tolist() == [[100, 100, 100], [100, 100, -1]]
    image = _ensemble_layer('inundation_probability', 'sensor_msgs/Image').values(ENSEMBLE)
    np.testing.assert_array_equal(image, ENSEMBLE.maps.probability)


@pytest.mark.parametrize(
    ('source', 'grid', 'image'),
    [
        ('arrival_p10', [[100, 75, 0], [0, 0, -1]], [[0, 25, NAN], [NAN, NAN, -1]]),
        ('arrival_p50', [[100, 50, 0], [0, 0, -1]], [[0, 50, NAN], [NAN, NAN, -1]]),
        ('arrival_p90', [[90, 0, 0], [0, 0, -1]], [[10, NAN, NAN], [NAN, NAN, -1]]),
    ],
)
def test_arrivals_of_ensembles(source, grid, image):
    """As the arrival of a forecast, by a share of the members; masks of it too."""
    assert _ensemble_layer(source).values(ENSEMBLE).tolist() == grid
    values = _ensemble_layer(source, 'sensor_msgs/Image').values(ENSEMBLE)
    np.testing.assert_array_equal(values, _array(*image))
    soon = _ensemble_layer(source, step=30.0).values(ENSEMBLE)
    # unknown is -1 in the one and in the other, and not soon
    np.testing.assert_array_equal(soon == 100, (values >= 0.0) & (values <= 30.0))
    gone = _ensemble_layer(source, 'sensor_msgs/Image').values(ENSEMBLE.withdrawn())
    assert set(gone.ravel()) == {-1.0}


def test_expected_thickness():
    """Metres, unknown outside."""
    image = _ensemble_layer('expected_thickness', 'sensor_msgs/Image', threshold=0.0)
    np.testing.assert_array_equal(image.values(ENSEMBLE), ENSEMBLE.maps.thickness)
    grid = _ensemble_layer('expected_thickness', range=[0.0, 10.0], threshold=0.1)
    assert grid.values(ENSEMBLE).tolist() == [[50, 20, 0], [0, 0, -1]]


def test_the_file_has_every_source_of_ensembles():
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
def test_wrong_layers_of_ensembles_are_refused(changes, field):
    """A probability has a scale of its own."""
    with pytest.raises(LavaError) as caught:
        _ensemble_layer('inundation_probability', **changes)
    assert caught.value.field == f'layers.one.{field}'
