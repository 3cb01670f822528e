# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Input and output of a simulation as numpy arrays."""

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.inundation import (
    area_of,
    footprint_cells,
    standing_cells,
    standing_part,
)


@dataclass(frozen=True)
class StepReport:
    """Statistics of time steps.

    Attributes:
        count: Number of time steps since the start.
        evaluations: Number of velocity evaluations: the sum of the stages of all steps.
        stages: Number of stages of the latest step.
        length: Length of the latest full step [s].
        limit: Limit of that step, one of ``timestep.LIMITS``.
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
        terrain: Terrain before the eruption, with the cells of the arrays.
        thickness: Thickness of all lava, flowing and solidified [m], float32, shape [rows,
            columns], 0 without lava and NaN where the terrain has no data.
        temperature: Depth-averaged temperature of flowing lava [K], float32, same shape; the
            solidus, its maximum, where all lava has solidified; NaN without lava.
        budget: Volume budget.
        particle_count: Number of particles on the terrain, or of cells with lava.
        steps: Time stepping so far.
        frozen: Solidified part of ``thickness`` [m], float32, same shape; None without
            solidification.
        arrived: First arrival time: end of the step in which lava touched the cell
            (``covered_cells.py``) [s], float32, same shape, NaN without arrival; None in a
            snapshot from maps without it.
        half_inundated: Time at which lava had covered half of the cell [s], as ``arrived``.
        inundated: Fraction of the cell that lava has covered so far, float32, same shape, NaN
            without data; above 0 where lava has arrived; None in a snapshot from maps without it.
        threshold: Minimum thickness of lava that counts as inundation [m].
        method: Carriers of the lava (``Accuracy.method``).
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
    half_inundated: np.ndarray | None = None
    inundated: np.ndarray | None = None
    threshold: float = COVERED
    method: str = METHODS[0]

    @property
    def footprint(self) -> np.ndarray:
        """Cells of which lava has covered at least half so far, bool, shape [rows, columns]."""
        if self.inundated is None:
            raise ValueError('a snapshot without inundated fractions')
        return footprint_cells(self.inundated)

    @property
    def standing(self) -> np.ndarray:
        """Cells with lava at this moment, flowing or solidified, bool, shape [rows, columns]."""
        return standing_cells(self.thickness, self.threshold)

    @property
    def standing_area(self) -> float:
        """Area on which lava stands at this moment [m2], within the inundated area."""
        return self.area(standing_part(self.standing, self.inundated))

    def area(self, cells: np.ndarray) -> float:
        """Return the total area [m2] of a mask or of fractions of cells, [rows, columns]."""
        return area_of(cells, self.terrain.resolution)

    def flaw(self) -> str:
        """Return why the snapshot cannot be shown as a map; empty if there is no reason."""
        budget = self.budget
        numbers = (
            self.time, budget.emitted, budget.flowing, budget.waiting, budget.lost,
            budget.solidified,
        )
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
    """A snapshot whose copy from the device may still be in progress."""

    def __init__(self, finish: Callable[[], Snapshot]) -> None:
        """Initialize with a function that waits for the copy; it is called once."""
        self._finish: Callable[[], Snapshot] = finish

    def result(self) -> Snapshot:
        """Wait for and return the snapshot; call it from a single thread."""
        snapshot = self._finish()
        # release the buffers
        self._finish = lambda: snapshot
        return snapshot


@dataclass(frozen=True, eq=False)
class Particles:
    """Initial lava as particles, each a column of constant volume.

    Attributes:
        position: Positions (x, y) in the map frame [m], shape [count, 2].
        volume: Volumes [m3], shape [count] or one number.
        temperature: Temperatures [K], shape [count] or one number.
        velocity: Velocities [m/s], shape [count, 2] or [2]; used with inertia.
    """

    position: np.ndarray
    volume: np.ndarray | float
    temperature: np.ndarray | float
    velocity: np.ndarray | tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Convert to float64 arrays of full shape.

        Raises:
            LavaError: If a shape does not fit, or a value is not finite or not positive.
        """
        position = np.array(self.position, dtype=np.float64)
        is_valid = position.ndim == 2 and position.shape[1] == 2
        self._set('position', position, is_valid, 'finite metres, shape [count, 2]')
        for name in ('volume', 'temperature'):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.ndim == 0:
                values = np.full(len(position), float(values))
            is_valid = values.shape == (len(position),) and bool((values > 0).all())
            self._set(name, values, is_valid, 'positive, one each')
        velocity = np.array(self.velocity, dtype=np.float64)
        if velocity.shape == (2,):
            velocity = np.tile(velocity, (len(position), 1))
        is_valid = velocity.shape == position.shape
        self._set('velocity', velocity, is_valid, 'finite m/s, shape [count, 2] or [2]')

    def _set(self, name: str, values: np.ndarray, is_valid: bool, expected: str) -> None:
        if not (is_valid and np.isfinite(values).all()):
            raise LavaError(f'particles.{name}', f'array of shape {values.shape}', expected)
        object.__setattr__(self, name, values)


def particles_of(scene: Scene, spacing: float) -> Particles | None:
    """Return the emplaced flows of a scene as particles with at most a given spacing [m]."""
    if not scene.emplaced_flows:
        return None
    columns = [flow.columns(spacing) for flow in scene.emplaced_flows]
    temperatures = [
        np.full(len(volume), flow.temperature)
        for flow, (_, volume) in zip(scene.emplaced_flows, columns, strict=True)
    ]
    places, volumes = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    return Particles(places, volumes, np.concatenate(temperatures))


def check_places(particles: Particles, terrain: Terrain) -> None:
    """Raise LavaError if a particle is not on the terrain."""
    for index in np.flatnonzero(~terrain.covered(particles.position))[:1]:
        where = tuple(particles.position[index].tolist())
        raise LavaError(f'particles.position[{index}]', where, 'a place on the terrain')


#: Distance over the spacing between particles given at the same place.
_COINCIDENT_OFFSET = 1e-3


def rows_of(particles: Particles, terrain: Terrain, spacing: float) -> np.ndarray:
    """Return rows of (map x, map y, volume, temperature), each at a different place.

    Particles at the same place exert no force on each other and would never separate. All except
    the first are moved by a small fraction of the ``spacing`` [m].

    Raises:
        LavaError: If a particle is not on the terrain.
    """
    check_places(particles, terrain)
    places = particles.position.copy()
    # complex numbers: sorting rows takes ten times as long
    _, which = np.unique(places[:, 0] + 1j * places[:, 1], return_inverse=True)
    if which.size == 0 or which.max() == which.size - 1:
        return np.column_stack([places, particles.volume, particles.temperature])
    order = np.argsort(which.ravel(), kind='stable')
    group = which.ravel()[order]
    begin = np.flatnonzero(np.diff(group, prepend=-1))
    number = np.arange(len(order)) - begin[group]
    # evenly, on a sunflower spiral; in the opposite direction if there is no ground
    turn = 2.399963 * number
    offset = np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.sqrt(number)[:, None]
    offset *= _COINCIDENT_OFFSET * spacing
    copies, offset = order[number > 0], offset[number > 0]
    onto = terrain.covered(places[copies] + offset)
    places[copies] += np.where(onto[:, None], offset, -offset)
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
