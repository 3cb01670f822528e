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

    def put(self, row: int, launches: Sequence[Launch]) -> None:
        """Let a row be a member with these launches."""
        for table, one in zip(self._tables, launches, strict=True):
            table.put(row, one)

    def select(self, rows: np.ndarray) -> None:
        """Let the members of some rows, int, take part from now on, and no others."""
        for table in self._tables:
            table.select(rows)

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
        key = times, *(table.blocks.ptr for table in self._tables)
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
        self._threads = np.zeros(rows, dtype=np.int64)
        # the arrays must live as long as they may be launched with
        self._kept: list[Any] = [None] * rows
        self.blocks = self._blocks(1)

    def put(self, row: int, launch: Launch) -> None:
        arguments = self._arguments()
        for name, value in zip(self._arguments.vars, launch.arguments, strict=True):
            if value is not None:
                setattr(arguments, name, value)
        self._kept[row] = arguments
        self._threads[row] = launch.dim
        host = wp.array([arguments], dtype=self._arguments, device='cpu')
        wp.copy(self._members, host, dest_offset=row, count=1)

    def select(self, rows: np.ndarray) -> None:
        threads = self._threads[rows]
        counts = -(-threads // self._size)
        used = int(counts.sum())
        room = self.blocks.shape[0]
        if not used <= room <= 2 * _SPARE * used:
            self.blocks = self._blocks(int(_SPARE * used) + 1)
        table = np.full((self.blocks.shape[0], 3), -1, dtype=np.int32)
        firsts = np.repeat(np.cumsum(counts) - counts, counts)
        table[:used, 0] = np.repeat(rows, counts)
        table[:used, 1] = (np.arange(used) - firsts) * self._size
        table[:used, 2] = np.repeat(threads, counts)
        self.blocks.assign(table)

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

    def _blocks(self, count: int) -> Any:
        return wp.full(count, wp.vec3i(-1, 0, 0), dtype=wp.vec3i, device=self._device)
