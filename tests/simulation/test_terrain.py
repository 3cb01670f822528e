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

"""The staggered terrain grid."""

import numpy as np
import pytest
import warp as wp

from lava_ros.scene import Terrain
from lava_ros.simulation.terrain import (
    corner_gradients,
    StaggeredTerrain,
    terrain_functions,
    TerrainFrame,
)


def sampled(terrain, points, device='cpu'):
    """Gradients at points given relative to the terrain's centre."""
    staggered = StaggeredTerrain(terrain, 'float64', device)
    functions = terrain_functions(wp.float64)

    @wp.kernel(module='unique')
    def sample(
        gradient: wp.array2d(dtype=wp.vec2d),
        frame: TerrainFrame,
        at: wp.array(dtype=wp.vec2d),
        out: wp.array(dtype=wp.vec2d),
    ):
        i = wp.tid()
        out[i] = functions.gradient_at(gradient, frame, at[i][0], at[i][1])

    at = wp.array(points, dtype=wp.vec2d, device=device)
    out = wp.zeros_like(at)
    wp.launch(
        sample, dim=len(points), inputs=[staggered.gradient, staggered.frame, at, out],
        device=device,
    )  # fmt: skip
    return out.numpy()


def plane(rows=6, columns=9, resolution=4.0):
    """Z = 0.3 x - 0.2 y on cells of 4 m."""
    x = (np.arange(columns) + 0.5) * resolution
    y = (np.arange(rows) + 0.5) * resolution
    return Terrain(0.3 * x[None, :] - 0.2 * y[:, None], resolution)


def test_gradient_of_a_plane_is_exact_everywhere():
    """Up to the border and beyond, the gradient of a plane is its slope (divisor dx, not 2 dx)."""
    gradient = corner_gradients(plane())
    assert gradient.shape == (7, 10, 2)
    assert gradient == pytest.approx(np.broadcast_to([0.3, -0.2], gradient.shape), abs=1e-5)


def test_corner_gradient_sees_a_spike():
    """A spike tilts its four corners outwards, which the plain central difference misses."""
    elevation = np.zeros((5, 5))
    elevation[2, 2] = 8.0
    gradient = corner_gradients(Terrain(elevation, 2.0))
    assert gradient[2, 2] == pytest.approx([2.0, 2.0])
    assert gradient[3, 3] == pytest.approx([-2.0, -2.0])


def test_sampling_is_bilinear(device):
    """Between corners the gradient is bilinear; at a corner it is the corner's."""
    rng = np.random.default_rng(3)
    terrain = Terrain(rng.normal(size=(6, 7)), 10.0)
    corners = corner_gradients(terrain)
    frame = StaggeredTerrain(terrain, 'float64', device).frame
    at = np.array([[3.0, 2.0], [3.25, 2.5]]) * 10.0 + [frame.x0, frame.y0]
    got = sampled(terrain, at, device)
    assert got[0] == pytest.approx(corners[2, 3])
    low = 0.75 * corners[2, 3] + 0.25 * corners[2, 4]
    high = 0.75 * corners[3, 3] + 0.25 * corners[3, 4]
    assert got[1] == pytest.approx(0.5 * (low + high))


def test_holes_do_not_bend_their_neighbours():
    """Around cells without data a plane keeps its slope."""
    terrain = plane()
    elevation = terrain.elevation.copy()
    elevation[2:4, 3] = np.nan
    gradient = corner_gradients(Terrain(elevation, terrain.resolution))
    assert gradient == pytest.approx(np.broadcast_to([0.3, -0.2], gradient.shape), abs=1e-5)
