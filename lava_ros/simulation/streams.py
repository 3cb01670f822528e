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

"""Launches beside others on a GPU, and reading back what others need not wait for.

A kernel of few threads takes as long as its reads wait for memory, and one of all particles needs
nothing of what it is busy with: in a graph each is a branch of its own.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import warp as wp


def read(array: Any) -> np.ndarray:
    """Copy an array to the host as soon as what is launched before on the same stream is done.

    ``array.numpy()`` waits for all streams, and all streams wait for it.
    """
    if not array.device.is_cuda:
        copied: np.ndarray = array.numpy().copy()
        return copied
    host = wp.empty_like(array, device='cpu')
    wp.copy(host, array)
    wp.synchronize_stream(wp.get_stream(array.device))
    values: np.ndarray = host.numpy()
    return values


class Beside:
    """A second stream of a GPU; on the CPU there is none, and everything takes its turn."""

    def __init__(self, device: Any) -> None:
        """Make the stream."""
        self._device = device
        self._stream = wp.Stream(device) if device.is_cuda else None

    @contextmanager
    def __call__(self, launch: Callable[[], None]) -> Iterator[None]:
        """Launch something beside all that is launched within; what comes after waits for both."""
        if self._stream is None:
            launch()
            yield
            return
        with wp.ScopedStream(self._stream):
            launch()
        yield
        wp.get_stream(self._device).wait_stream(self._stream)
