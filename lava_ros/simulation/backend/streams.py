# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Asynchronous readback from a GPU."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any
import weakref

import numpy as np
import warp as wp

from lava_ros.simulation.backend.graph import capture_lock
from lava_ros.simulation.backend.memory import read

#: Maximum number of page-locked arrays of each shape and type per reader: one in transfer, the
#: latest, and the last ones published by layers of two rates. They are scarce and slow to
#: allocate.
_MAX_PINNED_ARRAYS = 4

class _Lent:
    """Host memory that is not reused while a numpy array made of it lives."""

    def __init__(self, host: Any) -> None:
        self.host = host
        self.__array_interface__ = host.numpy().__array_interface__


class Reader:
    """Reader that copies GPU arrays to the host, in parallel with later launches.

    The host memory is page-locked and reused when no array refers to it any more: in the long
    run nothing is allocated.
    """

    def __init__(self, device: Any) -> None:
        """Initialize without allocating."""
        self._device = device
        self._stream: Any = None
        self._copied: Any = None
        self._made: dict[Any, int] = defaultdict(int)
        self._free: dict[Any, list[Any]] = defaultdict(list)

    def before_writing(self) -> None:
        """Let later launches wait until the latest copies are complete."""
        if self._copied is not None:
            wp.get_stream(self._device).wait_event(self._copied)

    def begin(self, arrays: Sequence[Any], *, overlaps: bool) -> Callable[[], list[np.ndarray]]:
        """Start to copy arrays, with their contents after all launches so far.

        Args:
            arrays: The arrays. Call ``before_writing`` before writing to them again.
            overlaps: If True, copy in parallel with later launches on a GPU; otherwise copy now.

        Returns:
            Function that waits for the copies and returns them, callable from any thread.
        """
        if not (overlaps and self._device.is_cuda):
            copies = [read(array) for array in arrays]
            return lambda: copies
        if self._stream is None:
            self._stream = wp.Stream(self._device)
        self._stream.wait_stream(wp.get_stream(self._device))
        lent = [self._copied_to(array) for array in arrays]
        copied = self._copied = self._stream.record_event()

        def finish() -> list[np.ndarray]:
            with capture_lock:
                wp.synchronize_event(copied)
            return [np.asarray(item) for item in lent]

        return finish

    def _copied_to(self, array: Any) -> Any:
        """Start to copy an array; return its host memory, reused where possible."""
        kind = (array.shape, array.dtype)
        free = self._free[kind]
        if not free:
            is_locked = self._made[kind] < _MAX_PINNED_ARRAYS
            self._made[kind] += is_locked
            host = wp.empty_like(array, device='cpu', pinned=is_locked)
        else:
            host = free.pop()
        wp.copy(host, array, stream=self._stream)
        lent = _Lent(host)
        if host.pinned:
            # the next copy into it is queued after this one, on the same stream
            weakref.finalize(lent, free.append, host).atexit = False
        return lent
