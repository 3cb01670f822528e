# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Detection of undeclared cells without data, by the cliffs around them."""

from collections.abc import Iterator

import numpy as np

from lava_ros.errors import LavaError

#: Values that files use for cells without data. ``MARKS`` are not elevations near volcanoes, so
#: that a single cell counts; ``BLOCK_MARKS`` may be the sea, so that only a block counts.
MARKS = (-32768.0, -32767.0, -9999.0, -999.0, 9999.0, 32767.0, 65535.0, 99999.0)
BLOCK_MARKS = (-99.0, -1.0, 0.0)

#: Minimum number of cells in a block.
MIN_BLOCK = 4

#: Maximum fraction of all cells with data in blocks: a plane with a few spikes is ground.
MAX_BLOCKS = 0.95

#: Minimum height of the step around cells without data, in cells (a slope of 63 degrees) and in
#: metres: boxes on a laboratory floor are lower.
MIN_STEP, MIN_STEP_HEIGHT = 2.0, 10.0

#: Maximum fraction of the border of such cells with a smaller step.
MAX_SMALL_STEPS = 0.1

#: Minimum gap between invalid elevations and all others [m]; it also exceeds the range of those.
MIN_GAP = 1000.0

#: A step larger than any other [m].
FAR = 1e30

#: Advice in errors, for ``format`` with the value.
NODATA_ADVICE = (
    'if these cells have no data, --nodata {0} or terrain.nodata: {0} in a scene file declares '
    'it, as gdal_edit.py -a_nodata {0} does in a GeoTIFF; --nodata none keeps them as ground'
)


def check_missing(
    field: str, elevation: np.ndarray, cell: float, *, unit: float = 1.0, advice: str = '',
    sea: float | None = None,
) -> None:
    """Raise LavaError if some cells of an elevation probably have no data.

    Args:
        field: Name of the elevation in the error.
        elevation: Elevation as stored, NaN without data, shape [rows, columns].
        cell: Approximate side of a cell [m].
        unit: Unit of the stored values [m].
        advice: Advice for the user, in which ``{0}`` stands for the value.
        sea: Sea level [m], None without a sea: blocks at or below it are the sea.

    Raises:
        LavaError: If a usual value for missing data occurs in a block or a spike with steep steps
            around it, or if some elevations are far away from all others.
    """
    known = elevation[np.isfinite(elevation)]
    if not known.size:
        return
    # differences of such values overflow in 32 bits
    if max(-known.min(), known.max()) > FAR:
        known = known.astype(np.float64)
    # the cell size and the unit have not been validated yet
    unit = min(max(abs(unit), 1.0 / FAR), FAR)
    step = min(max(MIN_STEP * cell, MIN_STEP_HEIGHT) / unit, FAR)
    gap = min(MIN_GAP / unit, FAR)
    level = -FAR if sea is None else sea / unit
    for value, count in (_far_value(known, gap), *_marks_with_cliffs(elevation, known, step)):
        if count and not (value in BLOCK_MARKS and value <= level):
            shown = f'{value:g} in {count} {"cell" if count == 1 else "cells"}'
            expected = f'elevations like those around them ({advice.format(f"{value:g}")})'
            raise LavaError(field, shown, expected)


def _far_value(known: np.ndarray, least: float) -> tuple[float, int]:
    """Return the extreme value of those far away from all others, and their number."""
    low, high = float(known.min()), float(known.max())
    if not high - low > least:
        return low, 0
    bins = 1024
    filled = np.flatnonzero(np.histogram(known, bins, (low, high))[0])
    widest = np.argmax(np.diff(filled))
    middle = 0.5 * (filled[widest] + filled[widest + 1] + 1.0)
    is_below = known < low + middle / bins * (high - low)
    below, above = known[is_below], known[~is_below]
    gap = float(above.min()) - float(below.max())
    if gap < least or gap <= 0.5 * (high - low):
        return low, 0
    # a constant is a mark, even in the majority of cells
    is_constant = below.max() == low, above.min() == high
    is_low = is_constant[0] if is_constant[0] != is_constant[1] else below.size <= above.size
    return (low, below.size) if is_low else (high, above.size)


def _marks_with_cliffs(
    elevation: np.ndarray, known: np.ndarray, least: float
) -> Iterator[tuple[float, int]]:
    """Yield each usual value for missing data, and its number of cells with cliffs around them."""
    for value in (*MARKS, *BLOCK_MARKS):
        is_marked, is_block = elevation == value, value in BLOCK_MARKS
        others = known[known != value]
        if others.size == known.size:
            continue
        # planes, and walls and steps of one height, are synthetic terrain
        if is_block and (others.size < (1.0 - MAX_BLOCKS) * known.size or not np.ptp(others)):
            continue
        # takes 0.2 s to load, and few terrains have such values
        from scipy.ndimage import label

        labels = label(is_marked)[0]
        sizes = np.bincount(labels.ravel())
        border, small = np.zeros((2, sizes.size))
        for one, other in ((labels, elevation), (labels.T, elevation.T)):
            for here, there in ((np.s_[1:], np.s_[:-1]), (np.s_[:-1], np.s_[1:])):
                # steps to cells without data are NaN, which compares as False
                with np.errstate(over='ignore', invalid='ignore'):
                    step = np.abs(other[there] - np.float32(value))
                at = (one[here] > 0) & (step > 0.0)
                border += np.bincount(one[here][at], minlength=sizes.size)
                at &= step < np.float32(least)
                small += np.bincount(one[here][at], minlength=sizes.size)
        is_missing = sizes >= (MIN_BLOCK if is_block else 1)
        is_missing &= (border > 0) & (small <= MAX_SMALL_STEPS * border)
        yield value, int(sizes[1:][is_missing[1:]].sum())
