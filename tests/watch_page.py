# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A server of a growing number of frames, and a visitor that does what a browser does."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
import time
from typing import Any

import msgspec
import numpy as np
import viser
from websockets.sync.client import ClientConnection, connect

from lava_ros.layers.frame import LayerFrame
from lava_ros.layers.layer import Layer, OCCUPANCY_GRID, PROBABILITY
from lava_ros.layers.recording import Recording
from lava_ros.watch.frames import Frames, Level, Status, WatchedParticles
from lava_ros.watch.page import Page
from lava_ros.watch.server import Server
from recording import growing, record

TIMES = [200.0, 400.0, 600.0, 800.0, 1000.0, 1200.0]


class Growing(Frames):
    """Six frames of a flow, the first ``count`` available; the last has probabilities."""

    _status = Status(Level.ERROR, 'no node answers <here>')

    def __init__(self, folder: Path, count: int) -> None:
        bag = record(folder / 'bag', TIMES, arrived=_arrived)
        super().__init__(list(Recording(bag).frames()))
        layer = Layer('p', 'p', PROBABILITY, OCCUPANCY_GRID)
        last = self._frames[-1]
        likely = LayerFrame(layer, 10.0 * last.layers['thickness'].values, False)
        self._frames[-1] = replace(last, layers={**last.layers, PROBABILITY: likely})
        self.places = {'<b>hut</b>': (20.0, 95.0), 'off the map': (1e6, 0.0)}
        self.commands: list[Any] = []
        self.grow(count)

    def grow(self, count: int) -> None:
        """Make the first ``count`` frames available."""
        self.times = [frame.time for frame in self._frames[:count]]
        self.version += 1

    def facts(self, index: int) -> dict[str, str]:
        return {'<i>effects</i>': f'frame <{index}>'}

    def particles(self, index: int) -> WatchedParticles:
        """Return three particles of an earlier time; the first frame has none."""
        values = np.array([[0.0, 90.0, 900.0], [0.0, 95.0, 901.0], [0.0, 100.0, 902.0]])
        return WatchedParticles(values[: 3 * index], 120.0)

    def command(self, name: str) -> None:
        self.commands.append(name)

    def open_vent(self, x: float, y: float) -> None:
        self.commands.append((x, y))


def _arrived(time: float) -> np.ndarray:
    """Return the arrival times of a flow that covers one more column every 100 s."""
    return np.where(growing(time) > 0.0, 100.0 * np.arange(1.0, 41.0), np.nan)


class Visitor:
    """A client that opens the page, sends its camera as a browser does, and changes elements."""

    def __init__(self, server: Server) -> None:
        self.server, known = server, set(server.pages)
        version = f'viser-v{viser.__version__}'
        self.socket: ClientConnection = connect(
            f'ws://127.0.0.1:{server.port}/', subprotocols=[version], max_size=None,
            open_timeout=60.0, ping_interval=None,
        )
        self.say(
            'ViewerCameraMessage', wxyz=(1, 0, 0, 0), position=(3, 3, 3), fov=1.0, near=0.01,
            far=1000.0, image_height=500, image_width=800, look_at=(0, 0, 0),
            up_direction=(0, 0, 1),
        )
        self.wait(lambda: server.pages.keys() - known)
        self.page = self.pages[-1]

    @property
    def pages(self) -> list[Page]:
        return list(self.server.pages.values())

    def say(self, kind: str, **fields: Any) -> None:
        self.socket.send(msgspec.msgpack.encode({'type': kind, **fields}))

    def press(self, handle: Any, value: Any = True) -> None:
        """Change the value of an element of the page."""
        self.say('GuiUpdateMessage', uuid=handle._impl.uuid, updates={'value': value})

    def wait(self, condition: Callable[[], Any]) -> None:
        """Update the server until a condition holds."""
        end = time.monotonic() + 120.0
        self.server.update()
        while not condition():
            assert time.monotonic() < end
            time.sleep(0.01)
            self.server.update()


@contextmanager
def served(frames: Frames, **options: Any) -> Iterator[Server]:
    """Serve frames until the end of the block."""
    server = Server(frames, 0, **options)
    try:
        yield server
    finally:
        server.close()
