# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Launches that take steps of one world or of several, each with its own time and window."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.simulation.backend.compiled import on_cuda
from lava_ros.simulation.cells.covered import Covered, note_function
from lava_ros.simulation.cells.flow import step_function
from lava_ros.simulation.cells.heated_step import heated_step_function
from lava_ros.simulation.cells.state import Cells, Heat, TARGET, TIME, WAITING
from lava_ros.simulation.cells.threads import THREADS


@wp.struct
class World:
    """Arrays and constants of a simulation."""

    flow: Cells
    heat: Heat
    covered: Covered


@lru_cache
def steps_kernel(effects: Effects, is_heated: bool, blocks: int, threads: int = THREADS) -> Any:
    """Return the kernel that takes steps, at most a number, and records what lava covers."""
    step = step_function(effects, is_uniform=True, blocks=blocks)
    heated_step = heated_step_function(effects, blocks) if is_heated else None
    note = note_function(blocks)

    @wp.func_native(on_cuda(f'return blockIdx.x / {blocks};', 'return thread;'))
    def world_of(thread: int) -> int: ...

    @wp.kernel(
        module='unique', enable_backward=False, grid_stride=False, cluster_dim=blocks,
        launch_bounds=threads, module_options={'enable_backward': False},
    )
    def take_steps(worlds: wp.array(dtype=World), rows: wp.array(dtype=wp.int32), most: int):
        world = worlds[rows[world_of(wp.tid())]]
        clock = world.flow.clock
        for _ in range(most):
            if clock[TIME] >= clock[TARGET] or clock[WAITING] > wp.float64(0.0):
                break
            if wp.static(is_heated):
                heated_step(world.flow, world.heat)
            else:
                step(world.flow)
            if clock[WAITING] == wp.float64(0.0):
                note(world.flow, world.covered)

    return take_steps
