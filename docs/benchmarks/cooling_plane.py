# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compute the references of the cases `cooling_plane` and `cooling_front` with finite volumes.

    python docs/benchmarks/cooling_plane.py 5 2.5 1.25 0.625
    python docs/benchmarks/cooling_plane.py carriers

writes a row for each cell size [m] to cooling_plane.csv: the front [m] and, for each column of the
map by its distance from the vent [m], the number of cells of 5 m on one side of the axis that are
covered at least half by lava thicker than 0.1 m. The flow is symmetric, so half of it is computed.
The reference of `cooling_front` is the result of `front_profile`.

`carriers` compares three carriers of heat on the same cells, in cell_heat.csv: van Leer's limited
slope, a limited slope of third order (Koren 1993), and about four tracers a cell that carry the
temperature with the velocity of the lava. Errors are over the reference of `cooling_plane`, and
over the same sheet below a wall on cells of 1.25 m by van Leer's slope.
"""

from collections.abc import Callable
import csv
from pathlib import Path
import sys
import time as wall_clock

import numpy as np

from lava_ros.scene import Lava
from lava_ros.simulation.output.inundation import footprint_cells
from lava_ros.verification import exact
from lava_ros.verification.cases import case, cooling
from lava_ros.verification.cases.case import FRONT, GRAVITY
from lava_ros.verification.exact import surface_loss

#: Borders of the computed half, all beyond the flow, and cell size of the map [m].
WEST, EAST, NORTH, MAP = -20.0, 290.0, 40.0, 5.0


def cooling_flow(
    lava: Lava, source: np.ndarray, cell: float, slope: float, until: float, *, initial: float,
    ambient: float, gravity: float, carrier: str = 'van Leer',
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
        carrier: Carrier of the temperature, one of ``CARRIERS``.
    """
    shape = source.shape
    thickness, temperature = np.zeros(shape), np.full(shape, initial)
    capacity = lava.density * lava.specific_heat
    weight = lava.density * gravity / (3.0 * lava.viscosity)
    tracers = Tracers(source, initial) if carrier == 'tracers' else None
    limited = CARRIERS[carrier]

    def cooled(hot: np.ndarray, depth: np.ndarray, step: float) -> np.ndarray:
        stored = capacity * np.maximum(depth, 1e-9) * np.maximum(hot - ambient, 1e-9)
        rate = surface_loss(lava, hot, ambient) / stored
        return ambient + (hot - ambient) * np.exp(-rate * step)

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
        fluxes = []
        for axis, fall in ((1, slope), (0, 0.0)):
            fields = [
                np.moveaxis(field, axis, 0)
                for field in (thickness, temperature, mobility, volume, heat)
            ]
            flux = _exchange(fields, fall, step / cell, cell, limited)
            fluxes.append(np.moveaxis(flux, 0, axis))
        is_wet = volume > 1e-12
        before, thickness = thickness, np.where(is_wet, volume, 0.0)
        mixed = np.where(is_wet, heat / np.maximum(volume, 1e-12), initial)
        if tracers is None:
            temperature = np.where(is_wet, cooled(mixed, thickness, step), initial)
        else:
            tracers.move(before, thickness, fluxes, step, mixed)
            depth = np.maximum(tracers.at(thickness), THIN)
            tracers.temperature = cooled(tracers.temperature, depth, step)
            temperature = np.where(is_wet, tracers.mean(temperature), initial)
        time += step
    return thickness, temperature


def _exchange(
    fields: list[np.ndarray], fall: float, ratio: float, cell: float,
    limited: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
) -> np.ndarray:
    """Move volume and heat, the last fields, between neighbours along the first axis.

    The others are thickness, temperature and mobility before the step, which is ``ratio`` times as
    long [s] as the cell [m]. Returns the thickness that passes each face [m].
    """
    h, t, mobility, volume, heat = fields
    if len(h) == 1:
        return np.zeros((0, *h.shape[1:]))
    wet = h > 0.0
    a, b = h[:-1], h[1:]
    both = 0.5 * (mobility[:-1] + mobility[1:])
    both = np.where(wet[:-1] & wet[1:], both, np.where(wet[:-1], mobility[:-1], mobility[1:]))
    spread = 0.25 * (a + b) * (a * a + b * b) * (b - a) / cell
    upper = np.maximum((h + 0.5 * van_leer(h)[0])[:-1], 0.0)
    flux = np.clip(both * (upper**3 * fall - spread) * ratio, -0.25 * b, 0.25 * a)
    # dry neighbours have no temperature
    slopes = limited(t)
    for slope in slopes:
        slope[1:-1] *= 0.5 * (wet[:-2] & wet[2:])
    carried = flux * np.where(flux > 0.0, (t + slopes[0])[:-1], (t - slopes[1])[1:])
    for total, moved in ((volume, flux), (heat, carried)):
        total[:-1] -= moved
        total[1:] += moved
    return flux


def _differences(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return field[1:-1] - field[:-2], field[2:] - field[1:-1]


def van_leer(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return van Leer's limited difference across a cell along axis 0, for flow up and down it.

    It is 0 at borders, and the same for both.
    """
    found = np.zeros_like(field)
    before, after = _differences(field)
    product, total = before * after, before + after
    is_smooth = product > 0.0
    found[1:-1][is_smooth] = 2.0 * product[is_smooth] / total[is_smooth]
    return found, found.copy()


def koren(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the same by a limiter of third order (Koren 1993)."""
    found = np.zeros((2, *field.shape))
    before, after = _differences(field)
    for slope, behind, ahead in ((found[0], before, after), (found[1], after, before)):
        sizes = np.abs([2.0 * behind, 2.0 * ahead, (behind + 2.0 * ahead) / 3.0])
        slope[1:-1] = np.where(behind * ahead > 0.0, np.sign(ahead) * sizes.min(axis=0), 0.0)
    return found[0], found[1]


def superbee(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the same by the most compressive limiter of second order (Roe 1986), for both."""
    found = np.zeros_like(field)
    before, after = _differences(field)
    small, large = np.abs(before), np.abs(after)
    sizes = np.maximum(np.minimum(2.0 * small, large), np.minimum(small, 2.0 * large))
    found[1:-1] = np.where(before * after > 0.0, np.sign(after) * sizes, 0.0)
    return found, found.copy()


#: Limited differences by carrier of heat; tracers do not use that of the cells.
CARRIERS = {
    'van Leer': van_leer, 'third order': koren, 'superbee': superbee, 'tracers': van_leer,
}

#: Tracers of a cell that come out of a vent, and maximum number in any cell.
TRACERS, MAX_TRACERS = 4, 8

#: Thickness without tracers [m], and over that of the thickest neighbour below which lava mixes.
THIN, MIXED = 1e-3, 0.5


class Tracers:
    """Points that carry a temperature with the velocity of the lava.

    Attributes:
        place: Column and row of each, shape [count, 2]; cell (0, 0) is between 0 and 1.
        temperature: Temperature of each [K], shape [count].
    """

    def __init__(self, source: np.ndarray, initial: float) -> None:
        """Start without tracers; the arguments are those of ``cooling_flow``."""
        self.place, self.temperature = np.empty((0, 2)), np.empty(0)
        self._source, self._initial, self._made = source, initial, 0
        self._due = np.zeros(source.shape)

    def at(self, field: np.ndarray) -> np.ndarray:
        """Return the values of a field in the cells of the tracers."""
        column, row = self.place.astype(int).T
        return field[row, column]

    def mean(self, otherwise: np.ndarray) -> np.ndarray:
        """Return the mean temperature around the centre of each cell, weighted bilinearly."""
        rows, columns = otherwise.shape
        total, weights = np.zeros((2, rows * columns))
        corner = np.floor(self.place - 0.5)
        for step in ((0, 0), (1, 0), (0, 1), (1, 1)):
            cell = corner + step
            weight = np.prod(1.0 - np.abs(self.place - 0.5 - cell), axis=1)
            j, i = np.clip(cell, 0, (columns - 1, rows - 1)).astype(int).T
            index = i * columns + j
            total += np.bincount(index, weight * self.temperature, rows * columns)
            weights += np.bincount(index, weight, rows * columns)
        found = np.where(weights > 1e-6, total / np.maximum(weights, 1e-6), otherwise.ravel())
        return found.reshape(rows, columns)

    def move(
        self, before: np.ndarray, after: np.ndarray, fluxes: list[np.ndarray], step: float,
        mixed: np.ndarray,
    ) -> None:
        """Move the tracers over a step, mix those of thin lava, and add new ones.

        Args:
            before: Thickness before the step [m].
            after: Thickness after it [m].
            fluxes: Thickness that passed the faces along rows and columns [m].
            step: Length of the step [s].
            mixed: Temperature of each cell by the heat that came in [K].
        """
        rows, columns = after.shape
        padded = np.pad(before, 1)
        thickest = np.max(
            [padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1]], axis=0
        )
        thin = before < MIXED * thickest
        self.temperature = np.where(self.at(thin), self.at(mixed), self.temperature)
        speeds = []
        for axis, flux in ((1, fluxes[0]), (0, fluxes[1])):
            h = np.moveaxis(0.5 * (before + after), axis, 0)
            passed = np.moveaxis(flux, axis, 0)
            both, giving = 0.5 * (h[:-1] + h[1:]), np.where(passed > 0.0, h[:-1], h[1:])
            is_even = np.minimum(h[:-1], h[1:]) > 0.3 * np.maximum(h[:-1], h[1:])
            depth = np.maximum(np.where(is_even, both, giving), THIN)
            speed = np.clip(passed / depth, -1.0, 1.0)
            edge = np.zeros((1, speed.shape[1]))
            speeds.append(np.moveaxis(np.concatenate([edge, speed, edge]), 0, axis))
        start, place = self.place, self.place
        for part in (0.5, 1.0):
            j, i = place.astype(int).T
            x, y = (place - np.floor(place)).T
            moved = np.column_stack([
                (1.0 - x) * speeds[0][i, j] + x * speeds[0][i, j + 1],
                (1.0 - y) * speeds[1][i, j] + y * speeds[1][i + 1, j],
            ])
            place = np.clip(start + part * moved, 0.01, (columns - 0.01, rows - 0.01))
        self.place = place
        stays = self.at(after) < THIN
        self.place[stays] = start[stays]
        self._thin_out(columns)
        # what comes out, and cells that no tracer has reached
        self._due += TRACERS * self._source * step / np.maximum(after, 0.05)
        new = self._due >= 1.0
        self._due[new] -= 1.0
        self._add(new, np.full(after.shape, self._initial))
        count = np.zeros(after.shape)
        np.add.at(count, tuple(self.place.astype(int).T[::-1]), 1.0)
        self._add((count == 0.0) & (after > THIN), mixed)

    def _thin_out(self, columns: int) -> None:
        """Drop the tracers of a cell above the maximum number."""
        cell = self.place[:, 1].astype(int) * columns + self.place[:, 0].astype(int)
        order = np.argsort(cell, kind='stable')
        ranked = cell[order]
        rank = np.arange(len(ranked)) - np.searchsorted(ranked, ranked)
        kept = np.sort(order[rank < MAX_TRACERS])
        self.place, self.temperature = self.place[kept], self.temperature[kept]

    def _add(self, where: np.ndarray, temperature: np.ndarray) -> None:
        """Add a tracer to each of some cells, at places that fill a cell evenly (R2 sequence)."""
        i, j = np.nonzero(where)
        number = self._made + np.arange(len(i)) + 1
        self._made += len(i)
        inside = np.column_stack([number * 0.7548776662466927, number * 0.5698402909980532]) % 1.0
        self.place = np.concatenate([self.place, np.column_stack([j, i]) + inside])
        self.temperature = np.concatenate([self.temperature, temperature[where]])


def front_profile(
    cell: float = cooling.CELL, carrier: str = 'van Leer', *, top: float = cooling.TOP
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places x, thickness [m] and temperature [K] of the sheet, [cells].

    The slope begins at x = ``top`` [m], where nothing flows out.
    """
    x = np.arange(top, cooling.BOTTOM, cell) + 0.5 * cell
    source = np.where(np.abs(x) < cooling.REACH, 0.5 * cooling.FLUX / cooling.REACH, 0.0)[None]
    thickness, temperature = cooling_flow(
        cooling.STIFFENING, source, cell, np.tan(cooling.SLOPE), cooling.FRONT_TIME,
        initial=cooling.HOT, ambient=cooling.COLD, gravity=GRAVITY, carrier=carrier,
    )
    return x, thickness[0], temperature[0]


def flow_on(cell: float, carrier: str = 'van Leer') -> tuple[float, np.ndarray]:
    """Return the front [m] and the footprint's cells by column of the map, for a cell size [m]."""
    x = np.arange(WEST, EAST, cell) + 0.5 * cell
    y = np.arange(0.0, NORTH, cell) + 0.5 * cell
    source = (np.hypot(x, y[:, None]) < cooling.RADIUS).astype(float)
    source *= 0.5 * cooling.DISCHARGE / (source.sum() * cell**2)
    thickness, _ = cooling_flow(
        cooling.STIFFENING, source, cell, np.tan(cooling.SLOPE), cooling.END,
        initial=cooling.HOT, ambient=cooling.COLD, gravity=GRAVITY, carrier=carrier,
    )
    front = float(x[(thickness > FRONT).any(axis=0)].max() + 0.5 * cell)
    many = round(MAP / cell)
    is_wet = (thickness > FRONT).reshape(round(NORTH / MAP), many, -1, many)
    return front, footprint_cells(is_wet.mean(axis=(1, 3))).sum(axis=0)


def errors_of(carrier: str, cell: float) -> list[str]:
    """Return the errors of a carrier's fronts and area, and its time [s] over both flows."""
    start = wall_clock.process_time()
    front, wet = flow_on(cell, carrier)
    x, thickness, _ = front_profile(cell, carrier, top=-cooling.REACH)
    spent = wall_clock.process_time() - start
    expected = np.zeros(len(wet))
    first = round((exact.PLANE_FIRST - WEST) / MAP - 0.5)
    expected[first : first + len(exact.PLANE_CELLS)] = exact.PLANE_CELLS
    apart = 1.0 - np.minimum(wet, expected).sum() / np.maximum(wet, expected).sum()
    reference = case.front(*front_profile(top=-cooling.REACH)[:2], FRONT)
    sheet = case.front(x, thickness, FRONT)
    errors = (front / exact.PLANE_FRONT - 1.0, apart, sheet / reference - 1.0)
    return [carrier, f'{cell:g}', *(f'{error:.4f}' for error in errors), f'{spent:.1f}']


def compare_carriers() -> None:
    """Write the errors of all carriers to cell_heat.csv."""
    with Path(__file__).with_name('cell_heat.csv').open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(['carrier', 'cell', 'plane front', 'plane area', 'sheet front', 'cpu'])
        for cell in (5.0, 2.5):
            for carrier in CARRIERS:
                writer.writerow(errors_of(carrier, cell))
                file.flush()


if __name__ == '__main__' and sys.argv[1:] == ['carriers']:
    compare_carriers()
elif __name__ == '__main__':
    with Path(__file__).with_suffix('.csv').open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        places = np.arange(WEST, EAST, MAP) + 0.5 * MAP
        writer.writerow(['cell', 'front', *(f'{place:g}' for place in places)])
        for cell in map(float, sys.argv[1:]):
            front, wet = flow_on(cell)
            writer.writerow([f'{cell:g}', f'{front:g}', *wet])
            file.flush()
