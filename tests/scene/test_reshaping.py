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

"""Barriers, the low-pass filter and finer cells: where they change the ground, and where not."""

from typing import Any

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.scene.reshaping import Barrier, finer, low_pass, with_barrier
from lava_ros.simulation.terrain import ringed_heights

GROUND = Terrain(
    np.add.outer(np.arange(40.0), np.zeros(50)), 10.0, epsg=32633, offset=(500_000.0, 4_180_000.0)
)


def _place(x: float, y: float) -> tuple[float, float]:
    return (500_000.0 + x, 4_180_000.0 + y)


def _added(terrain: Terrain) -> np.ndarray:
    return terrain.elevation - GROUND.elevation


def test_barrier_has_its_height_width_and_sides() -> None:
    """Full height on the crest, a fall of one beside it, nothing further away."""
    barrier = Barrier((_place(100, 205), _place(400, 205)), height=20.0, width=30.0)
    added = _added(with_barrier(GROUND, barrier))
    np.testing.assert_allclose(added[17:25, 25], [5, 15, 20, 20, 20, 15, 5, 0], atol=1e-4)
    assert added[20, 10:40].min() == pytest.approx(20.0)
    assert added[20, 3] == 0.0
    assert added[20, 47] == 0.0
    assert with_barrier(GROUND, barrier).epsg == 32633


def test_thin_barrier_has_no_gap() -> None:
    """A wall narrower than a cell stops what goes from cell to cell, also on its diagonal."""
    barrier = Barrier((_place(5, 5), _place(395, 385)), height=5.0, width=0.5, slope=100.0)
    raised = _added(with_barrier(GROUND, barrier)) > 4.0
    for row in range(1, 37):
        columns = np.flatnonzero(raised[row])
        following = np.flatnonzero(raised[row + 1])
        assert len(columns)
        # the parts of two rows overlap: no way leads through between them
        assert set(columns) & set(following)


def test_corners_and_turned_barriers() -> None:
    """Two parts of a line are not piled up; a barrier on turned ground is the turned barrier."""
    line = (_place(100, 100), _place(300, 100), _place(300, 300))
    added = _added(with_barrier(GROUND, Barrier(line, 8.0, 20.0)))
    assert added.max() == pytest.approx(8.0)
    flat = Terrain(np.zeros((40, 40)), 10.0)
    one = with_barrier(flat, Barrier(((55.0, 105.0), (255.0, 305.0)), 8.0, 20.0))
    other = with_barrier(flat, Barrier(((400.0 - 105.0, 55.0), (400.0 - 305.0, 255.0)), 8.0, 20.0))
    turned = np.rot90(one.elevation[::-1], 1)[::-1]
    np.testing.assert_allclose(other.elevation, turned, atol=1e-4)


def test_holes_stay_holes() -> None:
    """Cells without data get none from a barrier or a filter."""
    elevation = np.array(GROUND.elevation)
    elevation[20, 20:30] = np.nan
    holed = Terrain(elevation, 10.0)
    raised = with_barrier(holed, Barrier(((100.0, 205.0), (400.0, 205.0)), 8.0, 20.0))
    np.testing.assert_array_equal(raised.has_data, holed.has_data)
    smooth = low_pass(holed, 30.0)
    np.testing.assert_array_equal(smooth.has_data, holed.has_data)
    assert np.isfinite(smooth.elevation[19, 25])


@pytest.mark.parametrize(
    ('change', 'word'),
    [
        ({'line': ((0.0, 0.0),)}, 'two or more places'),
        ({'line': ((0.0, 0.0), (0.0, 0.0))}, 'that differ'),
        ({'line': '0,0 1,1'}, 'two or more places'),
        ({'line': ((0.0, 0.0), (1.0, np.nan))}, r'barrier.line\[1\]'),
        ({'height': -5.0}, 'barrier.height'),
        ({'width': 0.0}, 'barrier.width'),
        # one that does not touch the terrain is a mistake
        ({}, 'a line on the terrain.*easting 500000 to 500500'),
    ],
)
def test_wrong_barriers_are_refused(change: dict[str, Any], word: str) -> None:
    """Each by the name of what is wrong."""
    good: dict[str, Any] = {'line': ((0.0, 0.0), (100.0, 0.0)), 'height': 5.0, 'width': 5.0}
    with pytest.raises(LavaError, match=word):
        with_barrier(GROUND, Barrier(**{**good, **change}))


def test_filter_takes_short_waves_and_leaves_planes() -> None:
    """A wave of 8 widths keeps 73 % of its height, one of 2 widths less than 1 %."""
    x = (np.arange(400) + 0.5) * 10.0
    for length, share in ((800.0, 0.7346), (400.0, 0.2912), (200.0, 0.0072)):
        waves = Terrain(1000.0 + np.tile(np.sin(2.0 * np.pi * x / length), (200, 1)), 10.0)
        left = low_pass(waves, 100.0).elevation[100, 60:340] - 1000.0
        assert np.abs(left).max() == pytest.approx(share, abs=2e-3)
    smooth = low_pass(GROUND, 30.0)
    np.testing.assert_allclose(smooth.elevation[13:27], GROUND.elevation[13:27], atol=1e-3)
    assert low_pass(GROUND, 0.0) is GROUND
    for width in (-1.0, np.nan, 1e4):
        with pytest.raises(LavaError, match='low_pass'):
            low_pass(GROUND, width)


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
