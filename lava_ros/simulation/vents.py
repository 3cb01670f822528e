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
from collections.abc import Container, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain, Vent
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.streams import read
from lava_ros.simulation.state import centre_of

#: Particles that the vents may bring in a second: more is no flow that anybody can compute.
MOST_A_SECOND = 1e6

#: Particles that all vents together bring in a step, and at least each.
_MOST_A_STEP, _LEAST_MOST = 2**18, 64

#: Particles that come out of a disc and of a fissure at once, so that they have its symmetries.
_DISC_GROUP, _FISSURE_GROUP = 8, 4

#: Part of a particle that rounding may keep back.
_ROUNDING = 1e-6

#: Golden section: multiples of it, less their whole parts, are spread evenly.
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@wp.struct
class Outlets:
    """The tables of some vents, and what has come out of them, on a device.

    ``starts`` says which of the breakpoints of ``times``, ``fluxes`` and ``volumes`` are a vent's,
    shape [vents + 1]. ``released`` and ``due`` are those of ``VentSet``, ``most`` the particles
    that a vent may bring in a step.
    """

    shape: wp.array2d(dtype=wp.float64)
    starts: wp.array(dtype=wp.int32)
    times: wp.array(dtype=wp.float64)
    fluxes: wp.array(dtype=wp.float64)
    volumes: wp.array(dtype=wp.float64)
    particle_volume: wp.float64
    most: wp.int32
    released: wp.array(dtype=wp.int32)
    due: wp.array(dtype=wp.vec2d)


@lru_cache
def due_functions(symmetric: bool) -> tuple[Any, Any]:
    """Particles of a vent that come out at once, and when the next two of these groups do."""

    @wp.func
    def group_of(v: int, outlets: Outlets) -> int:
        if wp.static(symmetric):
            return wp.where(
                outlets.shape[v, 6] > wp.float64(0.0),
                wp.static(_FISSURE_GROUP),
                wp.static(_DISC_GROUP),
            )
        return 1

    @wp.func
    def due_at(v: int, volume: wp.float64, outlets: Outlets) -> wp.float64:
        """Time at which a vent has given a volume, infinite when it never will."""
        last = outlets.starts[v + 1]
        for k in range(outlets.starts[v], last):
            flux = outlets.fluxes[k]
            if flux > wp.float64(0.0):
                rest = wp.max(volume - outlets.volumes[k], wp.float64(0.0))
                time = outlets.times[k] + rest / flux
                if k + 1 == last or time <= outlets.times[k + 1]:
                    return time
        return wp.float64(wp.inf)

    @wp.func
    def next_two(v: int, outlets: Outlets) -> wp.vec2d:
        released, group = outlets.released[v], group_of(v, outlets)
        following = outlets.particle_volume * wp.float64(released + group)
        after = outlets.particle_volume * wp.float64(released + 2 * group)
        return wp.vec2d(due_at(v, following, outlets), due_at(v, after, outlets))

    return group_of, next_two


@lru_cache
def _kernel(symmetric: bool) -> Any:
    _, next_two = due_functions(symmetric)

    @wp.kernel(module='unique', enable_backward=False)
    def foresee(outlets: Outlets):
        v = wp.tid()
        outlets.due[v] = next_two(v, outlets)

    return foresee


class VentSet:
    """The vents of one span of time, on a device.

    Attributes:
        vents: The vents.
        since: Time from which they emit [s].
        due: Times at which the next particles of each vent come out, and those after them [s],
            float64, shape [vents, 2].
        released: Particles that have come out of each vent, shape [vents], at least one.
        outlets: All of it for kernels.
        is_symmetric: Whether particles come out in groups that have the vent's symmetries.
    """

    def __init__(
        self,
        vents: tuple[Vent, ...],
        terrain: Terrain,
        accuracy: Accuracy,
        particle_volume: float,
        device: Any,
        *,
        since: float,
        carried: Iterable[float],
    ) -> None:
        """Lay out the vents' tables.

        Args:
            vents: The vents.
            terrain: The ground that they are on.
            accuracy: The resolution; a vent narrower than its spacing is widened to that.
            particle_volume: Volume of a particle [m3].
            device: Warp device.
            since: Time from which they emit [s].
            carried: Volume already in each vent's conduit [m3].
        """
        assert accuracy.spacing is not None
        self.vents = vents
        self.since = since
        self._carried = np.array(list(carried), dtype=np.float64)
        # asked at each advance: found once
        self._opening = [vent.opens_after(since) for vent in self.vents]
        self._particle_volume = particle_volume
        self.is_symmetric = accuracy.symmetric
        self._device = device
        shape = np.zeros((len(self.vents), 11))
        centre = centre_of(terrain)
        places: Counter[Any] = Counter()
        starts, times, fluxes, volumes = [0], [], [], []
        for row, vent, conduit in zip(shape, vents, self._carried.tolist(), strict=True):
            end = vent.position if vent.end is None else vent.end
            row[0:2] = vent.position - centre
            row[2:4] = end - centre
            row[4] = max(vent.radius, accuracy.spacing)
            row[5] = vent.temperature
            row[6] = math.dist(vent.position, end)
            row[7:9] = vent.velocity
            row[9] = places[vent.position, vent.end]
            places[vent.position, vent.end] += 1
            # in half turns: a scene that is turned has the same places of particles, turned
            row[10] = _downhill(terrain, vent.position) / math.pi
            begins = [max(time, since) for time, _ in vent.series]
            times += begins
            fluxes += [flux for _, flux in vent.series]
            volumes += [conduit + volume for volume in vent.volumes_at(begins, since=since)]
            starts.append(len(times))
        self._areas = [math.pi * row[4] ** 2 + 2.0 * row[4] * row[6] for row in shape]
        self.released = wp.zeros(max(1, len(self.vents)), dtype=wp.int32, device=device)
        self.due = wp.zeros(len(self.vents), dtype=wp.vec2d, device=device)
        self.outlets = Outlets()
        self.outlets.starts = wp.array(starts, dtype=wp.int32, device=device)
        # in one copy, and a number more: Warp gives no part of length 0 at an array's end
        rows = [shape.ravel(), times, fluxes, volumes]
        table = wp.array([*np.concatenate(rows), 0.0], dtype=wp.float64, device=device)
        ends = np.cumsum([0, *map(len, rows)]).tolist()
        parts = [table[first:end] for first, end in pairwise(ends)]
        self.outlets.shape = parts[0].reshape(shape.shape)
        self.outlets.times, self.outlets.fluxes, self.outlets.volumes = parts[1:]
        self.outlets.particle_volume = particle_volume
        self.outlets.most = max(_MOST_A_STEP // max(len(self.vents), 1), _LEAST_MOST)
        self.outlets.released, self.outlets.due = self.released, self.due
        self._foresee()

    def _foresee(self) -> None:
        if self.vents:
            wp.launch(
                _kernel(self.is_symmetric),
                dim=len(self.vents),
                inputs=[self.outlets],
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

    def giving(self, until: float, *, others_than: Container[int]) -> list[int]:
        """Numbers of the vents with lava in their conduits, or that emit some by ``until`` [s].

        Vents with numbers in ``others_than`` are left out.
        """
        return [
            number
            for number, time in enumerate(self._opening)
            if number not in others_than and (self._carried[number] > 0.0 or time < until)
        ]

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

    def late(self, pending: float) -> float:
        """The part of what is pending [m3] that room and steps have kept from coming out."""
        groups = [_FISSURE_GROUP if vent.end else _DISC_GROUP for vent in self.vents]
        count = sum(groups) if self.is_symmetric else len(groups)
        usual = count * self._particle_volume * (1.0 + _ROUNDING)
        return pending - usual if pending > usual else 0.0

    def longest_step(self, thickness: float) -> float:
        """Time [s] in which no vent raises its own area by more than half a thickness [m].

        All together then bring no more particles than a step should.
        """
        strongest, total = 0.0, 0.0
        for vent, area in zip(self.vents, self._areas, strict=True):
            strongest, total = max(strongest, vent.peak / area), total + vent.peak
        if strongest <= 0.0:
            return math.inf
        return min(0.5 * thickness / strongest, _MOST_A_STEP * self._particle_volume / total)


def check_rates(vents: Sequence[Vent], particle_volume: float) -> None:
    """Refuse a discharge that would bring more particles than can be computed.

    Raises:
        LavaError: It names the vent and the largest discharge of all of them together.
    """
    most, total = MOST_A_SECOND * particle_volume, 0.0
    for number, vent in enumerate(vents):
        total += vent.peak
        if total > most:
            raise LavaError(
                f'vents[{number}].discharge',
                vent.peak,
                f'at most {most:.3g} m3/s of all vents together, {MOST_A_SECOND:g} particles of '
                f'{particle_volume:.3g} m3 in a second',
            )


def parting(
    vent: Vent, waiting: float, particle_volume: float
) -> Iterator[tuple[tuple[float, float], float]]:
    """Places and volumes [m3] of the particles of a conduit that is emptied.

    They are equal and spread over the vent with its symmetries; a single one is in its middle.
    """
    count = min(math.ceil(waiting / particle_volume), _MOST_A_STEP)
    if count > 1 and not vent.end:
        count = _DISC_GROUP * math.ceil(count / _DISC_GROUP)
    for n in range(count):
        x, y = vent.position
        if vent.end:
            share = (n + 0.5) / count
            x, y = x + share * (vent.end[0] - x), y + share * (vent.end[1] - y)
        elif count > 1:
            group, member = divmod(n, _DISC_GROUP)
            distance = vent.radius * math.sqrt((_DISC_GROUP * group + 0.5) / count)
            angle = 0.25 * math.pi * ((group + 0.5) * _GOLDEN % 1.0)
            # either side of each axis
            angle = 0.5 * math.pi * (member // 2) + (angle if member % 2 else -angle)
            x, y = x + distance * math.cos(angle), y + distance * math.sin(angle)
        yield (x, y), waiting / count


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
