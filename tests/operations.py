# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Growth of work with the size of its input, in instructions instead of time."""

from collections.abc import Callable
import sys
from types import FrameType
from typing import Any


def operations(action: Callable[[], object]) -> int:
    """Return the number of instructions of Python that an action executes."""
    count = 0

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal count
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        count += event == 'opcode'
        return trace

    previous = sys.gettrace()
    sys.settrace(trace)
    try:
        action()
    finally:
        sys.settrace(previous)
    return count


def growth(make: Callable[[int], Callable[[], object]], size: int) -> float:
    """Return the factor by which the instructions of an action grow when its input doubles."""
    make(2)()    # caches are filled
    return operations(make(2 * size)) / operations(make(size))
