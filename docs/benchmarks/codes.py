# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare codes on the same flow, the same map and one core.

The codes are the presets, the method cells on several cell sizes, both schemes of finite_volumes.c
(plain, and RKL2 steps in stages), and Lava2d from a folder (github.com/davemhyman/lava2d; it needs
numexpr, pandas, netCDF4 and scipy).
All are scored on cells of 5 m, by linear interpolation between larger cells and means over
smaller ones. The exact solution, averaged over the cells, is scored like a code: this is the error
of the map. All codes solve the equation for small slopes, without cos^4 of the slope, the only one
in Lava2d.

The script updates the rows of the named codes in codes.csv; the second command, the tables:

    python docs/benchmarks/codes.py presets cells volumes
    python docs/benchmarks/other_codes.py
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from concurrent.futures import as_completed, ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
import math
from multiprocessing import get_context
import os
from pathlib import Path
from statistics import median
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

import finite_volumes
import numpy as np
from table_text import lines_of

from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.backend.threads import use_threads
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases.case import FLAT, FRONT, GRAVITY, ISOTHERMAL, NU
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

FOLDER = Path(__file__).parent
TABLE = FOLDER / 'codes.csv'
COLUMNS = (
    'case',
    'code',
    'cell_m',
    'quantity',
    'value',
    'unit',
    'cpu_s',
    'low',
    'high',
    'repetitions',
    'machine',
    'command',
)

#: Discharge [m3/s] and radius of the vent [m] in all cases; the lava is ISOTHERMAL.
DISCHARGE, VENT_RADIUS = 10.0, 10.0

#: g / (3 nu) [1/(m s)].
ALPHA = GRAVITY / (3.0 * NU)

#: Sample points along a side of a cell for means.
N_POINTS = 8

#: Cell size of the one map on which all codes are scored [m].
MAP = 5.0

#: Cell size of the reference run, for flows without an exact solution [m].
FINEST = 1.25

#: Other cell sizes of finite volumes [m].
CELLS = (20.0, 10.0, 5.0, 2.5)

#: Environment that limits Lava2d to one core.
ONE_THREAD = {**os.environ, 'NUMEXPR_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}

PRESETS = ('draft', 'standard')

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Result(NamedTuple):
    """Thickness [m], shape [rows, columns], and the CPU time of each repetition [s]."""

    thickness: np.ndarray
    seconds: list[float]


@dataclass(frozen=True)
class Flow:
    """A flow on a rectangle of cells; the vent is at 0, 0.

    Attributes:
        name: Its name.
        window: Minimum x and y, maximum x and y [m]: multiples of all cell sizes.
        end: Simulated time of the comparison [s].
        ground: Elevation [m] at positions.
        scores: Scores of a thickness on the map: quantity, value and unit.
        exact: Exact thickness [m] at positions; None: the reference is the scheme in
            stages on FINEST.
    """

    name: str
    window: tuple[float, float, float, float]
    end: float
    ground: Function
    scores: Callable[[Flow, np.ndarray], Iterator[tuple[str, float, str]]]
    exact: Function | None = None

    def centres(self, cell: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions of cell centres, x and y [m]."""
        x0, y0, x1, y1 = self.window
        x, y = (np.arange(a + 0.5 * cell, b, cell) for a, b in ((x0, x1), (y0, y1)))
        return tuple(np.meshgrid(x, y))

    def means(self, function: Function, cell: float) -> np.ndarray:
        """Return the means of a function over the cells."""
        x, y = self.centres(cell)
        shifts = ((np.arange(N_POINTS) + 0.5) / N_POINTS - 0.5) * cell
        return sum(function(x + dx, y + dy) for dx in shifts for dy in shifts) / N_POINTS**2

    def expected(self) -> np.ndarray:
        """Return the expected thickness on the map [m]."""
        return finest(self.name) if self.exact is None else self.means(self.exact, MAP)


def on_map(flow, thickness, cell):
    """Return the thickness on the cells of the map: means, or linear between larger cells."""
    if cell > MAP:
        for axis in (0, 1):
            count = thickness.shape[axis]
            places = (np.arange(round(count * cell / MAP)) + 0.5) * MAP / cell - 0.5
            line = partial(np.interp, places, np.arange(count))
            thickness = np.apply_along_axis(line, axis, thickness)
        rows, columns = flow.centres(MAP)[0].shape
        return thickness[:rows, :columns]
    parts = round(MAP / cell)
    rows, columns = (side // parts for side in thickness.shape)
    return thickness.reshape(rows, parts, columns, parts).mean(axis=(1, 3))


def distance(thickness, expected):
    """Return the difference between two thicknesses, relative to the expected volume [%]."""
    return 100.0 * np.abs(thickness - expected).sum() / expected.sum()


SPREAD = exact.ConstantFluxSpread(DISCHARGE, NU, GRAVITY)
HOUR = 3600.0


def spread_scores(flow, thickness):
    """Yield the errors of the radius of the covered area and of the thickness."""
    covered = np.count_nonzero(thickness > FRONT) * MAP**2
    if flow.window[1] == 0.0:
        covered *= 2.0
    radius = math.sqrt(covered / math.pi)
    yield 'radius', 100.0 * (radius / SPREAD.radius_of_thickness(FRONT, flow.end) - 1.0), '%'
    yield 'profile', distance(thickness, flow.expected()), '%'


def spread(name, window):
    """Return a constant flux onto a plane (Huppert 1982)."""
    return Flow(
        name,
        window,
        HOUR,
        lambda x, y: np.zeros_like(x),
        spread_scores,
        lambda x, y: SPREAD.thickness(np.hypot(x, y), HOUR),
    )


#: The valley: its slope along x and that of its walls, and the x of the measured reach [m].
FALL, WALL, REACH = math.tan(math.radians(5.0)), 0.1, (350.0, 750.0)

#: Thickness in the middle of the stream with a level surface [m]: Q = alpha FALL h^4 / 2 WALL.
MIDDLE = (2.0 * WALL * DISCHARGE / (ALPHA * FALL)) ** 0.25

#: Cross section of the stream [m2]; the speed of the front is discharge over section.
SECTION = MIDDLE**2 / WALL


def valley_scores(flow, thickness):
    """Yield the errors of the front, the cross section and the thickness of the stream.

    The front is at half of the exact section.
    """
    x, _ = flow.centres(MAP)
    section = thickness.sum(axis=0) * MAP
    last = int(np.flatnonzero(section > 0.5 * SECTION)[-1])
    part = (section[last] - 0.5 * SECTION) / (section[last] - section[last + 1])
    front = x[0, last] + part * MAP
    yield 'front', 100.0 * (front * SECTION / (DISCHARGE * flow.end) - 1.0), '%'
    reach = (x[0] > REACH[0]) & (x[0] < REACH[1])
    stream = thickness[:, reach]
    expected = flow.expected()[:, reach]
    yield 'section', 100.0 * (stream.sum() / expected.sum() - 1.0), '%'
    yield 'profile', distance(stream, expected), '%'


def area_scores(flow, thickness):
    """Yield the errors of the covered area and of the thickness, relative to FINEST."""
    expected = flow.expected()
    covered = [np.count_nonzero(item > FRONT) for item in (thickness, expected)]
    yield 'area', 100.0 * (covered[0] / covered[1] - 1.0), '%'
    yield 'profile', distance(thickness, expected), '%'


def bumps(x, y, height, length):
    """Return the elevation of hills and hollows with a wavelength in both directions, all in m."""
    x, y = (2.0 * math.pi / length * item for item in (x, y))
    # no line of symmetry, and the vent is on a slope
    return height * (np.sin(x + 0.4 * y + 0.7) + np.sin(0.7 * x - y + 2.0))


def hill(x, y, height, width):
    """Return the elevation of a hill in the way of a flow [m]."""
    return height * np.exp(-((x - 150.0) ** 2 + (y - 10.0) ** 2) / (2.0 * width**2))


#: Other grounds, whose reference is the scheme in stages on FINEST.
GROUNDS = {
    'hill': lambda x, y: hill(x, y, 15.0, 30.0) - FALL * x,
    'low_hill': lambda x, y: hill(x, y, 5.0, 15.0) - FALL * x,
    'slope': lambda x, y: -FALL * x,
    'gentle_slope': lambda x, y: -0.5 * FALL * x,
    'gully': lambda x, y: 0.001 * y**2 - FALL * x,
    'rough': lambda x, y: bumps(x, y, 2.0, 80.0) - FALL * x,
    'rougher': lambda x, y: bumps(x, y, 1.5, 40.0) + bumps(y, -x, 3.0, 130.0) - FALL * x,
}

FLOWS = {
    flow.name: flow
    for flow in (
        spread('constant_flux', (-130.0, -130.0, 130.0, 130.0)),
        spread('constant_flux_half', (-130.0, 0.0, 130.0, 130.0)),
        Flow(
            'valley',
            (-100.0, -100.0, 1800.0, 100.0),
            7200.0,
            lambda x, y: WALL * np.abs(y) - FALL * x,
            valley_scores,
            lambda x, y: np.maximum(MIDDLE - WALL * np.abs(y), 0.0),
        ),
        *(
            Flow(name, (-60.0, -200.0, 480.0, 200.0), HOUR, ground, area_scores)
            for name, ground in GROUNDS.items()
        ),
    )
}


def exact_means(flow, cell, _):
    """Return the exact solution as means over the cells."""
    return Result(flow.expected(), [])


def timed(repetitions, run):
    """Return the last result of several runs, and the CPU time of each."""
    seconds = []
    for _ in range(repetitions):
        begin = time.process_time()
        result = run()
        seconds.append(time.process_time() - begin)
    return Result(result, seconds)


def preset(name, method='particles'):
    """Return a function that runs a preset, with compiled kernels; cells have the size given."""

    def run(flow, cell, repetitions):
        accuracy = replace(preset_accuracy(name), method=method)
        x0, y0, _, _ = flow.window
        terrain = Terrain(flow.ground(*flow.centres(cell)), cell, origin=(x0, y0))
        vent = Vent((0.0, 0.0), DISCHARGE, radius=VENT_RADIUS)
        scene = Scene(terrain, (vent,), ISOTHERMAL, gravity=GRAVITY)

        def thickness(end=flow.end):
            simulation = Simulation(
                scene,
                effects=FLAT,
                accuracy=accuracy,
                device='cpu',
                horizon=flow.end,
            )
            simulation.advance(end)
            return np.nan_to_num(simulation.snapshot().thickness).astype(float)

        thickness(1.0)
        return timed(repetitions, thickness)

    return run


def volumes(scheme):
    """Return a function that runs a scheme of finite_volumes.c."""

    def run(flow, cell, repetitions):
        z = flow.ground(*flow.centres(cell))
        source = flow.means(lambda x, y: 1.0 * (np.hypot(x, y) < VENT_RADIUS), cell)
        half = 0.5 if flow.window[1] == 0.0 else 1.0
        source *= half * DISCHARGE / (source.sum() * cell**2)
        finite_volumes.library()
        return timed(repetitions, lambda: scheme(z, cell, source, ALPHA, flow.end))

    return run


def staged(*arguments):
    """Return the thickness by the scheme in stages."""
    return finite_volumes.in_stages(*arguments).thickness


def lava2d(folder):
    """Return a function that runs Lava2d without heat, and measures the time of ``sim.run``."""

    def run(flow, cell, repetitions):
        seconds = []
        with tempfile.TemporaryDirectory() as place:
            output = f'{place}/out.npz'
            script = [sys.executable, FOLDER / 'lava2d.py', folder, flow.name, f'{cell:g}', output]
            for _ in range(repetitions):
                subprocess.run(script, env=ONE_THREAD, stdout=subprocess.DEVNULL, check=True)
                with np.load(output) as out:
                    thickness, second = out['thickness'], float(out['seconds'])
                seconds.append(second)
        return Result(thickness, seconds)

    return run


@lru_cache
def finest(name):
    """Return the thickness on the map of a flow by the scheme in stages on FINEST."""
    flow = FLOWS[name]
    return on_map(flow, volumes(staged)(flow, FINEST, 1).thickness, FINEST)


def codes(folder):
    """Yield all runs: group, name of the flow, name of the code, cell size [m] and function."""
    for name in FLOWS:
        half = name.endswith('_half')
        for cell in CELLS:
            # the cells have to fill the window
            x0, y0, x1, y1 = FLOWS[name].window
            if (x1 - x0) % cell or (y1 - y0) % cell:
                continue
            if name.startswith('constant_flux') and cell == MAP:
                yield 'volumes', name, 'exact solution', cell, exact_means
            yield 'volumes', name, 'plain scheme', cell, volumes(finite_volumes.plain)
            yield 'volumes', name, 'RKL2 scheme', cell, volumes(staged)
        for cell in () if half else CELLS:
            yield 'cells', name, 'cells', cell, preset('standard', 'cells')
        for item in () if half else PRESETS:
            yield 'presets', name, item, MAP, preset(item)
        for cell in () if half or folder is None else (10.0, MAP):
            yield 'lava2d', name, 'Lava2d', cell, lava2d(folder)


def rows_of(number, repetitions, folder):
    """Return the rows of one run, by its number among all."""
    use_threads(1)
    group, name, code, cell, run = list(codes(folder))[number]
    flow = FLOWS[name]
    result = run(flow, cell, repetitions)
    spent = sorted(result.seconds)
    times = [f'{item:.3g}' for item in (median(spent), spent[0], spent[-1])] if spent else [''] * 3
    rows = []
    for quantity, value, unit in flow.scores(flow, on_map(flow, result.thickness, cell)):
        row = (
            name, code, f'{cell:g}', quantity, f'{value:.4g}', unit, *times, len(spent),
            machine_name('cpu'), f'python docs/benchmarks/codes.py {group}',
        )
        rows.append(dict(zip(COLUMNS, row, strict=True)))
    return rows


def main():
    """Run codes and update their rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('group', nargs='+', choices=('presets', 'cells', 'volumes', 'lava2d'))
    parser.add_argument('--lava2d', metavar='FOLDER', help='a checkout of Lava2d')
    parser.add_argument('--flow', action='append', choices=FLOWS, help='a flow (default: all)')
    parser.add_argument('--repetitions', type=int, default=3)
    parser.add_argument('--processes', type=int, default=1, help='runs at the same time')
    chosen = parser.parse_args()
    if 'lava2d' in chosen.group and chosen.lava2d is None:
        parser.error('lava2d takes --lava2d FOLDER')
    known = lines_of(TABLE) if TABLE.exists() else []
    rows = {tuple(row[column] for column in COLUMNS[:4]): row for row in known}
    every = list(codes(chosen.lava2d))
    numbers = [
        number for number, (group, name, *_) in enumerate(every)
        if group in chosen.group and name in (chosen.flow or FLOWS)
    ]
    with ProcessPoolExecutor(chosen.processes, mp_context=get_context('spawn')) as pool:
        run = partial(pool.submit, rows_of)
        done = [run(number, chosen.repetitions, chosen.lava2d) for number in numbers]
        for future in as_completed(done):
            for row in future.result():
                rows[tuple(row[column] for column in COLUMNS[:4])] = row
                print(*row.values(), flush=True)
            # without rows of obsolete runs
            order = [(name, code, f'{cell:g}') for _, name, code, cell, _ in codes('')]
            kept = [row for made in order for key, row in rows.items() if key[:3] == made]
            write_csv(kept, TABLE)


if __name__ == '__main__':
    main()
