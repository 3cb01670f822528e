# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The staggered terrain grid."""

from dataclasses import replace
import gc
import itertools
import weakref

import numpy as np
import pytest
import warp as wp

from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy, METHODS
from lava_ros.simulation.particles.layout import ground_type
from lava_ros.simulation.particles.solidified import RaisedTerrain
from lava_ros.simulation.particles.terrain import StaggeredTerrain, terrain_functions
from solver import only


def sampled(terrain, points, device='cpu', *, of='gradient_at', kind=wp.vec2d):
    """Return a function of the ground (default: gradient) at points relative to its centre."""
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
    wp.launch(sample, len(points), inputs=[staggered.ground, at], outputs=[out], device=device)
    return out.numpy()


def plane(rows=6, columns=9, resolution=4.0):
    """Return z = 0.3 x - 0.2 y on cells of 4 m."""
    x = (np.arange(columns) + 0.5) * resolution
    y = (np.arange(rows) + 0.5) * resolution
    return Terrain(0.3 * x[None, :] - 0.2 * y[:, None], resolution)


def places_on(terrain, count=200, seed=1):
    x0, y0, x1, y1 = terrain.extent
    half = 0.5 * np.array([x1 - x0, y1 - y0])
    return np.random.default_rng(seed).uniform(-half, half, (count, 2))


def test_gradient_of_a_plane_is_exact(device):
    """The divisor is dx, also at the border, and not 2 dx."""
    gradient = sampled(plane(), places_on(plane()), device)
    assert gradient == pytest.approx(np.broadcast_to([0.3, -0.2], gradient.shape), abs=1e-6)


def test_gradient_at_corners_is_that_of_the_paper():
    elevation = np.random.default_rng(3).normal(size=(6, 7)).astype(np.float32)
    elevation[2, 2] += 8.0
    i, j = (index.ravel() for index in np.mgrid[1:6, 1:7])
    corners = np.stack([j, i], axis=1) * 10.0 - [35.0, 30.0]
    h = elevation.astype(float)
    rise = np.stack([
        h[i - 1, j] + h[i, j] - h[i - 1, j - 1] - h[i, j - 1],
        h[i, j - 1] + h[i, j] - h[i - 1, j - 1] - h[i - 1, j],
    ])
    assert sampled(Terrain(elevation, 10.0), corners) == pytest.approx(rise.T / 20.0)


def test_gradient_is_curl_free_across_cells():
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


def test_plane_keeps_its_slope_next_to_cells_without_data():
    terrain = plane()
    elevation = terrain.elevation.copy()
    elevation[2:4, 3] = np.nan
    holed = Terrain(elevation, terrain.resolution)
    places = places_on(terrain)
    centre = 0.5 * np.array(terrain.extent[2:])
    known = np.array([holed.covers(*(place + centre)) for place in places])
    gradient = sampled(holed, places[known])
    assert gradient == pytest.approx(np.broadcast_to([0.3, -0.2], gradient.shape), abs=1e-6)


def test_curvature_is_the_largest_eigenvalue_or_zero(device):
    elevation = np.random.default_rng(3).normal(size=(6, 7))
    terrain = Terrain(elevation, 10.0)
    # inside of cells, whose surface is quadratic: differences are exact
    points = (np.random.default_rng(4).integers(0, 5, (50, 2)) + 0.3) * 10.0 - [35.0, 30.0]
    along, across = 0.01 * np.eye(2)
    east = sampled(terrain, points + along) - sampled(terrain, points - along)
    north = sampled(terrain, points + across) - sampled(terrain, points - across)
    slopes = np.stack([east, north], axis=1) / 0.02
    largest = np.linalg.eigvalsh(0.5 * (slopes + np.swapaxes(slopes, 1, 2)))[:, -1]
    bends = sampled(terrain, points, device, of='curvature_at', kind=wp.float64)
    assert bends == pytest.approx(np.maximum(largest, 0.0), rel=1e-6, abs=1e-9)
    assert (bends == 0.0).any() and (bends > 0.0).any()


def ground_of(simulation):
    """Return the arrays of a simulation's ground that others may share."""
    solver = simulation.solver
    if simulation.accuracy.method == 'cells':
        return solver.state.kind, solver.heat.elevation, solver._known
    return solver.terrain.bare, solver.terrain.known, solver.terrain.sea


@pytest.mark.parametrize('effects', [(), ('cooling', 'solidification')])
@pytest.mark.parametrize('method', METHODS)
def test_simulations_share_their_ground_until_one_replaces_it(method, effects, device):
    ground = replace(plane(rows=12, columns=12), sea_level=0.0)
    scene = Scene(ground, (Vent((30.0, 20.0), 1.0),), Lava.paper())
    accuracy = Accuracy(spacing=4.0, thickness=0.5, method=method)
    one, other = (
        Simulation(scene, effects=only(*effects), accuracy=accuracy, device=device)
        for _ in range(2)
    )
    shared = ground_of(one)
    assert all(mine is theirs for mine, theirs in zip(shared, ground_of(other), strict=True))
    before = [array.numpy().copy() for array in shared]
    one.set_terrain(replace(ground, elevation=ground.elevation + 5.0))
    one.advance(1.0)
    assert not any(mine is old for mine, old in zip(ground_of(one), shared, strict=True))
    for array, old, values in zip(ground_of(other), shared, before, strict=True):
        assert array is old
        assert np.array_equal(array.numpy(), values)


def test_solidified_lava_does_not_raise_the_ground_of_others(device):
    terrain = plane()
    one, other = (RaisedTerrain(terrain, 'float32', device) for _ in range(2))
    assert one.bare is other.bare
    one.height.fill_(1e3)
    assert other.height.numpy().max() < 1e3
    assert other.bare.numpy().max() < 1e3
    assert one.ground.elevation is one.height


def test_shared_ground_is_kept_for_the_next_member_and_freed_after_newer_ones(device):
    terrain = plane()
    one = StaggeredTerrain(terrain, 'float32', device)
    bare = weakref.ref(one.bare)
    del one
    gc.collect()
    other = StaggeredTerrain(terrain, 'float32', device)
    assert bare() is other.bare
    newer = [StaggeredTerrain(plane(), 'float32', device) for _ in range(6)]
    del newer
    gc.collect()
    assert bare() is other.bare
    del other
    gc.collect()
    assert bare() is None
