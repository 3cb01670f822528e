# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compute the references of the cases `cooling_plane` and `cooling_front` with finite volumes.

    python docs/benchmarks/cooling_plane.py 5 2.5 1.25 0.625

writes a row for each cell size [m] to cooling_plane.csv: the front [m] and, for each column of the
map by its distance from the vent [m], the number of cells of 5 m on one side of the axis with a
mean thickness above 0.1 m. The flow is symmetric, so half of it is computed. The
reference of `cooling_front` is the result of `front_profile`.
"""

import csv
from pathlib import Path
import sys

import numpy as np

from lava_ros.scene import Lava
from lava_ros.verification.cases import cooling
from lava_ros.verification.cases.case import FRONT, GRAVITY
from lava_ros.verification.exact import surface_loss

#: Borders of the computed half, all beyond the flow, and cell size of the map [m].
WEST, EAST, NORTH, MAP = -20.0, 290.0, 40.0, 5.0


def cooling_flow(
    lava: Lava, source: np.ndarray, cell: float, slope: float, until: float, *, initial: float,
    ambient: float, gravity: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Thickness [m] and temperature [K] of a cooling flow by finite volumes, from no lava.

    Explicit steps for the volume and the heat of square cells with closed borders. Both are of
    second order where the flow is smooth: the thickness that runs down the slope and the
    temperature that it carries are extrapolated to the faces of cells, with van Leer's limiter.
    Spreading is central, with the mean of h^3 along the line between two thicknesses. cos^4 b is
    left out.

    Args:
        lava: Arrhenius law, heat capacity and heat loss; the yield strength is ignored.
        source: Emission [m/s], shape [rows, columns]; the ground falls along a row.
        cell: Side of a cell [m].
        slope: tan b.
        until: The end [s].
        initial: Temperature of emitted lava [K].
        ambient: Temperature of the air [K].
        gravity: g [m/s2].
    """
    shape = source.shape
    thickness, temperature = np.zeros(shape), np.full(shape, initial)
    capacity = lava.density * lava.specific_heat
    weight = lava.density * gravity / (3.0 * lava.viscosity)
    time = 0.0
    while time < until:
        cooler = lava.reference_temperature - temperature
        mobility = weight * np.exp(-lava.arrhenius * cooler)
        fastest = float((mobility * thickness**2).max()) + 1e-9
        step = min(
            0.2 * cell**2 / (fastest * float(thickness.max()) + 1e-9),
            0.1 * cell / (fastest * (slope + 0.3)), 0.8 * cell, until - time,
        )
        volume = thickness + step * source
        heat = thickness * temperature + step * source * initial
        for axis, fall in ((1, slope), (0, 0.0)):
            fields = [
                np.moveaxis(field, axis, 0)
                for field in (thickness, temperature, mobility, volume, heat)
            ]
            _exchange(fields, fall, step / cell, cell)
        is_wet = volume > 1e-12
        thickness = np.where(is_wet, volume, 0.0)
        mixed = np.where(is_wet, heat / np.maximum(volume, 1e-12), initial)
        stored = capacity * np.maximum(thickness, 1e-9) * np.maximum(mixed - ambient, 1e-9)
        rate = surface_loss(lava, mixed, ambient) / stored
        cooled = ambient + (mixed - ambient) * np.exp(-rate * step)
        temperature = np.where(is_wet, cooled, initial)
        time += step
    return thickness, temperature


def _exchange(fields: list[np.ndarray], fall: float, ratio: float, cell: float) -> None:
    """Move volume and heat, the last fields, between neighbours along the first axis.

    The others are thickness, temperature and mobility before the step, which is ``ratio`` times as
    long [s] as the cell [m].
    """
    h, t, mobility, volume, heat = fields
    if len(h) == 1:
        return
    wet = h > 0.0
    a, b = h[:-1], h[1:]
    both = 0.5 * (mobility[:-1] + mobility[1:])
    both = np.where(wet[:-1] & wet[1:], both, np.where(wet[:-1], mobility[:-1], mobility[1:]))
    spread = 0.25 * (a + b) * (a * a + b * b) * (b - a) / cell
    upper = np.maximum((h + 0.5 * _limited(h))[:-1], 0.0)
    flux = np.clip(both * (upper**3 * fall - spread) * ratio, -0.25 * b, 0.25 * a)
    # dry neighbours have no temperature
    rise = 0.5 * _limited(t)
    rise[1:-1] *= wet[:-2] & wet[2:]
    carried = flux * np.where(flux > 0.0, (t + rise)[:-1], (t - rise)[1:])
    for total, moved in ((volume, flux), (heat, carried)):
        total[:-1] -= moved
        total[1:] += moved


def _limited(field: np.ndarray) -> np.ndarray:
    """Return the difference across a cell along axis 0 by van Leer's limiter; 0 at borders."""
    found = np.zeros_like(field)
    before, after = field[1:-1] - field[:-2], field[2:] - field[1:-1]
    product, total = before * after, before + after
    is_smooth = product > 0.0
    found[1:-1][is_smooth] = 2.0 * product[is_smooth] / total[is_smooth]
    return found


def front_profile(cell: float = cooling.CELL) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places x, thickness [m] and temperature [K] of the sheet, [cells]."""
    x = np.arange(-cooling.REACH, 220.0, cell) + 0.5 * cell
    source = np.where(x < cooling.REACH, 0.5 * cooling.FLUX / cooling.REACH, 0.0)[None]
    thickness, temperature = cooling_flow(
        cooling.STIFFENING, source, cell, np.tan(cooling.SLOPE), cooling.FRONT_TIME,
        initial=cooling.HOT, ambient=cooling.COLD, gravity=GRAVITY,
    )
    return x, thickness[0], temperature[0]


def flow_on(cell: float) -> tuple[float, np.ndarray]:
    """Return the front [m] and the wet cells of each column of the map, for a cell size [m]."""
    x = np.arange(WEST, EAST, cell) + 0.5 * cell
    y = np.arange(0.0, NORTH, cell) + 0.5 * cell
    source = (np.hypot(x, y[:, None]) < cooling.RADIUS).astype(float)
    source *= 0.5 * cooling.DISCHARGE / (source.sum() * cell**2)
    thickness, _ = cooling_flow(
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
