# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Launches that serve all members of a batch at once.

The launches of each member are recorded (graph.py), and their arguments are kept in one row of a
table on the device. One launch serves all members: each block of threads belongs to one member
and reads the arguments from that member's row (``compiled.quick_kernel``). Members may differ in
size: a list maps each block to its member.
"""

from collections.abc import Sequence
import ctypes
import math
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.simulation.backend.graph import capture_lock, Launch, overlap

#: Default number of threads per block: for launches of many threads, and of a single one.
BLOCK, _WARP = 192, 32

#: Repetitions of all launches in one graph. Capturing takes as long as launching many times, and
#: a member that grows often needs a new graph.
_CAPTURED = 4

#: Alignment of the structs in a row [bytes].
_ALIGNED = 16

#: Maximum number of cached block lists and graphs: one for each rounded number of blocks.
_MAX_CACHED = 64


def kind_of(launches: Sequence[Launch]) -> tuple[Any, ...]:
    """Return the key that launches must share to be batched together."""
    return tuple((one.kernel, one.block_dim, one.is_over_particles) for one in launches)


def _rounded(count: int) -> int:
    """Round up, by at most a half, to one of few numbers."""
    step = 1 << max(count.bit_length() - 2, 0)
    return -(-count // step) * step


def _blocks_of(rows: np.ndarray, size: int, blocks: bytes, threads: bytes) -> np.ndarray:
    """List the blocks of the members of some rows (``_Table.blocks_of``).

    Returns:
        Row, first thread and end of the threads of each block, int64, shape [blocks, 3].
    """
    counts = np.frombuffer(blocks, dtype=np.int64)
    last = np.cumsum(counts)
    first = (np.arange(last[-1]) - np.repeat(last - counts, counts)) * size
    end = first + size
    end[last - 1] = np.frombuffer(threads, dtype=np.int64)
    return np.stack((np.repeat(rows, counts), first, end), axis=1)


class BatchedLaunches:
    """Batched launches of members that run the same kernels."""

    def __init__(self, launches: Sequence[Launch], rows: int, device: Any) -> None:
        """Allocate the tables.

        Args:
            launches: The launches of one member, which define the kernels.
            rows: Maximum number of members.
            device: Warp device.
        """
        self._device = device
        self._tables: list[_Table] = []
        length = 0
        for one in launches:
            self._tables.append(_Table(one, rows, length))
            length = self._tables[-1].end
        # a member's arguments are contiguous: a single copy takes all of them to the device
        self._length = length
        self._there = wp.zeros(rows * length, dtype=wp.uint8, device=device)
        self._here = wp.zeros(rows * length, dtype=wp.uint8, device='cpu')
        for table in self._tables:
            table.lay_out(self._here, self._there, length)
        self._is_new = np.zeros(rows, dtype=bool)
        self._ready: _Ready | None = None
        self._made: dict[tuple[int, ...], _Ready] = {}

    def put(self, row: int, launches: Sequence[Launch]) -> None:
        """Assign a row to a member with these launches, effective at the next ``select``."""
        for table, one in zip(self._tables, launches, strict=True):
            table.put(row, one)
        self._is_new[row] = True

    def _send(self) -> None:
        """Copy the rows that changed to the device."""
        rows = np.flatnonzero(self._is_new)
        if not len(rows):
            return
        first, end = int(rows[0]) * self._length, (int(rows[-1]) + 1) * self._length
        wp.copy(self._there, self._here, first, first, end - first)
        self._is_new[:] = False

    def select(self, rows: np.ndarray, particles: np.ndarray) -> None:
        """Select the members that take part from now on.

        Args:
            rows: Their rows, int.
            particles: Expected number of particles of each member; more than that takes longer.
        """
        # tables with equal numbers of threads share a list
        lists: dict[tuple[int, bytes, bytes], int] = {}
        numbers = [
            lists.setdefault(table.blocks_of(rows, particles), len(lists))
            for table in self._tables
        ]
        listed = [_blocks_of(rows, *one) for one in lists]
        room = [_rounded(len(one)) for one in listed]
        key = (*numbers, *room)
        ends = np.cumsum(room)
        if key not in self._made:
            if len(self._made) >= _MAX_CACHED:
                self._made.clear()
            empty = wp.empty(sum(room), dtype=wp.vec3i, device=self._device)
            parts = [empty[end - size : end] for end, size in zip(ends, room, strict=True)]
            self._made[key] = _Ready(empty, [parts[number] for number in numbers], {})
        self._ready = self._made[key]
        blocks = np.full((ends[-1], 3), -1, dtype=np.int32)
        for one, end, size in zip(listed, ends, room, strict=True):
            blocks[end - size : end - size + len(one)] = one
        self._ready.blocks.assign(blocks)
        self._send()

    def launch(self, times: int = 1) -> None:
        """Repeat all launches a number of times, on a GPU as a graph."""
        assert self._ready is not None
        if not self._device.is_cuda:
            self._launch(times)
            return
        graphs, captured = self._ready.graphs, math.gcd(times, _CAPTURED)
        if captured not in graphs:
            for table in self._tables:
                table.load()
            with capture_lock, wp.ScopedCapture(device=self._device) as capture:
                self._launch(captured)
            overlap(capture.graph, {table.kernel for table in self._tables})
            graphs[captured] = capture.graph
        for _ in range(times // captured):
            wp.capture_launch(graphs[captured])

    def _launch(self, times: int) -> None:
        assert self._ready is not None
        for _ in range(times):
            for table, blocks in zip(self._tables, self._ready.of_tables, strict=True):
                table.launch(blocks)


class _Ready(NamedTuple):
    """Lists of blocks on the device: row, first thread and end of the threads of each.

    Attributes:
        blocks: All lists in one array.
        of_tables: The list of each table.
        graphs: Graphs of the launches with these lists, by number of repetitions.
    """

    blocks: Any
    of_tables: list[Any]
    graphs: dict[int, Any]


class _Table:
    """One launch of all members.

    Attributes:
        kernel: The kernel.
        first, end: Start and end of the arguments within a member's row [bytes].
    """

    def __init__(self, launch: Launch, rows: int, first: int) -> None:
        self._size = launch.block_dim or (BLOCK if launch.dim > 1 else _WARP)
        # fewer blocks are needed while the last threads have no particle yet
        self._takes_turns = launch.is_over_particles and launch.block_dim is None
        self._arguments, self.kernel = launch.kernel.for_many(self._size, self._takes_turns)
        self.first, size = first, ctypes.sizeof(self._arguments.ctype)
        self.end = first + _ALIGNED * -(-size // _ALIGNED)
        self._threads = np.zeros(rows, dtype=np.int64)
        # the arrays must live as long as they may be used in a launch
        self._kept: list[Any] = [None] * rows

    def lay_out(self, here: Any, there: Any, length: int) -> None:
        """Place the arguments in rows of ``length`` bytes on the host and on the device."""
        self._device, count = there.device, len(self._kept)
        self._members = wp.array(
            ptr=there.ptr + self.first, dtype=self._arguments, shape=(count,), strides=(length,),
            device=there.device,
        )
        # packing by Warp checks each field, which takes a hundred times as long
        self._packed = [
            self._arguments.ctype.from_address(here.ptr + row * length + self.first)
            for row in range(count)
        ]

    def put(self, row: int, launch: Launch) -> None:
        packed = self._packed[row]
        for name, value in zip(self._arguments.vars, launch.arguments, strict=True):
            if value is None:
                value = type(getattr(packed, name))()
            setattr(packed, name, value.__ctype__() if hasattr(value, '__ctype__') else value)
        self._kept[row] = launch.arguments
        self._threads[row] = launch.dim

    def blocks_of(self, rows: np.ndarray, particles: np.ndarray) -> tuple[int, bytes, bytes]:
        """Return threads per block, and blocks and threads of each row, as bytes of int64."""
        threads = self._threads[rows]
        needed = np.minimum(particles, threads) if self._takes_turns else threads
        blocks = np.maximum(-(-needed // self._size), 1)
        return self._size, blocks.tobytes(), threads.tobytes()

    def launch(self, blocks: Any) -> None:
        wp.launch(
            self.kernel,
            dim=blocks.shape[0] * self._size,
            inputs=[self._members, blocks],
            device=self._device,
            block_dim=self._size,
        )

    def load(self) -> None:
        """Load the kernel, which is impossible while a graph is captured."""
        self.kernel.module.load(self._device, self._size)
