# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compute the reference of the case `cooling_plane` with finite volumes.

    python docs/benchmarks/cooling_plane.py 5 2.5 1.25

writes a row for each cell size [m] to cooling_plane.csv: the front [m] and, for each column of the
map by its distance from the vent [m], the number of cells of 5 m on one side of the axis with a
mean thickness above 0.1 m. The flow is symmetric, so half of it is computed.
"""

import csv
from pathlib import Path
import sys

import numpy as np

from lava_ros.verification import exact
from lava_ros.verification.cases import cooling
from lava_ros.verification.cases.case import FRONT, GRAVITY

#: Borders of the computed half, all beyond the flow, and cell size of the map [m].
WEST, EAST, NORTH, MAP = -20.0, 290.0, 40.0, 5.0


def flow_on(cell: float) -> tuple[float, np.ndarray]:
    """Return the front [m] and the wet cells of each column of the map, for a cell size [m]."""
    x = np.arange(WEST, EAST, cell) + 0.5 * cell
    y = np.arange(0.0, NORTH, cell) + 0.5 * cell
    source = (np.hypot(x, y[:, None]) < cooling.RADIUS).astype(float)
    source *= 0.5 * cooling.DISCHARGE / (source.sum() * cell**2)
    thickness, _ = exact.cooling_flow(
        cooling.STIFFENING, source, cell, np.tan(cooling.SLOPE), cooling.END,
        initial=cooling.HOT, ambient=cooling.COLD, gravity=GRAVITY,
    )
    front = float(x[(thickness > FRONT).any(axis=0)].max() + 0.5 * cell)
    many = round(MAP / cell)
    mean = thickness.reshape(round(NORTH / MAP), many, -1, many).mean(axis=(1, 3))
    return front, (mean > FRONT).sum(axis=0)


if __name__ == '__main__':
    with Path(__file__).with_suffix('.csv').open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        places = np.arange(WEST, EAST, MAP) + 0.5 * MAP
        writer.writerow(['cell', 'front', *(f'{place:g}' for place in places)])
        for cell in map(float, sys.argv[1:]):
            front, wet = flow_on(cell)
            writer.writerow([f'{cell:g}', f'{front:g}', *wet])
            file.flush()
