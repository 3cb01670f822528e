# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Frames of a live view: a growing list whose source has a status."""

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

#: Sources of the maps in a live view. The thickness is the layer that is not rounded.
SOURCES = ('thickness', 'temperature', 'hazard', ARRIVED, ARRIVAL, PROBABILITY)

#: Minimum wall time between two reads of a bag [s], and as a multiple of the duration of a read.
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
        times: Simulated times of the frames [s]; None if unknown.
        version: Number that changes with the frames.
    """

    times: list[float | None]
    version: int

    @property
    def status(self) -> Status:
        """Status of the source."""

    def poll(self) -> None:
        """Read new data; never raises an error for invalid data."""

    def frame(self, index: int) -> Frame:
        """Return the frame of ``times[index]``.

        Raises:
            LavaError: If the frame cannot be read.
        """


def watched_layers(files: tuple[str, ...] = ('default.yaml', 'forecast.yaml')) -> list[Layer]:
    """Return one layer for each of ``SOURCES`` from files in ``msg_configs/``."""
    layers: dict[str, Layer] = {}
    for file in files:
        for item in load_layers(share_path(f'msg_configs/{file}')):
            is_first = item.source not in layers or item.name == 'height_raw'
            if item.enabled and item.source in SOURCES and is_first:
                layers[item.source] = item
    return list(layers.values())


class BagFrames:
    """The frames of a bag, which may still be recording."""

    def __init__(self, path: str | Path) -> None:
        """Open a bag.

        Raises:
            LavaError: If the path is not a readable bag.
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
        """Read the bag again if it has grown; a long read delays the next one."""
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
        """Return the maps up to one of the times."""
        assert self._recording is not None
        return self._recording.frame_at(self.times[index])

    def _sizes(self) -> tuple[tuple[str, int], ...]:
        folder = self._path
        files = sorted(folder.glob('*.mcap')) if folder.is_dir() else [folder]
        try:
            return tuple((item.name, os.stat(item).st_size) for item in files)
        except OSError:
            # the writer may be between two files of the bag
            return self._size
