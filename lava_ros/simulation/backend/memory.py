# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrays that simulations share, allocation of many, a failed allocation, and readback."""

from collections import deque
from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
import ctypes
from functools import lru_cache
import math
from threading import local
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
import warp as wp
from warp.types import type_size_in_bytes

from lava_ros.errors import LavaError

#: Part of Warp's message if a device has no memory left.
NO_MEMORY = 'Failed to allocate'

#: Type of the pieces of a block, as a Warp array has at most 2^31 items of any type, and its size
#: [bytes], the alignment of arrays.
_PIECE, _BYTES = wp.mat44d, type_size_in_bytes(wp.mat44d)


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


class ArrayBlock:
    """Arrays of zeros in one block of memory, by name.

    A Warp array takes the host longer to make than its memory does, and most are only passed to
    kernels: each is made when it is first read here.
    """

    def __init__(self, items: Mapping[str, tuple[Any, tuple[int, ...]]], device: Any) -> None:
        """Allocate.

        Args:
            items: Type and shape of each array, by name.
            device: The Warp device.

        Raises:
            RuntimeError: If memory is insufficient.
        """
        self._items, self._device = items, wp.get_device(device)
        self._made: dict[str, Any] = {}
        starts, end = _places_of(tuple(items.values()))
        if self._device.is_cuda:
            self._block = wp.zeros(end, dtype=_PIECE, device=device)
            self._first = self._block.ptr
        else:
            # the system clears only pages that are used, and most of a terrain stays dry
            try:
                self._block = np.zeros((end + 1) * _BYTES, dtype=np.uint8)
            except MemoryError as error:
                raise RuntimeError(f'{NO_MEMORY} memory: {error}') from error
            self._first = -(-self._block.ctypes.data // _BYTES) * _BYTES
        self._size = end * _BYTES
        self._pointers = {
            name: self._first + start * _BYTES for name, start in zip(items, starts, strict=True)
        }

    def __contains__(self, name: object) -> bool:
        """Return True if an array has a name."""
        return name in self._items

    def __getitem__(self, name: str) -> Any:
        """Return an array, which keeps the memory of all."""
        if name not in self._made:
            dtype, shape = self._items[name]
            array = wp.array(
                ptr=self._pointers[name], dtype=dtype, shape=shape, device=self._device
            )
            array.block = self._block
            self._made[name] = array
        return self._made[name]

    def copy(self) -> 'ArrayBlock':
        """Return a copy of all arrays."""
        other = ArrayBlock(self._items, self._device)
        if self._device.is_cuda:
            wp.copy(other._block, self._block)
        else:
            ctypes.memmove(other._first, self._first, self._size)
        return other

    def describe(self, name: str, target: Any) -> None:
        """Write the C struct of an array to the attribute of its name of a C struct of kernels."""
        setattr(target, name, _described(*self._items[name]))
        getattr(target, name).data = self._pointers[name]


@lru_cache(maxsize=64)
def _places_of(items: tuple[tuple[Any, tuple[int, ...]], ...]) -> tuple[list[int], int]:
    """Return the first piece of each array in a block, and the number of pieces of all."""
    starts, end = [], 0
    for dtype, shape in items:
        starts.append(end)
        end += -(-math.prod(shape) * type_size_in_bytes(dtype) // _BYTES)
    return starts, end


@lru_cache(maxsize=64)
def _described(dtype: Any, shape: tuple[int, ...]) -> Any:
    """Return the C struct of an array; its address is not valid."""
    return wp.array(ptr=_BYTES, dtype=dtype, shape=shape, device='cpu').__ctype__()


#: Memory of the host that the GPUs of a thread copy to, by their names, and its maximum [bytes].
_here, _MAX_STAGING = local(), 2**26

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
    (values,) = _read([(array, 0, array.size)])
    return values.reshape(*array.shape, *values.shape[1:])


def read_parts(maps: Sequence[Any], part: tuple[slice, slice]) -> list[np.ndarray]:
    """Copy some rows and columns of maps of one shape to the host.

    A GPU copies whole rows: a kernel that gathers others would wait for those of other streams.
    """
    rows, columns = part
    if not maps[0].device.is_cuda:
        return [one.numpy()[part].copy() for one in maps]
    width, height = maps[0].shape[1], max(rows.stop - rows.start, 0)
    found = _read([(one, rows.start * width, height * width) for one in maps])
    return [one.reshape(height, width)[:, columns] for one in found]


def write_part(array: Any, part: Any, values: np.ndarray) -> None:
    """Write values to a part of an array, given by a slice or several.

    On a CPU this takes a tenth of the time of Warp's assignment, which first makes another array.
    """
    if not array.device.is_cuda:
        array.numpy()[part] = values
    elif values.size:
        target = array[part]
        # Warp copies from the host to whole rows only
        device = 'cpu' if target.is_contiguous else array.device
        wp.copy(target, wp.array(values, dtype=array.dtype, device=device, copy=False))


def _read(pieces: Sequence[tuple[Any, int, int]]) -> list[np.ndarray]:
    """Copy items of arrays of a GPU, from a number on and as many as another, to the host.

    The GPU copies all of them to page-locked memory, and the host waits once.
    """
    device = pieces[0][0].device
    sizes = [count * type_size_in_bytes(one.dtype) for one, _, count in pieces]
    ends = np.cumsum([-(-size // _BYTES) for size in sizes]).tolist()
    staging = vars(_here).get(device.alias)
    if staging is None or staging.size < ends[-1]:
        # such memory takes long to allocate, and the system cannot use it otherwise
        is_kept = ends[-1] * _BYTES <= _MAX_STAGING
        staging = wp.empty(ends[-1], dtype=_PIECE, device='cpu', pinned=is_kept)
        if is_kept:
            setattr(_here, device.alias, staging)
    hosts = []
    for (one, first, count), start in zip(pieces, (0, *ends), strict=False):
        host = wp.array(
            ptr=staging.ptr + start * _BYTES, dtype=one.dtype, shape=count, device='cpu',
            pinned=staging.pinned,
        )
        if count:
            wp.copy(host, one, 0, first, count)
        hosts.append(host)
    wp.synchronize_stream(wp.get_stream(device))
    return [host.numpy().copy() for host in hosts]


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
        self._seen = [one.numpy() for one in self._copies]

    def begin(self) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
        """Start the copies; return a function that waits for them and returns them."""
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
