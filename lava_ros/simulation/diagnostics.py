# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

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
from lava_ros.simulation import state as at
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.snapshot import Snapshot, StepReport
from lava_ros.simulation.state import State
from lava_ros.simulation.timestep import LIMITS
from lava_ros.simulation.vents import VentSet

#: Sums that the particles' volumes are added up in, which the host adds up. With as many on every
#: device and for any number of particles the order of the sum is always the same.
_SUMS = 16384


class Moment(NamedTuple):
    """The numbers of a moment, as ``Snapshot`` has them."""

    time: float
    particle_count: int
    steps: StepReport
    budget: VolumeBudget


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
        for i in range(t, counts[at.PARTICLES] + counts[at.NEWCOMERS], wp.static(_SUMS)):
            total += wp.float64(particle[i][2])
        numbers[t] = total
        if t == 0:
            place = int(wp.static(_SUMS))
            numbers[place] = left[at.BORDER]
            numbers[place + 1] = left[at.HOLES]
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
                state.particle, state.clock, state.counts, state.left,
                getattr(state, 'frozen', None), vents.released,
            ],
            outputs=[self._numbers],
            device=state.device,
        )
        return self._numbers


def moment_of(numbers: np.ndarray, state: State, vents: VentSet, before: float) -> Moment:
    """Read a copy of what was gathered.

    Of the state only the arrays' sizes are read; ``before`` [m3] came out before these vents did.
    """
    ends = np.cumsum([_SUMS, 3, state.clock.size, state.counts.size])
    sums, (border, holes, frozen), clock, places, released = np.split(numbers, ends)
    counts, time = places.astype(np.int64), float(clock[at.TIME])
    pending = float(vents.pending(time, released.astype(np.int32)).sum())
    return Moment(
        time=time,
        particle_count=at.count_in(counts),
        steps=StepReport(
            count=int(counts[at.STEPS]),
            evaluations=int(counts[at.EVALUATIONS]),
            stages=int(counts[at.STAGES]),
            length=float(clock[at.FULL_STEP]),
            limit=LIMITS[int(counts[at.LIMIT])],
        ),
        budget=VolumeBudget(
            emitted=before + vents.emitted(time),
            held=float(sums.sum()) + pending,
            pending=pending,
            left=float(border + holes),
            frozen=float(frozen),
            late=vents.late(pending),
            in_holes=float(holes),
        ),
    )


def snapshot_of(
    copies: Sequence[np.ndarray],
    terrain: Terrain,
    state: State,
    vents: VentSet,
    before: float,
) -> Snapshot:
    """Put together what is shown of a moment; state, vents and volume as of ``moment_of``.

    ``copies`` are the grids on the terrain, thickness, temperature and, with solidification, what
    has frozen of it, then the arrival; and what was gathered.
    """
    grids, numbers = copies
    arrived, grids = np.where(grids[-1] < 0.0, np.float32(np.nan), grids[-1]), grids[:-1]
    return Snapshot(
        terrain=terrain,
        thickness=grids[0],
        temperature=grids[1],
        frozen=grids[2] if len(grids) > 2 else None,
        arrived=arrived,
        **moment_of(numbers, state, vents, before)._asdict(),
    )
