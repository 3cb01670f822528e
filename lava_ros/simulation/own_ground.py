# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The ground that a particle stands for, and the times at which lava reached the cells of it.

A particle of volume V and thickness h stands for the square of side sqrt(V / h) around it. Lava
has reached a cell when its middle was in the square of a particle, or a particle was in the cell,
at the end of a time step, and the lava there was at least ``COVERED`` thick, or came out of a
vent there (docs/MODEL.md). This does not depend on when maps are drawn.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation import state as at
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.motion_arguments import arguments_type
from lava_ros.simulation.terrain import ground_type


@lru_cache
def cells_function(real: Any) -> Any:
    """Return the device function that finds the cells of a particle's own square.

    They are the particle's own cell and those whose middle is in the square. It returns the first
    row and the one after the last, the first column and the one after the last.
    """
    vec4 = wp.types.vector(4, real)

    @wp.func
    def cells_of(p: vec4, thickness: real, ground: ground_type(real)):
        inverse = real(1.0) / ground.resolution
        x, y = (p[0] - ground.x0) * inverse, (p[1] - ground.y0) * inverse
        # a square that is a cell less reaches into the cells whose middle the whole one has
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
    """Return the device function that notes the time in cells that lava has not reached before.

    They are the cells of a particle's own square, or its own cell alone where it ``is_new`` and
    has no thickness yet. Threads that meet in a cell write the same time.
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
