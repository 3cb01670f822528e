# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The ground that lava has covered: on other terrains, in checkpoints and in maps.

``covered_cells.py`` defines and records it.
"""

from collections.abc import Mapping
from functools import lru_cache
import math
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.scene import Terrain
from lava_ros.scene.terrain import HALF, has_same_cells, PARTS
from lava_ros.simulation.backend.compiled import access, quick_kernel
from lava_ros.simulation.backend.memory import ArrayBlock, read
from lava_ros.simulation.output.covered_cells import mark_bits, note_function
from lava_ros.simulation.output.inundation import squares_in, standing_cells, TOUCHED
from lava_ros.simulation.output.window import cell_in, CellWindow, Window
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.layout import (
    arguments_type,
    CELL_MAPS,
    CellMaps,
    fitting,
    kinds_of,
)
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.particles.terrain import averaged, sampled

#: Rows and columns of a rectangle.
_Box = tuple[slice, slice]

#: Arrays in checkpoints, by their names there.
_SAVED = {
    'times': 'arrived', 'half_inundated': 'half_inundated', 'squares': 'covered',
    'bounds': 'bounds',
}


@lru_cache
def covered_ground_kernel(real: Any) -> Any:
    """Return the kernel that records the ground under the ordered particles and their flow."""
    load, _ = access(real, 4)
    note = note_function(real, False)

    @quick_kernel()
    def note_all(i: int, m: arguments_type(real)):
        if i < m.counts[at.PARTICLES]:
            note(load(m.ordered, i), m.flow[i][0], m.clock[at.TIME], m)

    return note_all


# without new bits covered stays as it is: they are only counted
@quick_kernel()
def _show(
    thread: int, arrived: wp.array2d(dtype=wp.float32),
    half_inundated: wp.array2d(dtype=wp.float32), covered: wp.array2d(dtype=wp.int32),
    maps: wp.array3d(dtype=wp.float32), window: CellWindow,
):
    cell = cell_in(window, thread)
    i, j = cell[0], cell[1]
    if i >= 0 and arrived[i, j] >= wp.float32(0.0):
        count = wp.float32(mark_bits(covered, i, j, 0))
        maps[0, i, j] = wp.max(
            count / wp.float32(wp.static(PARTS**2)), wp.float32(wp.static(TOUCHED))
        )
        maps[2, i, j] = arrived[i, j]
        if half_inundated[i, j] >= wp.float32(0.0):
            maps[1, i, j] = half_inundated[i, j]


def show_covered_cells(state: State, maps: Any, window: Window) -> None:
    """Write fractions and times of the cells that lava has covered to maps.

    ``maps`` are ``Snapshot.inundated``, ``half_inundated`` and ``arrived``, with the values of
    other cells, float32, shape [3, rows, columns].
    """
    covered = state.cell_maps
    arguments = [covered.arrived, covered.half_inundated, covered.covered, maps]
    window.launch(state, _show, arguments)


class CoveredCells:
    """The ground that lava has covered in each cell of a terrain, on a device.

    Attributes:
        maps: The arrays that kernels update.
    """

    def __init__(self, terrain: Terrain, device: Any) -> None:
        """Allocate for a terrain that no lava has touched."""
        self._terrain, self._device = terrain, device
        kinds = kinds_of(wp.float32)
        block = ArrayBlock({
            name: (kinds[one.dtype], (4,) if name == 'bounds' else terrain.shape)
            for name, one in CELL_MAPS.items()
        }, device)
        self.maps = CellMaps(*(block[name] for name in CELL_MAPS))
        # filled on the device: members of an ensemble do this one after the other
        for times in (self.maps.arrived, self.maps.half_inundated):
            times.fill_(-1.0)

    def _put(
        self, arrived: np.ndarray, half_inundated: np.ndarray, covered: np.ndarray,
        bounds: np.ndarray | None = None,
    ) -> None:
        """Allocate the arrays for the terrain."""
        bounds = _bounds_of(arrived >= 0.0) if bounds is None else bounds
        values, kinds = (arrived, half_inundated, covered, bounds), kinds_of(wp.float32)
        self.maps = CellMaps(*(
            wp.array(one.astype(declared.dtype), dtype=kinds[declared.dtype], device=self._device)
            for one, declared in zip(values, CELL_MAPS.values(), strict=True)
        ))

    def attach(self, state: State) -> None:
        """Let the kernels of a state update the arrays."""
        state.cell_maps = self.maps

    def move(self, terrain: Terrain, solidified: np.ndarray | None, threshold: float) -> None:
        """Continue on the cells of another terrain.

        Args:
            terrain: The terrain.
            solidified: Thickness of the solidified lava on it [m], shape [rows, columns]; None
                without.
            threshold: Minimum thickness of lava that inundates ground [m].
        """
        former, self._terrain = self._terrain, terrain
        if has_same_cells(former, terrain):
            return
        arrived, half_inundated, squares = (
            read(one) for one in (self.maps.arrived, self.maps.half_inundated, self.maps.covered)
        )
        solid = np.zeros(terrain.shape) if solidified is None else solidified
        before = _grid_of(former).part(box_of(arrived >= 0.0))
        after = before.cells_on(_grid_of(terrain))
        moved = np.full((2, *terrain.shape), -1.0)
        covered = np.zeros(terrain.shape, dtype=np.int32)
        if not (all(before.shape) and all(after.shape)):
            self._put(moved[0], moved[1], covered, _bounds_of(solid > 0.0))
            return
        old, new = before.cells, after.cells
        bits = _bits_of(
            sampled(
                _squares_of(squares[old]), before.divided, after.divided, outside=0
            ).astype(bool)
        )
        covered[new] = bits
        is_standing = standing_cells(solid[new], threshold)
        for times, known, is_due in (
            (moved[0], arrived, (bits > 0) | is_standing),
            (moved[1], half_inundated, squares_in(bits) >= HALF),
        ):
            # the middle of a covered cell may be where no lava has arrived
            values = known[old]
            part = averaged(values >= 0.0, before, after)
            mean = averaged(np.maximum(values, 0.0), before, after) / np.maximum(part, 1e-9)
            found = sampled(values, before, after, outside=-1.0)
            # a cell that lava has only touched has no squares
            is_kept = is_due | ((found >= 0.0) & (known is arrived))
            found = np.where((found < 0.0) & (part > 0.0), mean, found)
            # in a smaller cell that is half covered, where the larger one was not
            found = np.where(found < 0.0, moved[0][new], found)
            times[new] = np.where(is_kept, found, -1.0)
        bounds = _bounds_of((moved[0] >= 0.0) | (solid > 0.0))
        self._put(moved[0], moved[1], covered, bounds)

    def save(self) -> dict[str, np.ndarray]:
        """Copy the arrays of cells, by name."""
        return {key: read(getattr(self.maps, name)) for key, name in _SAVED.items()}

    def load(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Restore a copy of ``save``.

        Raises:
            LavaError: If an array is missing, or has the wrong shape or type.
        """
        for key, name in _SAVED.items():
            array = getattr(self.maps, name)
            kind = wp.dtype_to_numpy(array.dtype)
            array.assign(fitting(f'arrived.{key}', arrays.get(key), array.shape, kind))


def box_of(cells: np.ndarray) -> _Box:
    """Return the rows and columns of the rectangle of marked cells, bool, [rows, columns]."""
    rows, columns = (np.flatnonzero(cells.any(axis=axis)) for axis in (1, 0))
    if not rows.size:
        return slice(0, 0), slice(0, 0)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _bounds_of(cells: np.ndarray) -> np.ndarray:
    """Return the bounds (``State.bounds``) of cells with lava, bool, shape [rows, columns]."""
    ends = zip(cells.shape, box_of(cells), strict=True)
    return np.array([
        value for count, part in ends
        for value in ((count - part.start, part.stop) if part.stop else (0, 0))
    ])


class _Grid(NamedTuple):
    """A rectangle of a terrain's cells, as ``sampled`` and ``averaged`` read a terrain."""

    shape: tuple[int, int]
    resolution: float
    origin: tuple[float, float]
    cells: _Box

    @property
    def divided(self) -> '_Grid':
        """The squares of its cells."""
        rows, columns = self.shape
        return self._replace(
            shape=(rows * PARTS, columns * PARTS), resolution=self.resolution / PARTS
        )

    def part(self, box: _Box) -> '_Grid':
        """Return a rectangle of its cells."""
        rows, columns = box
        x, y = np.add(self.origin, self.resolution * np.array([columns.start, rows.start]))
        shape = rows.stop - rows.start, columns.stop - columns.start
        return _Grid(shape, self.resolution, (float(x), float(y)), box)

    def cells_on(self, other: '_Grid') -> '_Grid':
        """Return the rectangle of another grid that this one overlaps."""
        box = []
        for axis, count in enumerate(other.shape):
            start = self.origin[1 - axis] - other.origin[1 - axis]
            ends = np.array([start, start + self.shape[axis] * self.resolution])
            first, end = np.clip(ends / other.resolution + (-1e-6, 1e-6), 0, count)
            box.append(slice(math.floor(first), math.ceil(end) if self.shape[axis] else 0))
        if any(one.stop <= one.start for one in box):
            box = [slice(0, 0), slice(0, 0)]
        return other.part((box[0], box[1]))


def _grid_of(terrain: Terrain) -> _Grid:
    whole = slice(0, terrain.shape[0]), slice(0, terrain.shape[1])
    return _Grid(terrain.shape, terrain.resolution, terrain.origin, whole)


def _squares_of(bits: np.ndarray) -> np.ndarray:
    """Return the covered squares of all cells, bool, shape [PARTS rows, PARTS columns]."""
    rows, columns = bits.shape
    place = np.arange(PARTS * PARTS, dtype=np.int32).reshape(PARTS, 1, PARTS)
    squares = bits[:, None, :, None] >> place & 1
    return squares.reshape(rows * PARTS, columns * PARTS).astype(bool)


def _bits_of(squares: np.ndarray) -> np.ndarray:
    """Return the bits of each cell, int32, of all squares."""
    rows, columns = np.array(squares.shape) // PARTS
    place = np.arange(PARTS * PARTS, dtype=np.int32).reshape(PARTS, 1, PARTS)
    parts = squares.reshape(rows, PARTS, columns, PARTS).astype(np.int32) << place
    return parts.sum(axis=(1, 3)).astype(np.int32)
