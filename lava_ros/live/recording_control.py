# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Start, retry and end of the recordings of a live simulation."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import os
from pathlib import Path
import shutil
import time
from typing import Any, NamedTuple

from lava_ros.errors import LavaError, refusing
from lava_ros.live.checkpoint_recording import CheckpointRecording
from lava_ros.live.recorder import BagFolder, Recorder
from lava_ros.live.restart import RestartFile

#: Maximum wait for the last checkpoint of a bag [s]. The simulation thread may be compiling.
CHECKPOINT_TIMEOUT = 2.0

#: Wall time after which a failed recording is tried again [s]. It doubles with each failure, up to
#: the maximum, until a recording has lasted longer than that.
RETRY_PERIOD, MAX_RETRY_PERIOD = 10.0, 600.0

#: Minimum free space on the disk at which a failed recording is tried again [bytes].
MIN_FREE = 64 * 2**20


class BagSettings(NamedTuple):
    """Settings of the next bag: its name, limits of a file, wall time between checkpoints [s]."""

    name: str
    max_size: int
    max_duration: float
    checkpoint_period: float


@dataclass(eq=False)
class RecordingControl:
    """Starts and ends bags, and retries a failed recording while one is wanted.

    Attributes:
        recorder: Recorder of the bags.
        checkpoints: Recording of checkpoints in them.
        folder: Folder of the bags.
        settings: Returns the current settings.
        restart_file: File with the progress of the run, None if it is not to be restarted.
        is_wanted: True if bags are to be recorded.
        is_restart: True if this process continues a killed one, so that its bag may exist.
        clock: Returns wall time [s].
    """

    recorder: Recorder
    checkpoints: CheckpointRecording
    folder: BagFolder
    settings: Callable[[], BagSettings]
    restart_file: RestartFile | None = None
    is_wanted: bool = False
    is_restart: bool = False
    clock: Callable[[], float] = time.monotonic

    def __post_init__(self) -> None:
        """Initialize without a failed attempt."""
        self._pause, self._begun = RETRY_PERIOD, 0.0
        self._due: float | None = None
        # folders of the requested bags, with symbolic links resolved
        self._resolved: dict[Path, Path] = {}

    @property
    def is_busy(self) -> bool:
        """True if a bag is open or chosen."""
        return self.recorder.is_recording or self.recorder.is_armed

    def begin(self) -> None:
        """Start the wanted recording, unless it has failed and is to be retried later.

        Raises:
            LavaError: If the bag cannot be created.
        """
        if self.is_wanted and not self.is_busy and not self.recorder.error:
            self.arm()

    def start(self) -> None:
        """Start a recording on request; errors as in ``arm``."""
        self.arm()
        self.is_wanted = True

    def arm(self, *, is_next: bool = False) -> None:
        """Choose a bag.

        With ``is_next``, for a bag without a request, a number is added to a name that exists, and
        the symbolic links in its path must be those of the last request.

        Raises:
            LavaError: If it cannot be created.
        """
        name, max_size, max_duration, _ = self.settings()
        directory = self.folder.path(name, is_next=is_next or self.is_restart)
        parent = directory.parent
        with refusing('bag_directory', str(directory), 'a path', OSError, RuntimeError):
            place = parent.resolve()
        if is_next and self._resolved.get(parent, place) != place:
            expected = 'a path without a symbolic link that was added after the first bag'
            raise LavaError('bag_directory', str(directory), expected)
        self._resolved[parent], self._begun = place, self.clock()
        self.recorder.arm(directory, max_size=max_size, max_duration=max_duration)

    def poll(self, stamp_ns: int, *, changes: int, is_active: bool) -> str:
        """Write checkpoints that are due, and try a failed recording again.

        Args:
            stamp_ns: ROS time [ns].
            changes: Number of changes of the scene and its effects so far.
            is_active: True if a recording may start.

        Returns:
            The reason why a checkpoint could not be taken, empty without an error.
        """
        if is_active and self.is_wanted and self.recorder.error and not self.is_busy:
            self._try_again()
        elif self.recorder.is_recording and self.clock() >= self._begun + self._pause:
            self._pause = RETRY_PERIOD
        period = self.settings().checkpoint_period
        return self.checkpoints.poll(period, stamp_ns, changes=changes)

    def _try_again(self) -> None:
        now = self.clock()
        if self._due is None:
            self._due, self._pause = now + self._pause, min(2.0 * self._pause, MAX_RETRY_PERIOD)
        if now < self._due or not self._has_space():
            return
        self._due = None
        try:
            self.arm(is_next=True)
        except LavaError as error:
            self.recorder.error = str(error)

    def _has_space(self) -> bool:
        path = self.recorder.directory
        while not os.path.isdir(path) and os.path.dirname(path) != path:
            path = os.path.dirname(path)
        try:
            return shutil.disk_usage(path or '.').free >= MIN_FREE
        except OSError:
            return False

    def finish_checkpoint(self, stamp_ns: int, *, period: float | None = None) -> str:
        """Write a checkpoint now; parameters and result as in ``CheckpointRecording.finish``."""
        wanted = self.settings().checkpoint_period if period is None else period
        return self.checkpoints.finish(wanted, stamp_ns, timeout=CHECKPOINT_TIMEOUT)

    def close(self, stamp_ns: int) -> str:
        """Finish the bag with a checkpoint; return the reason if there is none."""
        reason = self.finish_checkpoint(stamp_ns)
        self.recorder.stop()
        return reason

    def end_run(self) -> None:
        """Remove the progress of the run, so that no later process continues it."""
        if self.restart_file is not None:
            self.restart_file.remove()

    def note(self, **progress: Any) -> None:
        """Write the progress of the run if it can be resumed, even when nothing is recorded.

        ``progress`` contains the attributes of ``Progress`` that this object does not know.
        """
        saved = self.checkpoints.saved
        if self.restart_file is not None and saved is not None:
            self.restart_file.write(replace(saved, is_recording=self.is_wanted, **progress))
