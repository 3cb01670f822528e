# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Definition of a case and its measurements, timing of runs, and location of fronts on grids."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
import math
import time as wall_clock
from typing import Any, SupportsFloat

import numpy as np

from lava_ros.effects import compatible, EFFECTS, Effects
from lava_ros.runs.drive import drive
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.snapshot import ParticleSample

#: Isothermal lava with weight and viscosity only.
ISOTHERMAL = Lava.paper(
    density=2600.0, viscosity=1e4, arrhenius=0.0, emissivity=0.0, convection=0.0
)

#: Its kinematic viscosity [m2/s].
NU = ISOTHERMAL.viscosity / ISOTHERMAL.density

#: Gravity of scenes that do not set it [m/s2].
GRAVITY = 9.81

#: Thickness threshold of the front, for flows about 1 m thick [m].
FRONT = 0.1


def only(*names: str) -> Effects:
    """Return effects in which only the named ones are on, as far as they exist."""
    return compatible(name for name in EFFECTS if name in names)


FLAT, SLOPING = only(), only('steep')

#: Smallest x, smallest y, largest x, largest y [m].
Window = tuple[float, float, float, float]


@dataclass(frozen=True)
class Measurement:
    """A measured value and the exact one, both in ``unit``.

    The error is their difference over ``scale``, by default over the exact value.
    """

    quantity: str
    measured: float
    exact: float
    unit: str
    scale: float | None = None

    @property
    def error(self) -> float:
        """Relative difference; NaN, which exceeds every bound, if nothing was measured."""
        return float(abs(self.measured - self.exact) / abs(self.scale or self.exact))


@dataclass(frozen=True)
class Run:
    """One run of a case, by its name: comparisons, and cost.

    ``particles`` is their number at the end, ``evaluations`` that of velocity evaluations. Times
    are in seconds; ``wall_time`` excludes compiling the kernels and measuring.
    """

    case: str
    measurements: tuple[Measurement, ...]
    particles: int
    steps: int
    evaluations: int
    simulated_time: float
    wall_time: float

    @property
    def errors(self) -> dict[str, float]:
        """Relative errors by quantity."""
        return {item.quantity: item.error for item in self.measurements}


@dataclass(frozen=True)
class Case:
    """A flow whose exact solution is known, with the reference of the solution.

    ``measure`` runs the case at an accuracy on a Warp device. The spacing is that of the case
    divided by ``accuracy.refinement``. ``effects`` are those that it switches on.
    """

    name: str
    title: str
    source: str
    measure: Callable[[Accuracy, str], Run]
    effects: tuple[str, ...] = ()

    def run(self, accuracy: Accuracy, device: str) -> Run:
        """Run the case, and set its name in the result."""
        return replace(self.measure(accuracy, device), case=self.name)


@dataclass(frozen=True, eq=False)
class Field:
    """Thickness on square cells [m], shape [rows, columns].

    ``cell`` is the side of a cell, ``origin`` the lower-left corner (x, y) of cell [0, 0] [m].
    """

    thickness: np.ndarray
    cell: float
    origin: tuple[float, float]

    @property
    def x(self) -> np.ndarray:
        """Coordinates of the centres of the columns [m]."""
        return self.origin[0] + (np.arange(self.thickness.shape[1]) + 0.5) * self.cell

    @property
    def y(self) -> np.ndarray:
        """Coordinates of the centres of the rows [m]."""
        return self.origin[1] + (np.arange(self.thickness.shape[0]) + 0.5) * self.cell

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the thickness [m] at places inside the grid [m], bilinear."""
        rows, columns = self.thickness.shape
        column = np.clip((x - self.origin[0]) / self.cell - 0.5, 0.0, columns - 1.0)
        row = np.clip((y - self.origin[1]) / self.cell - 0.5, 0.0, rows - 1.0)
        j = np.minimum(column.astype(int), columns - 2)
        i = np.minimum(row.astype(int), rows - 2)
        s, t = column - j, row - i
        grid = self.thickness
        low = (1.0 - s) * grid[i, j] + s * grid[i, j + 1]
        high = (1.0 - s) * grid[i + 1, j] + s * grid[i + 1, j + 1]
        return (1.0 - t) * low + t * high

    def along_x(self, half_width: float) -> np.ndarray:
        """Return the mean thickness of each column within ``half_width`` [m] of y = 0."""
        return self.thickness[np.abs(self.y) <= max(half_width, self.cell)].mean(axis=0)

    def mean_radius(self, threshold: float, reach: float) -> float:
        """Return the mean distance [m] from (0, 0) of the front at a ``threshold`` [m].

        The mean is over 32 directions, each sampled up to ``reach`` [m].
        """
        distance = np.arange(0.0, reach, 0.5 * self.cell)
        radii = []
        for angle in 2.0 * math.pi * (np.arange(32) + 0.5) / 32:
            values = self.at(distance * math.cos(angle), distance * math.sin(angle))
            radii.append(front(distance, values, threshold))
        return float(np.mean(radii))


def front(place: np.ndarray, thickness: np.ndarray, threshold: float) -> float:
    """Return the largest place at which the thickness crosses ``threshold`` [m], interpolated.

    ``place`` is ascending [m], ``thickness`` the thickness there [m]. The result is NaN if no
    thickness exceeds the threshold, or if the last one still does.
    """
    above = np.flatnonzero(thickness > threshold)
    if len(above) == 0 or above[-1] + 1 == len(place):
        return math.nan
    i = above[-1]
    fraction = (thickness[i] - threshold) / (thickness[i] - thickness[i + 1])
    return float(place[i] + fraction * (place[i + 1] - place[i]))


def half_width(place: np.ndarray, thickness: np.ndarray, threshold: float) -> float:
    """Return the mean distance of the outermost fronts on both sides from 0 [m] (``front``)."""
    above, below = (place, thickness), (-place[::-1], thickness[::-1])
    return 0.5 * (front(*above, threshold) + front(*below, threshold))


def slope_of(x: np.ndarray, y: np.ndarray) -> float:
    """Return the slope of a straight line by least squares, NaN if one of its places is."""
    offset = x - np.mean(x)
    return float(offset @ (y - np.mean(y)) / (offset @ offset))


class Trial:
    """A simulation whose progress is timed, with kernels compiled beforehand."""

    def __init__(
        self, scene: Scene, accuracy: Accuracy, device: str, *, effects: Effects = FLAT,
        particles: Particles | None = None, **knobs: Any,
    ) -> None:
        """Compile the kernels and create the simulation; ``knobs`` replace ``accuracy`` fields."""
        make = partial(
            Simulation, effects=effects, accuracy=replace(accuracy, **knobs), device=device
        )
        # the kernels depend on the effects and the accuracy, not on the scene
        few = particles and _chosen(particles, slice(2))
        drive(make(scene, particles=few), 1e-3)
        self.simulation = self.start(partial(make, particles=particles), scene)
        self._wall_time = 0.0
        self._measurements: list[Measurement] = []

    def start(self, make: Callable[[Scene], Simulation], scene: Scene) -> Simulation:
        """Create and return the simulation of the scene from ``make``."""
        return make(scene)

    def advance(self, until: float) -> None:
        """Simulate up to a time [s] and add to the wall time."""
        start = wall_clock.perf_counter()
        drive(self.simulation, float(until))
        self._wall_time += wall_clock.perf_counter() - start

    def sample(self) -> ParticleSample:
        """Return the particles with thickness and velocity."""
        return self.simulation.sample()

    def field(self, window: Window) -> Field:
        """Return the thickness [m] in a window, as in output grids, on cells of half a spacing."""
        simulation = self.simulation
        assert simulation.accuracy.spacing is not None
        cell = 0.5 * simulation.accuracy.spacing
        x0, y0, x1, y1 = window
        rows, columns = int(np.ceil((y1 - y0) / cell)), int(np.ceil((x1 - x0) / cell))
        # lava beyond the window contributes to the thickness inside it
        beyond = int(np.ceil(2.0 * simulation.accuracy.radius / cell))
        fine = Terrain(
            np.zeros((rows + 2 * beyond, columns + 2 * beyond)), cell,
            origin=(x0 - beyond * cell, y0 - beyond * cell),
        )
        sample = self.sample()
        inside = fine.covered(sample.position)
        copy = Simulation(
            replace(simulation.scene, terrain=fine, vents=()), effects=simulation.effects,
            accuracy=simulation.accuracy, device=simulation.device,
            particles=_chosen(sample, inside),
        )
        thickness = copy.snapshot().thickness
        return Field(thickness[beyond:-beyond, beyond:-beyond], cell, (x0, y0))

    def middle(self, quantity: str, half: float) -> np.ndarray:
        """Return an attribute of the particles within ``half`` [m] of (0, 0) in x and y."""
        sample = self.sample()
        values: np.ndarray = getattr(sample, quantity)
        return values[np.abs(sample.position).max(axis=1) < half]

    def compare(
        self, quantity: str, measured: SupportsFloat, exact: SupportsFloat, unit: str,
        scale: float | None = None,
    ) -> None:
        """Add a measurement to the result."""
        found = Measurement(quantity, float(measured), float(exact), unit, scale)
        self._measurements.append(found)

    def compare_mean(
        self, measured: np.ndarray, expected: np.ndarray, quantity: str = 'profile'
    ) -> None:
        """Add the mean of |h - exact| over the mean of the exact thickness [m]."""
        difference = np.abs(measured - expected).mean()
        self.compare(quantity, difference, 0.0, 'm', scale=float(expected.mean()))

    def run(self, *measurements: Measurement) -> Run:
        """End the trial; return the result, without the name of a case."""
        snapshot = self.simulation.snapshot()
        return Run(
            case='', measurements=(*self._measurements, *measurements),
            particles=snapshot.particle_count, steps=snapshot.steps.count,
            evaluations=snapshot.steps.evaluations, simulated_time=snapshot.time,
            wall_time=self._wall_time,
        )


def _chosen(lava: Particles | ParticleSample, which: slice | np.ndarray) -> Particles:
    every = (lava.position, lava.volume, lava.temperature)
    return Particles(*(np.asarray(values)[which] for values in every))


def joined(runs: Iterable[Run]) -> Run:
    """Combine runs of several simulations of a case: largest particle number, sums of the rest."""
    runs = tuple(runs)
    sums = ('steps', 'evaluations', 'simulated_time', 'wall_time')
    return Run(
        case='', measurements=tuple(item for run in runs for item in run.measurements),
        particles=max(run.particles for run in runs),
        **{name: sum(getattr(run, name) for run in runs) for name in sums},
    )


def square(half: float) -> Window:
    """Return smallest x, smallest y, largest x, largest y [m] of a square around (0, 0)."""
    return (-half, -half, half, half)


def places(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return all points (x, y) of some columns and rows [m], shape [count, 2]."""
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def lattice(columns: int, rows: int, spacing: float) -> np.ndarray:
    """Return points of a square lattice around (0, 0) [m], shape [count, 2]."""
    x, y = ((np.arange(count) - 0.5 * (count - 1)) * spacing for count in (columns, rows))
    return places(x, y)


def layer(
    lava: Lava, effects: Effects, accuracy: Accuracy, device: str, *, thickness: float,
    spacing: float = 2.0, side: float = 120.0, slope: float = 0.0, temperature: float = 1400.0,
) -> Trial:
    """Return a square layer of uniform vertical thickness [m] around (0, 0) on a slope [rad].

    ``side`` is the side of the layer [m]; the ground is twice as long. The spacing [m] is that
    at a refinement of 1. The temperature is in kelvin.
    """
    spacing /= accuracy.refinement
    # keep the middle of a coarse layer away from its edge
    side = max(side, 8.0 * spacing)
    count = max(2, int(side / spacing))
    particles = Particles(lattice(count, count, spacing), thickness * spacing**2, temperature)
    return Trial(
        Scene(plane(square(side), 5.0, slope), lava=lava), accuracy, device, effects=effects,
        particles=particles, spacing=spacing, thickness=thickness,
    )


def plane(window: Window, cell: float, slope: float = 0.0) -> Terrain:
    """Return a plane that falls towards +x at an angle ``slope`` [rad], on cells of ``cell`` [m].

    It covers at least the window.
    """
    x0, y0, x1, y1 = window
    rows, columns = (max(2, int(np.ceil(side / cell))) for side in (y1 - y0, x1 - x0))
    x = x0 + (np.arange(columns) + 0.5) * cell
    return Terrain(np.tile(-np.tan(slope) * x, (rows, 1)), cell, origin=(x0, y0))


def strip(width: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return fractions along and places across [m] of even points on a rectangle of a width [m].

    The points, (i + 1/2) / count along it and i times the golden ratio across from its middle,
    stay evenly spaced however the rectangle is stretched.
    """
    index = np.arange(count)
    turn = np.modf(index * 0.5 * (np.sqrt(5.0) - 1.0))[0]
    return (index + 0.5) / count, (turn - 0.5) * width


def distributed(fraction: np.ndarray, place: np.ndarray, density: np.ndarray) -> np.ndarray:
    """Return the places below which given fractions of a distribution lie, by trapezoids."""
    held = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    return np.interp(fraction, held / held[-1], place)
