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

"""The numbers of a moment: clock, counts and volumes, gathered on the device in one array.

Read one after the other they would be of several moments where steps go on meanwhile, and the
particles' volumes would all have to come to the host for one sum.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.scene import Terrain
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.snapshot import Snapshot, StepReport
from lava_ros.simulation.state import (
    BORDER,
    EVALUATIONS,
    FULL_STEP,
    HOLES,
    LIMIT,
    NEWCOMERS,
    PARTICLES,
    STAGES,
    State,
    STEPS,
    TIME,
)
from lava_ros.simulation.timestep import LIMITS
from lava_ros.simulation.vents import VentSet

#: Sums that the particles' volumes are added up in, which the host adds up. With as many on every
#: device and for any number of particles the order of the sum is always the same.
_SUMS = 16384


class Moment(NamedTuple):
    """The numbers of a moment.

    Attributes:
        time: Simulated time [s].
        particle_count: Particles there are.
        steps: The time stepping so far.
        volume: Sum of the particles' volumes [m3].
        left: Volume that has left the terrain [m3].
        in_holes: The part of it that has come onto cells without data [m3].
        frozen: Volume that has frozen [m3].
        released: Particles that have come out of each vent, int32.
    """

    time: float
    particle_count: int
    steps: StepReport
    volume: float
    left: float
    in_holes: float
    frozen: float
    released: np.ndarray


@lru_cache
def _kernel(real: Any) -> Any:
    vec4 = wp.types.vector(4, real)

    @wp.kernel(module='unique', enable_backward=False)
    def gather(
        particle: wp.array(dtype=vec4),
        clock: wp.array(dtype=wp.float64),
        counts: wp.array(dtype=wp.int32),
        left: wp.array(dtype=wp.float64),
        frozen: wp.array(dtype=wp.float64),
        released: wp.array(dtype=wp.int32),
        numbers: wp.array(dtype=wp.float64),
    ):
        t = wp.tid()
        total = wp.float64(0.0)
        for i in range(t, counts[PARTICLES] + counts[NEWCOMERS], wp.static(_SUMS)):
            total += wp.float64(particle[i][2])
        numbers[t] = total
        if t == 0:
            place = int(wp.static(_SUMS))
            numbers[place] = left[BORDER]
            numbers[place + 1] = left[HOLES]
            if frozen:
                numbers[place + 2] = frozen[0]
            place += 3
            for i in range(clock.shape[0]):
                numbers[place + i] = clock[i]
            place += clock.shape[0]
            for i in range(counts.shape[0]):
                numbers[place + i] = wp.float64(counts[i])
            place += counts.shape[0]
            for i in range(released.shape[0]):
                numbers[place + i] = wp.float64(released[i])

    return gather


class FlowDiagnostics:
    """Where the numbers are gathered."""

    def __init__(self) -> None:
        """Begin without an array."""
        self._numbers: Any = None

    def take(self, state: State, vents: VentSet) -> Any:
        """Gather the numbers of now on the device, for ``moment_of``; the next time replaces them.

        Particles that have left are dropped already.
        """
        length = _SUMS + 3 + state.clock.size + state.counts.size + vents.released.size
        if self._numbers is None or self._numbers.size != length:
            self._numbers = wp.zeros(length, dtype=wp.float64, device=state.device)
        wp.launch(
            _kernel(state.real),
            dim=_SUMS,
            inputs=[
                state.particle,
                state.clock,
                state.counts,
                state.left,
                getattr(state, 'frozen', None),
                vents.released,
            ],
            outputs=[self._numbers],
            device=state.device,
        )
        return self._numbers


def moment_of(numbers: np.ndarray, state: State) -> Moment:
    """Read a copy of what a census has gathered; of the state only the arrays' sizes are read."""
    ends = np.cumsum([_SUMS, 3, state.clock.size, state.counts.size])
    sums, (border, holes, frozen), clock, places, released = np.split(numbers, ends)
    counts = places.astype(np.int64)
    return Moment(
        time=float(clock[TIME]),
        particle_count=int(counts[PARTICLES] + counts[NEWCOMERS]),
        steps=StepReport(
            count=int(counts[STEPS]),
            evaluations=int(counts[EVALUATIONS]),
            stages=int(counts[STAGES]),
            length=float(clock[FULL_STEP]),
            limit=LIMITS[int(counts[LIMIT])],
        ),
        volume=float(sums.sum()),
        left=float(border + holes),
        in_holes=float(holes),
        frozen=float(frozen),
        released=released.astype(np.int32),
    )


def budget_of(moment: Moment, vents: VentSet, before: float) -> VolumeBudget:
    """Account for the volume of a moment; ``before`` [m3] came out before these vents did."""
    pending = float(vents.pending(moment.time, moment.released).sum())
    return VolumeBudget(
        emitted=before + vents.emitted(moment.time),
        held=moment.volume + pending,
        pending=pending,
        left=moment.left,
        frozen=moment.frozen,
        late=vents.late(pending),
        in_holes=moment.in_holes,
    )


def snapshot_of(
    copies: Sequence[np.ndarray],
    terrain: Terrain,
    state: State,
    vents: VentSet,
    before: float,
) -> Snapshot:
    """Put together what is shown of a moment.

    Args:
        copies: The grids, thickness, temperature and, with solidification, what has frozen of
            it, and where it is noted the arrival; and what a census has gathered.
        terrain: The ground that the grids lie on.
        state: The particles; only the arrays' sizes are read.
        vents: The vents of then.
        before: Volume that was emitted before these vents [m3].
    """
    grids, numbers = copies
    moment = moment_of(numbers, state)
    arrived = None
    if hasattr(state, 'arrived'):
        arrived, grids = np.where(grids[-1] < 0.0, np.float32(np.nan), grids[-1]), grids[:-1]
    return Snapshot(
        time=moment.time,
        terrain=terrain,
        thickness=grids[0],
        temperature=grids[1],
        budget=budget_of(moment, vents, before),
        particle_count=moment.particle_count,
        steps=moment.steps,
        frozen=grids[2] if len(grids) > 2 else None,
        arrived=arrived,
    )
