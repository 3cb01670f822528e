# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Writes what the node sends into a bag: the bytes on the wire are the bytes in the bag."""

from collections.abc import Mapping
from dataclasses import dataclass
import os
from pathlib import Path

from lava_ros.bag import BagWriter, QosProfile
from lava_ros.errors import LavaError


@dataclass(frozen=True)
class RecorderStatus:
    """How the recorder is doing.

    Attributes:
        state: ``off``, ``armed`` (waiting for a terrain) or ``recording``.
        directory: The bag, empty before the first.
        files: Files it has so far.
        messages: Messages written to it.
        error: What stopped the last recording, empty when nothing did.
    """

    state: str
    directory: str
    files: int
    messages: int
    error: str


class Recorder:
    """Records one bag after the other.

    ``arm`` chooses the bag; ``begin`` opens it once there is a scene to describe. A bag that
    cannot be written is closed and reported in ``status``; the node goes on without it.
    """

    def __init__(self) -> None:
        """Start without a bag."""
        self._directory: Path | None = None
        self._is_armed = False
        self._writer: BagWriter | None = None
        self._files = self._messages = 0
        self._max_size, self._max_duration = 0, 0.0
        self._error = ''

    @property
    def status(self) -> RecorderStatus:
        """How the recorder is doing."""
        state = 'armed' if self._is_armed else 'off'
        if self._writer is not None:
            state = 'recording'
        return RecorderStatus(
            state, str(self._directory or ''), self._files, self._messages, self._error
        )

    @property
    def size(self) -> int:
        """Bytes in the bag that is open, 0 without one."""
        return self._writer.size if self._writer is not None else 0

    @property
    def is_armed(self) -> bool:
        """Whether a bag is chosen and not yet open."""
        return self._is_armed

    @property
    def is_recording(self) -> bool:
        """Whether a bag is open."""
        return self._writer is not None

    def arm(self, directory: Path, *, max_size: int = 0, max_duration: float = 0.0) -> None:
        """Choose the bag to record to.

        Args:
            directory: The bag.
            max_size: Size from which on a file of it is not continued [bytes]; 0: no limit.
            max_duration: Time after which a file of it is not continued [s]; 0: no limit.

        Raises:
            LavaError: A recording is under way, or the folder exists.
        """
        if self._is_armed or self.is_recording:
            raise LavaError('record', str(self._directory), 'one recording at a time')
        _check_new(directory)
        self._directory, self._is_armed = directory, True
        self._max_size, self._max_duration = max_size, max_duration
        self._files, self._messages, self._error = 0, 0, ''

    def begin(self, custom_data: Mapping[str, str]) -> None:
        """Open the bag that was chosen.

        Args:
            custom_data: What describes the recording.
        """
        assert self._directory is not None
        self._is_armed = False
        try:
            self._writer = BagWriter(
                self._directory,
                custom_data=custom_data,
                max_size=self._max_size,
                max_duration=self._max_duration,
            )
            self._files = 1
        except (OSError, LavaError) as error:
            self._error = f'cannot record to {self._directory}: {error}'

    def describe(self, custom_data: Mapping[str, str]) -> None:
        """Replace what describes the recording, when a bag is open."""
        if self._writer is not None:
            self._writer.set_custom_data(custom_data)

    def write(
        self, topic: str, message_type: str, data: bytes, stamp_ns: int, *, qos: QosProfile
    ) -> None:
        """Write a message, when a bag is open."""
        if self._writer is None:
            return
        try:
            self._writer.write(topic, message_type, data, stamp_ns, qos=qos)
            self._files, self._messages = self._writer.file_count, self._writer.message_count
        except (OSError, LavaError) as error:
            self._give_up(error)

    def attach(self, name: str, media_type: str, data: bytes, stamp_ns: int) -> None:
        """Put data beside the messages, when a bag is open, and make it survive."""
        if self._writer is None:
            return
        try:
            self._writer.attach(name, media_type, data, stamp_ns)
            self._writer.flush()
        except (OSError, LavaError) as error:
            self._give_up(error)

    def flush(self) -> None:
        """Make what was written survive the end of the process."""
        if self._writer is None:
            return
        try:
            self._writer.flush()
        except OSError as error:
            self._give_up(error)

    def stop(self) -> None:
        """Finish the bag; does nothing without one."""
        self._is_armed = False
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.close()
        except OSError as error:
            self._error = f'cannot finish {self._directory}: {error}'

    def _give_up(self, error: Exception) -> None:
        reason = f'recording to {self._directory} stopped: {error}'
        self.stop()
        self._error = reason


def _check_new(directory: Path) -> None:
    """Refuse a bag that cannot be made, as far as that is known before it is opened."""
    name = str(directory)
    try:
        if directory.exists():
            raise LavaError('bag_directory', name, 'a folder that does not exist yet')
        parent = next(path for path in directory.absolute().parents if path.exists())
        is_usable = parent.is_dir() and os.access(parent, os.W_OK | os.X_OK)
    except OSError as error:
        raise LavaError('bag_directory', name, f'a path ({error})') from error
    if not is_usable:
        raise LavaError('bag_directory', name, f'a new folder: {parent} cannot be written to')
