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

"""Fronts on a grid of thickness."""

import math

import numpy as np
import pytest

from lava_ros.verification.field import Field, front, slope_of


def cone(radius=10.0, cell=0.5, half=15.0):
    """A field whose thickness falls from 1 at (0, 0) to 0 at a radius."""
    count = int(2 * half / cell)
    ticks = -half + (np.arange(count) + 0.5) * cell
    x, y = np.meshgrid(ticks, ticks)
    thickness = np.clip(1.0 - np.hypot(x, y) / radius, 0.0, None)
    return Field(thickness, cell, (-half, -half))


def test_front_is_interpolated_between_cells():
    """The last crossing of the threshold, linear between its two places."""
    place = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    assert front(place, np.array([1.0, 0.1, 1.0, 0.5, 0.0]), 0.2) == pytest.approx(3.6)


def test_no_front_is_not_a_number():
    """Nothing above the threshold, or lava up to the last place: no front, no number."""
    place = np.arange(3.0)
    assert math.isnan(front(place, np.zeros(3), 0.1))
    assert math.isnan(front(place, np.ones(3), 0.1))


def test_mean_radius_of_a_cone():
    """The contour of a cone is a circle, found to a small part of a cell."""
    assert cone().mean_radius(0.2, 14.0) == pytest.approx(8.0, abs=0.03)


def test_sampling_is_exact_for_a_plane():
    """Bilinear interpolation gives a plane back at any place."""
    field = Field(np.add.outer(2.0 * np.arange(6), np.arange(8)).astype(float), 1.0, (0.0, 0.0))
    x, y = np.array([1.3, 6.9]), np.array([2.7, 0.6])
    assert field.at(x, y) == pytest.approx(x - 0.5 + 2.0 * (y - 0.5))


def test_mean_along_x_takes_the_middle_rows():
    """Rows outside the band do not count."""
    thickness = np.zeros((10, 4))
    thickness[4:6] = 3.0
    field = Field(thickness, 1.0, (0.0, -5.0))
    assert field.along_x(1.0) == pytest.approx([3.0] * 4)


def test_slope_of_a_line():
    """Least squares returns a line's slope, and not a number from what is none."""
    x = np.array([1.0, 2.0, 4.0])
    assert slope_of(x, 3.0 * x - 1.0) == pytest.approx(3.0)
    assert math.isnan(slope_of(x, np.array([1.0, math.nan, 2.0])))
