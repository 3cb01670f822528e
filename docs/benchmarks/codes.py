# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare codes on the same flow, the same grid and one core.

The codes are the presets, the plain scheme of finite_volumes.c (the baseline), and Lava2d from a
folder (github.com/davemhyman/lava2d; it needs numexpr, pandas, netCDF4 and scipy). The exact
solution, averaged over the cells, is scored like a code: this is the error of the grid. All codes
solve the equation for small slopes, without cos^4 of the slope, the only one in Lava2d.

The script updates the rows of the named codes in codes.csv; the second command, the tables:

    taskset --cpu-list 0 python docs/benchmarks/codes.py presets plain
    python docs/benchmarks/other_codes.py
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
import ctypes
from dataclasses import dataclass
from functools import lru_cache
import math
import os
from pathlib import Path
from statistics import median
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

import numpy as np
from tables import lines_of

from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation import Simulation
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

#: Cell size of the reference run of the plain scheme, for flows without an exact solution [m].
FINEST = 1.25

#: Other cell sizes of the plain scheme [m].
CELLS = (20.0, 10.0, 5.0, 2.5)

#: Time step of the plain scheme, as a fraction of the stable step.
STEP_FRACTION = 0.9

#: Environment that limits Lava2d to one core.
ONE_THREAD = {**os.environ, 'NUMEXPR_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}

PRESETS = ('draft', 'standard', 'fine')

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
        scores: Scores of a thickness on cells: quantity, value and unit.
        exact: Exact thickness [m] at positions; None: the reference is the plain scheme on FINEST.
    """

    name: str
    window: tuple[float, float, float, float]
    end: float
    ground: Function
    scores: Callable[[Flow, np.ndarray, float], Iterator[tuple[str, float, str]]]
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

    def expected(self, cell: float) -> np.ndarray:
        """Return the expected thickness on cells [m]."""
        if self.exact is not None:
            return self.means(self.exact, cell)
        fine = finest(self.name)
        rows, columns = (round(side * FINEST / cell) for side in fine.shape)
        blocks = fine.reshape(rows, len(fine) // rows, columns, -1)
        return blocks.mean(axis=(1, 3))


def distance(thickness, expected):
    """Return the difference between two thicknesses, relative to the expected volume [%]."""
    return 100.0 * np.abs(thickness - expected).sum() / expected.sum()


SPREAD = exact.ConstantFluxSpread(DISCHARGE, NU, GRAVITY)
HOUR = 3600.0


def spread_scores(flow, thickness, cell):
    """Yield the errors of the radius of the covered area and of the thickness."""
    covered = np.count_nonzero(thickness > FRONT) * cell**2
    if flow.window[1] == 0.0:
        covered *= 2.0
    radius = math.sqrt(covered / math.pi)
    yield 'radius', 100.0 * (radius / SPREAD.radius_of_thickness(FRONT, flow.end) - 1.0), '%'
    yield 'profile', distance(thickness, flow.expected(cell)), '%'


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


def valley_scores(flow, thickness, cell):
    """Yield the errors of the front, the cross section and the thickness of the stream.

    The front is at half of the exact section.
    """
    x, _ = flow.centres(cell)
    section = thickness.sum(axis=0) * cell
    last = int(np.flatnonzero(section > 0.5 * SECTION)[-1])
    part = (section[last] - 0.5 * SECTION) / (section[last] - section[last + 1])
    front = x[0, last] + part * cell
    yield 'front', 100.0 * (front * SECTION / (DISCHARGE * flow.end) - 1.0), '%'
    reach = (x[0] > REACH[0]) & (x[0] < REACH[1])
    stream = thickness[:, reach]
    expected = flow.expected(cell)[:, reach]
    yield 'section', 100.0 * (stream.sum() / expected.sum() - 1.0), '%'
    yield 'profile', distance(stream, expected), '%'


def area_scores(flow, thickness, cell):
    """Yield the errors of the covered area and of the thickness, relative to FINEST."""
    expected = flow.expected(cell)
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


#: Other grounds, whose reference is the plain scheme on FINEST.
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
    return Result(flow.expected(cell), [])


def timed(repetitions, run):
    """Return the last result of several runs, and the CPU time of each."""
    seconds = []
    for _ in range(repetitions):
        begin = time.process_time()
        result = run()
        seconds.append(time.process_time() - begin)
    return Result(result, seconds)


def preset(name):
    """Return a function that runs a preset with compiled kernels."""

    def run(flow, cell, repetitions):
        x0, y0, _, _ = flow.window
        terrain = Terrain(flow.ground(*flow.centres(cell)), cell, origin=(x0, y0))
        vent = Vent((0.0, 0.0), DISCHARGE, radius=VENT_RADIUS)
        scene = Scene(terrain, (vent,), ISOTHERMAL, gravity=GRAVITY)

        def thickness(end=flow.end):
            simulation = Simulation(
                scene,
                effects=FLAT,
                accuracy=preset_accuracy(name),
                device='cpu',
                horizon=flow.end,
            )
            simulation.advance(end)
            return np.nan_to_num(simulation.snapshot().thickness).astype(float)

        thickness(1.0)
        return timed(repetitions, thickness)

    return run


def compiled(folder):
    """Compile the plain scheme."""
    library, part = Path(folder) / 'finite_volumes.so', Path(folder) / 'finite_volumes.o'
    source = FOLDER / 'finite_volumes.c'
    options = ['-O3', '-march=native', '-ffast-math', '-fPIC', '-c']
    subprocess.run(['cc', *options, '-o', part, source], check=True)
    # linking with -ffast-math would set subnormal numbers of the whole process to 0
    subprocess.run(['cc', '-shared', '-o', library, part], check=True)
    advance = ctypes.CDLL(str(library)).advance
    cells, long = np.ctypeslib.ndpointer(np.float64, flags='C'), ctypes.c_long
    box = np.ctypeslib.ndpointer(np.int64, flags='C')
    advance.argtypes = [*[cells] * 4, box, long, long, *[ctypes.c_double] * 4]
    advance.restype = long
    return advance


def plain(flow, cell, repetitions):
    """Run the plain scheme."""
    z = flow.ground(*flow.centres(cell))
    source = flow.means(lambda x, y: 1.0 * (np.hypot(x, y) < VENT_RADIUS), cell)
    half = 0.5 if flow.window[1] == 0.0 else 1.0
    source *= half * DISCHARGE / (source.sum() * cell**2)
    rows, columns = np.nonzero(source)
    box = np.array([rows.min(), rows.max(), columns.min(), columns.max()])
    with tempfile.TemporaryDirectory() as folder:
        advance = compiled(folder)

        def thickness():
            h, change = np.zeros_like(z), np.zeros_like(z)
            advance(h, change, z, source, box, *z.shape, cell, ALPHA, STEP_FRACTION, flow.end)
            return h

        return timed(repetitions, thickness)


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
    """Return the thickness of a flow with the plain scheme on FINEST."""
    return plain(FLOWS[name], FINEST, 1).thickness


def codes(folder):
    """Yield all runs: group, name of the flow, name of the code, cell size [m] and function."""
    for name in FLOWS:
        half = name.endswith('_half')
        for cell in CELLS:
            if name.startswith('constant_flux'):
                yield 'plain', name, 'exact solution', cell, exact_means
            yield 'plain', name, 'plain scheme', cell, plain
        for item in () if half else PRESETS:
            yield 'presets', name, item, 5.0, preset(item)
        for cell in () if half or folder is None else (10.0, 5.0):
            yield 'lava2d', name, 'Lava2d', cell, lava2d(folder)


def main():
    """Run codes and update their rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('group', nargs='+', choices=('presets', 'plain', 'lava2d'))
    parser.add_argument('--lava2d', metavar='FOLDER', help='a checkout of Lava2d')
    parser.add_argument('--flow', action='append', choices=FLOWS, help='a flow (default: all)')
    parser.add_argument('--repetitions', type=int, default=3)
    chosen = parser.parse_args()
    if 'lava2d' in chosen.group and chosen.lava2d is None:
        parser.error('lava2d takes --lava2d FOLDER')
    known = lines_of(TABLE) if TABLE.exists() else []
    rows = {tuple(row[column] for column in COLUMNS[:4]): row for row in known}
    for group, name, code, cell, run in codes(chosen.lava2d):
        if group not in chosen.group or name not in (chosen.flow or FLOWS):
            continue
        flow = FLOWS[name]
        result = run(flow, cell, chosen.repetitions)
        spent = sorted(result.seconds)
        times = [f'{item:.3g}' for item in (median(spent), spent[0], spent[-1])] if spent else []
        for quantity, value, unit in flow.scores(flow, result.thickness, cell):
            key = (name, code, f'{cell:g}', quantity)
            fields = [f'{value:.4g}', unit, *(times or [''] * 3), len(spent)]
            command = f'taskset --cpu-list 0 python docs/benchmarks/codes.py {group}'
            fields += [machine_name('cpu'), command]
            rows[key] = dict(zip(COLUMNS, (*key, *fields), strict=True))
            print(*key, *fields[:3], flush=True)
    # removes rows of obsolete runs
    order = [(name, code, f'{cell:g}') for _, name, code, cell, _ in codes('')]
    write_csv([row for made in order for key, row in rows.items() if key[:3] == made], TABLE)


if __name__ == '__main__':
    main()
