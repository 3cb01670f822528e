# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrays that simulations share, allocation of many, a failed allocation, and readback."""

from collections import deque
from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
import math
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
import warp as wp
from warp.types import type_size_in_bytes

from lava_ros.errors import LavaError

#: Part of Warp's message if a device has no memory left.
NO_MEMORY = 'Failed to allocate'

#: Alignment of arrays in units of this type: a Warp array has at most 2^31 items of any type.
_PIECE = wp.mat44d


class OutOfMemoryError(LavaError, MemoryError):
    """The simulation does not fit into memory; a change that fails so may be incomplete."""


@contextmanager
def within_memory() -> Iterator[None]:
    """Raise ``OutOfMemoryError`` where Warp or numpy cannot allocate an array."""
    try:
        yield
    except (RuntimeError, MemoryError) as error:
        is_full = isinstance(error, MemoryError) or NO_MEMORY in str(error)
        if isinstance(error, LavaError) or not is_full:
            raise
        expected = f'room for the simulation ({error}); a larger spacing or a coarser terrain '
        expected += 'needs less'
        raise OutOfMemoryError('memory', 'used up', expected) from error


def bytes_per_cell(*kinds: Any, without: Collection[str] = ()) -> int:
    """Return the memory that the two-dimensional arrays of structs take for each cell [bytes].

    ``without`` names arrays that do not count.
    """
    items = [item for kind in kinds for item in kind.vars.items()]
    types = [item.type for name, item in items if name not in without]
    maps = [one for one in types if isinstance(one, wp.array) and one.ndim == 2]
    return sum(type_size_in_bytes(one.dtype) for one in maps)


def zeros(items: Mapping[str, tuple[Any, tuple[int, ...]]], device: Any) -> dict[str, Any]:
    """Allocate arrays of zeros in one block of memory, three times as fast as one by one.

    Args:
        items: Type and shape of each array, by name.
        device: The Warp device.

    Returns:
        The arrays, by name; the memory lives as long as any of them.

    Raises:
        RuntimeError: If memory is insufficient.
    """
    piece = type_size_in_bytes(_PIECE)
    starts, end = {}, 0
    for name, (dtype, shape) in items.items():
        starts[name] = end
        end += -(-math.prod(shape) * type_size_in_bytes(dtype) // piece)
    if wp.get_device(device).is_cuda:
        block = wp.zeros(end, dtype=_PIECE, device=device)
        first_piece = block.ptr
    else:
        # the system clears only pages that are used, and most of a terrain stays dry
        try:
            block = np.zeros((end + 1) * piece, dtype=np.uint8)
        except MemoryError as error:
            raise RuntimeError(f'{NO_MEMORY} memory: {error}') from error
        first_piece = -(-block.ctypes.data // piece) * piece
    found = {}
    for name, (dtype, shape) in items.items():
        first = first_piece + starts[name] * piece
        array = wp.array(ptr=first, dtype=dtype, shape=shape, device=device)
        array.block = block
        found[name] = array
    return found


#: Objects that are shared and in use, and the newest: those of two terrains, for members that run
#: one after the other with partners on coarser ground.
_shared: WeakValueDictionary[tuple[Hashable, ...], Any] = WeakValueDictionary()
_newest: deque[Any] = deque(maxlen=8)


def shared_object(make: Callable[..., Any], *key: Hashable) -> Any:
    """Return what a function makes of a key, which must not be written to.

    All callers with this key share it. It lives as long as one of them uses it, or it is one of
    the newest.
    """
    name = make, *key
    found = _shared.get(name)
    if found is None:
        found = _shared[name] = make(*key)
        _newest.append(found)
    return found


def shared_array(
    values: Callable[[Any], np.ndarray], source: Hashable, dtype: Any, device: Any
) -> Any:
    """Return the array of values of a source (``shared_object``).

    Args:
        values: Function of the source.
        source: The source, such as a terrain.
        dtype: Warp type of the array.
        device: The Warp device.
    """
    return shared_object(_array_of, values, source, dtype, str(device))


def _array_of(
    values: Callable[[Any], np.ndarray], source: Hashable, dtype: Any, device: str
) -> Any:
    return wp.array(values(source), dtype=dtype, device=device)


def forget_failure(device: Any) -> None:
    """Clear the sticky CUDA error left by a failed allocation.

    Warp raises for the allocation but leaves the error in the CUDA runtime. The next scan or sort
    would report it ("invalid device ordinal"), even in a simulation that has all it needs or in
    a new one after a reset. A scan of a single number clears the error.

    Args:
        device: The Warp device; nothing is done on the CPU.
    """
    if device.is_cuda:
        with suppress(RuntimeError):
            number = wp.zeros(1, dtype=wp.int32, device=device)
            wp.utils.array_scan(number, number)


def read(array: Any) -> np.ndarray:
    """Copy an array to the host after all earlier launches on the same stream.

    ``array.numpy()`` would wait for all streams and block them.
    """
    if not array.device.is_cuda:
        return array.numpy().copy()
    host = wp.empty_like(array, device='cpu')
    wp.copy(host, array)
    wp.synchronize_stream(wp.get_stream(array.device))
    return host.numpy()


def read_parts(maps: Sequence[Any], part: tuple[slice, slice]) -> np.ndarray:
    """Copy some rows and columns of several maps of one type and shape to the host.

    A GPU copies whole rows: a kernel that gathers others would wait for those of other streams.
    """
    rows, columns = part
    if not maps[0].device.is_cuda:
        return np.stack([one.numpy()[part] for one in maps])
    width, height = maps[0].shape[1], max(rows.stop - rows.start, 0)
    host = wp.empty((len(maps), height, width), dtype=maps[0].dtype, device='cpu')
    size = height * width
    for number, one in enumerate(maps):
        if size:
            wp.copy(host, one, number * size, rows.start * width, size)
    wp.synchronize_stream(wp.get_stream(maps[0].device))
    values: np.ndarray = host.numpy()[:, :, columns]
    return values


class Readback:
    """Copies of two small arrays, taken after all earlier launches on the same stream."""

    def __init__(self, arrays: tuple[Any, Any]) -> None:
        """Allocate the host copies, for one readback at a time."""
        device = arrays[0].device
        self._arrays = self._copies = arrays
        self._event = None
        if device.is_cuda:
            self._copies = tuple(wp.zeros_like(one, device='cpu', pinned=True) for one in arrays)
            self._event = wp.Event(device)
        self._views = [one.numpy() for one in self._copies]

    def begin(self) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
        """Start the copies; return a function that waits for them and returns them."""
        if self._event is None:
            now = self._views[0].copy(), self._views[1].copy()
            return lambda: now
        for copy, array in zip(self._copies, self._arrays, strict=True):
            wp.copy(copy, array)
        wp.get_stream(self._event.device).record_event(self._event)
        return self._finish

    def _finish(self) -> tuple[np.ndarray, np.ndarray]:
        wp.synchronize_event(self._event)
        return self._views[0].copy(), self._views[1].copy()
