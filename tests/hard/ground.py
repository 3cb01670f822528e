# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava and the ground under it in numpy, independent of the solver's own functions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
import math
from typing import Any

import numpy as np

from hard import cells
from lava_ros.scene import Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.cells import state as cell_state
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.particles.layout import EVALUATIONS, STAGE, STEPS

#: Result of a check: the invariant, its value, its maximum, and a comment.
Bound = tuple[str, float, float, str]

#: Maximum number of steps of a frame that are evaluated: each takes a few milliseconds.
MAX_SAMPLES = 4000


class Ground:
    """The ground of the solver including solidified lava, implemented independently in numpy.

    It is a quadratic B-spline for particles, and has one height in each cell for cells.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._terrain, self._is_spline = terrain_of(simulation), not is_on_cells(simulation)
        solver: Any = simulation.solver
        if self._is_spline:
            self._heights = solver.terrain.height.numpy().astype(np.float64)
        else:
            self._heights = solver.heat.elevation.numpy() + solver.heat.frozen.numpy()
        self.lowest = float(self._heights.min())
        self.relief = float(self._heights.max()) - self.lowest

    def height(self, position: np.ndarray) -> np.ndarray:
        """Return the height of the ground at map positions [m], shape [count]."""
        place = (position - np.asarray(self._terrain.origin)) / self._terrain.resolution
        last = np.array(self._terrain.shape[::-1]) - 1
        cell = np.clip(np.floor(place).astype(int), 0, last)
        if not self._is_spline:
            return np.asarray(self._heights[cell[:, 1] + 1, cell[:, 0] + 1])
        t = np.clip(place - cell - 0.5, -0.5, 0.5)
        weights = np.stack([0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2])
        total = np.zeros(len(position))
        for m, n in np.ndindex(3, 3):
            heights = self._heights[cell[:, 1] + m, cell[:, 0] + n]
            total += weights[m, :, 1] * weights[n, :, 0] * heights
        return total

    def slope(self, position: np.ndarray) -> np.ndarray:
        """Return the gradient of that surface at map positions, shape [count, 2]."""
        step = 1e-3 * self._terrain.resolution
        ways = step * np.eye(2)
        rises = [self.height(position + way) - self.height(position - way) for way in ways]
        return np.stack(rises, axis=1) / (2.0 * step)

    @property
    def steepest(self) -> float:
        """Return an upper bound of the slope of that surface."""
        largest = [float(np.abs(np.diff(self._heights, axis=axis)).max()) for axis in (0, 1)]
        return math.hypot(*largest) / self._terrain.resolution

    def bend(self, position: np.ndarray) -> np.ndarray:
        """Return the largest curvature at map positions [1/m], at least 0, shape [count]."""
        step = 1e-3 * self._terrain.resolution
        x, y = np.array([step, 0.0]), np.array([0.0, step])
        # second differences of a piecewise quadratic: exact except where they cross into a cell
        here = self.height(position)
        along = self.height(position + x) - 2.0 * here + self.height(position - x)
        across = self.height(position + y) - 2.0 * here + self.height(position - y)
        twist = self.height(position + x + y) - self.height(position + x - y)
        twist += self.height(position - x - y) - self.height(position - x + y)
        half, mixed = 0.5 * (along - across), 0.25 * twist
        bend = 0.5 * (along + across) + np.hypot(half, mixed)
        return np.maximum(bend, 0.0) / step**2

    def _around(self, position: np.ndarray, reach: float) -> np.ndarray:
        """Return bounds of the rows and columns within a reach of positions, shape [count, 4]."""
        place = (position - np.asarray(self._terrain.origin)) / self._terrain.resolution + 1.0
        span = reach / self._terrain.resolution
        low, high = (np.floor(place + way).astype(int) for way in (-span, span))
        last = np.array(self._heights.shape) - 1
        first, end = (np.clip(ends[:, ::-1], 0, last) for ends in (low, high))
        return np.stack([first[:, 0], end[:, 0] + 1, first[:, 1], end[:, 1] + 1], axis=1)

    def rise(self, position: np.ndarray, reach: float) -> np.ndarray:
        """Return the range of ground heights within a reach of positions [m], shape [count]."""
        kinds, which = np.unique(self._around(position, reach), axis=0, return_inverse=True)
        rises = [np.ptp(self._heights[a:b, c:d]) for a, b, c, d in kinds]
        return np.array(rises)[which.ravel()]

    def highest(self, vent: Vent, least: float) -> float:
        """Return the highest ground under a vent of a minimum radius [m], above the lowest [m].

        A fissure is sampled at as many places as cells.
        """
        start = np.asarray(vent.position)
        end = start if vent.end is None else np.asarray(vent.end)
        count = 1 + math.ceil(math.dist(start, end) / self._terrain.resolution)
        places = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
        # the spline at a place is a mean of its cell and adjacent cells
        reach = max(vent.radius, least) + self._terrain.resolution
        tops = [self._heights[a:b, c:d].max() for a, b, c, d in self._around(places, reach)]
        return float(max(tops)) - self.lowest


class Moment:
    """Current lava and ground of a simulation."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.time = simulation.time
        self.lava = simulation.sample()
        self.budget = simulation.budget()
        #: Numbers of steps and of evaluations of the flow.
        self.steps, self.evaluations, _ = counts_of(simulation)
        #: Volume that the vents have emitted [m3].
        self.given = self.budget.emitted - self.budget.waiting
        self.thickest = float(self.lava.thickness.max(initial=0.0))

    @property
    def reach(self) -> float:
        """Distance within which the solver does not resolve heights [m]."""
        if is_on_cells(self.simulation):
            return terrain_of(self.simulation).resolution
        return self.simulation.accuracy.radius

    @cached_property
    def ground(self) -> Ground:
        """The ground, including solidified lava."""
        return Ground(self.simulation)

    @cached_property
    def surface(self) -> np.ndarray:
        """Height of the lava's surface [m], shape [count]."""
        return self.lava.thickness + self.ground.height(self.lava.position)


def along(
    start: Checkpoint, simulation: Simulation, steps: int, rate: Callable[[Moment], float]
) -> Iterator[tuple[float, float, float, int]]:
    """Yield a rate at the start and at the end of each step, its length [s] and evaluations.

    The frame that began at ``start`` and ends at the simulation's current time is simulated again,
    step by step: lava that is emitted and runs off, yields for a moment, or falls and climbs,
    shows that at neither end of a frame. Samples change the order of the particles, so that a
    chaotic flow takes other steps than before. Of many ``steps`` only every n-th is evaluated,
    with length and evaluations of n steps.
    """
    again = Simulation.resume(start, device=simulation.device)
    if start.scene.vents != simulation.scene.vents:
        again.set_vents(simulation.scene.vents)
    if is_on_cells(again):
        cells.take_single_steps(again.solver)
    every = 1 + steps // MAX_SAMPLES
    begun, former, is_taken = start.time, rate(Moment(again)), True
    step, spent, _ = counts_of(again)
    for _ in again.advancing(simulation.time):
        reached, total, stage = counts_of(again)
        if stage == 0 and reached > step:
            was_taken, is_taken = is_taken, reached % every == 0
            now = rate(Moment(again)) if was_taken or is_taken else 0.0
            if was_taken:
                yield former, now, every * (again.time - begun), every * (total - spent)
            begun, step, former, spent = again.time, reached, now, total


def is_on_cells(simulation: Simulation) -> bool:
    """Return True if cells carry the lava."""
    return simulation.accuracy.method == 'cells'


def terrain_of(simulation: Simulation) -> Terrain:
    """Return the ground on the cells that the solver uses."""
    solver: Any = simulation.solver
    terrain: Terrain = solver.grid if is_on_cells(simulation) else solver.scene.terrain
    return terrain


def counts_of(simulation: Simulation) -> tuple[int, int, int]:
    """Return the numbers of steps, of evaluations of the flow, and of stages of a begun step."""
    solver: Any = simulation.solver
    if is_on_cells(simulation):
        return int(solver.counts[cell_state.STEPS]), int(solver.counts[cell_state.EVALUATIONS]), 0
    counts = solver.state.counts.numpy()
    return int(counts[STEPS]), int(counts[EVALUATIONS]), int(counts[STAGE])


def lift(former: Terrain, terrain: Terrain) -> float:
    """Return how much higher lava may be on a new terrain than on the previous one [m]."""
    if (former.extent, former.shape) != (terrain.extent, terrain.shape):
        return float(np.nanmax(terrain.elevation) - np.nanmin(former.elevation))
    return float(np.nanmax(terrain.elevation - former.elevation))


def head(vent: Vent, gravity: float) -> float:
    """Return the height to which a vent throws lava [m]."""
    return float(np.hypot(*vent.velocity)) ** 2 / (2.0 * gravity)


def distance(
    position: np.ndarray, start: tuple[float, float], end: tuple[float, float] | None
) -> np.ndarray:
    """Return the distance of positions from a point, or from a line between two [m]."""
    offset = position - np.asarray(start)
    if end is not None:
        along = np.subtract(end, start)
        square = max(float(along @ along), 1e-300)
        offset = offset - np.clip(offset @ along / square, 0.0, 1.0)[:, None] * along
    return np.linalg.norm(offset, axis=1)
