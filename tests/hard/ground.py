# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava and the ground under it, in numpy: an account of them beside the solver's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
import math

import numpy as np

from lava_ros.scene import Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.checkpoint import Checkpoint
from lava_ros.simulation.state import STAGE, STEPS

#: What a check says: the invariant, what was found, what it may be at most, more about it.
Bound = tuple[str, float, float, str]

#: Steps of a frame that are looked at, about: each takes a few milliseconds.
MOST_LOOKS = 4000


class Ground:
    """The ground as the solver has it, what froze included, written out again in numpy."""

    def __init__(self, simulation: Simulation) -> None:
        terrain = simulation.scene.terrain
        self._terrain = terrain
        self._heights = simulation._terrain.height.numpy().astype(np.float64)
        self.lowest = float(self._heights.min())
        self.relief = float(self._heights.max()) - self.lowest

    def height(self, position: np.ndarray) -> np.ndarray:
        """Height of the quadratic B-spline at map positions [m], shape [count]."""
        place = (position - np.asarray(self._terrain.origin)) / self._terrain.resolution
        last = np.array(self._terrain.shape[::-1]) - 1
        cell = np.clip(np.floor(place).astype(int), 0, last)
        t = np.clip(place - cell - 0.5, -0.5, 0.5)
        weights = np.stack([0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2])
        total = np.zeros(len(position))
        for m, n in np.ndindex(3, 3):
            heights = self._heights[cell[:, 1] + m, cell[:, 0] + n]
            total += weights[m, :, 1] * weights[n, :, 0] * heights
        return total

    def slope(self, position: np.ndarray) -> np.ndarray:
        """Gradient of that surface at map positions, shape [count, 2]."""
        step = 1e-3 * self._terrain.resolution
        ways = step * np.eye(2)
        rises = [self.height(position + way) - self.height(position - way) for way in ways]
        return np.stack(rises, axis=1) / (2.0 * step)

    @property
    def steepest(self) -> float:
        """Largest slope of that surface, or more."""
        largest = [float(np.abs(np.diff(self._heights, axis=axis)).max()) for axis in (0, 1)]
        return math.hypot(*largest) / self._terrain.resolution

    def bend(self, position: np.ndarray) -> np.ndarray:
        """Largest curvature of that surface at map positions [1/m], at least 0, shape [count]."""
        step = 1e-3 * self._terrain.resolution
        x, y = np.array([step, 0.0]), np.array([0.0, step])
        # second differences of a piecewise quadratic: exact but where they cross into a cell
        here = self.height(position)
        along = self.height(position + x) - 2.0 * here + self.height(position - x)
        across = self.height(position + y) - 2.0 * here + self.height(position - y)
        twist = self.height(position + x + y) - self.height(position + x - y)
        twist += self.height(position - x - y) - self.height(position - x + y)
        half, mixed = 0.5 * (along - across), 0.25 * twist
        bend = 0.5 * (along + across) + np.hypot(half, mixed)
        return np.maximum(bend, 0.0) / step**2

    def _around(self, position: np.ndarray, reach: float) -> np.ndarray:
        """Bounds of the rows and columns within a reach of positions, shape [count, 4]."""
        place = (position - np.asarray(self._terrain.origin)) / self._terrain.resolution + 1.0
        span = reach / self._terrain.resolution
        low, high = (np.floor(place + way).astype(int) for way in (-span, span))
        last = np.array(self._heights.shape) - 1
        first, end = (np.clip(ends[:, ::-1], 0, last) for ends in (low, high))
        return np.stack([first[:, 0], end[:, 0] + 1, first[:, 1], end[:, 1] + 1], axis=1)

    def rise(self, position: np.ndarray, reach: float) -> np.ndarray:
        """What the ground rises or falls by within a reach of positions [m], shape [count]."""
        kinds, which = np.unique(self._around(position, reach), axis=0, return_inverse=True)
        rises = [np.ptp(self._heights[a:b, c:d]) for a, b, c, d in kinds]
        return np.array(rises)[which.ravel()]

    def highest(self, vent: Vent, least: float) -> float:
        """Highest ground under a vent of a least radius [m], from the lowest of all [m].

        A fissure is looked at in as many places as cells.
        """
        start = np.asarray(vent.position)
        end = start if vent.end is None else np.asarray(vent.end)
        count = 1 + math.ceil(math.dist(start, end) / self._terrain.resolution)
        places = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
        # the spline at a place is a mean of its cell and of those beside it
        reach = max(vent.radius, least) + self._terrain.resolution
        tops = [self._heights[a:b, c:d].max() for a, b, c, d in self._around(places, reach)]
        return float(max(tops)) - self.lowest


class Moment:
    """Lava and ground of a simulation as they are now."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.time = simulation.time
        self.lava = simulation.sample()
        self.budget = simulation.budget()
        # on a CPU that is the solver's own array
        self.counts = simulation._state.counts.numpy().copy()
        #: Volume that has come out of the vents [m3].
        self.given = self.budget.emitted - self.budget.pending
        self.thickest = float(self.lava.thickness.max(initial=0.0))

    @cached_property
    def ground(self) -> Ground:
        """The ground, what froze included."""
        return Ground(self.simulation)

    @cached_property
    def surface(self) -> np.ndarray:
        """Height of the lava's surface [m], shape [count]."""
        return self.lava.thickness + self.ground.height(self.lava.position)


def along(
    start: Checkpoint, simulation: Simulation, steps: int, rate: Callable[[Moment], float]
) -> Iterator[tuple[float, float, float]]:
    """A rate at the start and at the end of each step, and the step's length [s].

    The frame that began at ``start`` and whose end the simulation is at is played again, step by
    step: lava that comes out and runs off, breaks loose for a moment, or falls and climbs, shows
    that at neither end of a frame. Of many ``steps`` only one in so many is taken, as long as all
    of them.
    """
    again = Simulation.resume(start, device=simulation.device)
    if start.scene.vents != simulation.scene.vents:
        again.set_vents(simulation.scene.vents)
    counts, every = again._state.counts, 1 + steps // MOST_LOOKS
    begun, step, former = start.time, int(counts.numpy()[STEPS]), rate(Moment(again))
    is_taken = True
    for _ in again.advancing(simulation.time):
        stage, reached = (int(counts.numpy()[count]) for count in (STAGE, STEPS))
        if stage == 0 and reached > step:
            was_taken, is_taken = is_taken, reached % every == 0
            now = rate(Moment(again)) if was_taken or is_taken else 0.0
            if was_taken:
                yield former, now, every * (again.time - begun)
            begun, step, former = again.time, reached, now


def lift(former: Terrain, terrain: Terrain) -> float:
    """How much higher lava may be on a new terrain than it was on the one before [m]."""
    if (former.extent, former.shape) != (terrain.extent, terrain.shape):
        return float(np.nanmax(terrain.elevation) - np.nanmin(former.elevation))
    return float(np.nanmax(terrain.elevation - former.elevation))


def head(vent: Vent, gravity: float) -> float:
    """How high lava rises that a vent throws [m]."""
    return float(np.hypot(*vent.velocity)) ** 2 / (2.0 * gravity)


def distance(
    position: np.ndarray, start: tuple[float, float], end: tuple[float, float] | None
) -> np.ndarray:
    """Distance of positions from a point, or from a line between two [m]."""
    offset = position - np.asarray(start)
    if end is not None:
        along = np.subtract(end, start)
        square = max(float(along @ along), 1e-300)
        offset = offset - np.clip(offset @ along / square, 0.0, 1.0)[:, None] * along
    return np.linalg.norm(offset, axis=1)
