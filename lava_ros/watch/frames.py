# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Frames of a live view: a growing list, and the status of its source."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import Enum
import math
from pathlib import Path
import time
from typing import NamedTuple

import numpy as np

from lava_ros.bag.checkpoints import checkpoint_at
from lava_ros.bag.decoding import Moment
from lava_ros.bag.reader import BagReader, mcap_files
from lava_ros.errors import LavaError, printable
from lava_ros.files.resources import share_path
from lava_ros.layers.frame import Frame, LayerFrame
from lava_ros.layers.layer import IMAGE, Layer, ZERO_CELSIUS
from lava_ros.layers.layer_files import load_layers
from lava_ros.layers.recording import Recording
from lava_ros.products.run_page import ENSEMBLE_MAPS, read_run
from lava_ros.products.run_warnings import method_of
from lava_ros.scene.onset import Onset, recorded_onset
from lava_ros.simulation.carriers import METHODS

#: Names of the layers in a live view, one of each source. The thickness is not rounded.
LAYERS = (
    'height_raw', 'temperature', 'hazard', 'arrived', 'inundated', 'arrival_time',
    'inundation_probability',
)

#: Minimum wall time between two reads of a bag [s], and as a multiple of the duration of a read.
PERIOD, REST = 1.0, 5.0

#: Commands to a node.
COMMANDS = ('pause', 'resume', 'step', 'reset')


class Level(Enum):
    """Severity of a status, with its colour."""

    OK = '#2f9e44'
    WARN = '#e8910c'
    ERROR = '#e03131'


class Status(NamedTuple):
    """State of the source of the frames: severity and a sentence."""

    level: Level
    words: str


class WatchedParticles(NamedTuple):
    """Map position x, y [m] and temperature [Celsius] of particles, shape [particles, 3].

    ``time`` is their simulated time [s]; None for the time of the maps.
    """

    values: np.ndarray
    time: float | None = None


#: Value for a frame without particles.
NO_PARTICLES = WatchedParticles(np.empty((0, 3)))


class Frames:
    """Frames of one run, oldest first. Subclasses read them from a bag or a node.

    Attributes:
        times: Simulated times of the frames [s]. If the recording has no simulated times: times on
            its clock since the first frame.
        is_simulated: False for times on the clock of the recording.
        onset: Date of simulated time 0; None if it is unknown.
        method: Carriers of the lava (``Accuracy.method``) of the newest frame.
        version: Number that changes with the frames.
        places: Map positions [m] of named places, by name.
        answer: The last command, and the node's answer.
        heading: Title and summary of all frames; None if each frame is described.
    """

    heading: tuple[str, str] | None = None
    is_simulated = True
    onset: Onset | None = None
    method = METHODS[0]
    _status = Status(Level.WARN, 'no maps yet')
    _facts: Mapping[str, str] = {}

    def __init__(self, frames: Sequence[Frame] = ()) -> None:
        """Initialize with frames that are in memory."""
        self._frames = frames
        self.times: list[float | None] = [frame.time for frame in frames]
        self.version, self.answer = 0, ''
        self.places: Mapping[str, tuple[float, float]] = {}

    @property
    def status(self) -> Status:
        """Status of the source."""
        return self._status

    def poll(self) -> None:
        """Read new data, if any; invalid data raise no error."""

    def frame(self, index: int) -> Frame:
        """Return the frame of ``times[index]``.

        Raises:
            LavaError: If the frame cannot be read.
        """
        return self._frames[index]

    def facts(self, index: int) -> Mapping[str, str]:
        """Return the diagnostics at ``times[index]`` as texts by name."""
        return self._facts

    def particles(self, index: int) -> WatchedParticles:
        """Return the newest particles at or before ``times[index]``."""
        return NO_PARTICLES

    def command(self, name: str) -> None:
        """Send one of ``COMMANDS`` to the node."""

    def open_vent(self, x: float, y: float) -> None:
        """Request a vent from the node at a map position [m]."""


def watched_layers() -> list[Layer]:
    """Return the layers of ``LAYERS``."""
    files = (share_path(f'msg_configs/{name}.yaml') for name in ('default', 'forecast'))
    return [item for file in files for item in load_layers(file) if item.name in LAYERS]


def ensemble_frames(path: str | Path, *, node: str | None = None) -> Frames:
    """Return the maps in the folder of a finished ensemble as a single frame.

    Raises:
        LavaError: If the path is not such a folder, or ``node`` is set.
    """
    run = read_run(path, node=node)
    layers = {}
    for name, panel in run.panels.items():
        source = ENSEMBLE_MAPS[name][0]
        layers[source] = LayerFrame(Layer(source, source, source, IMAGE), panel.values, False)
    frames = Frames([replace(next(iter(run.panels.values())).frame, layers=layers)])
    frames._status, frames._facts = Status(Level.OK, 'maps of an ensemble'), run.facts
    frames.heading, frames.onset = (run.title, run.summary), run.onset
    return frames


class BagFrames(Frames):
    """The frames of a bag, which may still be recording."""

    def __init__(self, path: str | Path, *, node: str | None = None) -> None:
        """Open a bag.

        ``node`` is the full name or the namespace of a node of the bag; None for the only one.

        Raises:
            LavaError: If the path is not a readable bag.
        """
        super().__init__()
        BagReader(path)
        self._path, self._node = Path(path), node
        self._recording: Recording | None = None
        self._moments: Sequence[Moment] = ()
        self._logged: list[int] = []
        self._sizes: list[int] = []
        self._next_look = 0.0

    def poll(self) -> None:
        """Read the bag again if it has grown; a long read delays the next one."""
        begun = time.monotonic()
        if begun < self._next_look:
            return
        try:
            sizes = [file.stat().st_size for file in mcap_files(self._path)]
            if sizes == self._sizes:
                return
            self._sizes = sizes
            forecasts = [item for item in watched_layers() if item.is_forecast]
            self._recording = Recording(
                self._path, node=self._node, more=forecasts, may_continue=True
            )
            self._moments = self._recording.timeline.last_run
            self.times = [item.time for item in self._moments]
            self.method = method_of(self._moments[-1]) if self._moments else METHODS[0]
            # without diagnostics, maps have times on the clock of the recording
            self._logged = [] if self._moments else self._recording.log_times()
            self.is_simulated = not self._logged
            self.times += [1e-9 * (log_time - self._logged[0]) for log_time in self._logged]
            self.times = self.times or [None]
            self.onset = recorded_onset(self._recording.bag.custom_data)
            self.places = self._recording.places
            self._status = Status(Level.OK, f'recorded in {printable(str(self._path))}')
        except (OSError, LavaError) as error:
            # the writer may be between two files of the bag, which is then read again
            self._status, self._sizes = Status(Level.WARN, str(error)), []
        self.version += 1
        self._next_look = time.monotonic() + max(PERIOD, REST * (time.monotonic() - begun))

    def frame(self, index: int) -> Frame:
        """Return the maps up to one of the times."""
        assert self._recording is not None
        if self._logged:
            return self._recording.frame_logged(self._logged[index])
        return self._recording.frame_at(self.times[index])

    def facts(self, index: int) -> Mapping[str, str]:
        """Return the diagnostics of the simulation at that time."""
        return self._moments[index].values if self._moments else {}

    def particles(self, index: int) -> WatchedParticles:
        """Return the particles of the newest checkpoint at or before that time."""
        time = self.times[index] if self.is_simulated else None
        found = checkpoint_at(self._path, math.inf if time is None else time)
        if found is None:
            return NO_PARTICLES
        particles = found.arrays['state.particle']
        positions = particles[:, :2] + found.scene.terrain.centre
        values = np.column_stack([positions, particles[:, 3] - ZERO_CELSIUS])
        return WatchedParticles(values, found.time)
