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

"""The neighbour grid (section 3.2.1): particles sorted by cells narrower than the kernel radius.

Cells are numbered row by row, so what is around a particle is a contiguous range of the ordered
particles in each of some rows. With cells as wide as the radius, and all nine around a particle,
one would look at almost twice as many.

Large terrains are covered only where lava is: what is beyond the window is found in its outermost
cells, as what is beyond the terrain is, and the window follows. It is made of whole cells of the
terrain's own grid, so the particles' order does not depend on it.
"""

from copy import copy
from functools import lru_cache
import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.errors import LavaError
from lava_ros.simulation.backend.compiled import (
    can_count,
    load2,
    load4,
    load_int,
    quick_kernel,
    store2,
    store4,
)
from lava_ros.simulation.backend.scan import Scan
from lava_ros.simulation.backend.streams import read
from lava_ros.simulation.backend.threads import launch_over, LEAST_MOVES
from lava_ros.simulation.cells import cell_frame, cell_functions, cells_to_radius
from lava_ros.simulation.state import (
    ADVECTION,
    BEYOND,
    DIFFUSION,
    NEWCOMERS,
    PARTICLES,
    SPARE,
    STAGE,
    State,
)
from lava_ros.simulation.terrain import StaggeredTerrain, terrain_frame, terrain_functions

#: Cells up to which the whole terrain is covered.
WHOLE = 2**14

#: What a window has on each side of the lava, over the lava's own extent, and at least [radii].
MARGIN, LEAST_MARGIN = 0.25, 8.0

#: Most particles in a cell, where evenly spread lava has one. The sums over neighbours
#: then take no more than this often as long as lava that is spread out.
MOST_IN_CELL = 2**15


@lru_cache
def bin_function(real: Any, has_empty: bool) -> Any:
    """Return the device function that puts a particle into its cell."""
    vec4 = wp.types.vector(4, real)
    functions = terrain_functions(real)
    is_known, side_of = functions.is_known, functions.side_of
    column_of, row_of, _, _ = cell_functions(real)
    volume_lost = _loss_function(real)

    @wp.func
    def is_beyond(cells: cell_frame(real), x: real, y: real) -> bool:
        """Whether a place is on the terrain's grid and not in the window."""
        column = int(wp.floor((x - cells.x0) * cells.columns_per_metre))
        row = int(wp.floor((y - cells.y0) * cells.rows_per_metre))
        if column < 0 or row < 0 or column >= cells.all_columns or row >= cells.all_rows:
            return False
        column -= cells.first_column
        row -= cells.first_row
        return column < 0 or row < 0 or column >= cells.columns or row >= cells.rows

    @wp.func
    def place(
        i: int,
        p: vec4,
        counts: wp.array(dtype=wp.int32),
        known: wp.array2d(dtype=wp.uint8),
        terrain: terrain_frame(real),
        cells: cell_frame(real),
        cell: wp.array(dtype=wp.int32),
        rank: wp.array(dtype=wp.int32),
        sizes: wp.array(dtype=wp.int32),
        left: wp.array(dtype=wp.float64),
    ):
        """Find a particle's cell and its rank there; what left the terrain goes last.

        On the CPU ranks are counted afterwards, by ``rank_particles``.
        """
        c = cells.rows * cells.columns
        if not (wp.static(has_empty) and p[2] == real(0.0)):
            # between the stages of a step nothing leaves: a stage may overshoot the border
            number = p[0] + p[1] + p[3]
            if counts[STAGE] > 0 or (wp.isfinite(number) and is_known(known, terrain, p[0], p[1])):
                c = row_of(cells, p[1]) * cells.columns + column_of(cells, p[0])
                if is_beyond(cells, p[0], p[1]):
                    counts[BEYOND] = 1
            elif can_count():
                wp.atomic_add(left, side_of(terrain, p[0], p[1]), volume_lost(p))
        cell[i] = c
        if can_count():
            rank[i] = wp.atomic_add(sizes, c, 1)

    return place


@lru_cache
def _loss_function(real: Any) -> Any:
    """Return the device function from a particle that has left the terrain to what left."""
    vec4 = wp.types.vector(4, real)

    @wp.func
    def volume_lost(p: vec4) -> wp.float64:
        # what is no number any more must not leave as if it had flowed off: it marks the sum
        return wp.float64(p[2] + real(0.0) * (p[0] + p[1] + p[3]))

    return volume_lost


@lru_cache
def _kernels(
    real: Any,
    is_staged: bool,
    has_velocity: bool,
    has_age: bool,
    has_empty: bool,
    is_ranked_again: bool,
) -> tuple[Any, ...]:
    vec2 = wp.types.vector(2, real)
    vec4 = wp.types.vector(4, real)
    load, store = load4(real), store4(real)
    load_pair, store_pair = load2(real), store2(real)

    place, volume_lost = bin_function(real, has_empty), _loss_function(real)
    side_of = terrain_functions(real).side_of

    @quick_kernel
    def bin_particles(
        i: int,
        particle: wp.array(dtype=vec4),
        counts: wp.array(dtype=wp.int32),
        known: wp.array2d(dtype=wp.uint8),
        terrain: terrain_frame(real),
        cells: cell_frame(real),
        cell: wp.array(dtype=wp.int32),
        rank: wp.array(dtype=wp.int32),
        sizes: wp.array(dtype=wp.int32),
        left: wp.array(dtype=wp.float64),
    ):
        if i < counts[PARTICLES] + counts[NEWCOMERS]:
            p = load(particle, i)
            place(i, p, counts, known, terrain, cells, cell, rank, sizes, left)

    @quick_kernel
    def rank_particles(
        i: int,
        particle: wp.array(dtype=vec4),
        counts: wp.array(dtype=wp.int32),
        terrain: terrain_frame(real),
        last: int,
        cell: wp.array(dtype=wp.int32),
        rank: wp.array(dtype=wp.int32),
        sizes: wp.array(dtype=wp.int32),
        left: wp.array(dtype=wp.float64),
    ):
        """Rank particles in their cells in the order of all, one after the other."""
        if i >= counts[PARTICLES] + counts[NEWCOMERS]:
            return
        c = cell[i]
        if c == last:
            p = particle[i]
            if not (wp.static(has_empty) and p[2] == real(0.0)):
                left[side_of(terrain, p[0], p[1])] += volume_lost(p)
        rank[i] = sizes[c]
        sizes[c] += 1

    @quick_kernel
    def list_members(
        i: int,
        last: int,
        cell: wp.array(dtype=wp.int32),
        rank: wp.array(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        members: wp.array(dtype=wp.int32),
    ):
        if i < starts[last + 1]:
            members[load_int(starts, cell[i]) + rank[i]] = i

    @wp.func
    def rank_of(i: int, first: int, end: int, members: wp.array(dtype=wp.int32)) -> int:
        """Rank of a particle by its number among those of its cell."""
        before = wp.int32(0)
        for k in range(first, end):
            if load_int(members, k) < i:
                before += 1
        return before

    @quick_kernel
    def order_particles(
        i: int,
        particle: wp.array(dtype=vec4),
        last: int,
        cell: wp.array(dtype=wp.int32),
        rank: wp.array(dtype=wp.int32),
        members: wp.array(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        sizes: wp.array(dtype=wp.int32),
        counts: wp.array(dtype=wp.int32),
        rates: wp.array(dtype=real),
        chosen: wp.array(dtype=wp.int32),
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
        """Gather the particles of each cell, and make ready for the next sums over them."""
        if i == 0:
            counts[PARTICLES] = starts[last]
            counts[NEWCOMERS] = 0
            rates[DIFFUSION] = real(0.0)
            rates[ADVECTION] = real(0.0)
            chosen[0] = 0
        end = starts[last + 1]
        if i >= end:
            # sums go on over the end of the last row, with weights of 0: no nan may be there
            if i < end + SPARE:
                store(ordered, i, vec4())
            return
        c = load_int(cell, i)
        p = load(particle, i)
        sizes[c] = 0
        place = load_int(starts, c)
        if wp.static(is_ranked_again):
            place += rank_of(i, place, load_int(starts, c + 1), members)
        else:
            place += load_int(rank, i)
        if c == last:
            # it has left
            p = vec4()
        store(ordered, place, p)
        if wp.static(real is wp.float32):
            store_pair(ordered_remainder, place, load_pair(remainder, i))
        if wp.static(has_velocity):
            store_pair(ordered_velocity, place, load_pair(velocity, i))
        if wp.static(has_age):
            ordered_age[place] = age[i]
        if wp.static(is_staged):  # noqa: SIM102, the static test decides what is compiled
            if counts[STAGE] > 0:
                store(ordered_base, place, load(base, i))
                store(ordered_drift, place, load(drift, i))

    return bin_particles, order_particles, rank_particles, list_members


def _kernels_of(state: State) -> tuple[Any, ...]:
    return _kernels(
        state.real,
        state.is_staged,
        state.has_velocity,
        state.has_age,
        state.has_empty,
        state.is_ranked_again,
    )


class NeighborGrid:
    """The cells of a terrain for one kernel radius.

    Attributes:
        frame: Where the cells lie.
        starts: Index of each cell's first ordered particle, shape [at least cells + 2]; that after
            the last cell is the number of particles on the terrain, the one after it that of all.
        is_binned: Whether the particles are in their cells already. Then those that have left are
            counted as such, though they are not dropped yet.
    """

    def __init__(
        self, terrain: StaggeredTerrain, radius: float, ratio: float, device: Any
    ) -> None:
        """Cover the terrain with cells.

        Args:
            terrain: The terrain.
            radius: Kernel radius [m].
            ratio: Kernel radius over particle spacing.
            device: Warp device.
        """
        self._terrain = terrain
        self._radius = radius
        rows, columns = cells_to_radius(ratio)
        self._device = device
        self.frame = cell_frame(terrain.height.dtype)()
        self.frame.x0, self.frame.y0 = terrain.frame.x0, terrain.frame.y0
        self.frame.rows_per_metre = rows / radius
        self.frame.columns_per_metre = columns / radius
        side = terrain.exact_frame.resolution / radius
        self.frame.all_rows = max(1, math.ceil(terrain.frame.rows * side * rows))
        self.frame.all_columns = max(1, math.ceil(terrain.frame.columns * side * columns))
        self.fit(np.zeros((0, 2)))

    def fit(self, places: np.ndarray) -> None:
        """Cover the surroundings of some places, or the whole of a small terrain.

        What is binned is forgotten.

        Args:
            places: Places from the terrain's centre [m], shape [count, 2].
        """
        # another one: what was launched with the former may be launched again
        frame = copy(self.frame)
        first, last = np.zeros(2, dtype=int), np.array((frame.all_columns, frame.all_rows))
        if last.prod() > WHOLE:
            places = places[np.isfinite(places).all(axis=1)]
            low, high = (places.min(axis=0), places.max(axis=0)) if len(places) else (0.0, 0.0)
            margin = np.maximum(MARGIN * (high - low), LEAST_MARGIN * self._radius)
            origin = np.array((frame.x0, frame.y0))
            per_metre = np.array((frame.columns_per_metre, frame.rows_per_metre))
            low = np.floor((low - margin - origin) * per_metre).astype(int)
            high = np.ceil((high + margin - origin) * per_metre).astype(int)
            first, last = np.clip(low, 0, last - 1), np.clip(high, low + 1, last)
        frame.first_column, frame.first_row = (int(value) for value in first)
        frame.columns, frame.rows = (int(value) for value in np.maximum(last - first, 1))
        self._cell_count = frame.rows * frame.columns
        self.frame = frame
        self.is_binned = False
        # 0 but while particles are binned
        room = 4 * math.ceil((self._cell_count + 2) / 4)
        self._sizes = wp.zeros(room, dtype=wp.int32, device=self._device)
        self.starts = wp.zeros(room, dtype=wp.int32, device=self._device)
        self._scan = Scan(room, self._device)

    def bin(self, state: State) -> None:
        """Put each particle into its cell, as ``place_in`` lets the motion do."""
        launch_over(
            state,
            _kernels_of(state)[0],
            inputs=[state.particle, state.counts],
            outputs=self.place_in(state),
            least=LEAST_MOVES,
        )
        self.is_binned = True

    def place_in(self, state: State) -> list[Any]:
        """What ``bin_function`` takes from ``known`` on; whoever uses it sets ``is_binned``."""
        terrain = self._terrain
        grid = [terrain.known, terrain.frame, self.frame]
        return [*grid, state.cell, state.rank, self._sizes, state.left]

    def rebuild(self, state: State) -> None:
        """Sort ``state.particle`` into ``state.ordered`` and drop what left the terrain.

        Sets ``state.rates`` to 0, to be raised by what is summed over the neighbours.
        """
        if not self.is_binned:
            self.bin(state)
        self.is_binned = False
        if not state.device.is_cuda:
            state.launches(
                _kernels_of(state)[2],
                dim=state.extent,
                inputs=[
                    state.particle,
                    state.counts,
                    self._terrain.frame,
                    self._cell_count,
                    state.cell,
                ],
                outputs=[state.rank, self._sizes, state.left],
            )
        self._scan(state.launches, self._sizes, self.starts)
        if state.is_ranked_again:
            state.launches(
                _kernels_of(state)[3],
                dim=state.capacity,
                inputs=[self._cell_count, state.cell, state.rank, self.starts],
                outputs=[state.members],
            )
        launch_over(
            state,
            _kernels_of(state)[1],
            inputs=[
                state.particle,
                self._cell_count,
                state.cell,
                state.rank,
                *state.optional('members'),
                self.starts,
            ],
            outputs=[
                self._sizes,
                state.counts,
                state.rates,
                state.chosen,
                state.ordered,
                *state.optional('remainder', 'ordered_remainder'),
                *state.optional('base', 'drift', 'ordered_base', 'ordered_drift'),
                *state.optional('velocity', 'ordered_velocity', 'age', 'ordered_age'),
            ],
            least=LEAST_MOVES,
        )

    def refuse_crowds(self) -> None:
        """Refuse what would take for ever: each particle looks at all of those around it.

        Raises:
            LavaError: There are more than ``MOST_IN_CELL`` particles in one cell.
        """
        most = int(np.diff(read(self.starts)[: self._cell_count + 1]).max())
        if most > MOST_IN_CELL:
            sides = 1.0 / self.frame.columns_per_metre, 1.0 / self.frame.rows_per_metre
            size = f'{sides[0]:g} by {sides[1]:g} m'
            right = f'at most {MOST_IN_CELL} in {size}: give it room, or a larger spacing'
            raise LavaError('particles', f'{most} in {size}', right)
