# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A page with a growing number of frames, served from a thread."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
import threading

import numpy as np

from lava_ros.maps.frames import Frame, LayerFrame, Recording
from lava_ros.maps.layers import Layer, OCCUPANCY_GRID, PROBABILITY
from lava_ros.watch.frames import Level, Status
from lava_ros.watch.page import serve
from recording import growing, record

TIMES = [200.0, 400.0, 600.0, 800.0, 1000.0, 1200.0]


class Growing:
    """Six frames of a flow, the first ``count`` available; the last has probabilities."""

    def __init__(self, folder: Path, count: int) -> None:
        bag = record(folder / 'bag', TIMES, arrived=_arrived)
        self._frames = list(Recording(bag).frames())
        layer = Layer('p', 'p', PROBABILITY, OCCUPANCY_GRID)
        last = self._frames[-1]
        likely = LayerFrame(layer, 10.0 * last.layers['thickness'].values, False)
        self._frames[-1] = replace(last, layers={**last.layers, PROBABILITY: likely})
        self.times: list[float | None] = []
        self.version = 0
        self.status = Status(Level.BAD, 'no node answers <here>')
        self.grow(count)

    def grow(self, count: int) -> None:
        """Make the first ``count`` frames available."""
        self.times = [frame.time for frame in self._frames[:count]]
        self.version += 1

    def poll(self) -> None:
        """Do nothing: no frame arrives by itself."""

    def frame(self, index: int) -> Frame:
        return self._frames[index]


def _arrived(time: float) -> np.ndarray:
    """Return the arrival times of a flow that covers one more column every 100 s."""
    return np.where(growing(time) > 0.0, 100.0 * np.arange(1.0, 41.0), np.nan)


@contextmanager
def served(frames: Growing) -> Iterator[str]:
    """Serve a page of frames; yield its address."""
    ready, servers = threading.Event(), []

    def run() -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        servers.append(serve(frames, '127.0.0.1', 0))
        ready.set()
        servers[0].io_loop.start()

    thread = threading.Thread(target=run)
    thread.start()
    assert ready.wait(120.0)
    try:
        yield f'http://127.0.0.1:{servers[0].port}/'
    finally:
        loop = servers[0].io_loop
        loop.add_callback(servers[0].stop)
        loop.add_callback(loop.stop)
        thread.join(30.0)
