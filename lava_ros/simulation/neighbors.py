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

"""The neighbour grid (section 3.2.1): particles sorted by cells as wide as the kernel radius.

Cells are numbered row by row, so the 3 x 3 cells around a particle are three contiguous ranges of
the ordered particles.
"""

from functools import lru_cache
import math
from typing import Any, NamedTuple

import warp as wp

from lava_ros.errors import LavaError
from lava_ros.simulation.state import PARTICLES, STAGE, State
from lava_ros.simulation.terrain import StaggeredTerrain, terrain_functions, TerrainFrame

#: Most particles in a cell, where evenly spread lava has 9 to 16 of them. The sums over neighbours
#: then take no more than this often as long as lava that is spread out.
MOST_IN_CELL = 2**15


@wp.struct
class CellFrame:
    """Where the cells lie, relative to the terrain's centre."""

    x0: wp.float64
    y0: wp.float64
    size: wp.float64
    rows: wp.int32
    columns: wp.int32


class CellFunctions(NamedTuple):
    """Device functions that find cells."""

    column_of: Any
    row_of: Any
    block_around: Any


@lru_cache
def cell_functions(real: Any) -> CellFunctions:
    """Return the column and row of the cell at a position, clamped, and the cells around it."""

    @wp.func
    def column_of(frame: CellFrame, x: real) -> int:
        column = int(wp.floor((x - real(frame.x0)) / real(frame.size)))
        return wp.clamp(column, 0, frame.columns - 1)

    @wp.func
    def row_of(frame: CellFrame, y: real) -> int:
        row = int(wp.floor((y - real(frame.y0)) / real(frame.size)))
        return wp.clamp(row, 0, frame.rows - 1)

    @wp.func
    def block_around(frame: CellFrame, x: real, y: real) -> wp.vec4i:
        """First and last column, first row and the one after the last, of the 3 x 3 cells."""
        column = column_of(frame, x)
        row = row_of(frame, y)
        return wp.vec4i(
            wp.max(column - 1, 0),
            wp.min(column + 1, frame.columns - 1),
            wp.max(row - 1, 0),
            wp.min(row + 2, frame.rows),
        )

    return CellFunctions(column_of, row_of, block_around)


@lru_cache
def _kernels(
    real: Any, is_staged: bool, has_velocity: bool, has_age: bool, has_empty: bool
) -> tuple[Any, ...]:
    vec2 = wp.types.vector(2, real)
    vec4 = wp.types.vector(4, real)
    is_known = terrain_functions(real).is_known
    column_of, row_of, _ = cell_functions(real)

    @wp.kernel(module='unique', enable_backward=False)
    def bin_particles(
        particle: wp.array(dtype=vec4),
        counts: wp.array(dtype=wp.int32),
        known: wp.array2d(dtype=wp.uint8),
        terrain: TerrainFrame,
        cells: CellFrame,
        cell: wp.array(dtype=wp.int32),
        rank: wp.array(dtype=wp.int32),
        sizes: wp.array(dtype=wp.int32),
        left: wp.array(dtype=wp.float64),
    ):
        """Find each particle's cell and its rank there; what left the terrain goes last."""
        i = wp.tid()
        if i >= counts[PARTICLES]:
            return
        p = particle[i]
        c = cells.rows * cells.columns
        if wp.static(has_empty):  # noqa: SIM102, the static test decides what is compiled
            if p[2] == real(0.0):
                cell[i] = c
                rank[i] = wp.atomic_add(sizes, c, 1)
                return
        # between the stages of a step nothing leaves: a stage may overshoot the border
        number = p[0] + p[1] + p[3]
        if counts[STAGE] > 0 or (
            wp.isfinite(number) and is_known(known, terrain, p[0], p[1])
        ):
            c = row_of(cells, p[1]) * cells.columns + column_of(cells, p[0])
        else:
            # what is no number any more must not leave as if it had flowed off: it marks the sum
            wp.atomic_add(left, 0, wp.float64(p[2] + real(0.0) * number))
        cell[i] = c
        rank[i] = wp.atomic_add(sizes, c, 1)

    @wp.kernel(module='unique', enable_backward=False)
    def order_particles(
        particle: wp.array(dtype=vec4),
        counts: wp.array(dtype=wp.int32),
        cell: wp.array(dtype=wp.int32),
        rank: wp.array(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        ordered: wp.array(dtype=vec4),
        remainder: wp.array(dtype=vec2),
        ordered_remainder: wp.array(dtype=vec2),
        base: wp.array(dtype=vec4),
        drift: wp.array(dtype=vec4),
        ordered_base: wp.array(dtype=vec4),
        ordered_drift: wp.array(dtype=vec4),
        velocity: wp.array(dtype=vec2),
        ordered_velocity: wp.array(dtype=vec2),
        age: wp.array(dtype=real),
        ordered_age: wp.array(dtype=real),
    ):
        i = wp.tid()
        if i >= counts[PARTICLES]:
            return
        place = starts[cell[i]] + rank[i]
        ordered[place] = particle[i]
        if wp.static(real is wp.float32):
            ordered_remainder[place] = remainder[i]
        if wp.static(has_velocity):
            ordered_velocity[place] = velocity[i]
        if wp.static(has_age):
            ordered_age[place] = age[i]
        if wp.static(is_staged):  # noqa: SIM102, the static test decides what is compiled
            if counts[STAGE] > 0:
                ordered_base[place] = base[i]
                ordered_drift[place] = drift[i]

    @wp.kernel(module='unique', enable_backward=False)
    def count_inside(
        starts: wp.array(dtype=wp.int32), last: int, counts: wp.array(dtype=wp.int32)
    ):
        counts[PARTICLES] = starts[last]

    @wp.kernel(module='unique', enable_backward=False)
    def list_cells(
        counts: wp.array(dtype=wp.int32),
        cell: wp.array(dtype=wp.int32),
        keys: wp.array(dtype=wp.int32),
        values: wp.array(dtype=wp.int32),
    ):
        i = wp.tid()
        values[i] = i
        keys[i] = wp.static(2**31 - 1)
        if i < counts[PARTICLES]:
            keys[i] = cell[i]

    @wp.kernel(module='unique', enable_backward=False)
    def rank_sorted(
        counts: wp.array(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        keys: wp.array(dtype=wp.int32),
        values: wp.array(dtype=wp.int32),
        rank: wp.array(dtype=wp.int32),
    ):
        """Rank in the cell by the order of the particles, not by who came first."""
        i = wp.tid()
        if i < counts[PARTICLES]:
            rank[values[i]] = i - starts[keys[i]]

    return bin_particles, order_particles, count_inside, list_cells, rank_sorted


def _kernels_of(state: State) -> tuple[Any, ...]:
    return _kernels(
        state.real, state.is_staged, state.has_velocity, state.has_age, state.has_empty
    )


class NeighborGrid:
    """The cells of a terrain for one kernel radius.

    Attributes:
        frame: Where the cells lie.
        starts: Index of each cell's first ordered particle, shape [cells + 1]; the entry after the
            last cell is the number of particles on the terrain.
    """

    def __init__(self, terrain: StaggeredTerrain, radius: float, device: Any) -> None:
        """Cover the terrain with cells of the given size [m]."""
        self._terrain = terrain
        self.frame = CellFrame()
        self.frame.x0, self.frame.y0 = terrain.frame.x0, terrain.frame.y0
        self.frame.size = radius
        side = terrain.frame.resolution
        self.frame.rows = max(1, math.ceil(terrain.frame.rows * side / radius))
        self.frame.columns = max(1, math.ceil(terrain.frame.columns * side / radius))
        self._cell_count = self.frame.rows * self.frame.columns
        self._sizes = wp.zeros(self._cell_count + 1, dtype=wp.int32, device=device)
        self.starts = wp.zeros(self._cell_count + 1, dtype=wp.int32, device=device)

    def rebuild(self, state: State) -> None:
        """Sort ``state.particle`` into ``state.ordered`` and drop what left the terrain."""
        bin_particles, order_particles, count_inside, *_ = _kernels_of(state)
        self._sizes.zero_()
        wp.launch(
            bin_particles,
            dim=state.capacity,
            inputs=[
                state.particle,
                state.counts,
                self._terrain.known,
                self._terrain.frame,
                self.frame,
            ],
            outputs=[state.cell, state.rank, self._sizes, state.left],
            device=state.device,
        )
        wp.utils.array_scan(self._sizes, self.starts, inclusive=False)
        if state.is_deterministic:
            self._rank_by_order(state)
        wp.launch(
            order_particles,
            dim=state.capacity,
            inputs=[state.particle, state.counts, state.cell, state.rank, self.starts],
            outputs=[
                state.ordered,
                *state.optional('remainder', 'ordered_remainder'),
                *state.optional('base', 'drift', 'ordered_base', 'ordered_drift'),
                *state.optional('velocity', 'ordered_velocity', 'age', 'ordered_age'),
            ],
            device=state.device,
        )
        wp.launch(
            count_inside,
            dim=1,
            inputs=[self.starts, self._cell_count],
            outputs=[state.counts],
            device=state.device,
        )

    def refuse_crowds(self) -> None:
        """Refuse what would take for ever: each particle looks at all of those around it.

        Raises:
            LavaError: There are more than ``MOST_IN_CELL`` particles in one cell.
        """
        most = int(self._sizes.numpy()[: self._cell_count].max())
        if most > MOST_IN_CELL:
            size = self.frame.size
            right = f'at most {MOST_IN_CELL} in {size:g} m: give it room, or a larger spacing'
            raise LavaError('particles', f'{most} in {size:g} m', right)

    def _rank_by_order(self, state: State) -> None:
        """Replace the ranks that atomics gave, which vary on a GPU, by a stable sort's."""
        *_, list_cells, rank_sorted = _kernels_of(state)
        wp.launch(
            list_cells,
            dim=state.capacity,
            inputs=[state.counts, state.cell],
            outputs=[state.sort_keys, state.sort_values],
            device=state.device,
        )
        wp.utils.radix_sort_pairs(state.sort_keys, state.sort_values, state.capacity)
        wp.launch(
            rank_sorted,
            dim=state.capacity,
            inputs=[state.counts, self.starts, state.sort_keys, state.sort_values],
            outputs=[state.rank],
            device=state.device,
        )
