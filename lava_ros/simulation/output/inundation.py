# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Sets of cells in all outputs: cells inundated so far, and cells with lava at a time."""

import numpy as np

from lava_ros.simulation.accuracy import COVERED

#: Maximum relative rounding error of a thickness in a map.
_ROUNDING = 1e-5


def inundated_cells(arrived: np.ndarray) -> np.ndarray:
    """Return the cells that lava has reached at any time so far.

    Args:
        arrived: First arrival time [s], NaN without arrival (``Snapshot.arrived``), any shape.

    Returns:
        True in inundated cells, bool, same shape.
    """
    return np.isfinite(arrived)


def raise_peak(peak: np.ndarray, arrived: np.ndarray) -> np.ndarray:
    """Return the peak thickness of maps, at least ``COVERED`` in inundated cells.

    Lava may arrive and drain between two maps.

    Args:
        peak: Peak thickness of all maps [m], any shape.
        arrived: First arrival time [s], NaN without arrival, same shape.

    Returns:
        Peak thickness [m], float32, same shape.
    """
    least = np.where(inundated_cells(arrived), np.float32(COVERED), np.float32(0.0))
    return np.fmax(peak, least).astype(np.float32)


def standing_cells(thickness: np.ndarray, least: float = COVERED) -> np.ndarray:
    """Return the cells with lava, flowing or solidified.

    Args:
        thickness: Lava thickness [m], NaN without lava or data, any shape.
        least: Minimum thickness [m]. A thickness that a map rounds to it counts.

    Returns:
        True in cells with lava, bool, same shape.
    """
    return np.asarray(thickness) >= np.float32(least * (1.0 - _ROUNDING))
