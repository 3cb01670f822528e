# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What a simulation is given and shows of itself: plain numpy data, free of device arrays."""

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.inundation import inundated_cells, standing_cells


@dataclass(frozen=True)
class StepReport:
    """How the simulation has been stepping.

    Attributes:
        count: Time steps taken since the start.
        evaluations: Velocity evaluations taken: the sum of the steps' stages.
        stages: Stages of the latest step.
        length: Length of the latest full step [s].
        limit: What bounded that step: ``diffusion``, ``advection`` or ``longest``.
    """

    count: int
    evaluations: int
    stages: int
    length: float
    limit: str


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of the flow at one moment, on the cells of its terrain.

    Attributes:
        time: Simulated time [s].
        terrain: The ground before the eruption, which the arrays belong to.
        thickness: Thickness of all lava on it, fluid and frozen [m], float32, shape [rows,
            columns], 0 where there is none and NaN where the terrain has no data.
        temperature: Depth-averaged temperature of the fluid lava [K], float32, same shape; the
            solidus, which it is no hotter than, where all has frozen; NaN where there is no lava.
        budget: The volume budget.
        particle_count: Particles on the terrain.
        steps: The time stepping so far.
        frozen: The frozen part of ``thickness`` [m], float32, same shape; None without
            solidification.
        arrived: Time of the end of the step in which lava reached a cell (``own_ground.py``) [s],
            float32, same shape, NaN where it has not; None in a snapshot made of maps without it.
    """

    time: float
    terrain: Terrain
    thickness: np.ndarray
    temperature: np.ndarray
    budget: VolumeBudget
    particle_count: int
    steps: StepReport
    frozen: np.ndarray | None = None
    arrived: np.ndarray | None = None

    @property
    def inundated(self) -> np.ndarray:
        """Cells that lava has reached so far, bool, shape [rows, columns]."""
        if self.arrived is None:
            raise ValueError('a snapshot without arrival times')
        return inundated_cells(self.arrived)

    @property
    def standing(self) -> np.ndarray:
        """Cells with lava now, flowing or solidified, bool, shape [rows, columns]."""
        return standing_cells(self.thickness)

    def area(self, cells: np.ndarray) -> float:
        """Area of some of the cells [m2]."""
        return float(cells.sum()) * self.terrain.resolution**2

    def flaw(self) -> str:
        """Say what makes this snapshot unfit to be shown as a map; empty when nothing does."""
        budget = self.budget
        numbers = (self.time, budget.emitted, budget.held, budget.left, budget.frozen)
        if not all(math.isfinite(number) for number in numbers):
            return f'time or volume is not a number: time {self.time} s, {budget}'
        is_thickness = np.isfinite(self.thickness) & (self.thickness >= 0.0)
        bad = int((self.terrain.has_data & ~is_thickness).sum())
        if bad:
            return f'thickness is not a number of metres in {bad} cells'
        is_temperature = np.isfinite(self.temperature) & (self.temperature > 0.0)
        bad = int(((self.thickness > 0.0) & ~is_temperature).sum())
        if bad:
            return f'temperature is not a number of kelvin in {bad} cells with lava'
        return ''


class PendingSnapshot:
    """A snapshot of a moment that has passed, on its way from the device."""

    def __init__(self, finish: Callable[[], Snapshot]) -> None:
        """Take what waits for it and makes it, called once."""
        self._finish: Callable[[], Snapshot] = finish

    def result(self) -> Snapshot:
        """Wait for it; in any thread, but in one of them only."""
        snapshot = self._finish()
        # what it was made of is not kept
        self._finish = lambda: snapshot
        return snapshot


@dataclass(frozen=True, eq=False)
class Particles:
    """Lava given as particles, each a column of constant volume.

    Attributes:
        position: Positions (x, y) in the map frame [m], shape [count, 2].
        volume: Volumes [m3], shape [count] or one for all.
        temperature: Temperatures [K], shape [count] or one for all.
        velocity: Velocities [m/s], shape [count, 2] or [2] for all; used with inertia.
    """

    position: np.ndarray
    volume: np.ndarray | float
    temperature: np.ndarray | float
    velocity: np.ndarray | tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Normalise to float64 arrays.

        Raises:
            LavaError: A shape does not fit, or a value is not finite or not positive.
        """
        position = np.array(self.position, dtype=np.float64)
        is_right = position.ndim == 2 and position.shape[1] == 2
        self._set('position', position, is_right, 'finite metres, shape [count, 2]')
        for name in ('volume', 'temperature'):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.ndim == 0:
                values = np.full(len(position), float(values))
            is_right = values.shape == (len(position),) and bool((values > 0).all())
            self._set(name, values, is_right, 'positive, one each')
        velocity = np.array(self.velocity, dtype=np.float64)
        if velocity.shape == (2,):
            velocity = np.tile(velocity, (len(position), 1))
        is_right = velocity.shape == position.shape
        self._set('velocity', velocity, is_right, 'finite m/s, shape [count, 2] or [2]')

    def _set(self, name: str, values: np.ndarray, is_right: bool, right: str) -> None:
        if not (is_right and np.isfinite(values).all()):
            raise LavaError(f'particles.{name}', f'array of shape {values.shape}', right)
        object.__setattr__(self, name, values)


#: Distance between particles that are given in one place, over the usual one.
_APART = 1e-3


def rows_of(particles: Particles, terrain: Terrain, spacing: float) -> np.ndarray:
    """Rows of (map x, map y, volume, temperature), no two of them in one place.

    Particles in one place push each other nowhere: they would stay together for ever. All but the
    first are moved a little, in parts of the usual ``spacing`` [m].

    Raises:
        LavaError: A particle is not on the terrain.
    """
    places = particles.position.copy()
    for index in np.flatnonzero(~terrain.covered(places))[:1]:
        where = f'particles.position[{index}]'
        raise LavaError(where, tuple(places[index]), 'a place on the terrain')
    # as complex numbers: a sort of rows takes ten times as long
    _, which = np.unique(places[:, 0] + 1j * places[:, 1], return_inverse=True)
    if which.size == 0 or which.max() == which.size - 1:
        return np.column_stack([places, particles.volume, particles.temperature])
    order = np.argsort(which.ravel(), kind='stable')
    group = which.ravel()[order]
    begin = np.flatnonzero(np.diff(group, prepend=-1))
    number = np.arange(len(order)) - begin[group]
    # as evenly as the seeds of a sunflower; back towards where there is ground
    turn = 2.399963 * number
    way = np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.sqrt(number)[:, None]
    way *= _APART * spacing
    copies, way = order[number > 0], way[number > 0]
    onto = terrain.covered(places[copies] + way)
    places[copies] += np.where(onto[:, None], way, -way)
    return np.column_stack([places, particles.volume, particles.temperature])


@dataclass(frozen=True, eq=False)
class ParticleSample:
    """The particles of a running simulation, as numpy arrays of float64.

    Attributes:
        position: Positions (x, y) in the map frame [m], shape [count, 2].
        volume: Volumes [m3], shape [count].
        temperature: Temperatures [K], shape [count].
        thickness: Lava thickness at the particles [m], shape [count].
        velocity: Depth-averaged velocity [m/s], shape [count, 2].
    """

    position: np.ndarray
    volume: np.ndarray
    temperature: np.ndarray
    thickness: np.ndarray
    velocity: np.ndarray
