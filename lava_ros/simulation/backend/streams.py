# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Reading back from a GPU what others need not wait for."""

from collections import defaultdict
from collections.abc import Callable, Sequence
import threading
from typing import Any
import weakref

import numpy as np
import warp as wp

#: Page-locked arrays of a kind that a reader has at most: one under way, the latest, and those
#: that layers of two rates have published last. They are scarce, and slow to make.
_MOST_LOCKED = 4

#: Held while a graph is captured, and while a thread waits for an event: Warp refuses to wait
#: during a capture, whosever it is.
capture_lock = threading.Lock()


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


class Readback:
    """Copies of two small arrays, when what is launched before on the same stream is done."""

    def __init__(self, arrays: tuple[Any, Any]) -> None:
        """Make room for one look at a time."""
        device = arrays[0].device
        self._arrays = self._copies = arrays
        self._event = None
        if device.is_cuda:
            self._copies = tuple(wp.zeros_like(one, device='cpu', pinned=True) for one in arrays)
            self._event = wp.Event(device)
        self._seen = [one.numpy() for one in self._copies]

    def begin(self) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
        """Begin to copy, and return what waits for the copies and gives them."""
        if self._event is None:
            now = self._seen[0].copy(), self._seen[1].copy()
            return lambda: now
        for copy, array in zip(self._copies, self._arrays, strict=True):
            wp.copy(copy, array)
        wp.get_stream(self._event.device).record_event(self._event)
        return self._finish

    def _finish(self) -> tuple[np.ndarray, np.ndarray]:
        wp.synchronize_event(self._event)
        return self._seen[0].copy(), self._seen[1].copy()


class _Lent:
    """Memory of an array, which is not used again as long as a numpy array made of it lives."""

    def __init__(self, host: Any) -> None:
        self.host = host
        self.__array_interface__ = host.numpy().__array_interface__


class Reader:
    """Copies arrays of a GPU to the host beside all that is launched later, on its own stream.

    What it copies to is page-locked and used again once nobody holds an array of it any more: in
    the long run nothing is allocated.
    """

    def __init__(self, device: Any) -> None:
        """Make nothing yet."""
        self._device = device
        self._stream: Any = None
        self._copied: Any = None
        self._made: dict[Any, int] = defaultdict(int)
        self._free: dict[Any, list[Any]] = defaultdict(list)

    def before_writing(self) -> None:
        """Let what is launched from now on wait until the latest copies are made."""
        if self._copied is not None:
            wp.get_stream(self._device).wait_event(self._copied)

    def begin(self, arrays: Sequence[Any], *, beside: bool) -> Callable[[], list[np.ndarray]]:
        """Begin to copy arrays, as they are when what is launched so far is done.

        Args:
            arrays: The arrays. Before they are written to again ``before_writing`` is called.
            beside: Whether others go on meanwhile; on the CPU, and without, they are copied now.

        Returns:
            What waits for the copies and gives them, in any thread.
        """
        if not (beside and self._device.is_cuda):
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
        """Memory that an array is being copied to: free, or new as long as there is little."""
        kind = (array.shape, array.dtype)
        free = self._free[kind]
        if not free:
            is_locked = self._made[kind] < _MOST_LOCKED
            self._made[kind] += is_locked
            host = wp.empty_like(array, device='cpu', pinned=is_locked)
        else:
            host = free.pop()
        wp.copy(host, array, stream=self._stream)
        lent = _Lent(host)
        if host.pinned:
            # the next copy to it comes after this one, on the same stream
            weakref.finalize(lent, free.append, host).atexit = False
        return lent
