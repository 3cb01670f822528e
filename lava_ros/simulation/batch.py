# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Several simulations on one GPU at once.

Few particles do not fill a GPU. So the simulations of a batch go through their stages together:
each launch serves all of them (``backend/batched_launches.py``), each with its own step, vents and
constants. The host looks at all clocks in one copy after some stages. Whoever has arrived, or
needs room for more particles, goes on by itself for a moment; whoever is done makes room for one
that waits.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, islice
from threading import local
from time import perf_counter
from typing import Any

import numpy as np
import warp as wp

from lava_ros.simulation.backend.batched_launches import BatchedLaunches, BLOCK, kind_of
from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.graph import Launch
from lava_ros.simulation.backend.streams import Readback
from lava_ros.simulation.state import FULL, FULLEST, NEAR_BORDER, NEWCOMERS, PARTICLES, State, TIME

#: Simulations at work at once.
AT_ONCE = 256

#: Stages between two looks at the clocks, by whether it is a GPU.
_STAGES = {True: 16, False: 1}

#: Rounds of stages under way: while the host looks at what came of one a GPU has the next to do.
_UNDER_WAY = {True: 2, False: 1}

#: Share of the members that may have nothing to do: who waits for a look waits for others, for a
#: launch costs as much for one as for many, and so does a new list of who takes part.
_IDLE = 0.125

#: Time for members to begin in between two rounds [s]; one begins in any case.
_BEGINNING = 0.01

_END = object()

#: A route that can go on, and clock and counts (``State``) of its simulation where it was brought.
_Ready = tuple[Iterator[None], tuple[np.ndarray, np.ndarray] | None]

_here = local()


def at_work() -> 'Batch | None':
    """The batch whose member goes on at the moment, in this thread."""
    return getattr(_here, 'batch', None)


@quick_kernel
def _look(
    thread: int,
    row: int,
    clock: wp.array(dtype=wp.float64),
    counts: wp.array(dtype=wp.int32),
    clocks: wp.array2d(dtype=wp.float64),
    all_counts: wp.array2d(dtype=wp.int32),
):
    if thread < clock.shape[0]:
        clocks[row, thread] = clock[thread]
    if thread < counts.shape[0]:
        all_counts[row, thread] = counts[thread]


class _Group:
    """Members whose stages go through the same kernels, a row each."""

    def __init__(self, launches: Sequence[Launch], rows: int, state: State) -> None:
        device = self._device = state.device
        self.rounds_at_once = _UNDER_WAY[device.is_cuda]
        self._stages = BatchedLaunches(launches, rows, device)
        self._clocks = wp.zeros((rows, *state.clock.shape), dtype=wp.float64, device=device)
        self._counts = wp.zeros((rows, *state.counts.shape), dtype=wp.int32, device=device)
        self._looks = BatchedLaunches(self._look_of(0, state), rows, device)
        self._copies = deque(Readback((self._clocks, self._counts)) for _ in range(3))
        self._until = np.full(rows, np.inf)
        self._room = np.zeros(rows)
        #: Particles of each row when it was last looked at, threads that they have, and whether
        #: nobody has looked yet.
        self._particles = np.zeros(rows, dtype=np.int64)
        self._threads = np.zeros(rows, dtype=np.int64)
        self._is_guess = np.zeros(rows, dtype=bool)
        #: How often a row was asked for: what a round has found before is of no use.
        self._asked = np.zeros(rows, dtype=np.int64)
        self._selected: set[int] = set()
        self._has_new_looks = False
        #: Of each row the state that it was put of, and how often that had forgotten launches.
        self._put: dict[int, tuple[State, int]] = {}
        self.under_way: dict[int, Iterator[None]] = {}
        self.free = list(reversed(range(rows)))

    def _look_of(self, row: int, state: State) -> list[Launch]:
        arguments = [row, state.clock, state.counts, self._clocks, self._counts]
        return [Launch(_look, state.counts.size, 32, False, arguments)]

    def put(self, row: int, launches: Sequence[Launch], state: State) -> None:
        """Let a row be a member."""
        self._stages.put(row, launches)
        self._room[row] = FULLEST * state.capacity
        if self._put.get(row, (None, 0))[0] is not state:
            # as many as there may be, before anyone has looked
            self._particles[row], self._is_guess[row] = state.capacity, True
            self._looks.put(row, self._look_of(row, state))
            self._has_new_looks = True
        self._put[row] = state, state.launches.forgotten
        # it may have more threads than the one before
        self._selected.clear()

    def leave(self, row: int) -> None:
        """Let a row be free."""
        self.under_way.pop(row, None)
        # what its launches need may be gone
        self._selected.clear()
        self.free.append(row)

    def bring(self, row: int, until: float, route: Iterator[None]) -> None:
        """Let the member of a row go on to a time [s]; its route goes on when it is there."""
        self._until[row] = until
        self._asked[row] += 1
        self.under_way[row] = route

    def _select(self, idle: float) -> None:
        """Let those that are under way take part, and up to a share of others."""
        others = self._selected - self.under_way.keys()
        is_in = len(self._selected) == len(others) + len(self.under_way)
        # launches into arrays that are others now would write anywhere
        put = [self._put[row] for row in others]
        are_as_put = all(state.launches.forgotten == count for state, count in put)
        if not (is_in and are_as_put and len(others) <= idle * len(self._selected)):
            self._selected = set(self.under_way)
            rows = np.array(sorted(self._selected), dtype=np.int64)
            # room for particles to come: one for eight that it has, and whole blocks
            self._threads = BLOCK * -(-(self._particles + self._particles // 8) // BLOCK)
            self._stages.select(rows, self._threads[rows])
        if self._has_new_looks:
            # at those that do not take part as well: another list costs more
            rows = np.array(sorted(self._put), dtype=np.int64)
            self._looks.select(rows, self._threads[rows])
            self._has_new_looks = False

    def launch_once(self) -> list[_Ready]:
        """Make the launches of those that are under way, and give their routes."""
        self._select(0.0)
        self._stages.launch()
        routes: list[_Ready] = [(route, None) for route in self.under_way.values()]
        self.under_way.clear()
        return routes

    def begin(self) -> Callable[[], list[_Ready]]:
        """Begin a round of stages; return what waits for it and gives the routes to go on with."""
        self._select(_IDLE)
        self._stages.launch(_STAGES[self._device.is_cuda])
        self._looks.launch()
        asked = self._asked.copy()
        self._copies.rotate()
        copied = self._copies[0].begin()

        def end() -> list[_Ready]:
            clocks, counts = copied()
            particles = counts[:, PARTICLES] + counts[:, NEWCOMERS]
            is_due = ~(clocks[:, TIME] < self._until) | (particles > self._room)
            is_due |= (counts[:, FULL] != 0) | (counts[:, NEAR_BORDER] != 0)
            is_current = asked == self._asked
            self._particles[is_current] = particles[is_current]
            if (self._particles > self._threads).any() or (self._is_guess & is_current).any():
                # the last block of a member does what others should, or others have nothing to do
                self._selected.clear()
            self._is_guess[is_current] = False
            rows = np.flatnonzero(is_due & is_current).tolist()
            return [
                (self.under_way.pop(row), (clocks[row], counts[row]))
                for row in rows
                if row in self.under_way
            ]

        return end


class Batch:
    """Simulations that go through their stages together on one device.

    Attributes:
        seen: Clock and counts (``State``) of the simulation that goes on after ``bring``: as they
            are where it has arrived, else as they were some stages before.
    """

    seen: Any

    def __init__(self, *, at_once: int = AT_ONCE) -> None:
        """Begin with none; ``at_once`` of them are at work at once."""
        self._at_once = at_once
        self._groups: dict[Any, _Group] = {}
        #: Of each route that has begun, and whether it is of stages: group, row, and what they
        #: were taken down of.
        self._places: dict[tuple[Iterator[None], bool], tuple[_Group, int, State, int]] = {}
        self._route: Iterator[None] | None = None
        self._has_asked = False

    def bring(
        self, state: State, taken_down: Callable[[], list[Launch]], until: float
    ) -> None:
        """Bring the simulation of the route that goes on to a time [s], once that yields.

        The route goes on when it is there, or when there is something to be done for its
        particles: room for more of them, or a wider neighbour grid.

        Args:
            state: Its particles.
            taken_down: Takes down what a stage of it launches.
            until: The time [s].
        """
        group, row = self._place(state, taken_down, True)
        assert self._route is not None
        group.bring(row, until, self._route)

    def launch(self, state: State, taken_down: Callable[[], list[Launch]]) -> None:
        """Make launches once for the route that goes on, once that yields.

        Args:
            state: Its particles.
            taken_down: Takes down what is launched.
        """
        group, row = self._place(state, taken_down, False)
        assert self._route is not None
        group.under_way[row] = self._route

    def _place(
        self, state: State, taken_down: Callable[[], list[Launch]], is_stage: bool
    ) -> tuple[_Group, int]:
        """Group and row of what the route that goes on launches."""
        assert self._route is not None
        self._has_asked = True
        key = self._route, is_stage
        group, row, of, forgotten = self._places.get(key, (None, 0, None, 0))
        if group is None or of is not state or forgotten != state.launches.forgotten:
            self._leave(*key)
            launches = taken_down()
            kind = is_stage, kind_of(launches)
            group = self._groups.get(kind)
            if group is None:
                group = self._groups[kind] = _Group(launches, self._at_once, state)
            row = group.free.pop()
            group.put(row, launches, state)
            self._places[key] = group, row, state, state.launches.forgotten
        return group, row

    def run(self, routes: Iterable[Iterator[None]]) -> None:
        """Take all routes to their ends, as ``running`` does in parts."""
        for _ in self.running(routes):
            pass

    def running(self, routes: Iterable[Iterator[None]]) -> Iterator[None]:
        """Take all routes to their ends, with time for something else after each part.

        A route leaves off whenever it has asked for something (``Simulation.advancing``). It
        begins only when it is its turn.

        Args:
            routes: The routes.

        Raises:
            Exception: Whatever a route raises; the others are given up.
        """
        waiting, begun = iter(routes), 0
        ready = deque[_Ready]()
        rounds = deque[tuple[_Group, Callable[[], list[_Ready]]]]()
        while True:
            while ready:
                begun -= self._has_ended(*ready.popleft(), ready)
            # the others are not kept waiting by all that begin
            new, end = False, perf_counter() + _BEGINNING
            for route in islice(waiting, self._at_once - begun):
                new = True
                begun += 1 - self._has_ended(route, None, ready)
                if perf_counter() > end:
                    break
            stages = [group for (is_stage, _), group in self._groups.items() if is_stage]
            is_at_work = any(group.under_way for group in stages)
            for (is_stage, _), group in self._groups.items():
                count = len(group.under_way)
                if not is_stage and count and (count >= _IDLE * begun or not is_at_work):
                    ready.extend(group.launch_once())
            if ready:
                continue
            for group in stages:
                here = sum(one is group for one, _ in rounds)
                if group.under_way and here < group.rounds_at_once:
                    rounds.append((group, group.begin()))
                    break
            else:
                if rounds:
                    yield
                    ready.extend(rounds.popleft()[1]())
                elif not new:
                    return

    def _has_ended(self, route: Iterator[None], seen: Any, ready: deque[_Ready]) -> bool:
        """Go on with a route, and say whether it has come to its end."""
        self._route, self.seen, self._has_asked = route, seen, False
        former, _here.batch = at_work(), self
        try:
            is_at_end = next(route, _END) is _END
        finally:
            _here.batch = former
        if is_at_end:
            self._leave(route, True)
            self._leave(route, False)
        elif not self._has_asked:
            ready.append((route, seen))
        return is_at_end

    def _leave(self, route: Iterator[None], is_stage: bool) -> None:
        """Free the row of a route, if it has one."""
        group, row, *_ = self._places.pop((route, is_stage), (None, 0))
        if group is not None:
            group.leave(row)


def side_by_side(
    routes: Iterable[Iterator[None]], device: str, *, at_once: int = AT_ONCE
) -> Iterator[None]:
    """Take all routes to their ends, with time for something else after each part.

    On a GPU they go as a batch. On the CPU one follows the other, each on all cores. A route
    begins only when it is its turn.

    Args:
        routes: The routes (``Simulation.advancing``).
        device: Warp device they launch on.
        at_once: Routes on their way at a time.

    Raises:
        Exception: Whatever a route raises; the others are given up.
    """
    if wp.get_device(device).is_cuda:
        return Batch(at_once=at_once).running(routes)
    return chain.from_iterable(routes)
