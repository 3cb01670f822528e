# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The two sets of cells that all outputs count: inundated cells, and cells with standing lava."""

import numpy as np

from lava_ros.simulation.accuracy import COVERED

#: Relative error with which a map's numbers may state a thickness.
_ROUNDING = 1e-5


def inundated_cells(arrived: np.ndarray) -> np.ndarray:
    """Return the cells that lava has reached at any time so far, whether or not it still stands.

    Args:
        arrived: Time at which lava reached each cell [s], NaN where it has not
            (``Snapshot.arrived``), any shape.

    Returns:
        True in inundated cells, bool, same shape.
    """
    return np.isfinite(arrived)


def raise_peak(peak: np.ndarray, arrived: np.ndarray) -> np.ndarray:
    """Return the largest thickness of maps, at least ``COVERED`` in inundated cells.

    Lava may come and drain away between two maps.

    Args:
        peak: Largest thickness in any map [m], any shape.
        arrived: Time at which lava reached each cell [s], NaN where it has not, same shape.

    Returns:
        Largest thickness [m], float32, same shape.
    """
    least = np.where(inundated_cells(arrived), np.float32(COVERED), np.float32(0.0))
    return np.fmax(peak, least).astype(np.float32)


def standing_cells(thickness: np.ndarray, least: float = COVERED) -> np.ndarray:
    """Return the cells with lava now, flowing or solidified.

    Args:
        thickness: Lava thickness [m], NaN where there is no lava or no data, any shape.
        least: Minimum thickness [m]. A thickness that a map rounds to it counts.

    Returns:
        True in cells with lava, bool, same shape.
    """
    return np.asarray(thickness) >= np.float32(least * (1.0 - _ROUNDING))
