# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the errors of a ground that was interpolated from contours, by leaving out contours.

python docs/benchmarks/contours.py OUT.csv --case DIR --interval M [--every M]

The ground of the case is a thin plate through contours with an interval. It is interpolated again
from every second and every fourth contour, and compared with itself.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.interpolate import RBFInterpolator

from lava_ros.hindcast.case import load_case
from lava_ros.scene import Terrain
from lava_ros.verification.rows import write_csv

#: Number of nearest points of contours that determine the elevation of a cell, and distance of
#: points in intervals on average, so that these points lie on several contours.
NEIGHBORS, APART = 100, 0.5


def contour_points(ground: Terrain, level: float) -> np.ndarray:
    """Return places (x, y) [m] where the lines of cells cross a level, shape [points, 2]."""
    found = []
    for heights, order in ((ground.elevation, (1, 0)), (ground.elevation.T, (0, 1))):
        low, high = heights[:, :-1] - level, heights[:, 1:] - level
        line, along = np.nonzero(low * high < 0.0)
        part = low[line, along] / (low[line, along] - high[line, along])
        places = np.stack([line, along + part], axis=1)
        found.append(places[:, order] * ground.resolution)
    return np.concatenate(found)


def correlation_length(error: np.ndarray, side: float) -> float:
    """Return the distance at which the correlation of a map of errors falls to 1/e [m]."""
    deviation = error - np.nanmean(error)
    for cells in range(1, min(error.shape)):
        pairs = (
            (deviation[:, cells:], deviation[:, :-cells]), (deviation[cells:], deviation[:-cells])
        )
        value = np.mean([np.nanmean(one * other) for one, other in pairs])
        if value < np.nanvar(error) / np.e:
            return cells * side
    return float('nan')


def main() -> None:
    """Measure the ground of the arguments."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--case', required=True, metavar='DIR')
    parser.add_argument('--interval', type=float, required=True, metavar='M')
    parser.add_argument('--every', type=float, default=100.0, metavar='M')
    args = parser.parse_args()
    case = load_case(args.case)
    ground, rows = case.scene.terrain, list[dict[str, object]]()
    stride = max(round(args.every / ground.resolution), 1)
    heights = ground.elevation[::stride, ::stride]
    place = np.stack(np.indices(heights.shape)[::-1], axis=-1) * stride * ground.resolution
    highest = float(np.nanmax(ground.elevation))
    for factor in (2, 4):
        step = factor * args.interval
        for first in (args.interval * index for index in range(factor)):
            levels = np.arange(first or step, highest, step)
            thin = max(round(APART * step / ground.resolution), 1)
            points = [contour_points(ground, level)[::thin] for level in levels]
            values = np.repeat(levels, [len(item) for item in points])
            plate = RBFInterpolator(
                np.concatenate(points), values, neighbors=NEIGHBORS, kernel='thin_plate_spline'
            )
            inside = (heights > levels[0]) & (heights < levels[-1])
            error = np.full(heights.shape, np.nan)
            error[inside] = plate(place[inside]) - heights[inside]
            deviation = float(np.sqrt(np.nanmean(error**2)))
            rows.append({
                'case': case.name, 'interval_m': step, 'first_m': first,
                'deviation_m': deviation, 'deviation_of_interval': deviation / step,
                'correlation_m': correlation_length(error, stride * ground.resolution),
            })
            print(rows[-1], flush=True)
    write_csv(rows, args.output)


if __name__ == '__main__':
    main()
