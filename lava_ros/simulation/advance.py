# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The solver of particles behind a simulation.

It adds the methods that it shares with the solver of cells, and the loop that advances it to a
time, alone or as a member of a batch.
"""

from collections import deque
from collections.abc import Generator
from functools import partial
import math
import time as wall_clock
from typing import Any

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Vent
from lava_ros.simulation.batch import Batch, current_batch
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.output.checkpoint_contents import (
    capacity_for,
    check_conserved,
    check_contents,
    check_restored,
)
from lava_ros.simulation.output.peaks import PeakMaps, Peaks
from lava_ros.simulation.output.snapshot import ParticleSample
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.layout import fitting
from lava_ros.simulation.solver import Solver
from lava_ros.simulation.step.vents import check_rates, Emission
from lava_ros.simulation.stop import Stop

#: Launches in flight, by whether the device is a GPU, while the target is far enough away.
_IN_FLIGHT = {True: 2, False: 1}

#: Maximum fraction of a launch's progress that rounding may change.
_ROUNDING = 1e-3

#: Copies of the clock and the counts of a ``State``.
_Readback = tuple[np.ndarray, np.ndarray]


def advancing_to(
    solver: Solver, until: float, end: float | None, deadline: float, max_end: float = math.inf
) -> Generator[None, None, Stop]:
    """Advance to a time, or to the step after which no lava is left; yield between launches.

    After the deadline the last step may be incomplete. The next call continues it; with the
    current time as ``until`` it only completes that step.

    Args:
        solver: The solver.
        until: Simulated time to reach [s].
        end: Simulated time that no step may pass [s]; None keeps the previous one.
        deadline: Time of ``time.monotonic`` after which to stop early [s].
        max_end: Simulated time after which no step may end [s]: a step that would end later does
            not begin. Infinite for a member of a batch.

    Returns:
        Where it stopped; the time is the end of the last complete step.
    """
    state = solver.state
    state.write_target(until, end, max_end)
    batch, is_step_pending = current_batch(), False
    if batch is None:
        clock, counts, is_step_pending = yield from _advance_alone(solver, until, deadline)
    else:
        assert max_end == math.inf
        clock, counts = yield from _advance_in_batch(solver, batch, until, deadline)
    if clock[at.TIME] < until:
        # no step begins after the current one
        state.write_target(clock[at.TIME])
    while counts[at.STAGE] and wall_clock.monotonic() < deadline:
        solver.run_stages()
        yield
        clock, counts = state.read_clock()
    # also needed if the first stage has reached the time
    solver.make_room(counts)
    return Stop(float(clock[at.TIME]), float(clock[at.FULL_STEP]), is_step_pending)


def _advance_alone(
    solver: Solver, until: float, deadline: float
) -> Generator[None, None, tuple[np.ndarray, np.ndarray, bool]]:
    """Advance to a time [s], or a wall time [s].

    Returns:
        Clock, counts, and True if the next step would end too late.
    """
    state = solver.state
    clock, counts = state.read_clock()
    # a GPU computes the next stages while the host reads the results of the previous ones
    in_flight: deque[Any] = deque()
    gain, is_step_pending = math.inf, False
    while clock[at.TIME] < until and wall_clock.monotonic() < deadline:
        is_free = len(in_flight) < _IN_FLIGHT[solver.device.is_cuda]
        # the launches in flight may reach the target within rounding: more of them would idle
        reached = clock[at.TIME] + (len(in_flight) + _ROUNDING) * gain
        if not in_flight or (is_free and reached < until):
            solver.run_stages()
            in_flight.append(state.begin_readback())
            yield
            continue
        former = clock[at.TIME]
        clock, counts = in_flight.popleft()()
        gain = clock[at.TIME] - former
        # stages after the last step idle: the next step would end too late
        is_step_pending = clock[at.TIME] < until and not counts[at.CURRENT]
        if solver.count_particles(counts) or is_step_pending:
            break
        if state.needs_room(counts) or counts[at.NEAR_BORDER]:
            while in_flight:
                clock, counts = in_flight.popleft()()
            solver.make_room(counts)
    while in_flight:
        clock, counts = in_flight.popleft()()
        # also after a slice that is shorter than a launch
        is_step_pending = clock[at.TIME] < until and not counts[at.CURRENT]
    return clock, counts, is_step_pending


def _advance_in_batch(
    solver: Solver, batch: Batch, until: float, deadline: float
) -> Generator[None, None, _Readback]:
    """Advance as a member of a batch, which reads the clocks of all members at once."""
    while True:
        solver.bin()
        state = solver.state
        record = partial(state.launches.record, solver.take_stages, state.capacity)
        batch.advance(state, record, until)
        yield
        clock, counts = batch.readback
        is_over = solver.count_particles(counts)
        if clock[at.TIME] >= until:
            return clock, counts
        if is_over:
            # only the remaining stages of the current step
            until = float(clock[at.TIME])
            solver.state.write_target(until)
        if wall_clock.monotonic() >= deadline:
            # the clock includes stages launched since that readback
            return solver.state.read_clock()
        solver.make_room(counts)


class ParticleSolver(Solver):
    """The lava of a simulation as particles."""

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.state.time

    @property
    def effects(self) -> Effects:
        """The effects that are on."""
        return self.state.effects

    @property
    def count(self) -> int:
        """Number of particles."""
        return self.state.count

    @property
    def steps(self) -> int:
        """Number of time steps so far."""
        return int(self.state.read_clock()[1][at.STEPS])

    @property
    def capacity(self) -> int:
        """Number of particles for which there is memory."""
        return self.state.capacity

    @property
    def column_spacing(self) -> float:
        """Distance between the columns into which emplaced lava is divided [m]."""
        assert self.accuracy.spacing is not None
        return self.accuracy.spacing

    def advancing_to(
        self, until: float, end: float | None, deadline: float, max_end: float = math.inf
    ) -> Generator[None, None, Stop]:
        """Advance to a time; yield between launches (``advance.advancing_to``)."""
        return advancing_to(self, until, end, deadline, max_end)

    def read_flow(self) -> ParticleSample:
        """Return the particles of the flow: all."""
        return self.read_sample()

    def start_peaks(self) -> None:
        """Do nothing: observations gather the peaks of particles."""

    def observe_now(self, peaks: Peaks) -> None:
        """Raise peaks to the values of the current flow.

        Raises:
            LavaError: If too many particles are in one place.
        """
        self.bin()
        self.observe(peaks)
        self.neighbors.refuse_crowds()

    def read_peaks(self, peaks: Peaks, *, where_wet: bool) -> PeakMaps:
        """Return the peaks so far, of all cells or of the rectangle that lava can reach."""
        rows, columns = self.scene.terrain.shape
        part = slice(0, rows), slice(0, columns)
        if where_wet:
            part = self.raster.window.rectangle(self.state)
        return peaks.read(self.state, part)

    def sample(self) -> ParticleSample:
        """Read the sorted particles back, with their current thickness and velocity."""
        self.stage.compute_flow()
        return self.read_sample()

    def check_rates(self, vents: tuple[Vent, ...]) -> None:
        """Raise LavaError if a discharge produces more particles than can be computed."""
        check_rates(vents, self.accuracy.particle_volume)

    def forget(self) -> None:
        """Record the launches again."""
        self.state.launches.forget()

    def save(self) -> dict[str, np.ndarray]:
        """Copy all arrays from which the solver can be resumed, between two steps, by name.

        A GPU then captures the next stages again, as it does for a resumed simulation: both idle
        for the same number of stages past the next target.
        """
        self.state.launches.forget()
        arrays = {f'state.{name}': array for name, array in self.state.save().items()}
        arrays |= {f'vents.{name}': array for name, array in self.vents.save().items()}
        arrays |= {f'arrived.{name}': item for name, item in self.covered.save().items()}
        if self.raised is not None:
            arrays |= {f'solidified.{name}': item for name, item in self.raised.save().items()}
        return arrays

    def load(self, checkpoint: Checkpoint) -> None:
        """Restore the arrays of a checkpoint of the same scene, effects and accuracy.

        Raises:
            LavaError: If an array is missing, does not belong to the scene and the effects, or has
                numbers that no simulation has.
        """
        check_contents(checkpoint)
        parts: dict[str, dict[str, np.ndarray]] = {}
        for name, array in checkpoint.arrays.items():
            owner, _, own_name = name.partition('.')
            parts.setdefault(owner, {})[own_name] = array
        # lava may have solidified before the effect was switched off
        if self.raised is not None or 'solidified' in parts:
            self.own_terrain().load(parts.pop('solidified', {}))
        self.state.load(parts.pop('state', {}), capacity_for(checkpoint))
        vents = parts.pop('vents', {})
        emission = Emission.from_arrays(vents, len(checkpoint.scene.vents))
        self.open_vents(checkpoint.since, emission)
        # the state has the vents' heights; lava solidified since then may have raised the ground
        shape = (len(checkpoint.scene.vents),)
        is_counted = fitting('vents.counted', vents.get('counted'), shape, np.int32)
        self.vents.counted = set(np.flatnonzero(is_counted).tolist())
        arrived = parts.pop('arrived', None)
        if arrived is not None:
            self.covered.load(arrived)
        check_restored(checkpoint, parts, self.time)
        self.volume_before = checkpoint.emitted
        # the neighbour grid was created without the particles
        self.cover()
        if arrived is None:
            self.record_covered_ground()
        check_conserved(self.budget())
