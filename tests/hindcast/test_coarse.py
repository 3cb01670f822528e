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


"""Coarser ground, and maps back on the finer one."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.hindcast.coarse import coarsened, refined
from lava_ros.scene import Terrain
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.snapshot import Snapshot, StepReport


def test_larger_cells_are_means_of_what_is_known() -> None:
    """They reach over all borders alike, share cells by area, and leave out those without data."""
    elevation = np.arange(35.0).reshape(5, 7)
    elevation[0, 0] = np.nan
    elevation[4, 5:] = np.nan
    elevation[3, 5:] = np.nan
    ground = Terrain(elevation, 10.0, origin=(3.0, 4.0), epsg=32633, offset=(5e5, 4e6))
    coarse = coarsened(ground, 2)
    assert coarse.shape == (3, 4)
    assert (coarse.resolution, coarse.origin, coarse.offset) == (20.0, (-2.0, -1.0), (5e5, 4e6))
    # cells 1 and 7 by halves, 8 by a quarter
    assert coarse.elevation[0, 0] == pytest.approx((0.5 * 1 + 0.5 * 7 + 0.25 * 8) / 1.25)
    weights = np.outer([0.5, 1.0, 0.5], [0.5, 1.0, 0.5])
    mean = np.average(elevation[1:4, 1:4], weights=weights)
    assert coarse.elevation[1, 1] == pytest.approx(mean)
    assert np.isnan(coarse.elevation[2, 3])
    assert coarsened(ground, 1) is ground


def test_larger_cells_turn_with_the_ground() -> None:
    """A terrain that is turned by a quarter, or mirrored, has the same larger cells."""
    elevation = np.random.default_rng(3).normal(size=(19, 14))
    elevation[3, 4] = np.nan
    ground = Terrain(elevation, 10.0)
    for factor in (2, 3, 4):
        coarse = coarsened(ground, factor).elevation
        for change in (np.rot90, np.flipud, np.fliplr):
            other = coarsened(replace(ground, elevation=change(elevation)), factor)
            np.testing.assert_allclose(other.elevation, change(coarse), rtol=0.0, atol=1e-14)


def test_maps_come_back_on_the_finer_cells() -> None:
    """Each cell has the value of its block, the volume stays, holes stay holes."""
    elevation = np.zeros((6, 4))
    elevation[5, 3] = np.nan
    ground = Terrain(elevation, 10.0)
    coarse = coarsened(ground, 2)
    thickness = np.arange(6.0, dtype=np.float32).reshape(3, 2)
    snapshot = Snapshot(
        1.0, coarse, thickness, np.full((3, 2), np.nan, np.float32),
        VolumeBudget(1.0, 1.0, 0.0, 0.0), 1, StepReport(1, 1, 1, 1.0, 'longest'), thickness,
    )
    fine = refined(snapshot, ground, 2)
    assert fine.terrain is ground
    assert fine.frozen is not None
    for values in (fine.thickness, fine.frozen):
        np.testing.assert_array_equal(values[:2, :2], 0.0)
        np.testing.assert_array_equal(values[4, :], [4, 4, 5, 5])
        assert np.isnan(values[5, 3])
    assert np.nansum(fine.thickness) * 100.0 == thickness.sum() * 400.0 - 500.0
    assert refined(snapshot, coarse, 1) is snapshot
