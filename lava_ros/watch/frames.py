# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Frames that a live view shows: their number grows, and their source has a status."""

from enum import IntEnum
import os
from pathlib import Path
import time
from typing import NamedTuple, Protocol

from lava_ros.bag.reader import BagReader
from lava_ros.errors import LavaError, printable
from lava_ros.files.resources import share_path
from lava_ros.maps.frames import Frame, Recording
from lava_ros.maps.layer_files import load_layers
from lava_ros.maps.layers import ARRIVAL, ARRIVED, Layer, PROBABILITY

#: Maps that are watched, by what they show; the thickness is the one that is not rounded.
SOURCES = ('thickness', 'temperature', 'hazard', ARRIVED, ARRIVAL, PROBABILITY)

#: Least wall time between two looks at a bag [s], and how often longer than a look it is.
PERIOD, REST = 1.0, 5.0


class Level(IntEnum):
    """Severity of a status."""

    WELL = 0
    WAITING = 1
    BAD = 2


class Status(NamedTuple):
    """State of the source of the frames: severity and a sentence."""

    level: Level
    words: str


class Frames(Protocol):
    """Frames of one run, oldest first.

    Attributes:
        times: Their simulated times [s]; None for one that does not say.
        version: Changes when they do.
    """

    times: list[float | None]
    version: int

    @property
    def status(self) -> Status:
        """State of the source."""

    def poll(self) -> None:
        """Take what has come since; never raises for what came."""

    def frame(self, index: int) -> Frame:
        """The frame of ``times[index]``.

        Raises:
            LavaError: The frame cannot be read.
        """


def watched_layers(files: tuple[str, ...] = ('default.yaml', 'forecast.yaml')) -> list[Layer]:
    """The layers of files in ``msg_configs/`` that are watched, one for each of ``SOURCES``."""
    layers: dict[str, Layer] = {}
    for file in files:
        for item in load_layers(share_path(f'msg_configs/{file}')):
            is_first = item.source not in layers or item.name == 'height_raw'
            if item.enabled and item.source in SOURCES and is_first:
                layers[item.source] = item
    return list(layers.values())


class BagFrames:
    """The frames of a bag, also of one that is still recorded."""

    def __init__(self, path: str | Path) -> None:
        """Open a bag.

        Raises:
            LavaError: The path is not a readable bag.
        """
        BagReader(path)
        self.times: list[float | None] = []
        self.version = 0
        self.status = Status(Level.WAITING, f'{path} has no maps yet')
        self._path = Path(path)
        self._layers = watched_layers(('forecast.yaml',))
        self._recording: Recording | None = None
        self._size: tuple[tuple[str, int], ...] = ()
        self._next_look = 0.0

    def poll(self) -> None:
        """Read the bag again when it has grown; a long read delays the next one."""
        begun = time.monotonic()
        size = self._sizes()
        if begun < self._next_look or size == self._size:
            return
        name = printable(str(self._path))
        try:
            self._recording = Recording(self._path, more=self._layers)
            self.times = [item.time for item in self._recording.timeline.last_run] or [None]
            self.status = Status(Level.WELL, f'recorded in {name}')
        except LavaError as error:
            self.status = Status(Level.WAITING, str(error))
        self._size = size
        self.version += 1
        self._next_look = time.monotonic() + max(PERIOD, REST * (time.monotonic() - begun))

    def frame(self, index: int) -> Frame:
        """The maps up to one of the times."""
        assert self._recording is not None
        return self._recording.frame_at(self.times[index])

    def _sizes(self) -> tuple[tuple[str, int], ...]:
        folder = self._path
        files = sorted(folder.glob('*.mcap')) if folder.is_dir() else [folder]
        try:
            return tuple((item.name, os.stat(item).st_size) for item in files)
        except OSError:
            # between two files of one bag
            return self._size
