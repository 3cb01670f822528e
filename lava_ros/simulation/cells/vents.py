# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Vents on cells: the rate at which each cell of the grid receives lava."""

from functools import lru_cache
import math

import numpy as np

from lava_ros.scene import Terrain, Vent
from lava_ros.simulation.step.vent_ground import permitted_places, VentShape
from lava_ros.simulation.step.vents import OpenVents

#: Places along the diameter of a vent, and minimum number along a cell: fewer, but at least one,
#: across more than ``_MANY`` cells.
_ACROSS, _PER_CELL, _MANY = 32, 4, 256

#: Maximum number of places along a fissure.
_MAX_ALONG = 4096


class CellVents(OpenVents):
    """Vents on the cells of a grid.

    Attributes:
        cells: Indices of the cells in which lava comes out, in ascending order.
        weights: Fraction of the lava of each vent that comes out in each of these cells.
    """

    def __init__(self, vents: tuple[Vent, ...], grid: Terrain, since: float, rise: float) -> None:
        """Distribute the vents over the cells.

        Args:
            vents: The vents.
            grid: The ground on the solver's cells.
            since: Time from which the vents emit [s].
            rise: Maximum rise of the ground outside a vent's own radius [m].
        """
        super().__init__(vents, since)
        shapes = (VentShape(vent.position, vent.radius, vent.end) for vent in vents)
        found = [_weights_of(shape, grid, rise) for shape in shapes]
        places = [np.zeros(0, dtype=int), *(cells for cells, _ in found)]
        self.cells = np.unique(np.concatenate(places))
        self.weights = np.zeros((len(vents), self.cells.size))
        for own, (cells, parts) in zip(self.weights, found, strict=True):
            own[np.searchsorted(self.cells, cells)] = parts

    def sources(self, time: float, area: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the emission of each cell from a time until the next change.

        Args:
            time: The time [s].
            area: Area of a cell [m2].

        Returns:
            Rate of emission [m/s], and temperature of the lava [K], each as ``cells``.
        """
        hot = np.array([vent.temperature for vent in self.vents])
        discharge = np.array([vent.discharge_at(time) for vent in self.vents])
        rates = self.weights * discharge[:, None] / area
        source = rates.sum(axis=0)
        with np.errstate(invalid='ignore', divide='ignore'):
            mean = np.where(source > 0.0, hot @ rates / source, hot.max(initial=0.0))
        # not the rounded mean of equal numbers
        return source, np.clip(mean, hot.min(initial=np.inf), hot.max(initial=0.0))

    def next_change(self, time: float) -> float:
        """Return the time after ``time`` at which a discharge changes next [s], or infinity."""
        later = (at for vent in self.vents for at, _ in vent.series if at > time)
        return min(later, default=math.inf)


@lru_cache(maxsize=8)
def _weights_of(vent: VentShape, grid: Terrain, rise: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the cells in which the lava of a vent comes out, and the fraction in each.

    Members of an ensemble share the result.
    """
    places = _places_in(vent, grid)
    allowed = permitted_places(vent, places, grid, rise)
    place = np.floor((allowed - grid.origin) / grid.resolution).astype(int)
    rows, columns = grid.shape
    index = np.clip(place[:, 1], 0, rows - 1) * columns + np.clip(place[:, 0], 0, columns - 1)
    cells, counts = np.unique(index, return_counts=True)
    return cells, counts / counts.sum()


def _places_in(vent: VentShape, grid: Terrain) -> np.ndarray:
    """Return places evenly spread over a vent, at least as wide as a cell, [count, 2].

    A disc has none beyond the border of the grid.
    """
    cell = grid.resolution
    radius = max(vent.radius, 0.5 * cell)
    cells = math.ceil(2.0 * radius / cell)
    across = max(_ACROSS, cells * max(min(_PER_CELL, _PER_CELL * _MANY // cells), 1))
    ticks = radius * ((np.arange(across) + 0.5) / across * 2.0 - 1.0)
    start = np.asarray(vent.position)
    if vent.end is None:
        low, high = (np.subtract(corner, start) for corner in np.split(np.array(grid.extent), 2))
        x, y = np.meshgrid(*(
            ticks[(ticks >= low[axis]) & (ticks <= high[axis])] for axis in (0, 1)
        ))
        inside = np.hypot(x, y) <= radius
        return start + np.column_stack([x[inside], y[inside]])
    way = np.subtract(vent.end, start)
    length = math.hypot(*way)
    along = min(max(_ACROSS, math.ceil(length / cell) * _PER_CELL), _MAX_ALONG)
    fractions, aside = np.meshgrid((np.arange(along) + 0.5) / along, ticks)
    normal = np.array([-way[1], way[0]]) / max(length, 1e-300)
    return start + fractions.ravel()[:, None] * way + aside.ravel()[:, None] * normal


