# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The loop that runs a simulation as fast as possible while sinks observe the flow.

A simulation that follows a clock is run by ``live.worker`` instead.
"""

from collections.abc import Callable, Generator, Iterable, Sequence
import math
import time as wall_clock
from typing import Any, TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    # the solver loads Warp, which drawing and merging results do not need
    from lava_ros.simulation.simulation import Simulation

ResultT = TypeVar('ResultT')


#: Minimum wall time of a part [s], so that every part advances.
MIN_PART = 0.005


class Sink:
    """An observer of a simulation.

    An observation takes place at the end of the first time step at or after its simulated time, so
    that observations do not change the flow.

    Attributes:
        due: Simulated time of its next observation [s]; infinity for none.
        wall_due: Time of ``time.monotonic`` after which it also observes the flow [s]; infinity
            for a run in a batch, which cannot stop at a wall time.
    """

    due = math.inf
    wall_due = math.inf

    def observe(self, simulation: 'Simulation', time: float) -> Iterable[object]:
        """Observe the flow at a simulated time [s], and set the times of the next observation.

        Returns:
            Parts of the work, between which the caller may do other work while a GPU computes.
        """
        return ()

    def note(self, simulation: 'Simulation') -> None:
        """Record that a part of the simulation has been computed; the flow cannot be read here."""


def driving(
    simulation: 'Simulation',
    until: float,
    sinks: Sequence[Sink] = (),
    *,
    wall_limit: float = math.inf,
    is_over: Callable[[], bool] = lambda: False,
) -> Generator[None, None, bool]:
    """Run a simulation in parts, so that the caller can do other work while a GPU computes.

    Args:
        simulation: The simulation.
        until: Simulated time at which the run ends [s], exactly.
        sinks: Observers of the flow, called in this order.
        wall_limit: Stop early after this wall time [s]. The next call continues.
        is_over: Stop early if it returns True after a part.

    Returns:
        True if the run has reached its end.

    Raises:
        LavaError: If a sink refuses the flow.
    """
    end, time = wall_clock.monotonic() + wall_limit, simulation.time
    while True:
        due = min([until, *(sink.due for sink in sinks)])
        if time < due:
            deadline = min([end, *(sink.wall_due for sink in sinks)])
            left = max(deadline - wall_clock.monotonic(), MIN_PART)
            limit = None if math.isinf(left) else left
            steps: Any = simulation.advancing(due, limit=until, wall_limit=limit)
            while True:
                # the returned time needs no access to the device
                try:
                    next(steps)
                except StopIteration as stop:
                    time = stop.value
                    break
                for sink in sinks:
                    sink.note(simulation)
                yield
                if is_over():
                    # completes the step
                    simulation.advance(simulation.time)
                    return False
        now = wall_clock.monotonic()
        for sink in sinks:
            if sink.due <= time or sink.wall_due <= now:
                for _ in sink.observe(simulation, time):
                    yield
        if time >= until or now >= end:
            return time >= until


def drive(
    simulation: 'Simulation', until: float, sinks: Sequence[Sink] = (), **options: Any
) -> bool:
    """Run a simulation up to a time [s]; arguments, result and errors as for ``driving``."""
    return result_of(driving(simulation, until, sinks, **options))


def result_of(parts: Generator[Any, None, ResultT]) -> ResultT:
    """Run all parts of some work, and return its result."""
    while True:
        try:
            next(parts)
        except StopIteration as stop:
            result: ResultT = stop.value
            return result
