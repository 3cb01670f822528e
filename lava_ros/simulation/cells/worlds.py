# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Launches that take steps of one world or of several, each with its own time and window.

The host gives each world an order: its clock, and a window that its own must contain. A world
takes an order once, by its number. After the steps of a launch each world reports its clock, its
counts and its thickest lava, and the host reads all reports in one copy.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
import ctypes
from functools import lru_cache
from threading import local
from typing import Any
from weakref import ref

import numpy as np
import warp as wp

from lava_ros.effects import Effects
from lava_ros.simulation.backend.compiled import on_cuda
from lava_ros.simulation.backend.memory import Readback
from lava_ros.simulation.cells.covered import Covered, note_function
from lava_ros.simulation.cells.flow import step_function
from lava_ros.simulation.cells.heated_step import heated_step_function
from lava_ros.simulation.cells.highest import Highest, raise_function
from lava_ros.simulation.cells.spans import spans_function
from lava_ros.simulation.cells.state import (
    Cells,
    CLOCK,
    Heat,
    LARGEST,
    NUMBER,
    POURED,
    TARGET,
    TIME,
    WAITING,
)
from lava_ros.simulation.cells.threads import shared, THREADS

#: Wall time of a launch of a batch to aim at [s], as members that have arrived wait for its end,
#: and maximum number of steps.
_LAUNCH_TIME, _MAX_STEPS = 0.004, 4096

#: Number of items of a report, and of an order: clock, window (``CellState.box``), 1 to record
#: what lava covers before the steps, and number.
_REPORT, _ORDER = 26, 15

#: Numbers of blocks of a world on a GPU, each a kernel of its own: fewer for more worlds. Also
#: the minimum compute capability: the blocks of a cluster run at the same time; and the number of
#: blocks that run at the same time on a multiprocessor.
_BLOCKS, _MIN_ARCH, _BLOCKS_AT_ONCE = (16, 4, 2), 90, 2

_BEGIN = """{
    const long top = 0, bottom = 0;
    SHARED
    const double* order = orders.data + row * ORDER;
    double* taken = numbers.data + row;
    const bool is_new = order[14] != *taken;
    together();
    if (is_new && is_first) {
        for (int n = 0; n < 9; ++n) s.clock.data[n] = order[n];
        int* box = s.box.data;
        const bool is_empty = box[1] <= box[0];
        for (int n = 0; n < 4; ++n) {
            const int own = (int)order[9 + n];
            const bool is_wider = n % 2 ? own > box[n] : own < box[n];
            if (order[10] > order[9] && (is_empty || is_wider)) box[n] = own;
        }
        *taken = order[14];
    }
    together();
    return is_new && order[13] > 0.0;
}"""

_END = """{
    const long top = 0, bottom = 0;
    SHARED
    if (!is_first) return;
    double* report = reports.data + row * REPORT;
    for (int n = 0; n < 9; ++n) report[n] = s.clock.data[n];
    for (int n = 0; n < 4; ++n) report[9 + n] = s.counts.data[n];
    report[13] = s.peaks.data[0];
    report[14] = numbers.data[row];
    for (int n = 0; n < 4; ++n) report[15 + n] = s.box.data[n];
    for (int n = 0; n < 4; ++n) report[19 + n] = record.bounds.data[n];
    for (int n = 0; n < 3; ++n) report[23 + n] = s.left.data[n];
}"""


_here = local()


@wp.struct
class World:
    """Arrays and constants of a simulation."""

    flow: Cells
    heat: Heat
    covered: Covered
    highest: Highest


@lru_cache
def steps_kernel(effects: Effects, is_heated: bool, blocks: int, is_cuda: bool) -> Any:
    """Return the kernel that takes steps, at most a number, and records what lava covers.

    Without steps it records what lava covers now.

    Args:
        effects: The effects that are on.
        is_heated: True if lava carries heat.
        blocks: Number of blocks of a world on a GPU.
        is_cuda: True for a GPU, which divides and takes roots by its own instructions.
    """
    step = step_function(effects, is_uniform=True, blocks=blocks)
    heated_step = heated_step_function(effects, blocks) if is_heated else None
    note, raise_peaks = note_function(blocks), raise_function(blocks)
    find_spans = spans_function(Cells, blocks)
    beginning, ending = (
        text.replace('SHARED', shared(blocks)).replace('ORDER', str(_ORDER))
        .replace('REPORT', str(_REPORT)) for text in (_BEGIN, _END)
    )

    @wp.func_native(on_cuda(f'return blockIdx.x / {blocks};', 'return thread;'))
    def place_of(thread: int) -> int: ...

    @wp.func_native(beginning)
    def begin(
        s: Cells, orders: wp.array2d(dtype=wp.float64), numbers: wp.array(dtype=wp.float64),
        row: int,
    ) -> int: ...

    @wp.func_native(ending)
    def end(
        s: Cells, record: Covered, reports: wp.array2d(dtype=wp.float64),
        numbers: wp.array(dtype=wp.float64), row: int,
    ): ...

    @wp.kernel(
        module='unique', enable_backward=False, grid_stride=False, cluster_dim=blocks,
        launch_bounds=THREADS, module_options={'enable_backward': False, 'fast_math': is_cuda},
    )
    def take_steps(
        worlds: wp.array(dtype=World), rows: wp.array(dtype=wp.int32),
        orders: wp.array2d(dtype=wp.float64), reports: wp.array2d(dtype=wp.float64),
        numbers: wp.array(dtype=wp.float64), most: int,
    ):
        row = rows[place_of(wp.tid())]
        world = worlds[row]
        clock = world.flow.clock
        is_due = begin(world.flow, orders, numbers, row)
        if is_due == 1 or most == 0:
            find_spans(world.flow)
            note(world.flow, world.covered)
        for _ in range(most):
            is_empty = world.flow.peaks[LARGEST] <= wp.float64(world.flow.film)
            if is_empty and clock[POURED] == wp.float64(0.0) and wp.isfinite(clock[TARGET]):
                # nothing moves; the host skips idle time of particles, whose launches are stages
                clock[TIME] = wp.max(clock[TIME], clock[TARGET])
            if clock[TIME] >= clock[TARGET] or clock[WAITING] > wp.float64(0.0):
                break
            if wp.static(is_heated):
                heated_step(world.flow, world.heat)
            else:
                step(world.flow)
            if clock[WAITING] == wp.float64(0.0):
                note(world.flow, world.covered)
                raise_peaks(world.flow, world.heat, world.highest)
        end(world.flow, world.covered, reports, numbers, row)

    return take_steps


class PackedWorld:
    """Arrays and constants of a simulation as the bytes of a ``World``.

    Attributes:
        data: The bytes.
    """

    def __init__(self, world: Any, owners: Any) -> None:
        """Pack a C struct; the ``owners`` of its arrays live as long as this object."""
        self.data, self._owners = np.frombuffer(bytes(world), dtype=np.uint8), owners


class Worlds:
    """Worlds whose steps a launch takes together; the caller keeps them until it has ended."""

    def __init__(self, rows: int, device: Any) -> None:
        """Allocate for at most some worlds."""
        self._device, self._size = device, ctypes.sizeof(World.ctype)
        self._put: list[Any] = [None] * rows
        memory = wp.zeros(rows * self._size, dtype=wp.uint8, device=device)
        self._worlds = wp.array(ptr=memory.ptr, dtype=World, shape=(rows,), device=device)
        self._packed = _Mirror(memory)
        self._orders = _Mirror(wp.zeros((rows, _ORDER), dtype=wp.float64, device=device))
        self._rows = _Mirror(wp.zeros(rows, dtype=wp.int32, device=device))
        self._reports = wp.zeros((rows, _REPORT), dtype=wp.float64, device=device)
        self._numbers = wp.zeros(rows, dtype=wp.float64, device=device)
        # each is free again when the next but one begins
        self._copies = deque(Readback((self._reports, self._numbers)) for _ in range(3))
        self._launches: dict[Any, Any] = {}

    def put(self, row: int, world: PackedWorld) -> None:
        """Assign a row to a world."""
        if self._put[row] is None or self._put[row]() is not world:
            self._packed.write(row * self._size, world.data)
            self._put[row] = ref(world)

    def order(
        self, row: int, clock: np.ndarray, window: np.ndarray, records: bool = False
    ) -> None:
        """Give the world of a row its clock, and a window that its own must contain.

        If it ``records``, it does so with the ground that lava covers before the steps.
        """
        number = self._orders.here[row, -1] + 1.0
        self._orders.write(row, np.array([[*clock, *window, float(records), number]]))

    def are_current(self, reports: np.ndarray) -> np.ndarray:
        """Return for each row whether its report follows its latest order."""
        current: np.ndarray = reports[:, NUMBER] == self._orders.here[:, -1]
        return current

    def launch(
        self, rows: Sequence[int], effects: Effects, is_heated: bool, steps: int
    ) -> Callable[[], np.ndarray]:
        """Take at most some steps of the worlds of some rows.

        Returns:
            Function that waits and returns the reports of all rows, float64.
        """
        if not np.array_equal(self._rows.here[: len(rows)], rows):
            self._rows.write(0, np.array(rows, dtype=np.int32))
        for mirror in (self._packed, self._orders, self._rows):
            mirror.send()
        blocks, is_cuda = blocks_of(self._device, len(rows)), self._device.is_cuda
        key, threads = (effects, is_heated, blocks), blocks * THREADS if is_cuda else 1
        command = self._launches.get(key)
        if command is None:
            command = self._launches[key] = wp.launch(
                steps_kernel(effects, is_heated, blocks, is_cuda),
                dim=len(rows) * threads, block_dim=THREADS,
                inputs=[
                    self._worlds, self._rows.there, self._orders.there, self._reports,
                    self._numbers, 0,
                ],
                device=self._device, record_cmd=True,
            )
        command.set_dim(len(rows) * threads)
        command.set_param_at_index(5, steps)
        command.launch()
        self._copies.rotate()
        finish = self._copies[0].begin()
        return lambda: finish()[0]


def worlds_alone(device: Any) -> Worlds:
    """Return ``Worlds`` for one world at a time, which the simulations of a thread share."""
    known: dict[str, Worlds] = vars(_here).setdefault('worlds', {})
    if str(device) not in known:
        known[str(device)] = Worlds(1, device)
    return known[str(device)]


def blocks_of(device: Any, count: int) -> int:
    """Return the number of blocks of each of some worlds on a GPU."""
    if not device.is_cuda or device.arch < _MIN_ARCH:
        return 1
    most = _BLOCKS_AT_ONCE * device.sm_count // count
    return next((blocks for blocks in _BLOCKS if blocks <= most), _BLOCKS[-1])


class _Mirror:
    """An array on a device, and its copy on the host, which is the same on a CPU.

    Attributes:
        there: The array.
        here: The copy.
    """

    def __init__(self, there: Any) -> None:
        """Begin with an array of zeros."""
        self.there, self._is_apart = there, there.device.is_cuda
        self.here = there.numpy()
        self._first, self._end = 0, 0

    def write(self, first: int, values: np.ndarray) -> None:
        """Write values from an item of the first axis on."""
        end = first + len(values)
        self.here[first:end] = values
        if self._end:
            self._first, self._end = min(first, self._first), max(end, self._end)
        else:
            self._first, self._end = first, end

    def send(self) -> None:
        """Copy what has been written to the device."""
        if self._end and self._is_apart:
            self.there[self._first : self._end].assign(self.here[self._first : self._end])
        self._first = self._end = 0


class CellGroup:
    """Members of a batch (``simulation/batch.py``) whose steps run the same kernel, one row each.

    Launches have a stream of their own, so that members that have arrived need not wait for it.
    Launches in flight only read the clocks of these members.

    Attributes:
        rounds_at_once: Number of launches in flight.
        is_patient: True if a round begins only when no route can continue.
        under_way: Routes of the members that have been asked to advance, by row.
        free: Rows without a member.
    """

    rounds_at_once, is_patient = 2, False

    def __init__(self, effects: Effects, is_heated: bool, device: Any, rows: int) -> None:
        """Prepare for at most some members."""
        self._kind, self._device = (effects, is_heated), device
        self._worlds, self._stream = Worlds(rows, device), wp.Stream(device)
        self._steps = 8
        #: World of each row, number of launches, and previous worlds with the number at their end.
        self._kept: list[Any] = [None] * rows
        self._launched, self._former = 0, deque[tuple[int, Any]]()
        self.under_way: dict[int, Iterator[None]] = {}
        self.free = list(reversed(range(rows)))

    def put(self, row: int, world: PackedWorld) -> None:
        """Assign a row to a member."""
        self._worlds.put(row, world)
        # launches in flight may still use the arrays of the previous world
        self._former.append((self._launched, self._kept[row]))
        self._kept[row] = world

    def wait(self) -> None:
        """Let what the current stream does next wait for the launches in flight."""
        wp.get_stream(self._device).wait_stream(self._stream)

    def leave(self, row: int) -> None:
        """Free a row."""
        self.under_way.pop(row, None)
        self.free.append(row)

    def advance(
        self, row: int, order: tuple[np.ndarray, np.ndarray, bool], route: Iterator[None]
    ) -> None:
        """Advance the member of a row by its clock and window; then its route continues."""
        self._worlds.order(row, *order)
        self.under_way[row] = route

    def begin(self) -> Callable[[], list[tuple[Iterator[None], np.ndarray]]]:
        """Start a launch; return a function that waits and returns the due routes."""
        rows = sorted(self.under_way)
        with wp.ScopedStream(self._stream):
            begun = self._stream.record_event(wp.Event(self._device, enable_timing=True))
            finish = self._worlds.launch(rows, *self._kind, self._steps)
            ended = self._stream.record_event(wp.Event(self._device, enable_timing=True))
        self._launched += 1
        launched = self._launched

        def end() -> list[tuple[Iterator[None], np.ndarray]]:
            reports = finish()
            while self._former and self._former[0][0] <= launched:
                self._former.popleft()
            clocks = reports[:, CLOCK]
            is_due = (clocks[:, TIME] >= clocks[:, TARGET]) | (clocks[:, WAITING] > 0.0)
            is_due &= self._worlds.are_current(reports)
            due = [
                (self.under_way.pop(row), reports[row])
                for row in rows if is_due[row] and row in self.under_way
            ]
            spent = 1e-3 * wp.get_event_elapsed_time(begun, ended)
            more = self._steps * 2 if spent < _LAUNCH_TIME else self._steps // 2
            self._steps = min(max(more, 1), _MAX_STEPS)
            return due

        return end
