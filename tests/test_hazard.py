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

"""Hazard from thickness and temperature."""

import numpy as np
import pytest

from lava_ros.hazard import hazard


def _one(thickness, temperature, **limits):
    return float(hazard(np.array([[thickness]]), np.array([[temperature]]), **limits)[0, 0])


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


def test_unknown_temperature_is_lethal():
    """Lava of unknown temperature counts as hot."""
    assert _one(0.1, np.nan) == 100.0


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
