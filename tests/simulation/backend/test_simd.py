# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Sums over eight neighbours at a time on a CPU, compared with plain sums; and the scan."""

import numpy as np
import pytest
import warp as wp

from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.backend.scan import Scan
from lava_ros.simulation.backend.simd import WIDTH
from lava_ros.simulation.particles.cells import sums_function, wide_sums_function
from lava_ros.simulation.particles.kernels import k0_within, smoothing_kernel
from lava_ros.simulation.particles.layout import cell_frame, SPARE
from lava_ros.simulation.step.effects import green as green
from lava_ros.simulation.step.effects import helmholtz as helmholtz

#: Rows and columns of cells in the grid: before, in and after the box.
ROWS, COLUMNS = 5, 9
BOX = (1, 4, 2, 7)
RADIUS = 3.0

WENDLAND = smoothing_kernel('wendland', wp.float32)

#: Sums of the flow and of two effects, in float32: one neighbour after the other, two or four at a
#: time, and eight.
FLOW = (
    sums_function(wp.float32, WENDLAND, 1, False),
    sums_function(wp.float32, WENDLAND, 1, True),
    wide_sums_function(WENDLAND.wide_terms),
)
HEAT = (
    sums_function(wp.float32, WENDLAND, 1, False, has_heat=True),
    sums_function(wp.float32, WENDLAND, 1, True, has_heat=True),
    wide_sums_function(WENDLAND.wide_terms, has_heat=True),
)
GREEN = (
    green._sums_function(wp.float32, 1, False),
    green._sums_function(wp.float32, 1, True),
    green._wide_sums_function(),
)
HELMHOLTZ = (
    helmholtz._sums_function(wp.float32, WENDLAND, 1),
    helmholtz._wide_sums_function(WENDLAND.wide_terms),
)


def kernel_of(name, sums):
    """Return a kernel that evaluates some sums at one place."""
    powers_of = k0_within(wp.float32).powers_of

    @wp.kernel(module='unique')
    def sum_up(
        values: wp.array(dtype=wp.vec4),
        area: wp.array(dtype=float),
        pairs: wp.array(dtype=wp.vec2),
        cells: cell_frame(wp.float32),
        box: wp.vec4i,
        p: wp.vec4,
        result: wp.array(dtype=wp.vec4),
    ):
        inverse = wp.static(1.0 / RADIUS)
        if wp.static(name == 'heat'):
            result[0] = sums(0, values, cells, box, p, inverse)
            return
        found = wp.vec3()
        if wp.static(name == 'flow'):
            found = sums(0, values, cells, box, p, inverse)
        if wp.static(name == 'green'):
            found = sums(0, values, area, cells, box, p, powers_of(2.0), 0.2)
        if wp.static(name == 'helmholtz'):
            found = sums(0, values, pairs, cells, box, p, wp.vec2(0.3, -0.4), inverse)
        result[0] = wp.vec4(found[0], found[1], found[2], 0.0)

    return sum_up


KERNELS = {
    name: [kernel_of(name, sums) for sums in every]
    for name, every in (
        ('flow', FLOW), ('heat', HEAT), ('green', GREEN), ('helmholtz', HELMHOLTZ)
    )
}


def sums_of(kernel, sizes, seed=0, outside=np.nan, room=0):
    """Return the sums of a kernel over cells with given numbers of particles.

    Particles outside the box, and `room` more after the last, have the value `outside`.
    """
    random = np.random.default_rng(seed)
    starts = np.concatenate([[0], np.cumsum(sizes.ravel())]).astype(np.int32)
    values = random.uniform(-2.0, 2.0, (starts[-1], 4)).astype(np.float32)
    area = random.uniform(0.5, 1.5, len(values)).astype(np.float32)
    pairs = random.uniform(-1.0, 1.0, (len(values), 2)).astype(np.float32)
    inside = np.zeros(sizes.shape, bool)
    inside[BOX[0] : BOX[1], BOX[2] : BOX[3]] = True
    counts = np.repeat(inside.ravel(), sizes.ravel())
    values[~counts], area[~counts], pairs[~counts] = outside, outside, outside
    room = max(room, WIDTH - len(values))
    values, area, pairs = (
        np.concatenate([items, np.full((room, *items.shape[1:]), outside, np.float32)])
        for items in (values, area, pairs)
    )
    cells = cell_frame(wp.float32)()
    cells.rows, cells.columns = ROWS, COLUMNS
    cells.starts = wp.array(starts, dtype=wp.int32, device='cpu')
    result = wp.zeros(1, dtype=wp.vec4, device='cpu')
    wp.launch(
        kernel,
        dim=1,
        inputs=[
            wp.array(values, dtype=wp.vec4, device='cpu'),
            wp.array(area, dtype=float, device='cpu'),
            wp.array(pairs, dtype=wp.vec2, device='cpu'),
            cells,
            wp.vec4i(*BOX),
            wp.vec4(0.1, -0.2, 1.0, 2.0),
        ],
        outputs=[result],
        device='cpu',
    )
    return result.numpy()[0]


def plain_sums(kernels, sizes, seed=0):
    """Return the sums without vectors."""
    first, *others = (sums_of(one, sizes, seed, outside=7.0, room=SPARE) for one in kernels)
    for other in others:
        assert other == pytest.approx(first, abs=1e-5 * max(float(np.abs(first).max()), 1.0))
    return first


@pytest.mark.parametrize('name', KERNELS)
@pytest.mark.parametrize('most', [1, 2, 3, 5, 40])
def test_wide_sums_equal_plain_sums(name, most):
    random = np.random.default_rng(most)
    *plain, wide = KERNELS[name]
    for seed in range(20):
        sizes = random.integers(0, most + 1, (ROWS, COLUMNS))
        if seed % 2:
            # the last particles of the box are the last of the array
            sizes[BOX[1] - 1, BOX[3] :] = sizes[BOX[1] :] = 0
        expected = plain_sums(plain, sizes, seed)
        scale = 1e-5 * max(float(np.abs(expected).max()), 1.0)
        assert np.isfinite(expected).all()
        assert sums_of(wide, sizes, seed) == pytest.approx(expected, abs=scale)


@pytest.mark.parametrize('name', KERNELS)
def test_wide_sums_over_few_particles_or_none(name):
    *plain, wide = KERNELS[name]
    sizes = np.zeros((ROWS, COLUMNS), int)
    assert (sums_of(wide, sizes) == 0.0).all()
    sizes[2, 3] = 3
    expected = plain_sums(plain, sizes)
    assert np.abs(expected).max() > 0.01
    assert sums_of(wide, sizes) == pytest.approx(expected, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize('length', [4, 4096, 4100, 100_000, 600_000, 3_000_000])
def test_scan_sums_the_preceding_items(device, length):
    rng = np.random.default_rng(length)
    starts = wp.full(length, -1, dtype=wp.int32, device=device)
    scan, launches = Scan(length, wp.get_device(device)), Launches(wp.get_device(device))
    for most in (1, 700):
        sizes = rng.integers(0, most + 1, length)
        for _ in range(3):
            scan(launches, wp.array(sizes, dtype=wp.int32, device=device), starts)
            assert (starts.numpy() == np.cumsum(sizes) - sizes).all()
