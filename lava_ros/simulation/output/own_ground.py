# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ground covered by a particle, and first arrival times of its cells.

A particle of volume V and thickness h covers the square of side sqrt(V / h) around it. Lava has
reached a cell if, at the end of a time step, the centre of the cell was in the square of a
particle, or a particle was in the cell, and the lava was at least ``COVERED`` thick or had just
erupted there (docs/MODEL.md). Arrival times do not depend on the times of maps.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.layout import arguments_type, ground_type


@lru_cache
def cells_function(real: Any) -> Any:
    """Return the device function that finds the cells covered by a particle.

    They are the cell of the particle and those with their centre in its square. The function
    returns the first row and the one after the last, then the same for columns.
    """
    vec4 = wp.types.vector(4, real)

    @wp.func
    def cells_of(p: vec4, thickness: real, ground: ground_type(real)):
        inverse = real(1.0) / ground.resolution
        x, y = (p[0] - ground.x0) * inverse, (p[1] - ground.y0) * inverse
        # a square smaller by one cell touches the cells with their centre in the full square
        half = wp.max(real(0.5) * (wp.sqrt(p[2] / thickness) * inverse - real(1.0)), real(0.0))
        return wp.vec4i(
            wp.max(int(wp.floor(y - half)), 0),
            wp.min(int(wp.floor(y + half)) + 1, ground.rows),
            wp.max(int(wp.floor(x - half)), 0),
            wp.min(int(wp.floor(x + half)) + 1, ground.columns),
        )

    return cells_of


@lru_cache
def note_function(real: Any, is_new: bool) -> Any:
    """Return the device function that records first arrival times.

    It applies to the cells covered by a particle, or to the cell of a particle that ``is_new`` and
    has no thickness yet. Threads with a common cell write the same time.
    """
    vec4 = wp.types.vector(4, real)
    cells_of = cells_function(real)

    @wp.func
    def note(p: vec4, thickness: real, m: arguments_type(real)):
        if wp.static(is_new) or thickness >= real(wp.static(COVERED)):
            cells = cells_of(p, thickness, m.ground)
            time = wp.float32(m.clock[at.TIME])
            for row in range(cells[0], cells[1]):
                for column in range(cells[2], cells[3]):
                    is_known = m.ground.known[row, column] != wp.uint8(0)
                    if is_known and m.arrived[row, column] < wp.float32(0.0):
                        m.arrived[row, column] = time

    return note
