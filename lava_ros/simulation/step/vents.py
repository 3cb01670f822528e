# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Vents, which emit particles of constant volume by the integral of their discharge."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from itertools import count
import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain, Vent
from lava_ros.scene.vents import distances, extents
from lava_ros.simulation.accuracy import Accuracy, MAX_PARTICLES_PER_SECOND
from lava_ros.simulation.backend.memory import read
from lava_ros.simulation.particles.layout import centre_of, fitting
from lava_ros.simulation.step.outlets import foresee, list_places, Outlet, Outlets
from lava_ros.simulation.step.vent_ground import is_open, permitted_places

#: Maximum number of particles of all vents in a step, and minimum of that for each vent.
_MAX_PARTICLES_PER_STEP, _MIN_PARTICLE_LIMIT = 2**18, 64

#: Number of groups of particles after which a new vent's sequence begins again: an int32 counts
#: the particles.
_MAX_GROUPS = 2**24

#: Fraction of a particle that rounding may delay.
_ROUNDING = 1e-6

#: Number of particles that a disc and a fissure emit at once, so that they have its symmetries.
_DISC_GROUP, _FISSURE_GROUP = 8, 4

#: Number of candidate places of a vent around which lava may not come out everywhere.
_CANDIDATES = 4096


@dataclass(frozen=True)
class Emission:
    """Emitted volumes of vents, and the sequences of places of their particles.

    A vent that changes keeps only these values: its next particle comes out at the next place of
    its sequence, however often the vent or the ground is updated.

    Attributes:
        volume: Volume that each vent has emitted [m3], float64, shape [vents].
        released: Number of particles that each vent has emitted, int32, shape [vents].
        phase: Start of the sequence of places of each vent, different for vents at the same place,
            float64, shape [vents]. NaN if not chosen yet.
        downhill: Direction in which the ground fell when the vent opened [half turns], float64,
            shape [vents]. NaN if not computed yet.
    """

    volume: np.ndarray
    released: np.ndarray
    phase: np.ndarray
    downhill: np.ndarray

    @classmethod
    def of_new_vents(
        cls, number: int, volume: float = 0.0, particle_volume: float = 1.0
    ) -> 'Emission':
        """Return the emission of vents that open after other vents have emitted a volume.

        The sequences begin as if each new vent had emitted all of that volume. A vent that closes
        and opens again therefore emits at other places than before.

        Args:
            number: Number of new vents.
            volume: Volume that other vents have emitted [m3].
            particle_volume: Volume of a particle [m3].
        """
        groups = math.ceil(volume / (_DISC_GROUP * particle_volume))
        whole = _DISC_GROUP * (groups % _MAX_GROUPS)
        unknown = np.full(number, np.nan)
        released = np.full(number, whole, dtype=np.int32)
        return cls(released * particle_volume, released, unknown, unknown)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], number: int) -> 'Emission':
        """Return the emission of ``number`` vents in a checkpoint (``VentSet.save``).

        Raises:
            LavaError: If an array is missing or has another number of vents.
        """
        kinds = {item.name: np.float64 for item in fields(cls)} | {'released': np.int32}
        return cls(**{
            name: fitting(f'vents.{name}', arrays.get(name), (number,), kind)
            for name, kind in kinds.items()
        })

    def continued(self, matches: Sequence[int | None], new: 'Emission') -> 'Emission':
        """Return the emission of vents that continue these by index, or ``new`` where None."""
        old = [index for index, match in enumerate(matches) if match is not None]
        chosen = [match for match in matches if match is not None]
        result = {name: values.copy() for name, values in vars(new).items()}
        for name, values in vars(self).items():
            result[name][old] = values[chosen]
        return Emission(**result)


class OpenVents:
    """The vents of one span of time.

    Attributes:
        vents: The vents.
        since: Time from which they emit [s].
    """

    def __init__(self, vents: tuple[Vent, ...], since: float) -> None:
        """Store the vents, and the time from which they emit [s]."""
        self.vents, self.since = vents, since

    def volumes(self, time: float) -> list[float]:
        """Return the volume [m3] that each vent has emitted from ``since`` to a time [s]."""
        return [vent.volume_between(self.since, time) for vent in self.vents]

    def emitted(self, time: float) -> float:
        """Return the volume [m3] that all vents have emitted from ``since`` to a time [s]."""
        return sum(self.volumes(time))


class VentSet(OpenVents):
    """Vents that emit particles, on a device.

    Attributes:
        counted: Indices of the vents whose ground ``ParticleSolver.raise_top`` has counted.
    """

    def __init__(
        self, vents: tuple[Vent, ...], terrain: Terrain, accuracy: Accuracy, device: Any, *,
        since: float, before: Emission,
    ) -> None:
        """Build the vents' tables.

        Args:
            vents: The vents.
            terrain: The ground.
            accuracy: The resolution; a vent narrower than the spacing is widened to it.
            device: Warp device.
            since: Time from which they emit [s].
            before: Emission of each vent until then.
        """
        super().__init__(vents, since)
        spacing, thickness = accuracy.spacing, accuracy.thickness
        assert spacing is not None
        self.counted: set[int] = set()
        # read at each advance, so computed once
        self._opening = [vent.next_opening(since) for vent in vents]
        self._particle_volume = particle_volume = accuracy.particle_volume
        self._thickness, self._rise = thickness, spacing if thickness is None else thickness
        self._groups = [
            1 if not accuracy.symmetric else _FISSURE_GROUP if vent.end else _DISC_GROUP
            for vent in vents
        ]
        self._device = device
        self._before = self._with_places(before, terrain, spacing)
        conduits = before.volume - before.released * particle_volume
        self._is_filled = conduits > _ROUNDING * particle_volume
        self._terrain, self._centre = terrain, centre_of(terrain)
        # such a disc covers the terrain; of a wider one hardly any place would be on it
        widest = terrain.resolution * math.hypot(*terrain.shape)
        self._radii = [min(max(vent.radius, spacing), widest) for vent in vents]
        self._lengths = [math.dist(vent.position, vent.end or vent.position) for vent in vents]

    @cached_property
    def outlets(self) -> Outlets:
        """Tables of the vents for kernels, made when a kernel first needs them."""
        vents, since, device = self.vents, self.since, self._device
        table: np.ndarray = np.zeros(len(vents), dtype=Outlet.numpy_dtype())
        starts, times, fluxes, volumes = [0], list[float](), list[float](), list[float]()
        emitted = self._before.volume.tolist()
        table['radius'], table['length'] = self._radii, self._lengths
        for row, vent, volume in zip(table, vents, emitted, strict=True):
            end = vent.position if vent.end is None else vent.end
            row['start'], row['end'] = vent.position - self._centre, end - self._centre
            row['temperature'], row['velocity'] = vent.temperature, vent.velocity
            begins = [max(time, since) for time, _ in vent.series]
            times += begins
            fluxes += [flux for _, flux in vent.series]
            volumes += [volume + more for more in vent.volumes_at(begins, since=since)]
            starts.append(len(times))
        table['phase'], table['downhill'] = self._before.phase, self._before.downhill
        table['group'] = self._groups
        made = Outlets()
        made.starts = wp.array(starts, dtype=wp.int32, device=device)
        # with an extra item: Warp has no empty slice at the end of an array
        size = len(times)
        series = wp.array([*times, *fluxes, *volumes, 0.0], dtype=wp.float64, device=device)
        made.times, made.fluxes, made.volumes = (
            series[first : first + size] for first in (0, size, 2 * size)
        )
        made.vents = wp.array(table, dtype=Outlet, device=device)
        made.particle_volume = self._particle_volume
        per_vent = _MAX_PARTICLES_PER_STEP // max(len(vents), 1)
        made.max_per_step = max(per_vent, _MIN_PARTICLE_LIMIT)
        made.released = wp.zeros(max(1, len(vents)), dtype=wp.int32, device=device)
        made.due = wp.zeros(len(vents), dtype=wp.vec2d, device=device)
        self._restrict(made)
        if vents:
            made.released.assign(self._before.released)
            wp.launch(foresee, len(vents), inputs=[made], outputs=[made.due], device=device)
        return made

    def _read_released(self) -> np.ndarray:
        """Return a copy of the number of emitted particles of each vent."""
        # without tables no particle has been emitted
        if 'outlets' not in vars(self):
            return self._before.released
        return read(self.outlets.released)[: len(self.vents)]

    def _with_places(self, before: Emission, terrain: Terrain, spacing: float) -> Emission:
        """Return an emission in which the missing phases and directions are chosen."""
        phase, downhill = before.phase.copy(), before.downhill.copy()
        sizes, new = extents(self.vents, spacing), np.flatnonzero(np.isnan(phase))
        apart = distances([self.vents[index] for index in new], self.vents)
        for index, distance in zip(new, apart, strict=True):
            # overlapping vents need different phases, or their particles would coincide
            near = distance <= np.maximum(sizes, sizes[index])
            taken = set(phase[near].tolist())
            phase[index] = next(number for number in count() if number not in taken)
        for index in np.flatnonzero(np.isnan(downhill)):
            # relative to downhill: in a rotated scene the places of particles are rotated too
            downhill[index] = _downhill(terrain, self.vents[index].position) / math.pi
        return Emission(before.volume, before.released, phase, downhill)

    def _restrict(self, outlets: Any) -> None:
        """List the places of each vent around which lava may not come out everywhere."""
        terrain, rise = self._terrain, self._rise
        places, first = [np.empty((0, 2))], [0]
        outlets.places = wp.empty(0, dtype=wp.vec2d, device=self._device)
        outlets.first_place = wp.zeros(len(self.vents) + 1, dtype=wp.int32, device=self._device)
        for number, (vent, radius) in enumerate(zip(self.vents, self._radii, strict=True)):
            if not is_open(vent, radius, terrain, rise):
                tried = self.places(number, 0, _CANDIDATES, outlets)
                found = permitted_places(vent, tried, terrain, rise)
                if len(found) < _CANDIDATES or not np.array_equal(found, tried):
                    places.append(found - self._centre)
            first.append(sum(map(len, places)))
        if first[-1]:
            outlets.places = wp.array(np.concatenate(places), dtype=wp.vec2d, device=self._device)
            outlets.first_place.assign(np.array(first, dtype=np.int32))

    def places(self, number: int, first: int, count: int, outlets: Any = None) -> np.ndarray:
        """Return the places of consecutive particles of a vent, (x, y) [m], shape [count, 2]."""
        places = wp.empty(count, dtype=wp.vec2d, device=self._device)
        inputs = [number, first, self.outlets if outlets is None else outlets]
        wp.launch(list_places, count, inputs=inputs, outputs=[places], device=self._device)
        return read(places) + self._centre

    def emission(self, time: float) -> Emission:
        """Return the emission up to a time [s]; no step may be running."""
        volume = self._before.volume + self.volumes(time)
        return replace(self._before, volume=volume, released=self._read_released())

    def save(self) -> dict[str, np.ndarray]:
        """Copy the arrays of ``Emission``, and ``counted``, for a checkpoint at ``since``."""
        counted = np.zeros(len(self.vents), dtype=np.int32)
        counted[list(self.counted)] = 1
        released = self._read_released()
        return asdict(self._before) | {'released': released, 'counted': counted}

    def conduit_particles(
        self, number: int, waiting: float
    ) -> list[tuple[float, float, float, float]]:
        """Return the particles that empty the conduit of a vent.

        They have equal volumes and are at the next places of the vent.

        Args:
            number: Index of the vent.
            waiting: Volume in its conduit [m3].

        Returns:
            Rows of (x [m], y [m], volume [m3], temperature [K]).
        """
        vent = self.vents[number]
        count = max(min(math.ceil(waiting / self._particle_volume), _MAX_PARTICLES_PER_STEP), 0)
        group = self._groups[number]
        if count > 1:
            count = group * math.ceil(count / group)
        if not count:
            return []
        is_restricted = np.diff(read(self.outlets.first_place))[number] > 0
        if group > 1 and count == 1 and not is_restricted:
            places = 0.5 * np.add(vent.position, vent.end or vent.position)[None]
        else:
            places = self.places(number, int(self._read_released()[number]), count)
        return [(x, y, waiting / count, vent.temperature) for x, y in places.tolist()]

    def emitting_by(self, until: float) -> set[int]:
        """Return the indices of vents with lava in their conduits, or that emit by ``until`` [s].

        Vents that are ``counted`` are excluded.
        """
        return {
            number
            for number, time in enumerate(self._opening)
            if number not in self.counted and (self._is_filled[number] or time < until)
        }

    def idle_until(self, time: float, end: float) -> float:
        """Return the time [s] before which no vent emits; infinite if none releases by ``end``.

        A particle that is due already makes it ``time``. On cells the kernel skips idle time, as
        lava may leave in any of the many steps of a launch (``cells/worlds.py``).
        """
        due = read(self.outlets.due)
        first = due[:, 0].min() if due.size else math.inf
        if first == math.inf or first > (1.0 + _ROUNDING) * end:
            return math.inf
        opening = min(vent.next_opening(time) for vent in self.vents)
        return opening if first >= (1.0 - _ROUNDING) * opening else time

    def pending(self, time: float, released: np.ndarray | None = None) -> np.ndarray:
        """Return the volume [m3] of each vent that is emitted but not yet a particle.

        Args:
            time: Simulated time [s].
            released: A copy of ``released`` at that time, by default the current values.
        """
        if released is None:
            released = self._read_released()
        released = released[: len(self.vents)]
        return self._before.volume + self.volumes(time) - released * self._particle_volume

    def overdue(self, pending: float) -> float:
        """Return the part of the pending volume [m3] that is overdue."""
        usual = sum(self._groups) * self._particle_volume * (1.0 + _ROUNDING)
        return pending - usual if pending > usual else 0.0

    @cached_property
    def step_limits(self) -> np.ndarray:
        """Limits of the steps while each discharge lasts.

        In such a step no vent raises its area by more than half of the expected thickness, and all
        vents together emit no more than the maximum number of particles. The columns are the end
        of each span of constant discharge [s], the longest step in it [s] and the discharge of all
        vents [m3/s].
        """
        assert self._thickness is not None
        series = [np.transpose(vent.series) for vent in self.vents]
        ends = np.unique([time for times, _ in series for time in times if time > self.since])
        begins = np.array([self.since, *ends])
        rates = np.zeros((len(series), len(begins)))
        for row, (times, fluxes) in zip(rates, series, strict=True):
            index = np.searchsorted(times, begins, side='right') - 1
            row[:] = np.where(index >= 0, fluxes[index], 0.0)
        total = rates.sum(axis=0)
        radii, lengths = np.array(self._radii), np.array(self._lengths)
        # lava comes out on cells with data only
        ground = float(self._terrain.has_data.sum()) * self._terrain.resolution**2
        areas = np.minimum(math.pi * radii**2 + 2.0 * radii * lengths, ground)
        strongest = np.max(rates.T / areas, axis=1, initial=0.0)
        with np.errstate(divide='ignore'):
            steps = np.minimum(
                0.5 * self._thickness / strongest,
                _MAX_PARTICLES_PER_STEP * self._particle_volume / total,
            )
        return np.column_stack([[*ends, math.inf], steps, total])


def check_rates(vents: Sequence[Vent], particle_volume: float) -> None:
    """Check that a discharge does not produce more particles than can be computed.

    Raises:
        LavaError: If the sum of the peaks is too large; it names the vent that exceeds it.
    """
    max_rate, total = MAX_PARTICLES_PER_SECOND * particle_volume, 0.0
    for number, vent in enumerate(vents):
        total += vent.peak
        if total > max_rate:
            raise LavaError(
                f'vents[{number}].discharge',
                vent.peak,
                f'at most {max_rate:.3g} m3/s of all vents together, '
                f'{MAX_PARTICLES_PER_SECOND:g} particles of {particle_volume:.3g} m3 in a second',
            )


def _downhill(terrain: Terrain, place: tuple[float, float]) -> float:
    """Return the direction in which the ground falls around a place [rad], 0 if level."""
    cell = terrain.cell_at(*place)
    if cell is None:
        return 0.0
    rows, columns = (
        np.clip(np.arange(n - 1, n + 2), 0, side - 1)
        for n, side in zip(cell, terrain.shape, strict=True)
    )
    around = terrain.elevation[np.ix_(rows, columns)].astype(np.float64)
    fall_x = float((around[:, 0] - around[:, 2]).sum())
    fall_y = float((around[0, :] - around[2, :]).sum())
    falls = math.hypot(fall_x, fall_y) > 0.0
    return math.atan2(fall_y, fall_x) if falls else 0.0
