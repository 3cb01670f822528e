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

"""Terrains on finer cells."""

import numpy as np
import pytest

from lava_ros.scene import Terrain
from lava_ros.scene.finer import finer
from lava_ros.simulation.terrain import ringed_heights


def test_it_is_the_surface_that_lava_flows_on() -> None:
    """The quadratic B-spline of the heights, at the middle of the finer cells."""
    heights = np.random.default_rng(3).uniform(0.0, 30.0, (7, 9)).astype(np.float32)
    terrain = Terrain(heights, 30.0, origin=(5.0, -7.0))
    fine = finer(terrain, 3)
    assert fine.resolution == 10.0 and fine.shape == (21, 27) and fine.extent == terrain.extent
    ring = ringed_heights(terrain) + heights.astype(np.float64).mean()
    near, middle, far = 25 / 72, 46 / 72, 1 / 72
    weights = {-1: (near, middle, far), 0: (1 / 8, 3 / 4, 1 / 8), 1: (far, middle, near)}
    for row, column in ((0, 0), (3, 5), (6, 8)):
        patch = ring[row : row + 3, column : column + 3]
        for m, low in weights.items():
            for n, left in weights.items():
                expected = np.array(low) @ patch @ np.array(left)
                found = fine.elevation[3 * row + 1 + m, 3 * column + 1 + n]
                assert found == pytest.approx(expected, abs=1e-4)


def test_cells_without_data_stay_without() -> None:
    """A plane stays one beside a hole and at the border."""
    x, y = np.meshgrid(np.arange(8.0), np.arange(6.0))
    heights = 3.0 * x - 2.0 * y
    heights[2:4, 3] = np.nan
    terrain = Terrain(heights, 1.0)
    fine = finer(terrain, 4)
    x, y = np.meshgrid((np.arange(32) + 0.5) / 4 - 0.5, (np.arange(24) + 0.5) / 4 - 0.5)
    known = np.kron(terrain.has_data, np.ones((4, 4), dtype=bool))
    np.testing.assert_array_equal(fine.has_data, known)
    np.testing.assert_allclose(fine.elevation[known], (3.0 * x - 2.0 * y)[known], atol=1e-5)
    assert finer(terrain, 1) is terrain
