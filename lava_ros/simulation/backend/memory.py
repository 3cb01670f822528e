# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Allocation of many arrays at once, and recovery from an allocation that failed on a GPU."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import warp as wp

#: Alignment of arrays in units of this type: a Warp array has at most 2^31 items of any type.
_PIECE = wp.mat44d


def zeros(items: Mapping[str, tuple[Any, int]], device: Any, *, spare: int = 0) -> dict[str, Any]:
    """Allocate arrays of zeros in one block of memory, three times as fast as one by one.

    Args:
        items: Type and number of items of each array, by name.
        device: The Warp device.
        spare: Extra items after the end of each array that may be read.

    Returns:
        The arrays, by name; the memory lives as long as any of them.

    Raises:
        RuntimeError: If memory is insufficient.
    """
    size = wp.types.type_size_in_bytes
    starts, end = {}, 0
    for name, (dtype, count) in items.items():
        starts[name] = end
        end += -(-(count + spare) * size(dtype) // size(_PIECE))
    block = wp.zeros(end, dtype=_PIECE, device=device)
    found = {}
    for name, (dtype, count) in items.items():
        first = block.ptr + starts[name] * size(_PIECE)
        array = wp.array(ptr=first, dtype=dtype, shape=count, device=device)
        array.block = block
        found[name] = array
    return found


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
