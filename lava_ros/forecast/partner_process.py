# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The child process that measures the numerical error of a live simulation, and ends.

It receives one request, ``measure``, with the arguments of ``partner_runs.measuring`` and the
``share`` of the time in which it may compute. It replies ``measured`` with the ``error``, or
``refused`` with the ``reason``. It ends when the other end of its connection is closed.
"""

from collections.abc import Iterator
from multiprocessing.connection import Connection
import os
import sys
import threading
import time
from typing import Any

from lava_ros.forecast.child_process import NICENESS, SLICE_WALL_TIME
from lava_ros.forecast.partner_runs import measuring
from lava_ros.simulation.numerical_error import NumericalError


def measure(share: float, **run: Any) -> NumericalError:
    """Measure an error, with pauses so that it takes a fraction ``share`` of one core's time."""

    def slowly() -> Iterator[None]:
        error: NumericalError = yield from measuring(clock=time.process_time, **run)
        found.append(error)

    found: list[NumericalError] = []
    begun = time.process_time()
    for _ in slowly():
        spent = time.process_time() - begun
        if spent >= SLICE_WALL_TIME:
            time.sleep(spent * (1.0 / share - 1.0))
            begun = time.process_time()
    return found[0]


def main() -> None:
    """Execute the request."""
    os.nice(NICENESS)
    node = Connection(int(sys.argv[1]))
    _, values = node.recv()
    threading.Thread(target=_watch, args=(node,), daemon=True).start()
    try:
        try:
            node.send(('measured', {'error': measure(**values)}))
        except (ValueError, MemoryError) as error:
            node.send(('refused', {'reason': str(error)}))
    except OSError:
        # the node has closed the connection
        sys.exit(0)


def _watch(node: Connection) -> None:
    """End the process when the connection is closed, even in the middle of a step."""
    try:
        node.recv()
    finally:
        os._exit(0)


if __name__ == '__main__':
    main()
