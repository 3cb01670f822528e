# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The velocity as the paper prints it, for the formulation ``as-published``."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.backend.compiled import access, quick_kernel
from lava_ros.simulation.particles.cells import cell_functions
from lava_ros.simulation.particles.layout import arguments_type, PARTICLES


@lru_cache
def published_kernel(real: Any) -> Any:
    """Return the kernel of the velocity as the paper prints it (3.36 to 3.44), for comparison.

    u_i = h_i^3 sum_j K0(r) b_j / sum_j K0(r) over neighbours within l, with
    b = -h^3 rho g grad S / (f(theta) mu). Printed in it: the velocity is multiplied by h^3 instead
    of divided by k^2 h^3; the viscosity counts twice, as f(theta) and as mu; K0 is its two-term
    series of the bare distance r in metres, without k; and K0(0) is K0(0.001). The paper writes
    |u| for the distance; the distance of two particles is used here. ``source`` and ``area`` must
    be filled; ``viscosity`` is the constant mu [Pa s].
    """
    vec3 = wp.types.vector(3, real)
    _, _, cells_around, range_in = cell_functions(real)
    load, _ = access(real, 4)

    @wp.func
    def series(r: real) -> real:
        log = wp.log(real(2.0) / r) - real(0.577216)
        return log + real(0.25) * r * r * (log + real(1.0))

    @quick_kernel()
    def published_velocity(i: int, m: arguments_type(real), viscosity: real):
        if i >= m.counts[PARTICLES]:
            return
        p = load(m.ordered, i)
        height = m.flow[i][0]
        support = m.constants.radius
        total = real(0.0)
        x = real(0.0)
        y = real(0.0)
        box = cells_around(m.cells, p[0], p[1], support)
        for r in range(box[0], box[1]):
            near = range_in(m.cells, r, box)
            for j in range(near[0], near[1]):
                other = load(m.ordered, j)
                dx = p[0] - other[0]
                dy = p[1] - other[1]
                square = dx * dx + dy * dy
                if square < support * support:
                    weight = series(wp.max(wp.sqrt(square), real(1.0e-3)))
                    total += weight
                    there = load(m.source, j)
                    x += weight * there[2] / m.area[j]
                    y += weight * there[3] / m.area[j]
        # source over area is h u_local = -h^3 rho g grad S / (3 f): b is 3 / mu of it
        scale = real(3.0) / viscosity * height * height * height / total
        m.flow[i] = vec3(height, scale * x, scale * y)

    return published_velocity
