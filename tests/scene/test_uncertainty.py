# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Distributions of uncertain input."""

from dataclasses import replace
import math

import numpy as np
import pytest
from scipy import stats
import yaml

from geodata import write_scene
from lava_ros.scene import scene_from_yaml, scene_to_dict
from lava_ros.scene.distributions import Displacement, Distribution, Roughness
from lava_ros.scene.uncertainty import (
    Uncertainty,
    uncertainty_from_dict,
    uncertainty_to_dict,
)
from lava_ros.simulation.output.checkpoint import from_bytes
from small_checkpoint import small_checkpoint

WHOLE = {
    'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5, 'limits': [0.3, 3]},
    'temperature': {'distribution': 'normal', 'mean': 0.0, 'deviation': 15.0},
    'viscosity': {'distribution': 'loguniform', 'low': 0.3, 'high': 3.0},
    'yield_strength': {
        'distribution': 'triangular', 'low': 0.5, 'mode': 1.0, 'high': 2.0, 'source': 'a paper',
        'follows': '-viscosity',
    },
    'position': {'radius': 40.0, 'source': 'a map'},
    'terrain': {'deviation': 1.5, 'correlation': 100.0},
    'constants': {'crust_temperature': {'distribution': 'uniform', 'low': 700, 'high': 750}},
    'eruption': [
        {
            'name': 'short', 'probability': 3.0,
            'duration': {'distribution': 'uniform', 'low': 3600, 'high': 86400},
            'volume': {'distribution': 'lognormal', 'median': 1e5, 'factor': 2.0},
        },
        {
            'name': 'long', 'probability': 1.0,
            'duration': {'distribution': 'uniform', 'low': 86400, 'high': 864000},
            'volume': {'distribution': 'loguniform', 'low': 1e6, 'high': 1e7},
        },
    ],
    'exact': ['density'],
    'material': 'basalt',
}


@pytest.mark.parametrize(('distribution', 'reference'), [
    (Distribution('normal', (2.0, 3.0)), stats.norm(2.0, 3.0)),
    (Distribution('lognormal', (2.0, 1.5)), stats.lognorm(math.log(1.5), scale=2.0)),
    (Distribution('uniform', (-1.0, 3.0)), stats.uniform(-1.0, 4.0)),
    (Distribution('loguniform', (0.5, 3.0)), stats.loguniform(0.5, 3.0)),
    (Distribution('triangular', (0.0, 1.0, 4.0)), stats.triang(0.25, 0.0, 4.0)),
    (Distribution('triangular', (0.0, 0.0, 4.0)), stats.triang(0.0, 0.0, 4.0)),
    (Distribution('normal', (0.0, 2.0), (-1.0, 4.0)), stats.truncnorm(-0.5, 2.0, 0.0, 2.0)),
])
def test_quantiles_are_those_of_scipy(distribution, reference):
    for probability in (1e-6, 0.01, 0.2, 0.5, 0.7, 0.99, 1.0 - 1e-6):
        expected = reference.ppf(probability)  # type: ignore[attr-defined]
        found = distribution.quantile(probability)
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_quantiles_are_within_limits_and_displacements_in_a_disc():
    cut = Distribution('lognormal', (1.0, 2.0), (0.5, 1.5))
    values = [cut.quantile(probability) for probability in (1e-300, 0.5, 1.0 - 1e-16)]
    assert 0.5 <= values[0] < values[1] < values[2] <= 1.5
    assert cut.support == (0.5, 1.5)
    probabilities = (np.arange(2000) + 0.5) / 2000
    disc = Displacement(radius=10.0)
    distances = np.array([math.hypot(*disc.quantile(first, 0.3)) for first in probabilities])
    assert (distances < 5.0).mean() == pytest.approx(0.25, abs=1e-3)
    normal = Displacement(deviation=10.0)
    deviation = np.std([normal.quantile(first, 0.5)[0] for first in probabilities])
    assert deviation == pytest.approx(10.0, rel=0.01)


def test_scene_file_has_every_uncertain_quantity(tmp_path):
    """Plain data and a checkpoint give the same uncertainty."""
    data = {'lava': {'yield_strength': 100.0}, 'uncertainty': WHOLE}
    scene = scene_from_yaml(write_scene(tmp_path, np.zeros((10, 10)), 10.0, data))
    assert scene.uncertainty == uncertainty_from_dict(WHOLE)
    assert scene.uncertainty.discharge == Distribution('lognormal', (1.0, 1.5), (0.3, 3.0))
    assert scene.uncertainty.position == Displacement(radius=40.0, source='a map')
    assert scene.uncertainty.terrain == Roughness(1.5, 100.0)
    plain = scene_to_dict(scene)['uncertainty']
    assert uncertainty_from_dict(plain) == scene.uncertainty
    assert yaml.safe_load(yaml.safe_dump(plain)) == plain
    assert uncertainty_to_dict(Uncertainty()) == {}
    stored = replace(small_checkpoint(1.0, 3), scene=scene).to_bytes()
    assert from_bytes(stored).scene.uncertainty == scene.uncertainty
