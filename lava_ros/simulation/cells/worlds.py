# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Launches that take steps of one world or of several, each with its own time and window.

The host gives each world an order: its clock, and a window that its own must contain. A world takes
an order once, by its number. After the steps of a launch each world reports its clock, its counts
and its thickest lava, and the host reads all reports in one copy.
"""

from collections.abc import Callable, Sequence
import ctypes
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import Effects
from lava_ros.simulation.backend.compiled import on_cuda
from lava_ros.simulation.cells.covered import Covered, note_function
from lava_ros.simulation.cells.flow import step_function
from lava_ros.simulation.cells.heated_step import heated_step_function
from lava_ros.simulation.cells.peaks import Highest, raise_function
from lava_ros.simulation.cells.state import Cells, Heat, TARGET, TIME, WAITING
from lava_ros.simulation.cells.threads import shared, THREADS

#: Parts of a report: clock and counts (``CellState``), largest thickness [m], number of the order.
CLOCK, COUNTS, THICKEST, NUMBER = slice(0, 8), slice(8, 12), 12, 13

#: Items of an order: clock, window (first and last row and column) and number.
_ORDER, _REPORT = 13, 14

#: Largest number of blocks of a world on a GPU: those of a cluster run at the same time.
_MAX_BLOCKS = 8

_BEGIN = """{
    const long top = 0, bottom = 0;
    SHARED
    const double* order = orders.data + row * ORDER;
    double* taken = numbers.data + row;
    const bool is_new = order[12] != *taken;
    together();
    if (is_new && is_first) {
        for (int n = 0; n < 8; ++n) s.clock.data[n] = order[n];
        int* box = s.box.data;
        const bool is_empty = box[1] <= box[0];
        for (int n = 0; n < 4; ++n) {
            const int own = (int)order[8 + n];
            const bool is_wider = n % 2 ? own > box[n] : own < box[n];
            if (order[9] > order[8] && (is_empty || is_wider)) box[n] = own;
        }
        *taken = order[12];
    }
    together();
}"""

_END = """{
    const long top = 0, bottom = 0;
    SHARED
    if (!is_first) return;
    double* report = reports.data + row * REPORT;
    for (int n = 0; n < 8; ++n) report[n] = s.clock.data[n];
    for (int n = 0; n < 4; ++n) report[8 + n] = s.counts.data[n];
    report[12] = s.peaks.data[0];
    report[13] = numbers.data[row];
}"""


@wp.struct
class World:
    """Arrays and constants of a simulation."""

    flow: Cells
    heat: Heat
    covered: Covered
    highest: Highest


def world_of(flow: Any, heat: Any, covered: Any, highest: Any) -> Any:
    """Return a world of its parts."""
    world = World()
    world.flow, world.heat, world.covered, world.highest = flow, heat, covered, highest
    return world


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
    ): ...

    @wp.func_native(ending)
    def end(
        s: Cells, reports: wp.array2d(dtype=wp.float64), numbers: wp.array(dtype=wp.float64),
        row: int,
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
        begin(world.flow, orders, numbers, row)
        if most == 0:
            note(world.flow, world.covered)
        for _ in range(most):
            if clock[TIME] >= clock[TARGET] or clock[WAITING] > wp.float64(0.0):
                break
            if wp.static(is_heated):
                heated_step(world.flow, world.heat)
            else:
                step(world.flow)
            if clock[WAITING] == wp.float64(0.0):
                note(world.flow, world.covered)
                raise_peaks(world.flow, world.heat, world.highest)
        end(world.flow, reports, numbers, row)

    return take_steps


class Worlds:
    """Worlds whose steps a launch takes together."""

    def __init__(self, rows: int, device: Any) -> None:
        """Allocate for at most some worlds."""
        self._device = device
        self._kept: list[Any] = [None] * rows
        self._size = ctypes.sizeof(World.ctype)
        self._packed = np.zeros((rows, self._size), dtype=np.uint8)
        self._there = wp.zeros(rows * self._size, dtype=wp.uint8, device=device)
        self._worlds = wp.array(
            ptr=self._there.ptr, dtype=World, shape=(rows,), device=device
        )
        self._is_new = np.zeros(rows, dtype=bool)
        self._rows = wp.zeros(rows, dtype=wp.int32, device=device)
        self._chosen: list[int] = []
        self._orders = np.zeros((rows, _ORDER))
        self._has_orders = False
        zeros = wp.zeros((rows, _ORDER), dtype=wp.float64, device=device)
        self._orders_there = zeros
        self._reports = wp.zeros((rows, _REPORT), dtype=wp.float64, device=device)
        self._numbers = wp.zeros(rows, dtype=wp.float64, device=device)
        self._processors = device.sm_count if device.is_cuda else 1

    def put(self, row: int, world: Any) -> None:
        """Assign a row to a world, whose arrays live as long as it has the row."""
        packed = ctypes.string_at(ctypes.addressof(world.__ctype__()), self._size)
        self._packed[row] = np.frombuffer(packed, dtype=np.uint8)
        self._kept[row], self._is_new[row] = world, True

    def order(self, row: int, clock: np.ndarray, window: np.ndarray) -> None:
        """Give the world of a row its clock, and a window that its own must contain."""
        order = self._orders[row]
        order[CLOCK], order[8:12] = clock, window
        order[12] += 1.0
        self._has_orders = True

    def is_current(self, row: int, report: np.ndarray) -> bool:
        """Return True if the report of a row follows its latest order."""
        return bool(report[NUMBER] == self._orders[row, 12])

    def blocks(self, count: int) -> int:
        """Return the number of blocks of each of some worlds."""
        fit = self._device.is_cuda and self._device.arch >= 90
        return _MAX_BLOCKS if fit and count * _MAX_BLOCKS <= self._processors else 1

    def launch(
        self, rows: Sequence[int], effects: Effects, is_heated: bool, steps: int
    ) -> Callable[[], np.ndarray]:
        """Take at most some steps of the worlds of some rows.

        Returns:
            Function that waits and returns the reports of all rows, float64.
        """
        self._send(rows)
        blocks, is_cuda = self.blocks(len(rows)), self._device.is_cuda
        kernel = steps_kernel(effects, is_heated, blocks, is_cuda)
        wp.launch(
            kernel, dim=len(rows) * (blocks * THREADS if is_cuda else 1), block_dim=THREADS,
            inputs=[
                self._worlds, self._rows, self._orders_there, self._reports, self._numbers, steps
            ],
            device=self._device,
        )
        if not is_cuda:
            return self._reports.numpy
        copy = wp.empty_like(self._reports, device='cpu', pinned=True)
        wp.copy(copy, self._reports)
        event = wp.get_stream(self._device).record_event()

        def read() -> np.ndarray:
            wp.synchronize_event(event)
            values: np.ndarray = copy.numpy()
            return values

        return read

    def _send(self, rows: Sequence[int]) -> None:
        """Copy worlds, orders and numbers of rows that changed to the device."""
        new = np.flatnonzero(self._is_new)
        if new.size:
            first, end = int(new[0]), int(new[-1]) + 1
            part = self._there[first * self._size : end * self._size]
            part.assign(self._packed[first:end].ravel())
            self._is_new[:] = False
        if self._has_orders:
            self._orders_there.assign(self._orders)
            self._has_orders = False
        chosen = list(rows)
        if chosen != self._chosen:
            self._rows[: len(chosen)].assign(np.array(chosen, dtype=np.int32))
            self._chosen = chosen
