# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Many arrays from one allocation; and what a GPU that had no memory left leaves behind."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import warp as wp

#: Arrays begin at multiples of its size: an array has no more than 2^31 items, of whatever type.
_PIECE = wp.mat44d


def zeros(items: Mapping[str, tuple[Any, int]], device: Any, *, spare: int = 0) -> dict[str, Any]:
    """Arrays of zeros in one piece of memory: one by one they take three times as long.

    Args:
        items: Type and number of items of each array, by name.
        device: The Warp device.
        spare: Items behind the last of each array that may be read.

    Returns:
        The arrays, by name; the memory lives as long as any of them.

    Raises:
        RuntimeError: There is no memory for them.
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
    """Take away the error of an allocation that failed, which a GPU keeps for whoever asks next.

    Warp raises for the allocation and leaves the error with the CUDA runtime. The next scan or
    sort finds it there and fails in its place ("invalid device ordinal"): that of the simulation
    which still has all it needs, or of the new one after a reset. A scan of one number takes it.

    Args:
        device: The Warp device; nothing is done on the CPU.
    """
    if device.is_cuda:
        with suppress(RuntimeError):
            number = wp.zeros(1, dtype=wp.int32, device=device)
            wp.utils.array_scan(number, number)
