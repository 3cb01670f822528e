# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Solidified lava: a terrain that the lava of one simulation has raised.

The effect ``solidification`` only adds to it (step/effects/solidification.py). It stays when that
effect is switched off, when the terrain is replaced, and in checkpoints. Its volume is the sum
over the cells of the map and is stored nowhere else: a budget in which the map lacks solidified
lava has an error.

The thickness is stored separately from the elevation in integer multiples of 2^-44 m: sums of
integers do not depend on their order, so runs are bitwise identical, and deposits are not lost to
the rounding of a float32 elevation.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.scene.terrain import has_same_cells
from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.memory import read
from lava_ros.simulation.output.window import cell_in, CellWindow, Window
from lava_ros.simulation.particles.layout import BORDER, fitting, HOLES, SEA
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.particles.terrain import averaged, StaggeredTerrain

#: Unit of the thickness of solidified lava [m]; the maximum thickness is 2^63 units.
THICKNESS_UNIT = 2.0**-44


def volume_of(placed: np.ndarray, resolution: float) -> float:
    """Return the volume of a thickness in ``THICKNESS_UNIT`` on cells of a side [m3]."""
    return float(placed.sum(dtype=np.float64)) * THICKNESS_UNIT * resolution**2


@quick_kernel(fast_math=False)
def _show(
    thread: int, placed: wp.array2d(dtype=wp.int64), known: wp.array2d(dtype=wp.uint8),
    solidus: wp.float32, thickness: wp.array2d(dtype=wp.float32),
    temperature: wp.array2d(dtype=wp.float32), frozen: wp.array2d(dtype=wp.float32),
    window: CellWindow,
):
    """Add solidified lava to a map; where all lava has solidified, it has the solidus."""
    cell = cell_in(window, thread)
    i, j = cell[0], cell[1]
    if i < 0:
        return
    if known[i, j] == wp.uint8(0):
        frozen[i, j] = wp.float32(wp.nan)
        return
    parts = wp.float64(placed[i, j])
    solid = wp.float32(parts * wp.float64(wp.static(THICKNESS_UNIT)))
    frozen[i, j] = solid
    thickness[i, j] = thickness[i, j] + solid
    if solid > wp.float32(0.0) and wp.isnan(temperature[i, j]):
        temperature[i, j] = solidus


class RaisedTerrain(StaggeredTerrain):
    """A terrain on a device, and the lava that has solidified on it.

    Attributes:
        deposit: Solidified lava as it raises ``height`` [2^-44 m], int64, of the same shape.
        placed: Thickness of solidified lava on maps [2^-44 m], int64, shape [rows, columns].
    """

    def __init__(self, terrain: Terrain, precision: str, device: Any) -> None:
        """Copy the heights of a terrain, on which no lava has solidified yet."""
        super().__init__(terrain, precision, device)
        self._terrain = terrain
        # not the elevation of the bare ground, which other simulations share
        self.ground.elevation = self.height = wp.clone(self.bare)
        self.deposit = wp.zeros(self.height.shape, dtype=wp.int64, device=device)
        self.placed = wp.zeros(self.known.shape, dtype=wp.int64, device=device)

    def show(self, state: State, solidus: float, grids: Any, window: Window) -> None:
        """Add the solidified lava to a map on the cells of a window.

        The ``grids`` are thickness [m] and temperature [K] of the fluid lava, which become those
        of all lava, and the thickness of solidified lava [m]; float32, on the device.
        """
        maps = [grids[n] for n in range(3)]
        window.launch(state, _show, [self.placed, self.known, solidus, *maps])

    def thickness(self) -> np.ndarray:
        """Return the solidified thickness as maps show it [m], float64, shape [rows, columns]."""
        return read(self.placed) * THICKNESS_UNIT

    def take_over(self, former: 'RaisedTerrain', left: Any) -> None:
        """Transfer the solidified lava of the previous terrain to this one, which has none.

        Cells that do not coincide are weighted by their common area. Lava outside this terrain or
        on cells without data is added to the volume that has ``left`` (``State.left``) [m3].
        """
        before, terrain = former._terrain, self._terrain
        moved = partial(averaged, before=before, after=terrain)
        frozen = former.thickness()
        thickness = moved(frozen)
        volume, on_map = (
            values.sum() * cells.resolution**2
            for values, cells in ((frozen, before), (thickness, terrain))
        )
        lost = np.zeros(3)
        lost[BORDER] = volume - on_map
        for place, cells in ((HOLES, np.isnan(terrain.elevation)), (SEA, terrain.is_sea)):
            lost[place] = thickness[cells].sum() * terrain.resolution**2
        # smaller differences are rounding
        if abs(lost.sum()) > 1e-9 * volume:
            left.assign(left.numpy() + lost)
        self.placed.assign(_counted(np.where(terrain.has_data, thickness, 0.0)))
        raised = read(former.deposit) * THICKNESS_UNIT
        inner = raised[1:-1, 1:-1]
        # on cells without data the deposit is a continuation, and its lava is in other cells
        covered = moved(np.where(before.has_data, inner, 0.0))
        inner = np.where(terrain.has_data, covered, moved(inner))
        if not has_same_cells(before, terrain):
            raised = np.pad(inner, 1, mode='edge')
        raised[1:-1, 1:-1] = inner
        self._lay(_counted(raised))

    def save(self) -> dict[str, np.ndarray]:
        """Copy the solidified lava."""
        return {'deposit': self.deposit.numpy().copy(), 'placed': self.placed.numpy().copy()}

    def load(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Restore a copy of ``save`` to a terrain without solidified lava.

        Raises:
            LavaError: If the copy belongs to another terrain, or is not that of lava on cells with
                data.
        """
        deposit, placed = (
            fitting(f'solidified.{name}', arrays.get(name), array.shape, np.int64)
            for name, array in (('deposit', self.deposit), ('placed', self.placed))
        )
        for name, values in (('deposit', deposit), ('placed', placed)):
            if (values < 0).any():
                raise LavaError(f'checkpoint.solidified.{name}', int(values.min()), 'at least 0')
        if placed[~self._terrain.has_data].any():
            where = 'lava on cells without data'
            raise LavaError('checkpoint.solidified.placed', where, 'lava on cells with data')
        self.placed.assign(placed)
        self._lay(deposit)

    def _lay(self, parts: np.ndarray) -> None:
        self.deposit.assign(parts)
        self.height.assign(self.bare.numpy().astype(np.float64) + parts * THICKNESS_UNIT)


def _counted(thickness: np.ndarray) -> np.ndarray:
    """Return a thickness [m] in integer units."""
    return np.rint(thickness / THICKNESS_UNIT).astype(np.int64)
