# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Layers of forecasts and ensembles: files of msg_configs/, and their values."""

from pathlib import Path

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.layers.forecast import EnsembleForecast, Forecast, HazardMaps
from lava_ros.layers.layer import ENSEMBLE_SOURCES, IMAGE, OCCUPANCY_GRID
from lava_ros.layers.layer_files import layers_from_dict, load_layers
from lava_ros.scene import Terrain

CONFIGS = Path(__file__).parents[2] / 'msg_configs'
NAN = np.nan


def _array(*rows):
    return np.array(rows, dtype=np.float32)


#: Cells: inundated now, in 25 s, in 99 s, at the horizon, never, no data.
FORECAST = Forecast(
    time=500.0, horizon=100.0, threshold=0.01,
    terrain=Terrain(np.array([[1.0, 1.0, 1.0], [1.0, 1.0, NAN]]), 10.0),
    arrival=_array([0.0, 25.0, 99.0], [100.0, NAN, NAN]),
    inundated=_array([1.0, 1.0, 0.02], [1.0, 0.0, NAN]),
    thickness=_array([5.0, 2.0, 0.05], [0.3, 0.0, NAN]),
    temperature=_array([1400.0, 1300.0, 900.0], [800.0, NAN, NAN]), duration=1.0, particle_count=3,
)

#: Cells: certain, likely, unlikely, never, never, no data.
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
        inundated=dict.fromkeys((0.1, 0.5, 0.9), _array([1.0, 1.0, 0.0], [0.0, 0.0, NAN])),
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


def _layer(source, message=OCCUPANCY_GRID, **changes):
    data = {'source': source, 'message': message, **changes}
    return layers_from_dict({'layers': {'one': data}})[0]


def _shown(source, message=OCCUPANCY_GRID, *, withdrawn=False, **changes):
    layer = _layer(source, message, **changes)
    ahead = ENSEMBLE if source in ENSEMBLE_SOURCES else FORECAST
    return layer.values(ahead.withdrawn() if withdrawn else ahead)


@pytest.mark.parametrize(('source', 'changes', 'grid'), [
    # 100 is now, 1 just within the horizon, 0 not within it, -1 no data
    ('arrival', {}, [[100, 75, 1], [1, 0, -1]]),
    ('arrival', {'outside': 100}, [[100, 75, 1], [1, 0, 100]]),
    # a cell that lava reaches after the end of the range is 1
    ('arrival', {'range': [0.0, 50.0]}, [[100, 50, 1], [1, 0, -1]]),
    # an earlier class is worse, and contains its bound
    ('arrival', {'classes': [25.0, 50.0, 99.0]}, [[100, 100, 50], [25, 0, -1]]),
    # with a step a cell is 100 if lava arrives by then; a margin surrounds it
    ('arrival', {'step': 99.0}, [[100, 100, 100], [0, 0, -1]]),
    ('arrival', {'step': 20.0}, [[100, 0, 0], [0, 0, -1]]),
    ('arrival', {'step': 20.0, 'margin': 10.0}, [[100, 100, 0], [100, 100, -1]]),
    # peaks have the scale of their quantity
    ('peak_thickness', {'range': [0.0, 10.0]}, [[50, 20, 0], [3, 0, -1]]),
    ('peak_temperature', {'range': [0.0, 1200.0]}, [[94, 86, 0], [44, 0, -1]]),
    ('peak_hazard', {'threshold': 0.0}, [[100, 100, 100], [100, 0, -1]]),
    # 0 only if lava arrives in no member, 100 only if in all, -1 no data
    ('inundation_probability', {}, [[100, 60, 1], [0, 0, -1]]),
    ('inundation_probability', {'step': 50.0, 'outside': 100}, [[100, 100, 0], [0, 0, 100]]),
    ('inundation_probability', {'classes': [10.0, 60.0]}, [[100, 100, 33], [0, 0, -1]]),
    ('inundation_probability', {'step': 50.0, 'margin': 10.0}, [[100] * 3, [100, 100, -1]]),
    # like the arrival of a forecast, for a fraction of the members
    ('arrival_p10', {}, [[100, 75, 0], [0, 0, -1]]),
    ('arrival_p50', {}, [[100, 50, 0], [0, 0, -1]]),
    ('arrival_p90', {}, [[90, 0, 0], [0, 0, -1]]),
    ('arrival_p10', {'step': 30.0}, [[100, 100, 0], [0, 0, -1]]),
    ('arrival_p50', {'step': 30.0}, [[100, 0, 0], [0, 0, -1]]),
    ('arrival_p90', {'step': 30.0}, [[100, 0, 0], [0, 0, -1]]),
    ('expected_peak_thickness', {'range': [0.0, 10.0], 'threshold': 0.1},
     [[50, 20, 0], [0, 0, -1]]),
])
def test_grids_are_scaled_and_unknown_when_withdrawn(source, changes, grid):
    if source in ENSEMBLE_SOURCES:
        changes = {'threshold': 0.01, **changes}
    assert _shown(source, **changes).tolist() == grid
    unknown = {100} if 'outside' in changes else {-1}
    assert set(_shown(source, withdrawn=True, **changes).ravel()) == unknown


@pytest.mark.parametrize(('source', 'image', 'gone'), [
    # seconds, NaN for never, -1 for unknown, which is not safe
    ('arrival', _array([0.0, 25.0, 99.0], [100.0, NAN, -1.0]), -1.0),
    ('arrival_p10', _array([0, 25, NAN], [NAN, NAN, -1]), -1.0),
    ('arrival_p50', _array([0, 50, NAN], [NAN, NAN, -1]), -1.0),
    ('arrival_p90', _array([10, NAN, NAN], [NAN, NAN, -1]), -1.0),
    ('peak_thickness', FORECAST.thickness, NAN),
    ('peak_temperature', FORECAST.temperature - np.float32(273.15), NAN),
    ('inundation_probability', ENSEMBLE.maps.probability, NAN),
    ('expected_peak_thickness', ENSEMBLE.maps.thickness, NAN),
])
def test_images_are_unscaled_and_empty_when_withdrawn(source, image, gone):
    values = _shown(source, IMAGE, threshold=0.0)
    assert values.dtype == np.float32
    np.testing.assert_allclose(values, image, rtol=1e-6)
    gone_values = _shown(source, IMAGE, threshold=0.0, withdrawn=True)
    np.testing.assert_array_equal(gone_values, np.full((2, 3), gone))


def test_layers_of_the_file_are_latched_and_recorded():
    layers = load_layers(CONFIGS / 'forecast.yaml')
    shown = {layer.topic: (layer.source, layer.message) for layer in layers
             if not layer.is_ensemble}
    assert shown == {
        'arrival_time': ('arrival', IMAGE),
        'arrival': ('arrival', OCCUPANCY_GRID),
        'arrival_class': ('arrival', OCCUPANCY_GRID),
        'peak_height': ('peak_thickness', OCCUPANCY_GRID),
        'peak_temperature': ('peak_temperature', OCCUPANCY_GRID),
    }
    assert {layer.source for layer in layers if layer.is_ensemble} == set(ENSEMBLE_SOURCES)
    for layer in layers:
        assert layer.is_forecast and layer.enabled and layer.record
        assert layer.qos.durability == 'transient_local'
        assert layer.values(ENSEMBLE if layer.is_ensemble else FORECAST).shape == (2, 3)
    live = load_layers(CONFIGS / 'default.yaml')
    assert not any(layer.is_forecast or layer.is_ensemble for layer in live)


@pytest.mark.parametrize(('source', 'changes', 'field'), [
    ('arrival', {'margin': 10.0}, 'margin'),
    ('peak_thickness', {}, 'range'),
    # a probability has a fixed scale
    ('inundation_probability', {'range': [0, 50]}, 'range'),
    ('inundation_probability', {'scale': [0, 50]}, 'scale'),
    ('inundation_probability', {'margin': 5.0}, 'margin'),
    ('inundation_probability', {'message': IMAGE, 'step': 5.0}, 'step'),
])
def test_names_the_option_that_does_not_suit_the_source(source, changes, field):
    with pytest.raises(LavaError) as caught:
        _layer(source, **{'threshold': 0.01, **changes})
    assert caught.value.field == f'layers.one.{field}'
