# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Clock, counts and volumes of one moment, gathered on the device in one array.

Read one after the other while steps continue, they would belong to different moments, and all
particle volumes would have to be copied to the host for one sum.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.scene import Terrain
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.budget import lost_volumes, VolumeBudget
from lava_ros.simulation.output.snapshot import Snapshot, StepReport
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.solidified import RaisedTerrain, THICKNESS_UNIT
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.step.timestep import LIMITS
from lava_ros.simulation.step.vents import VentSet

#: Last grids of a map: what lava has covered, as fields of ``Snapshot``.
SHOWN = ('inundated', 'half_inundated', 'arrived')

#: Number of partial sums of the particles' volumes, which the host adds up. It is the same on
#: every device and for any number of particles, and with it the order of summation.
_SUMS = 16384


class Moment(NamedTuple):
    """Clock, counts and volumes of one moment, as fields of ``Snapshot``."""

    time: float
    particle_count: int
    steps: StepReport
    budget: VolumeBudget


@lru_cache
def _kernel(real: Any) -> Any:
    vec4 = wp.types.vector(4, real)

    @wp.kernel(module='unique', enable_backward=False)
    def gather(
        particle: wp.array(dtype=vec4), clock: wp.array(dtype=wp.float64),
        counts: wp.array(dtype=wp.int32), left: wp.array(dtype=wp.float64),
        placed: wp.array2d(dtype=wp.int64), placed_unit: wp.float64,
        released: wp.array(dtype=wp.int32), numbers: wp.array(dtype=wp.float64),
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
            numbers[place + 2] = left[at.SEA]
            place += 3
            for i in range(clock.shape[0]):
                numbers[place + i] = clock[i]
            place += clock.shape[0]
            for i in range(counts.shape[0]):
                numbers[place + i] = wp.float64(counts[i])
            place += counts.shape[0]
            for i in range(released.shape[0]):
                numbers[place + i] = wp.float64(released[i])
        if placed:
            # integers: thread n sums every 16384th cell
            parts = wp.int64(0)
            columns = placed.shape[1]
            for cell in range(t, placed.shape[0] * columns, wp.static(_SUMS)):
                parts += placed[cell // columns, cell % columns]
            numbers[numbers.shape[0] - wp.static(_SUMS) + t] = wp.float64(parts) * placed_unit

    return gather


def gather_numbers(
    state: State, vents: VentSet, raised: RaisedTerrain | None, former: Any = None
) -> Any:
    """Gather the current values in an array on the device: the ``former`` one if it fits.

    Particles that have left must have been dropped. ``raised`` is the ground if lava can have
    solidified onto it.
    """
    released, placed, unit = vents.outlets.released, None, 0.0
    length = _SUMS + 3 + state.clock.size + state.counts.size + released.size
    if raised is not None:
        length += _SUMS
        placed, unit = raised.placed, THICKNESS_UNIT * raised.exact_ground.resolution**2
    numbers = former
    if former is None or former.size != length:
        numbers = wp.zeros(length, dtype=wp.float64, device=state.device)
    arrays = [state.particle, state.clock, state.counts, state.left, placed, unit, released]
    kernel, device = _kernel(state.real), state.device
    wp.launch(kernel, dim=_SUMS, inputs=arrays, outputs=[numbers], device=device)
    return numbers


def moment_of(numbers: np.ndarray, state: State, vents: VentSet, before: float) -> Moment:
    """Convert a copy of the gathered values.

    Only the sizes of the state's arrays are read; ``before`` [m3] was emitted by earlier vents.
    """
    sizes = [_SUMS, 3, state.clock.size, state.counts.size, vents.outlets.released.size]
    parts = np.split(numbers, np.cumsum(sizes))
    sums, left, clock, places, released, frozen = parts
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
            flowing=float(sums.sum()),
            solidified=float(frozen.sum()),
            **lost_volumes(left),
            waiting=pending,
            overdue=vents.overdue(pending),
        ),
    )


def snapshot_of(
    maps: np.ndarray, moment: Moment, terrain: Terrain, accuracy: Accuracy
) -> Snapshot:
    """Build the snapshot of a moment.

    Args:
        maps: Thickness, temperature, solidified thickness if lava can have solidified, and
            ``SHOWN``, shape [maps, rows, columns].
        moment: The other values, without the volume that is too thin to inundate.
        terrain: The terrain with the cells of the maps.
        accuracy: The resolution of the simulation.
    """
    inundated, half_inundated, arrived = maps[-len(SHOWN) :]
    grids = maps[: -len(SHOWN)]
    if (missing := ~terrain.has_data).any():
        # ground may lose its data during a run
        inundated = np.where(missing, np.float32(np.nan), inundated)
    # not nansum, which copies the grid
    thin = np.sum(grids[0], where=np.isnan(arrived) & (grids[0] > 0.0), dtype=np.float64)
    budget = replace(moment.budget, thin=float(thin) * terrain.resolution**2)
    return Snapshot(
        terrain=terrain,
        thickness=grids[0],
        temperature=grids[1],
        frozen=grids[2] if len(grids) > 2 else None,
        arrived=arrived,
        half_inundated=half_inundated,
        inundated=inundated,
        threshold=accuracy.inundation_threshold,
        method=accuracy.method,
        **moment._replace(budget=budget)._asdict(),
    )
