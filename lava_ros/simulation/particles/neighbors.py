# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The neighbour grid (section 3.2.1): particles sorted by cells narrower than the kernel radius.

Cells are numbered row by row, so the surroundings of a particle are a contiguous range of the
ordered particles in each of a few rows. With cells as wide as the radius, and all nine around a
particle, almost twice as many particles would be examined.

On large terrains the grid is a window around the lava, which grows when needed: particles beyond
the window, as beyond the terrain, are assigned to its outermost cells. The window consists of
whole cells of the terrain's own grid, so the order of the particles does not depend on it.
"""

from functools import lru_cache
import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.errors import LavaError
from lava_ros.simulation.backend import compiled
from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.memory import read
from lava_ros.simulation.backend.scan import Scan
from lava_ros.simulation.backend.threads import launch_over, MIN_MOVES
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.cells import bin_function, border_functions, cells_to_radius
from lava_ros.simulation.particles.layout import arguments_type, cell_frame, Form
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.particles.terrain import StaggeredTerrain

#: Maximum number of cells for which the whole terrain is covered.
WHOLE = 2**14

#: Initial margin of a window on each side of the lava, minimum length of an extension [radii], and
#: the length of an extension over the length of the window: each stage visits all of its cells.
MARGIN, PIECE, GROWTH = 16.0, 12.0, 1.0

#: Distance from the window's border at which lava requests an extension [radii]; some more steps
#: run until then. Beyond the window lava counts as on its border: its sums are rounded
#: differently.
NEAR = 4.0

#: Outward directions from the lower and the upper ends of a window.
_OUTWARD = np.array(((-1,), (1,)))

#: Column and row limits that are never crossed.
_NEVER_BELOW, _NEVER_ABOVE = -(2**31), 2**31 - 1

#: Maximum number of cells of a window: they take 0.5 GB, and each stage visits all of them.
MAX_CELLS = 2**26

#: Maximum distance of particles from the terrain's centre, in spacings: float32 resolves 1/16 of a
#: spacing there.
MAX_DISTANCE = 2**20

#: Maximum number of particles in a cell; evenly spread lava has one. It bounds the cost of sums
#: over neighbours relative to the cost with evenly spread lava.
MAX_PARTICLES_PER_CELL = 2**15


@lru_cache
def _kernels(form: Form) -> tuple[Any, ...]:
    real = form.real
    vec4 = wp.types.vector(4, real)
    load, store = compiled.access(real, 4)
    load_pair, store_pair = compiled.access(real, 2)

    place = bin_function(real, form.has_empty)
    _, side_of, volume_lost = border_functions(real)

    @quick_kernel()
    def bin_particles(i: int, m: arguments_type(real)):
        if i < m.counts[at.PARTICLES] + m.counts[at.NEWCOMERS]:
            place(i, load(m.particle, i), m)

    @quick_kernel()
    def rank_particles(i: int, m: arguments_type(real)):
        """Rank particles in their cells in the order of all particles, one after the other."""
        if i >= m.counts[at.PARTICLES] + m.counts[at.NEWCOMERS]:
            return
        c = compiled.load_int(m.cell, i)
        if c == m.cells.rows * m.cells.columns:
            p = m.particle[i]
            if not (wp.static(form.has_empty) and p[2] == real(0.0)):
                m.left[side_of(m.ground, p[0], p[1])] += volume_lost(p)
        before = m.cells.sizes[c]
        m.rank[i] = before
        m.cells.sizes[c] = before + 1

    @quick_kernel()
    def list_members(i: int, m: arguments_type(real)):
        if i < m.cells.starts[m.cells.rows * m.cells.columns + 1]:
            m.members[compiled.load_int(m.cells.starts, m.cell[i]) + m.rank[i]] = i

    @wp.func
    def rank_of(i: int, first: int, end: int, members: wp.array(dtype=wp.int32)) -> int:
        """Return the rank of a particle by number among the particles of its cell."""
        before = wp.int32(0)
        for k in range(first, end):
            if compiled.load_int(members, k) < i:
                before += 1
        return before

    @quick_kernel()
    def order_particles(i: int, m: arguments_type(real)):
        """Gather the particles of each cell, and reset the values for the next sums over them."""
        starts = m.cells.starts
        last = m.cells.rows * m.cells.columns
        if i == 0:
            m.counts[at.PARTICLES] = starts[last]
            m.counts[at.NEWCOMERS] = 0
            m.rates[at.DIFFUSION] = real(0.0)
            m.rates[at.ADVECTION] = real(0.0)
            m.chosen[0] = 0
        end = starts[last + 1]
        if i >= end:
            return
        c = compiled.load_int(m.cell, i)
        p = load(m.particle, i)
        m.cells.sizes[c] = 0
        place = compiled.load_int(starts, c)
        if wp.static(form.is_ranked_again):
            place += rank_of(i, place, compiled.load_int(starts, c + 1), m.members)
        else:
            place += compiled.load_int(m.rank, i)
        if c == last:
            # it has left the terrain
            p = vec4()
        store(m.ordered, place, p)
        if wp.static(form.has_remainder):
            store_pair(m.ordered_remainder, place, load_pair(m.remainder, i))
        if wp.static(form.has_velocity):
            store_pair(m.ordered_velocity, place, load_pair(m.velocity, i))
        if wp.static(form.has_age):
            m.ordered_emission_time[place] = m.emission_time[i]
        if wp.static(form.has_temperature_remainder):
            m.ordered_temperature_remainder[place] = m.temperature_remainder[i]
        if wp.static(form.is_staged):  # noqa: SIM102, the static test decides what is compiled
            if m.counts[at.STAGE] > 0:
                store(m.ordered_base, place, load(m.base, i))
                store(m.ordered_drift, place, load(m.drift, i))
                if m.mean_temperature:
                    m.ordered_mean_temperature[place] = m.mean_temperature[i]

    return bin_particles, order_particles, rank_particles, list_members


class NeighborGrid:
    """The cells of a terrain for one kernel radius.

    Attributes:
        cells: Position and contents of the cells (cells.py).
        is_binned: True if the particles have been assigned to cells. Particles that have left are
            then counted as such, though they are not dropped yet.
    """

    def __init__(self, terrain: StaggeredTerrain, radius: float, ratio: float) -> None:
        """Divide the terrain into cells for a kernel radius [m] and its ratio to the spacing."""
        self._terrain = terrain
        self._radius, self._spacing = radius, radius / ratio
        rows, columns = cells_to_radius(ratio)
        ground = terrain.exact_ground
        self.cells = cell_frame(terrain.height.dtype)()
        self.cells.x0, self.cells.y0 = ground.x0, ground.y0
        self.cells.rows_per_metre = rows / radius
        self.cells.columns_per_metre = columns / radius
        side = ground.resolution / radius
        #: Columns and rows of the whole terrain.
        self._all = np.ceil(side * np.array((ground.columns * columns, ground.rows * rows)))
        self._all = np.maximum(self._all.astype(int), 1)
        self._per_metre = np.array((columns, rows)) / radius
        #: Columns and rows of the initial margin, and of an extension.
        self._margin, self._piece = (
            np.ceil(length * radius * self._per_metre).astype(int) for length in (MARGIN, PIECE)
        )
        self.is_binned = False

    def fit(self, places: np.ndarray) -> None:
        """Cover the surroundings of some places, or the whole of a small terrain.

        This discards the assignment to cells and replaces the cells: launches recorded with the
        previous ones must be discarded, too. Places are relative to the terrain's centre [m],
        shape [count, 2].

        Raises:
            LavaError: If the spacing is too small for these places.
        """
        self._cover(self.window(places))

    def window(self, places: np.ndarray) -> np.ndarray:
        """Return the first columns and rows around some places, and the ends, int [2, 2].

        Raises:
            LavaError: If the spacing is too small for these places.
        """
        cells = self.cells
        farthest = -min(cells.x0, cells.y0)
        if farthest > MAX_DISTANCE * self._spacing:
            reason = f'closer particles coincide by rounding {farthest:.3g} m from the centre'
            raise self._refusal(farthest / MAX_DISTANCE, reason)
        ends = np.stack((np.zeros(2, dtype=int), self._all))
        if self._all.prod() > WHOLE:
            places = places[np.isfinite(places).all(axis=1)]
            bounds = (places.min(axis=0), places.max(axis=0)) if len(places) else np.zeros((2, 2))
            origin = np.array((cells.x0, cells.y0))
            ends = np.floor((bounds - origin) * self._per_metre).astype(int)
            ends += ((0,), (1,)) + _OUTWARD * self._margin
        ends = self._clipped(ends)
        self._check_size(ends)
        return ends

    def _clipped(self, ends: np.ndarray) -> np.ndarray:
        """Return columns and rows within the terrain, at least one of each."""
        first = np.clip(ends[0], 0, self._all - 1)
        return np.stack((first, np.clip(ends[1], first + 1, self._all)))

    def _check_size(self, ends: np.ndarray) -> None:
        """Check the number of cells from the first columns and rows up to the ends."""
        count = int((ends[1] - ends[0]).prod())
        if count > MAX_CELLS:
            reason = f'the neighbour grid around vents and lava would have {count} cells, '
            reason += f'more than {MAX_CELLS}'
            raise self._refusal(self._spacing * math.sqrt(count / MAX_CELLS), reason)

    def _refusal(self, min_spacing: float, reason: str) -> LavaError:
        expected = f'at least {min_spacing:.3g} m, because {reason}'
        return LavaError('accuracy.spacing', float(f'{self._spacing:.4g}'), expected)

    def widen(self, sides: int) -> None:
        """Extend some sides (``State.counts[NEAR_BORDER]``); otherwise as ``fit``.

        Raises:
            LavaError: If the spacing is too small for the extent of the lava.
        """
        cells = self.cells
        first = np.array((cells.first_column, cells.first_row))
        length = np.array((cells.columns, cells.rows))
        is_near = sides >> np.arange(4).reshape(2, 2) & 1
        piece = np.maximum(self._piece, (GROWTH * length).astype(int))
        ends = self._clipped(np.stack((first, first + length)) + _OUTWARD * is_near * piece)
        self._check_size(ends)
        self._cover(ends)

    def _cover(self, ends: np.ndarray) -> None:
        """Cover the columns and rows from the first ones up to the ends, int [2, 2]."""
        # a new struct: launches with the previous one may be repeated
        cells = cell_frame(self._terrain.height.dtype)()
        cells.assign(self.cells)
        first, last = ends
        cells.first_column, cells.first_row = first.tolist()
        cells.columns, cells.rows = (last - first).tolist()
        near = np.ceil(NEAR * self._radius * self._per_metre).astype(int)
        # the border of the terrain does not move
        cells.west, cells.south = np.where(first > 0, first + near, _NEVER_BELOW).tolist()
        cells.east, cells.north = np.where(last < self._all, last - near, _NEVER_ABOVE).tolist()
        self.is_binned = False
        # always 0 except while particles are binned
        room = 4 * math.ceil((cells.rows * cells.columns + 2) / 4)
        device = self._terrain.height.device
        cells.sizes, cells.starts = (
            wp.zeros(room, dtype=wp.int32, device=device) for _ in range(2)
        )
        self.cells = cells
        self._scan = Scan(room, device)

    def bin(self, state: State, arguments: Any) -> None:
        """Assign each particle to its cell, as a motion that sets ``is_binned`` does."""
        bins, *_ = _kernels(state.form)
        launch_over(state, bins, [arguments], min_items=MIN_MOVES)
        self.is_binned = True

    def rebuild(self, state: State, arguments: Any) -> None:
        """Sort ``state.particle`` into ``state.ordered`` and drop particles off the terrain.

        Resets ``state.rates`` to 0, to be raised by the sums over the neighbours.
        """
        if not self.is_binned:
            self.bin(state, arguments)
        self.is_binned = False
        _, order, rank, members = _kernels(state.form)
        if not state.device.is_cuda:
            state.launches(rank, [arguments], dim=state.extent)
        self._scan(state.launches, self.cells.sizes, self.cells.starts)
        if state.form.is_ranked_again:
            launch_over(state, members, [arguments], min_items=MIN_MOVES)
        launch_over(state, order, [arguments], min_items=MIN_MOVES)

    def refuse_crowds(self) -> None:
        """Check the number of particles per cell: each particle visits all those around it.

        Raises:
            LavaError: If a cell contains more than ``MAX_PARTICLES_PER_CELL`` particles.
        """
        starts = read(self.cells.starts)[: self.cells.rows * self.cells.columns + 1]
        largest = int(np.diff(starts).max())
        if largest > MAX_PARTICLES_PER_CELL:
            sides = 1.0 / self.cells.columns_per_metre, 1.0 / self.cells.rows_per_metre
            size = f'{sides[0]:g} by {sides[1]:g} m'
            limit = f'at most {MAX_PARTICLES_PER_CELL} in {size}'
            expected = f'{limit}: give it room, or a larger spacing'
            raise LavaError('particles', f'{largest} in {size}', expected)
