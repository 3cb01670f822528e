# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Vents: particles of constant volume, as many as the integral of the discharge asks for."""

from collections import Counter
from collections.abc import Iterable, Sequence
from functools import lru_cache
import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.accuracy import Accuracy
from lava_ros.scene import Terrain, Vent
from lava_ros.simulation.cells import cell_frame
from lava_ros.simulation.compiled import after_the_former
from lava_ros.simulation.neighbors import bin_function, NeighborGrid
from lava_ros.simulation.state import (
    centre_of,
    FULL,
    IS_LAST,
    NEWCOMERS,
    PARTICLES,
    State,
    TIME,
)
from lava_ros.simulation.streams import read
from lava_ros.simulation.terrain import terrain_frame

#: Relative error of the time at which a particle is due.
_ROUNDING = 1e-9

#: Particles that come out of a disc and of a fissure at once, so that they have its symmetries.
_DISC_GROUP, _FISSURE_GROUP = 8, 4


@lru_cache
def _due_functions(symmetric: bool) -> tuple[Any, Any, Any]:
    """Particles of a vent that come out at once, when the next do, and a kernel for all vents."""

    @wp.func
    def group_of(shape: wp.array2d(dtype=wp.float64), v: int) -> int:
        if wp.static(symmetric):
            return wp.where(
                shape[v, 6] > wp.float64(0.0), wp.static(_FISSURE_GROUP), wp.static(_DISC_GROUP)
            )
        return 1

    @wp.func
    def due_at(
        volume: wp.float64,
        first: int,
        last: int,
        times: wp.array(dtype=wp.float64),
        fluxes: wp.array(dtype=wp.float64),
        volumes: wp.array(dtype=wp.float64),
    ) -> wp.float64:
        """Time at which a vent has given a volume, infinite when it never will."""
        for k in range(first, last):
            if fluxes[k] > wp.float64(0.0):
                time = times[k] + wp.max(volume - volumes[k], wp.float64(0.0)) / fluxes[k]
                if k + 1 == last or time <= times[k + 1]:
                    return time
        return wp.float64(wp.inf)

    @wp.func
    def next_two(
        v: int,
        released: int,
        shape: wp.array2d(dtype=wp.float64),
        starts: wp.array(dtype=wp.int32),
        times: wp.array(dtype=wp.float64),
        fluxes: wp.array(dtype=wp.float64),
        volumes: wp.array(dtype=wp.float64),
        particle_volume: wp.float64,
    ) -> wp.vec2d:
        """When the next particles come out of a vent, and those after them."""
        group = group_of(shape, v)
        following = particle_volume * wp.float64(released + group)
        after = particle_volume * wp.float64(released + 2 * group)
        return wp.vec2d(
            due_at(following, starts[v], starts[v + 1], times, fluxes, volumes),
            due_at(after, starts[v], starts[v + 1], times, fluxes, volumes),
        )

    @wp.kernel(module='unique', enable_backward=False)
    def foresee(
        shape: wp.array2d(dtype=wp.float64),
        starts: wp.array(dtype=wp.int32),
        times: wp.array(dtype=wp.float64),
        fluxes: wp.array(dtype=wp.float64),
        volumes: wp.array(dtype=wp.float64),
        particle_volume: wp.float64,
        released: wp.array(dtype=wp.int32),
        due: wp.array(dtype=wp.vec2d),
    ):
        v = wp.tid()
        due[v] = next_two(
            v, released[v], shape, starts, times, fluxes, volumes, particle_volume
        )

    return group_of, next_two, foresee


@lru_cache
def _kernel(real: Any, symmetric: bool, has_velocity: bool, has_age: bool, bins: bool) -> Any:
    vec2 = wp.types.vector(2, real)
    vec4 = wp.types.vector(4, real)

    group_of, next_two, _ = _due_functions(symmetric)
    put = bin_function(real, False)
    # the motion of the others goes on meanwhile, and needs to know how many there are
    total = NEWCOMERS if bins else PARTICLES

    @wp.func
    def place_of(shape: wp.array2d(dtype=wp.float64), v: int, n: int) -> vec2:
        """Place of a vent's n-th particle: stratified, never the same place twice.

        The additive recurrence of the plastic number spreads any number of points evenly. With
        symmetry each of its points is in one part of the vent, and the others mirror it.
        """
        group = group_of(shape, v)
        part = n % group
        turns = wp.float64(n // group + 1)
        # vents in one place begin elsewhere, or their particles would be in one place
        a = wp.float64(0.7548776662466927) * turns
        a += wp.float64(0.6180339887498949) * shape[v, 9]
        b = wp.float64(0.5698402909980532) * turns
        b += wp.float64(0.4142135623730951) * shape[v, 9]
        a = a - wp.floor(a)
        b = b - wp.floor(b)
        radius = shape[v, 4]
        length = shape[v, 6]
        x = wp.float64(0.0)
        y = wp.float64(0.0)
        if length > wp.float64(0.0):
            across = wp.float64(2.0) * b - wp.float64(1.0)
            if wp.static(symmetric):
                a = wp.float64(0.5) * a
                across = b
                if part % 2 == 1:
                    a = wp.float64(1.0) - a
                if part >= 2:
                    across = -across
            across *= radius / length
            along_x = shape[v, 2] - shape[v, 0]
            along_y = shape[v, 3] - shape[v, 1]
            x = a * along_x - across * along_y
            y = a * along_y + across * along_x
        elif wp.static(symmetric):
            # away from the sides of its eighth, lest a point meet its mirror image
            angle = wp.float64(0.25 * wp.pi) * (wp.float64(0.1) + wp.float64(0.8) * a)
            x = radius * wp.sqrt(b) * wp.cos(angle)
            y = radius * wp.sqrt(b) * wp.sin(angle)
            if part % 2 == 1:
                swapped = x
                x = y
                y = swapped
            if (part // 2) % 2 == 1:
                x = -x
            if part >= 4:
                y = -y
        else:
            angle = wp.float64(2.0 * wp.pi) * a + shape[v, 10]
            x = radius * wp.sqrt(b) * wp.cos(angle)
            y = radius * wp.sqrt(b) * wp.sin(angle)
        return vec2(real(shape[v, 0] + x), real(shape[v, 1] + y))

    @wp.kernel(module='unique', enable_backward=False)
    def emit(
        span: int,
        shape: wp.array2d(dtype=wp.float64),
        starts: wp.array(dtype=wp.int32),
        times: wp.array(dtype=wp.float64),
        fluxes: wp.array(dtype=wp.float64),
        volumes: wp.array(dtype=wp.float64),
        particle_volume: wp.float64,
        clock: wp.array(dtype=wp.float64),
        capacity: int,
        emitted: wp.array(dtype=wp.int32),
        due_times: wp.array(dtype=wp.vec2d),
        counts: wp.array(dtype=wp.int32),
        particle: wp.array(dtype=vec4),
        remainder: wp.array(dtype=vec2),
        velocity: wp.array(dtype=vec2),
        age: wp.array(dtype=real),
        known: wp.array2d(dtype=wp.uint8),
        terrain: terrain_frame(real),
        cells: cell_frame(real),
        cell: wp.array(dtype=wp.int32),
        rank: wp.array(dtype=wp.int32),
        sizes: wp.array(dtype=wp.int32),
        left: wp.array(dtype=wp.float64),
    ):
        """Release the whole particles that the discharge up to now makes and are not out yet."""
        after_the_former()
        if counts[IS_LAST] == 0:
            return
        time = clock[TIME]
        vents = starts.shape[0] - 1
        first = wp.tid() * span
        for v in range(first, wp.min(first + span, vents)):
            k = starts[v]
            # nothing is read but when something is due, give or take its rounding
            is_due = time >= (wp.float64(1.0) - wp.float64(_ROUNDING)) * due_times[v][0]
            if is_due and time >= times[k]:
                while k + 1 < starts[v + 1] and times[k + 1] <= time:
                    k += 1
                volume = volumes[k] + fluxes[k] * (time - times[k])
                due = int(volume / particle_volume) - emitted[v]
                due -= due % group_of(shape, v)
                slot = 0
                if due > 0:
                    slot = wp.atomic_add(counts, wp.static(total), due)
                    if wp.static(bins):
                        slot += counts[PARTICLES]
                    if slot + due > capacity:
                        # no room: what is due stays in the conduit until the host has made some
                        wp.atomic_sub(counts, wp.static(total), due)
                        counts[FULL] = 1
                        due = 0
                for n in range(due):
                    if wp.static(real is wp.float32):
                        remainder[slot + n] = vec2()
                    if wp.static(has_velocity):
                        velocity[slot + n] = vec2(real(shape[v, 7]), real(shape[v, 8]))
                    if wp.static(has_age):
                        age[slot + n] = real(0.0)
                    place = place_of(shape, v, emitted[v] + n)
                    p = vec4(place[0], place[1], real(particle_volume), real(shape[v, 5]))
                    particle[slot + n] = p
                    if wp.static(bins):
                        put(slot + n, p, counts, known, terrain, cells, cell, rank, sizes, left)
                if due > 0:
                    emitted[v] = emitted[v] + due
                    due_times[v] = next_two(
                        v, emitted[v], shape, starts, times, fluxes, volumes, particle_volume
                    )

    return emit


class VentSet:
    """The vents of one span of time, on a device.

    Attributes:
        vents: The vents.
        since: Time from which they emit [s].
        due: Times at which the next particles of each vent come out, and those after them [s],
            float64, shape [vents, 2].
        released: Particles that have come out of each vent, shape [vents], at least one.
    """

    def __init__(
        self,
        vents: Sequence[Vent],
        *,
        since: float,
        carried: Sequence[float],
        centre: np.ndarray,
        particle_volume: float,
        least_radius: float,
        downhill: Sequence[float],
        symmetric: bool,
        device: Any,
    ) -> None:
        """Lay out the vents' tables.

        Args:
            vents: The vents.
            since: Time from which they emit [s].
            carried: Volume already in each vent's conduit [m3].
            centre: Map position particles are relative to [m].
            particle_volume: Volume of a particle [m3].
            least_radius: Radius below which a vent is not resolved [m]: it is widened to this.
            downhill: Direction in which the ground falls at each vent [rad]: places of particles
                in a disc turn with it, so a scene that is turned has the same ones.
            symmetric: Whether particles come out in groups that have the vent's symmetries.
            device: Warp device.
        """
        self.vents = tuple(vents)
        self.since = since
        self._carried = np.array(carried, dtype=np.float64)
        self._particle_volume = particle_volume
        self._symmetric = symmetric
        self._device = device
        shape = np.zeros((len(self.vents), 11))
        shape[:, 10] = downhill
        places: Counter[Any] = Counter()
        starts, times, fluxes, volumes = [0], [], [], []
        for row, vent, conduit in zip(shape, self.vents, carried, strict=True):
            end = vent.position if vent.end is None else vent.end
            row[0:2] = vent.position - centre
            row[2:4] = end - centre
            row[4] = max(vent.radius, least_radius)
            row[5] = vent.temperature
            row[6] = math.dist(vent.position, end)
            row[7:9] = vent.velocity
            row[9] = places[vent.position, vent.end]
            places[vent.position, vent.end] += 1
            for time, flux in vent.series:
                times.append(max(time, since))
                fluxes.append(flux)
                volumes.append(conduit + vent.volume_between(since, times[-1]))
            starts.append(len(times))
        self._areas = [math.pi * row[4] ** 2 + 2.0 * row[4] * row[6] for row in shape]
        self._shape = wp.array(shape, dtype=wp.float64, ndim=2, device=device)
        self._starts = wp.array(starts, dtype=wp.int32, device=device)
        self._times = wp.array(times, dtype=wp.float64, device=device)
        self._fluxes = wp.array(fluxes, dtype=wp.float64, device=device)
        self._volumes = wp.array(volumes, dtype=wp.float64, device=device)
        self.released = wp.zeros(max(1, len(self.vents)), dtype=wp.int32, device=device)
        self.due = wp.zeros(len(self.vents), dtype=wp.vec2d, device=device)
        self._foresee()

    def emit(self, state: State, neighbors: NeighborGrid) -> None:
        """Append to the state's particles what is due at its time."""
        if not self.vents:
            return
        # one thread for all vents gives their particles the same order in every run
        span = len(self.vents) if state.is_deterministic else 1
        state.launches(
            _kernel(
                state.real,
                self._symmetric,
                state.has_velocity,
                state.has_age,
                state.bins_in_motion,
            ),
            dim=len(self.vents) // span,
            inputs=[
                span,
                self._shape,
                self._starts,
                self._times,
                self._fluxes,
                self._volumes,
                self._particle_volume,
                state.clock,
                state.capacity,
            ],
            outputs=[
                self.released,
                self.due,
                state.counts,
                state.particle,
                *state.optional('remainder', 'velocity', 'age'),
                *neighbors.place_in(state),
            ],
        )

    def _foresee(self) -> None:
        if not self.vents:
            return
        wp.launch(
            _due_functions(self._symmetric)[2],
            dim=len(self.vents),
            inputs=[
                self._shape,
                self._starts,
                self._times,
                self._fluxes,
                self._volumes,
                self._particle_volume,
                self.released,
            ],
            outputs=[self.due],
            device=self._device,
        )

    def save(self) -> dict[str, np.ndarray]:
        """Copy what is not in the vents themselves: their conduits, and what has come out."""
        released = read(self.released)[: len(self.vents)]
        return {'carried': self._carried.copy(), 'released': released}

    def load(self, released: np.ndarray) -> None:
        """Go on after as many particles as ``save`` has found released."""
        if len(released):
            self.released.assign(released)
            self._foresee()

    def emitted(self, time: float) -> float:
        """Volume [m3] the vents have given from ``since`` to ``time``."""
        return sum(vent.volume_between(self.since, time) for vent in self.vents)

    def pending(self, time: float, released: np.ndarray | None = None) -> np.ndarray:
        """Volume [m3] of each vent that is emitted but not yet a particle.

        Args:
            time: Simulated time [s].
            released: A copy of ``released`` as it was then, read when left out.
        """
        if released is None:
            released = read(self.released)
        released = released[: len(self.vents)]
        given = [vent.volume_between(self.since, time) for vent in self.vents]
        return self._carried + given - released * self._particle_volume

    def longest_step(self, thickness: float) -> float:
        """Time [s] in which the strongest vent raises its own area by half a thickness [m]."""
        strongest = 0.0
        for vent, area in zip(self.vents, self._areas, strict=True):
            flux = max(value for _, value in vent.series)
            strongest = max(strongest, flux / area)
        return 0.5 * thickness / strongest if strongest > 0.0 else math.inf


def vent_set(
    vents: tuple[Vent, ...],
    terrain: Terrain,
    accuracy: Accuracy,
    particle_volume: float,
    device: Any,
    *,
    since: float,
    carried: Iterable[float],
) -> VentSet:
    """Lay out the vents of a simulation; arguments as those of ``VentSet``."""
    assert accuracy.spacing is not None
    return VentSet(
        vents,
        since=since,
        carried=list(carried),
        centre=centre_of(terrain),
        particle_volume=particle_volume,
        least_radius=accuracy.spacing,
        downhill=[_downhill(terrain, vent.position) for vent in vents],
        symmetric=accuracy.symmetric,
        device=device,
    )


def _downhill(terrain: Terrain, place: tuple[float, float]) -> float:
    """Direction in which the ground falls around a place [rad], 0 where it does not."""
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
