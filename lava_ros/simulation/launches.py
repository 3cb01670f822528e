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

"""Launches that are made again and again with the same arguments.

Warp takes 40 microseconds to look at the arguments of a launch and to pack them, longer than the
CPU takes for what some hundred particles do in it. Packed once, a launch takes 15. A GPU has its
graphs for that.
"""

from collections.abc import Sequence
from typing import Any

import warp as wp

#: Packed launches that are kept; they keep their arrays too.
MOST = 256


class Launches:
    """The launches of a device. On a CPU they are kept as they were packed.

    Arguments are told by what they are, not by what is in them: a struct that was launched with
    must not be changed afterwards.
    """

    def __init__(self, device: Any) -> None:
        """Begin without any."""
        self._device = device
        self._kept: dict[tuple[int, ...], list[Any]] = {}

    def __call__(
        self,
        kernel: Any,
        *,
        dim: int,
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        block_dim: int | None = None,
    ) -> None:
        """Launch a kernel.

        Args:
            kernel: The kernel.
            dim: Threads.
            inputs: Its arguments.
            outputs: Those that it writes.
            block_dim: Threads to a block of a GPU; Warp's own number when left out.
        """
        if self._device.is_cuda:
            wp.launch(
                kernel,
                dim=dim,
                inputs=inputs,
                outputs=outputs,
                device=self._device,
                block_dim=block_dim,
            )
        elif dim > 0:
            self.packed(kernel, dim=dim, arguments=[*inputs, *outputs]).launch()

    def packed(self, kernel: Any, *, dim: int, arguments: list[Any]) -> Any:
        """A launch of some threads on the CPU that is made by its ``launch()``."""
        key = (id(kernel), *map(id, arguments))
        kept = self._kept.get(key)
        if kept is None:
            if len(self._kept) >= MOST:
                self._kept.clear()
            command: Any = wp.launch(
                kernel, dim=dim, inputs=arguments, device=self._device, record_cmd=True
            )
            # as long as they are here nothing else has their numbers
            self._kept[key] = [dim, command, kernel, arguments]
            return command
        if kept[0] != dim:
            kept[1].set_dim(dim)
            kept[0] = dim
        return kept[1]

    def forget(self) -> None:
        """Keep none any more, nor their arrays."""
        self._kept.clear()
