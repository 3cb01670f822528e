# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The loop that advances a solver to a time, alone or as a member of a batch."""

from collections import deque
from collections.abc import Generator
from functools import partial
import math
import time as wall_clock
from typing import Any, NamedTuple

import numpy as np

from lava_ros.simulation.batch import Batch, current_batch
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.solver import Solver

#: Launches in flight, by whether the device is a GPU, while the target is far enough away.
_IN_FLIGHT = {True: 2, False: 1}

#: Maximum fraction of a launch's progress that rounding may change.
_ROUNDING = 1e-3

#: Copies of the clock and the counts of a ``State``.
_Readback = tuple[np.ndarray, np.ndarray]


class Stop(NamedTuple):
    """Where a solver has stopped.

    Attributes:
        time: Simulated time reached [s].
        step: Length of the next step if ``is_step_pending``, otherwise of the latest step, as it
            would be without stops and without particles that are due within it [s].
        is_step_pending: True if the next step has not begun because it would end too late.
    """

    time: float
    step: float
    is_step_pending: bool


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
