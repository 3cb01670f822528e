# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The same launches of many members, each of them in one launch.

What a member launches is taken down (graph.py), and its arguments are kept in a row of a table on
the device. One launch serves all: each block of its threads belongs to one member, and finds the
arguments in that member's row (``compiled.quick_kernel``). Members may differ in size: a list says
of each block which member it belongs to.
"""

from collections.abc import Sequence
import ctypes
import math
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.simulation.backend.graph import Launch
from lava_ros.simulation.backend.programmatic_launch import overlap
from lava_ros.simulation.backend.streams import capture_lock

#: Threads of a block where a launch does not say, and where it has one thread.
BLOCK, _WARP = 192, 32

#: Times that a graph makes all launches: to capture one takes as long as to launch it many times,
#: and members that grow need another one often.
_CAPTURED = 4

#: Bytes between two structs in a row are a multiple of it.
_ALIGNED = 16

#: Lists of blocks, and graphs, that are kept: one for each number of blocks, rounded up.
_MOST = 64


def kind_of(launches: Sequence[Launch]) -> tuple[Any, ...]:
    """What launches must have in common with others to be made together."""
    return tuple((one.kernel, one.block_dim, one.is_over_particles) for one in launches)


def _rounded(count: int) -> int:
    """A number that is no less, by a half at most, of which there are few."""
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
    """Launches of members that go through the same kernels."""

    def __init__(self, launches: Sequence[Launch], rows: int, device: Any) -> None:
        """Make tables.

        Args:
            launches: Those of one member, to see the kernels.
            rows: Members there is room for.
            device: Warp device.
        """
        self._device = device
        self._tables: list[_Table] = []
        length = 0
        for one in launches:
            self._tables.append(_Table(one, rows, length))
            length = self._tables[-1].end
        # a member's arguments lie side by side: one copy takes all of them to the device
        self._length = length
        self._there = wp.zeros(rows * length, dtype=wp.uint8, device=device)
        self._here = wp.zeros(rows * length, dtype=wp.uint8, device='cpu')
        for table in self._tables:
            table.lay_out(self._here, self._there, length)
        self._is_new = np.zeros(rows, dtype=bool)
        self._ready: _Ready | None = None
        self._made: dict[tuple[int, ...], _Ready] = {}

    def put(self, row: int, launches: Sequence[Launch]) -> None:
        """Let a row be a member with these launches, once ``select`` is called again."""
        for table, one in zip(self._tables, launches, strict=True):
            table.put(row, one)
        self._is_new[row] = True

    def _send(self) -> None:
        """Copy what was put into rows to the device."""
        rows = np.flatnonzero(self._is_new)
        if not len(rows):
            return
        first, end = int(rows[0]) * self._length, (int(rows[-1]) + 1) * self._length
        wp.copy(self._there, self._here, first, first, end - first)
        self._is_new[:] = False

    def select(self, rows: np.ndarray, particles: np.ndarray) -> None:
        """Let some members take part from now on, and no others.

        Args:
            rows: Their rows, int.
            particles: How many each of them is expected to have; more take longer.
        """
        # tables with as many threads share a list
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
            if len(self._made) >= _MOST:
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
        """Make all launches some times, on a GPU as a graph."""
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
        blocks: All of them.
        of_tables: The part of each table.
        graphs: Graphs of the launches with them, by how often.
    """

    blocks: Any
    of_tables: list[Any]
    graphs: dict[int, Any]


class _Table:
    """One launch of all members.

    Attributes:
        kernel: The kernel.
        first, end: Bytes of a member's row before its arguments, and up to their end.
    """

    def __init__(self, launch: Launch, rows: int, first: int) -> None:
        self._size = launch.block_dim or (BLOCK if launch.dim > 1 else _WARP)
        # blocks are fewer where the last threads have no particle yet
        self._takes_turns = launch.is_over_particles and launch.block_dim is None
        self._arguments, self.kernel = launch.kernel.for_many(self._size, self._takes_turns)
        self.first, size = first, ctypes.sizeof(self._arguments.ctype)
        self.end = first + _ALIGNED * -(-size // _ALIGNED)
        self._threads = np.zeros(rows, dtype=np.int64)
        # the arrays must live as long as they may be launched with
        self._kept: list[Any] = [None] * rows

    def lay_out(self, here: Any, there: Any, length: int) -> None:
        """Place the arguments in rows of ``length`` bytes on the host and on the device."""
        self._device, count = there.device, len(self._kept)
        self._members = wp.array(
            ptr=there.ptr + self.first, dtype=self._arguments, shape=(count,), strides=(length,),
            device=there.device,
        )
        # Warp looks at each field of what it packs, which takes a hundred times as long
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
        """Threads to a block; blocks and threads of each of some rows, as bytes of int64."""
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
        """Load the kernel, which cannot be done while a graph is captured."""
        self.kernel.module.load(self._device, self._size)
