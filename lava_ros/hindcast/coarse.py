# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Coarsening of terrain to the particle spacing, and conversion of maps back to its cells.

Particles do not resolve features smaller than their spacing, and may not move further than a cell
per step: cells of half the spacing take four times as long and change nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lava_ros.scene import Terrain
from lava_ros.simulation.output.snapshot import Snapshot

#: The maps of a snapshot.
GRIDS = ('thickness', 'temperature', 'frozen', 'arrived', 'half_inundated', 'inundated')


def coarsened(terrain: Terrain, factor: int) -> Terrain:
    """Average a terrain over cells larger by ``factor``, with the same centre.

    If the sides are not multiples of the larger cells, these extend equally beyond all borders, so
    that a terrain rotated by 90 degrees gets the same cells. A larger cell has data if at least
    one of its cells has data.
    """
    if factor == 1:
        return terrain
    rows, columns = (_halves(side, factor) for side in terrain.shape)
    mean = _mean(terrain.elevation, lambda values: _gathered(values, rows, columns))
    x, y = (
        start - (-side % factor) * terrain.resolution / 2.0
        for start, side in zip(terrain.origin, terrain.shape[::-1], strict=True)
    )
    return replace(
        terrain, elevation=mean, resolution=terrain.resolution * factor, origin=(x, y)
    )


def refined(snapshot: Snapshot, terrain: Terrain) -> Snapshot:
    """Convert the maps on a coarsened terrain to the cells of the original terrain."""
    factor = round(snapshot.terrain.resolution / terrain.resolution)
    if factor == 1:
        return snapshot
    rows, columns = (_halves(side, factor) for side in terrain.shape)

    def quarters(values: np.ndarray) -> np.ndarray:
        total = values[rows[0]] + values[rows[1]]
        return total[:, columns[0]] + total[:, columns[1]]

    def spread(values: np.ndarray) -> np.ndarray:
        mean = _mean(values, quarters)
        return np.where(terrain.has_data, mean, np.nan).astype(np.float32)

    changed = regridded(snapshot, terrain, spread)
    if changed.inundated is None or changed.half_inundated is None:
        return changed
    half = np.where(changed.footprint, changed.half_inundated, np.float32(np.nan))
    return replace(changed, half_inundated=half)


def regridded(
    snapshot: Snapshot, terrain: Terrain, change: Callable[[np.ndarray], np.ndarray]
) -> Snapshot:
    """Convert all maps of a snapshot to the cells of another terrain."""
    changed = {name: change(grid) for name, grid in grids_of(snapshot).items()}
    return replace(snapshot, terrain=terrain, **changed)  # type: ignore[arg-type]


def grids_of(snapshot: Snapshot) -> dict[str, np.ndarray]:
    """Return the available maps of a snapshot by name."""
    grids = {name: getattr(snapshot, name) for name in GRIDS}
    return {name: grid for name, grid in grids.items() if grid is not None}


def _mean(values: np.ndarray, total: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the mean of finite values with a function that adds them up, NaN without any."""
    known = np.isfinite(values)
    weight, found = total(known.astype(float)), total(np.where(known, values, 0.0))
    return np.where(weight > 0.0, found / np.where(weight > 0.0, weight, 1.0), np.nan)


def _halves(side: int, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the larger cells that contain the two halves of each of ``side`` cells."""
    first = np.arange(side) + 0.5 * (-side % factor)
    return (first // factor).astype(int), ((first + 0.5) // factor).astype(int)


def _gathered(
    values: np.ndarray, rows: Sequence[np.ndarray], columns: Sequence[np.ndarray]
) -> np.ndarray:
    """Add up the quarters of the cells of each larger cell (``_halves``)."""
    values = values.astype(float)
    for axis, halves in enumerate((rows, columns)):
        starts = [np.flatnonzero(np.diff(half, prepend=-1)) for half in halves]
        first, second = (np.add.reduceat(values, start, axis) for start in starts)
        values = first + second
    return values
