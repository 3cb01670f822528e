# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Several simulations on one GPU at once.

Few particles do not fill a GPU. The simulations of a batch therefore run their stages together:
each launch serves all of them (``backend/batched_launches.py``), each with its own step, vents and
constants. After some stages the host reads all clocks in one copy. A member that reaches its
target time, or needs a larger allocation, leaves the batch temporarily. A finished member frees
its row for the next member in the queue.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import chain, islice
from threading import local
from time import perf_counter
from typing import Any

import numpy as np
import warp as wp

from lava_ros.simulation.backend.batched_launches import BatchedLaunches, BLOCK, kind_of
from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.graph import Launch
from lava_ros.simulation.backend.memory import Readback
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.state import State

#: Default maximum number of active simulations.
AT_ONCE = 256

#: Stages between two readbacks of the clocks, by whether the device is a GPU.
_STAGES = {True: 16, False: 1}

#: Rounds of stages in flight: while the host processes one, a GPU computes the next.
_UNDER_WAY = {True: 2, False: 1}

#: Maximum fraction of idle members before the selection changes. A launch for one member costs as
#: much as for many, and so does a new list of members; they therefore wait for each other.
_IDLE = 0.125

#: Time for members to start in between two rounds [s]; at least one starts in any case. The same,
#: and time for others to continue, if rounds do not wait for members that can.
_BEGINNING, _CONTINUING = 0.01, 0.004

_END = object()

#: A route that can continue, and the clock and counts (``State``) at which its simulation stopped.
_Ready = tuple[Iterator[None], tuple[np.ndarray, np.ndarray] | None]

#: A group (``_Group``, ``cells.worlds.CellGroup``), and the function that ends its launches.
_Round = tuple[Any, Callable[[], list[_Ready]]]

_here = local()


def current_batch() -> 'Batch | None':
    """Return the batch whose member currently runs in this thread."""
    return getattr(_here, 'batch', None)


@quick_kernel()
def _read_back(
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
    """Members whose stages run the same kernels, one row each.

    Another list of members costs more than a round: it begins when no route can continue.
    """

    is_patient = True

    def __init__(self, launches: Sequence[Launch], state: State, rows: int) -> None:
        device = self._device = state.device
        self.rounds_at_once = _UNDER_WAY[device.is_cuda]
        self._stages = BatchedLaunches(launches, rows, device)
        self._clocks = wp.zeros((rows, *state.clock.shape), dtype=wp.float64, device=device)
        self._counts = wp.zeros((rows, *state.counts.shape), dtype=wp.int32, device=device)
        self._readback_launches = BatchedLaunches(self._readback_of(0, state), rows, device)
        self._copies = deque(Readback((self._clocks, self._counts)) for _ in range(3))
        self._until = np.full(rows, np.inf)
        self._room = np.zeros(rows)
        #: Particles of each row at the latest readback, number of threads, and whether there has
        #: been no readback yet.
        self._particles = np.zeros(rows, dtype=np.int64)
        self._threads = np.zeros(rows, dtype=np.int64)
        self._is_guess = np.zeros(rows, dtype=bool)
        #: Number of requests of each row: results of rounds before the latest request are
        #: discarded.
        self._asked = np.zeros(rows, dtype=np.int64)
        self._selected: set[int] = set()
        self._has_new_readbacks = False
        #: State of each row, and the value of its ``launches.forgotten`` when it was assigned.
        self._put: dict[int, tuple[State, int]] = {}
        self.under_way: dict[int, Iterator[None]] = {}
        self.free = list(reversed(range(rows)))

    def _readback_of(self, row: int, state: State) -> list[Launch]:
        arguments = [row, state.clock, state.counts, self._clocks, self._counts]
        return [Launch(_read_back, state.counts.size, 32, False, arguments)]

    def put(self, row: int, launches: Sequence[Launch], state: State) -> None:
        """Assign a row to a member."""
        self._stages.put(row, launches)
        self._room[row] = state.growth_threshold
        if self._put.get(row, (None, 0))[0] is not state:
            # assume a full state until the first readback
            self._particles[row], self._is_guess[row] = state.capacity, True
            self._readback_launches.put(row, self._readback_of(row, state))
            self._has_new_readbacks = True
        self._put[row] = state, state.launches.forgotten
        # it may have more threads than the previous member
        self._selected.clear()

    def leave(self, row: int) -> None:
        """Free a row."""
        self.under_way.pop(row, None)
        # arrays that its launches use may be gone
        self._selected.clear()
        self.free.append(row)

    def advance(self, row: int, until: float, route: Iterator[None]) -> None:
        """Advance the member of a row to a time [s]; its route continues when it is there."""
        self._until[row] = until
        self._asked[row] += 1
        self.under_way[row] = route

    def _select(self, idle: float) -> None:
        """Select the rows in flight, and keep up to a fraction of idle ones selected."""
        others = self._selected - self.under_way.keys()
        is_in = len(self._selected) == len(others) + len(self.under_way)
        # launches into arrays that have been replaced would write anywhere
        put = [self._put[row] for row in others]
        are_as_put = all(state.launches.forgotten == count for state, count in put)
        if not (is_in and are_as_put and len(others) <= idle * len(self._selected)):
            self._selected = set(self.under_way)
            rows = np.array(sorted(self._selected), dtype=np.int64)
            # capacity for new particles: one eighth, rounded up to whole blocks
            self._threads = BLOCK * -(-(self._particles + self._particles // 8) // BLOCK)
            self._stages.select(rows, self._threads[rows])
        if self._has_new_readbacks:
            # idle members as well: another list would cost more
            rows = np.array(sorted(self._put), dtype=np.int64)
            self._readback_launches.select(rows, self._threads[rows])
            self._has_new_readbacks = False

    def wait(self) -> None:
        """All launches are on the stream of the routes."""

    def launch_once(self) -> list[_Ready]:
        """Run the launches of all waiting rows once, and return their routes."""
        self._select(0.0)
        self._stages.launch()
        routes: list[_Ready] = [(route, None) for route in self.under_way.values()]
        self.under_way.clear()
        return routes

    def begin(self) -> Callable[[], list[_Ready]]:
        """Start a round of stages; return a function that waits and returns the due routes."""
        self._select(_IDLE)
        self._stages.launch(_STAGES[self._device.is_cuda])
        self._readback_launches.launch()
        asked = self._asked.copy()
        self._copies.rotate()
        copied = self._copies[0].begin()

        def end() -> list[_Ready]:
            clocks, counts = copied()
            particles = counts[:, at.PARTICLES] + counts[:, at.NEWCOMERS]
            is_due = ~(clocks[:, at.TIME] < self._until) | (particles > self._room)
            # when no lava is left, a member may have nothing to do
            is_due |= (particles == 0) & (self._particles > 0)
            is_due |= (counts[:, at.FULL] != 0) | (counts[:, at.NEAR_BORDER] != 0)
            is_current = asked == self._asked
            self._particles[is_current] = particles[is_current]
            if (self._particles > self._threads).any() or (self._is_guess & is_current).any():
                # the last block of a member does extra work, or others have none
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
    """Simulations that run their stages together on one device.

    Attributes:
        readback: Clock and counts (``State``) of the simulation that continues after ``advance``:
            the current values if it has arrived, otherwise values of some stages ago.
    """

    readback: Any

    def __init__(self, *, at_once: int = AT_ONCE) -> None:
        """Create an empty batch with at most ``at_once`` active simulations."""
        self._at_once = at_once
        #: Groups (``_Group``, ``cells.worlds.CellGroup``), by whether they take steps, and kind.
        self._groups: dict[Any, Any] = {}
        #: Group and row of each active route (True: for steps), and their owner and its version.
        self._places: dict[tuple[Iterator[None], bool], tuple[Any, int, Any, int]] = {}
        self._route: Iterator[None] | None = None
        self._has_asked = False

    def advance(
        self, state: State, record: Callable[[], list[Launch]], until: float
    ) -> None:
        """Advance the simulation of the current route to a time [s], once the route yields.

        The route continues at that time, or when its particles need a larger allocation or a wider
        neighbour grid.

        Args:
            state: State of the simulation.
            record: Function that records the launches of one of its stages.
            until: The time [s].
        """
        group, row = self._place_launches(state, record, True)
        group.advance(row, until, self._route)

    def advance_world(
        self, kind: Any, make: Callable[[int], Any], world: Any, order: Any
    ) -> None:
        """Advance lava on cells with all other members of its kind, once the route yields.

        Args:
            kind: What members in one launch have in common.
            make: Function that makes their group (``cells/worlds.py``), for a number of rows.
            world: Arrays and constants of the member.
            order: Its clock and window.
        """
        group, row = self._place(True, (world, 0), lambda: (kind, make, (world,)))
        group.advance(row, order, self._route)

    def wait_for_launches(self) -> None:
        """Let what the current route does next on the device wait for the launches in flight."""
        for group in self._groups.values():
            group.wait()

    def launch(self, state: State, record: Callable[[], list[Launch]]) -> None:
        """Run launches once for the current route, once the route yields.

        Args:
            state: State of its simulation.
            record: Function that records the launches.
        """
        group, row = self._place_launches(state, record, False)
        group.under_way[row] = self._route

    def _place_launches(
        self, state: State, record: Callable[[], list[Launch]], is_stage: bool
    ) -> tuple[Any, int]:
        """Return the group and row for launches of the current route."""
        state.launches.launched = None

        def recorded() -> tuple[Any, Callable[[int], Any], tuple[Any, ...]]:
            launches = record()
            return kind_of(launches), partial(_Group, launches, state), (launches, state)

        return self._place(is_stage, (state, state.launches.forgotten), recorded)

    def _place(
        self, is_stage: bool, owner: tuple[Any, int],
        describe: Callable[[], tuple[Any, Callable[[int], Any], tuple[Any, ...]]],
    ) -> tuple[Any, int]:
        """Return the group and row of the current route.

        Unless it has a row for this version of its ``owner``, ``describe`` returns the kind of the
        group, the function that makes one, and the arguments of its ``put``.
        """
        assert self._route is not None
        self._has_asked = True
        key = self._route, is_stage
        group, row, of, version = self._places.get(key, (None, 0, None, 0))
        if of is not owner[0] or version != owner[1]:
            self._leave(*key)
            kind, make, contents = describe()
            if (is_stage, kind) not in self._groups:
                self._groups[is_stage, kind] = make(self._at_once)
            group = self._groups[is_stage, kind]
            row = group.free.pop()
            group.put(row, *contents)
            self._places[key] = group, row, *owner
        return group, row

    def run(self, routes: Iterable[Iterator[None]]) -> None:
        """Run all routes to their ends; ``running`` does the same in parts."""
        for _ in self.running(routes):
            pass

    def running(self, routes: Iterable[Iterator[None]]) -> Iterator[None]:
        """Run all routes to their ends, and yield in between so that the caller can do other work.

        A route yields whenever it has made a request (``Simulation.advancing``). It starts only
        when there is a row for it.

        Args:
            routes: The routes.

        Raises:
            Exception: If a route raises; the other routes are abandoned.
        """
        rounds = deque[_Round]()
        try:
            yield from self._running(iter(routes), rounds)
        finally:
            # launches may still use arrays of abandoned routes
            for _, finish in rounds:
                finish()

    def _running(self, waiting: Iterator[Iterator[None]], rounds: deque[_Round]) -> Iterator[None]:
        """Run all routes, with the ``rounds`` in flight."""
        ready, begun = deque[_Ready](), 0
        while True:
            is_patient = all(group.is_patient for group in self._groups.values())
            span = _BEGINNING if is_patient else _CONTINUING
            end = perf_counter() + span
            while ready and (is_patient or perf_counter() < end):
                begun -= self._has_ended(*ready.popleft(), ready)
            # routes that start must not delay the active ones for long
            new, end = False, perf_counter() + span
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
            if ready and is_patient:
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
                elif not (new or ready):
                    return

    def _has_ended(self, route: Iterator[None], readback: Any, ready: deque[_Ready]) -> bool:
        """Continue a route; return True if it has ended."""
        self._route, self.readback, self._has_asked = route, readback, False
        former, _here.batch = current_batch(), self
        try:
            is_at_end = next(route, _END) is _END
        finally:
            _here.batch = former
        if is_at_end:
            self._leave(route, True)
            self._leave(route, False)
        elif not self._has_asked:
            ready.append((route, readback))
        return is_at_end

    def _leave(self, route: Iterator[None], is_stage: bool) -> None:
        """Free the row of a route, if it has one."""
        group, row, *_ = self._places.pop((route, is_stage), (None, 0))
        if group is not None:
            group.leave(row)


def side_by_side(
    routes: Iterable[Iterator[None]], device: str, *, at_once: int = AT_ONCE
) -> Iterator[None]:
    """Run all routes to their ends, and yield in between so that the caller can do other work.

    On a GPU several run as a batch. A single one runs alone, which takes two thirds of the time,
    and on the CPU they run one after the other, each on all cores. A route starts only when it is
    its turn.

    Args:
        routes: The routes (``Simulation.advancing``).
        device: Warp device of their launches.
        at_once: Maximum number of active routes.

    Raises:
        Exception: If a route raises; the other routes are abandoned.
    """
    if not wp.get_device(device).is_cuda:
        return chain.from_iterable(routes)
    rest = iter(routes)
    first = list(islice(rest, 2))
    routes = chain(first, rest)
    if len(first) < 2:
        return chain.from_iterable(routes)
    return Batch(at_once=at_once).running(routes)
