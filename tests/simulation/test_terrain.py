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

import itertools

import numpy as np
import pytest
import warp as wp

from lava_ros.scene import Terrain
from lava_ros.simulation.terrain import ground_type, StaggeredTerrain, terrain_functions


def sampled(terrain, points, device='cpu', *, of='gradient_at', kind=wp.vec2d):
    """Gradients, or another function of the ground, at points given relative to its centre."""
    staggered = StaggeredTerrain(terrain, 'float64', device)
    function = getattr(terrain_functions(wp.float64), of)

    @wp.kernel(module='unique')
    def sample(
        ground: ground_type(wp.float64),
        at: wp.array(dtype=wp.vec2d),
        out: wp.array(dtype=kind),
    ):
        i = wp.tid()
        out[i] = function(ground, at[i][0], at[i][1])

    at = wp.array(points, dtype=wp.vec2d, device=device)
    out = wp.zeros(len(points), dtype=kind, device=device)
    wp.launch(
        sample, dim=len(points), inputs=[staggered.ground, at], outputs=[out],
        device=device,
    )  # fmt: skip
    return out.numpy()


def plane(rows=6, columns=9, resolution=4.0):
    """Z = 0.3 x - 0.2 y on cells of 4 m."""
    x = (np.arange(columns) + 0.5) * resolution
    y = (np.arange(rows) + 0.5) * resolution
    return Terrain(0.3 * x[None, :] - 0.2 * y[:, None], resolution)


def places_on(terrain, count=200, seed=1):
    """Random places on a terrain, relative to its centre."""
    x0, y0, x1, y1 = terrain.extent
    half = 0.5 * np.array([x1 - x0, y1 - y0])
    return np.random.default_rng(seed).uniform(-half, half, (count, 2))


def test_gradient_of_a_plane_is_exact_everywhere(device):
    """Up to the border the gradient of a plane is its slope (divisor dx, not 2 dx)."""
    gradient = sampled(plane(), places_on(plane()), device)
    assert gradient == pytest.approx(np.broadcast_to([0.3, -0.2], gradient.shape), abs=1e-6)


def test_gradient_at_corners_is_the_papers():
    """At a corner the gradient differences the half-heights around it (3.21)."""
    elevation = np.random.default_rng(3).normal(size=(6, 7)).astype(np.float32)
    terrain = Terrain(elevation, 10.0)
    corner = np.array([[3.0, 2.0]]) * 10.0 - [35.0, 30.0]
    h = elevation.astype(float)
    expected = [
        (h[1, 3] + h[2, 3] - h[1, 2] - h[2, 2]) / 20.0,
        (h[2, 2] + h[2, 3] - h[1, 2] - h[1, 3]) / 20.0,
    ]
    assert sampled(terrain, corner)[0] == pytest.approx(expected)


def test_spike_tilts_its_corners():
    """A spike tilts its four corners outwards, which the plain central difference misses."""
    elevation = np.zeros((5, 5))
    elevation[2, 2] = 8.0
    corners = np.array([[-1.0, -1.0], [1.0, 1.0]])
    gradient = sampled(Terrain(elevation, 2.0), corners)
    assert gradient == pytest.approx(np.array([[2.0, 2.0], [-2.0, -2.0]]))


def test_gradient_is_curl_free_and_continuous():
    """The circulation around any small square vanishes, also across cell borders."""
    terrain = Terrain(np.random.default_rng(3).normal(size=(12, 14)), 10.0)
    centres = places_on(terrain, 400) * 0.9
    # Simpson's rule is exact on each side where the gradient is quadratic: inside one cell
    size = 0.5
    total = np.zeros(len(centres))
    corners = size * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]], dtype=float)
    for start, end in itertools.pairwise(corners):
        along = end - start
        for where, weight in ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6)):
            total += weight * (sampled(terrain, centres + start + where * along) @ along)
    inside = (np.abs((centres % 10.0) - 5.0).max(axis=1)) < 4.4
    assert inside.sum() > 200
    assert np.abs(total[inside]).max() < 1e-12
    assert np.abs(total).max() < 0.02


def test_holes_do_not_bend_their_neighbours():
    """Around cells without data a plane keeps its slope."""
    terrain = plane()
    elevation = terrain.elevation.copy()
    elevation[2:4, 3] = np.nan
    holed = Terrain(elevation, terrain.resolution)
    places = places_on(terrain)
    centre = 0.5 * np.array(terrain.extent[2:])
    known = np.array([holed.covers(*(place + centre)) for place in places])
    gradient = sampled(holed, places[known])
    assert gradient == pytest.approx(np.broadcast_to([0.3, -0.2], gradient.shape), abs=1e-6)


def test_bend_is_the_largest_curvature_of_the_surface(device):
    """It is the largest eigenvalue of the gradient's own derivatives, and 0 on a dome."""
    elevation = np.random.default_rng(3).normal(size=(6, 7))
    terrain = Terrain(elevation, 10.0)
    # inside of cells, whose surface is quadratic: differences are exact
    points = (np.random.default_rng(4).integers(0, 5, (50, 2)) + 0.3) * 10.0 - [35.0, 30.0]
    along, across = 0.01 * np.eye(2)
    east = sampled(terrain, points + along) - sampled(terrain, points - along)
    north = sampled(terrain, points + across) - sampled(terrain, points - across)
    slopes = np.stack([east, north], axis=1) / 0.02
    largest = np.linalg.eigvalsh(0.5 * (slopes + np.swapaxes(slopes, 1, 2)))[:, -1]
    bends = sampled(terrain, points, device, of='bend_at', kind=wp.float64)
    assert bends == pytest.approx(np.maximum(largest, 0.0), rel=1e-6, abs=1e-9)
    assert (bends == 0.0).any() and (bends > 0.0).any()
