# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Peak values of a flow in each cell, from successive observations, on its device.

Arrival times are those that the simulation records at its steps (``covered_cells.py``). An
observation visits the cells that lava can reach.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.scene import Terrain
from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.memory import read, read_parts
from lava_ros.simulation.output.inundation import inundated_fraction
from lava_ros.simulation.output.rasterization import Raster
from lava_ros.simulation.output.window import Bounded, cell_in, CellWindow
from lava_ros.simulation.particles.state import State

#: Reasons why a map cannot be shown, by their number.
_FLAWS = ('', 'thickness is not a number of metres', 'temperature is not a number of kelvin')


@quick_kernel(fast_math=False)
def _raise_peaks(
    thread: int, known: wp.array2d(dtype=wp.uint8), maps: wp.array3d(dtype=wp.float32),
    peaks: wp.array3d(dtype=wp.float32), flaw: wp.array(dtype=wp.int32), window: CellWindow,
):
    """Raise the peaks of thickness and temperature to the values of a map."""
    cell = cell_in(window, thread)
    i, j = cell[0], cell[1]
    if i < 0:
        return
    if known[i, j] == wp.uint8(0):
        return
    height = maps[0, i, j]
    heat = maps[1, i, j]
    if not (wp.isfinite(height) and height >= wp.float32(0.0)):
        flaw[0] = 1
        return
    if height > peaks[0, i, j]:
        peaks[0, i, j] = height
    if height == wp.float32(0.0):
        return
    if not (wp.isfinite(heat) and heat > wp.float32(0.0)):
        flaw[0] = 2
        return
    if heat > peaks[1, i, j] or wp.isnan(peaks[1, i, j]):
        peaks[1, i, j] = heat


class PeakMaps(NamedTuple):
    """Peaks of all observations so far, for a rectangle of cells.

    Attributes:
        corner: Row and column of the first cell.
        arrival: First arrival time [s], at or after the first observation, float64, shape [rows,
            columns] of the rectangle; NaN without arrival.
        half_inundated: Time at which lava had covered half of the cell [s], as ``arrival``.
        inundated: Fraction of the cell that lava has covered so far, float32, same shape; NaN
            where the terrain has no data now, as in a snapshot.
        thickness: Largest thickness [m], float32, same shape; NaN where the terrain has no data
            now.
        temperature: Highest temperature [K], float32, same shape; NaN without lava.
        flaw: Reason why an observation cannot be shown as a map; empty if there is none.
    """

    corner: tuple[int, int]
    arrival: np.ndarray
    half_inundated: np.ndarray
    inundated: np.ndarray
    thickness: np.ndarray
    temperature: np.ndarray
    flaw: str


class Peaks:
    """Largest values of a flow in each cell, gathered on its device.

    Attributes:
        COUNT: Number of arrays of the terrain's cells, float32.
    """

    COUNT = 2

    def __init__(
        self, shape: tuple[int, int], threshold: float, start: float, device: Any
    ) -> None:
        """Initialize without observations.

        Args:
            shape: Rows and columns of the terrain.
            threshold: Minimum thickness of lava that has arrived [m].
            start: Time of the first observation [s].
            device: Warp device.
        """
        self._threshold, self._start = threshold, start
        self._shape, self._device = (self.COUNT, *shape), device
        #: Number of the flaw (``_FLAWS``) that ``check`` has found.
        self._checked = 0

    @cached_property
    def _arrays(self) -> tuple[Any, Any]:
        """Peaks, and the number of a flaw: only of a solver that does not keep peaks itself."""
        # filled on the device: members of an ensemble do this one after the other
        peaks = wp.zeros(self._shape, dtype=wp.float32, device=self._device)
        peaks[1].fill_(np.nan)
        return peaks, wp.zeros(1, dtype=wp.int32, device=self._device)

    def observe(self, state: State, known: Any, raster: Raster) -> None:
        """Raise the peaks to the values of the current maps.

        Args:
            state: The particles of the flow.
            known: 1 for cells with data, 0 for others, shape [rows, columns].
            raster: The maps.
        """
        raster.window.launch(state, _raise_peaks, [known, raster.grids, *self._arrays])

    def check(self, thickness: np.ndarray, temperature: np.ndarray) -> None:
        """Note whether the thickness [m] or the temperature [K] of cells cannot be shown."""
        for number, values in enumerate((thickness, temperature), start=1):
            # a sum is finite if all are
            if not np.isfinite(values.sum()):
                self._checked = number

    def flaw(self) -> str:
        """Return why an observation cannot be shown as a map; empty if there is no reason."""
        number = self._checked
        if '_arrays' in vars(self):
            number = number or int(read(self._arrays[1])[0])
        return _FLAWS[number]

    def read(
        self, state: Bounded, terrain: Terrain, part: tuple[slice, slice], *,
        kept: np.ndarray | None = None,
    ) -> PeakMaps:
        """Return the peaks so far.

        Args:
            state: The state of the flow.
            terrain: The ground now, which may have lost data since the first observation.
            part: Rows and columns.
            kept: Thickness [m] and temperature [K] that the steps themselves have kept, in place
                of those of the observations, float32, shape [2, rows, columns] of the part.
        """
        start, corner, covered = self._start, (part[0].start, part[1].start), state.cell_maps
        maps = [covered.arrived, covered.half_inundated, covered.covered.view(wp.float32)]
        if kept is None:
            maps += self._arrays[0][0], self._arrays[0][1]
        arrived, half_inundated, squares, *observed = read_parts(maps, part)
        thickness, temperature = observed if kept is None else kept
        missing = ~terrain.has_data[part]
        arrival, half = (
            np.where(times >= 0.0, np.maximum(times.astype(np.float64), start), np.nan)
            for times in (arrived, half_inundated)
        )
        # lava that came and drained between two observations was as thick as the threshold
        least = np.where(arrival > start, np.float32(self._threshold), np.float32(0.0))
        thickness = np.maximum(thickness, least)
        inundated = inundated_fraction(arrived, squares.view(np.int32))
        for values in (inundated, thickness, temperature):
            values[missing] = np.nan
        return PeakMaps(corner, arrival, half, inundated, thickness, temperature, self.flaw())
