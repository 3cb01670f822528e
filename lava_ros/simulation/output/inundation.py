# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Inundated area, footprint, reached cells and standing lava, as in all outputs.

The first three follow from the fraction of each cell that lava has covered (``covered_cells.py``).
"""

import numpy as np

from lava_ros.scene.terrain import PARTS

#: Covered fraction of a cell that lava has touched, but of which it has covered no square.
TOUCHED = 0.5 / PARTS**2

#: Units in which areas of cells are counted: a cell, its squares and quarters of these have whole
#: numbers of them.
_UNITS = 8 * PARTS**2

#: Maximum relative rounding error of a thickness in a map.
_ROUNDING = 1e-5


def squares_in(bits: np.ndarray) -> np.ndarray:
    """Return the number of bits that are set in each item of an int32 array, as int64."""
    # sums of pairs, of groups of four, and of bytes
    count = bits - (bits >> 1 & 0x55555555)
    count = (count & 0x33333333) + (count >> 2 & 0x33333333)
    count = count + (count >> 4) & 0x0F0F0F0F
    return (count.astype(np.int64) * 0x01010101 >> 24) & 0xFF


def inundated_fraction(arrived: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Return the fraction of each cell that lava has covered so far.

    Args:
        arrived: First arrival time [s], negative or NaN without arrival, any shape.
        squares: Covered squares of the cells, one bit each, int32, same shape.

    Returns:
        Fraction from 0 to 1, float32, same shape; above 0 in each cell that lava has reached.
    """
    part = squares_in(squares).astype(np.float32) / np.float32(PARTS**2)
    return np.where(arrived >= 0.0, np.fmax(part, np.float32(TOUCHED)), np.float32(0.0))


def reached_cells(arrived: np.ndarray) -> np.ndarray:
    """Return the cells that lava has touched at any time so far.

    Args:
        arrived: First arrival time [s], NaN without arrival (``Snapshot.arrived``), any shape.

    Returns:
        True in cells that lava has reached, bool, same shape.
    """
    return np.isfinite(arrived)


def footprint_cells(inundated: np.ndarray) -> np.ndarray:
    """Return the cells of which lava has covered at least half so far.

    Args:
        inundated: Inundated fraction (``Snapshot.inundated``), NaN without data, any shape.

    Returns:
        True in the cells of the footprint, bool, same shape.
    """
    return np.asarray(inundated) >= 0.5


def area_of(cells: np.ndarray, resolution: float) -> float:
    """Return the area of a mask or of fractions of cells [m2].

    The inundated area is the area of the inundated fraction.

    Args:
        cells: Mask, bool, or fraction (``Snapshot.inundated``), NaN without data, shape [rows,
            columns].
        resolution: Side of a cell [m].
    """
    # a sum of integers does not depend on its order
    parts = np.rint(np.nan_to_num(np.asarray(cells, dtype=np.float64)) * _UNITS).sum()
    return float(parts * resolution**2 / _UNITS)


def standing_part(standing: np.ndarray, inundated: np.ndarray | None) -> np.ndarray:
    """Return the fraction of each cell on which lava stands: the inundated part, if it has lava.

    Args:
        standing: Cells with lava, bool, any shape.
        inundated: Inundated fraction, same shape; None if it is unknown: lava then covers all of
            a cell.

    Returns:
        Fraction from 0 to 1, of which the area is that of standing lava.
    """
    return standing if inundated is None else np.where(standing, inundated, np.float32(0.0))


def raise_peak(peak: np.ndarray, arrived: np.ndarray, threshold: float) -> np.ndarray:
    """Return the peak thickness of maps, at least the threshold where lava has arrived.

    Lava may arrive and drain between two maps.

    Args:
        peak: Peak thickness of all maps [m], any shape.
        arrived: First arrival time [s], NaN without arrival, same shape.
        threshold: Minimum thickness of lava that has arrived [m].

    Returns:
        Peak thickness [m], float32, same shape.
    """
    minimum = np.where(reached_cells(arrived), np.float32(threshold), np.float32(0.0))
    return np.fmax(peak, minimum).astype(np.float32)


def standing_cells(thickness: np.ndarray, minimum: float) -> np.ndarray:
    """Return the cells with lava, flowing or solidified.

    Args:
        thickness: Lava thickness [m], NaN without lava or data, any shape.
        minimum: Minimum thickness [m]. A thickness that a map rounds to it counts.

    Returns:
        True in cells with lava, bool, same shape.
    """
    return np.asarray(thickness) >= np.float32(minimum * (1.0 - _ROUNDING))
