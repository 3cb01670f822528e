# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The same launches of many members, each of them in one launch.

What a member launches is taken down (graph.py), and its arguments are kept in a row of a table on
the device. One launch serves all: each block of its threads belongs to one member, and finds the
arguments in that member's row (``compiled.quick_kernel``). Members may differ in size: a list says
of each block which member it belongs to.
"""

from collections.abc import Sequence
import ctypes
from typing import Any

import numpy as np
import warp as wp

from lava_ros.simulation.backend.graph import Launch
from lava_ros.simulation.backend.programmatic_launch import overlap
from lava_ros.simulation.backend.streams import capture_lock

#: Threads of a block where a launch does not say.
_BLOCK = 256

#: Blocks there is room for over those that are used: for more another graph is captured.
_SPARE = 1.25


def kind_of(launches: Sequence[Launch]) -> tuple[Any, ...]:
    """What launches must have in common with others to be made together."""
    return tuple((one.kernel, one.block_dim) for one in launches)


class Together:
    """Launches of members that go through the same kernels."""

    def __init__(self, launches: Sequence[Launch], rows: int, device: Any) -> None:
        """Make tables.

        Args:
            launches: Those of one member, to see the kernels.
            rows: Members there is room for.
            device: Warp device.
        """
        self._device = device
        self._tables = [_Table(one, rows, device) for one in launches]
        self._graph: tuple[Any, Any] | None = None
        self._room: list[int] = []
        self._blocks: Any = None

    def put(self, row: int, launches: Sequence[Launch]) -> None:
        """Let a row be a member with these launches, once ``select`` is called again."""
        for table, one in zip(self._tables, launches, strict=True):
            table.put(row, one)

    def select(self, rows: np.ndarray) -> None:
        """Let the members of some rows, int, take part from now on, and no others."""
        parts = [table.parts(rows) for table in self._tables]
        used = [len(part) for part in parts]
        if not self._room or not all(
            one <= room <= 2 * _SPARE * one
            for one, room in zip(used, self._room, strict=True)
        ):
            self._room = [int(_SPARE * one) + 1 for one in used]
            self._blocks = wp.empty(sum(self._room), dtype=wp.vec3i, device=self._device)
        ends = np.cumsum(self._room)
        blocks = np.full((ends[-1], 3), -1, dtype=np.int32)
        for table, part, end, room in zip(self._tables, parts, ends, self._room, strict=True):
            table.send()
            table.blocks = self._blocks[end - room : end]
            blocks[end - room :][: len(part)] = part
        self._blocks.assign(blocks)

    def launch(self) -> None:
        """Make all launches once."""
        for table in self._tables:
            table.launch()

    def launch_again(self, times: int) -> None:
        """Make all launches some times, on a GPU as a graph."""
        if not self._device.is_cuda:
            for _ in range(times):
                self.launch()
            return
        key = times, self._blocks.ptr
        if self._graph is None or self._graph[0] != key:
            for table in self._tables:
                table.load()
            with capture_lock, wp.ScopedCapture(device=self._device) as capture:
                for _ in range(times):
                    self.launch()
            overlap(capture.graph, {table.kernel for table in self._tables})
            self._graph = key, capture.graph
        wp.capture_launch(self._graph[1])


class _Table:
    """One launch of all members.

    Attributes:
        kernel: The kernel.
        blocks: Member, first thread and end of the member's threads, of each block.
    """

    def __init__(self, launch: Launch, rows: int, device: Any) -> None:
        self._size = launch.block_dim or _BLOCK
        self._arguments, self.kernel = launch.kernel.for_many(self._size)
        self._device = device
        self._members = wp.zeros(rows, dtype=self._arguments, device=device)
        # Warp looks at each field of what it packs, which takes a hundred times as long
        self._packed = (self._arguments.ctype * rows)()
        size = ctypes.sizeof(self._packed)
        self._there = wp.array(
            ptr=self._members.ptr, dtype=wp.uint8, shape=size, device=device
        )
        self._here = wp.array(
            ptr=ctypes.addressof(self._packed), dtype=wp.uint8, shape=size, device='cpu'
        )
        self._threads = np.zeros(rows, dtype=np.int64)
        self._is_new = np.zeros(rows, dtype=bool)
        # the arrays must live as long as they may be launched with
        self._kept: list[Any] = [None] * rows
        self.blocks: Any = None

    def put(self, row: int, launch: Launch) -> None:
        packed = self._packed[row]
        for name, value in zip(self._arguments.vars, launch.arguments, strict=True):
            if value is None:
                value = type(getattr(packed, name))()
            setattr(packed, name, value.__ctype__() if hasattr(value, '__ctype__') else value)
        self._kept[row] = launch.arguments
        self._threads[row] = launch.dim
        self._is_new[row] = True

    def send(self) -> None:
        """Copy what was put into rows to the device."""
        rows = np.flatnonzero(self._is_new)
        if not len(rows):
            return
        size = ctypes.sizeof(self._arguments.ctype)
        first, end = int(rows[0]) * size, (int(rows[-1]) + 1) * size
        wp.copy(self._there, self._here, first, first, end - first)
        self._is_new[:] = False

    def parts(self, rows: np.ndarray) -> np.ndarray:
        """What ``blocks`` has to hold for the members of some rows, int, shape [blocks, 3]."""
        threads = self._threads[rows]
        counts = -(-threads // self._size)
        firsts = np.repeat(np.cumsum(counts) - counts, counts)
        numbers = np.arange(len(firsts)) - firsts
        columns = np.repeat(rows, counts), numbers * self._size, np.repeat(threads, counts)
        return np.stack(columns, axis=1)

    def launch(self) -> None:
        wp.launch(
            self.kernel,
            dim=self.blocks.shape[0] * self._size,
            inputs=[self._members, self.blocks],
            device=self._device,
            block_dim=self._size,
        )

    def load(self) -> None:
        """Load the kernel, which cannot be done while a graph is captured."""
        self.kernel.module.load(self._device, self._size)
