# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Recording of the node's messages in a bag, byte by byte as they were published."""

from collections.abc import Callable, Mapping
from itertools import chain, count
import os
from pathlib import Path
import time
from typing import Any

from lava_ros.bag import BagWriter, QosProfile
from lava_ros.bag.recorded_node import DEFAULT_NODE
from lava_ros.errors import LavaError, RefusalError, refusing
from lava_ros.live.clock import JITTER

#: Maximum time of the clock between two messages of a bag [s].
MAX_GAP = 86_400.0


class Recorder:
    """Records bags, one at a time.

    ``arm`` chooses the bag; ``describe`` opens it once there is a scene. A bag that
    cannot be written is closed and reported in ``error``; the node continues without it.

    Publish times are those of the ROS clock. Log times, by which players and readers order the
    messages, equal them until the clock jumps. When it goes back by ``JITTER`` or more, or ahead
    by more than ``MAX_GAP``, log times continue with a constant difference from the clock until
    the next jump.

    Attributes:
        state: ``off``, ``armed`` (a bag is chosen and not yet open) or ``recording``.
        directory: The bag, empty before the first.
        files, messages: Its numbers of files and messages.
        log_time_ns: Log time of its newest message [ns], 0 before the first.
        error: Error that stopped the last recording, empty without one.
    """

    def __init__(self) -> None:
        """Initialize without a bag."""
        self._place = Path()
        self._limits: dict[str, Any] = {}
        self._writer: BagWriter | None = None
        self.state, self.directory, self.error = 'off', '', ''
        self._begin()

    def _begin(self) -> None:
        self.files = self.messages = self.log_time_ns = 0
        # difference between log times and the clock [ns]
        self._shift_ns = 0

    @property
    def size(self) -> int:
        """Size of the open bag [bytes], 0 without one."""
        return self._writer.size if self._writer is not None else 0

    @property
    def is_armed(self) -> bool:
        """True if a bag is chosen and not yet open."""
        return self.state == 'armed'

    @property
    def is_recording(self) -> bool:
        """True if a bag is open."""
        return self._writer is not None

    def arm(self, directory: Path, *, max_size: int = 0, max_duration: float = 0.0) -> None:
        """Choose the bag to record to.

        A new file starts at ``max_size`` [bytes] and ``max_duration`` [s]; 0: no limit.

        Raises:
            LavaError: If a bag is being recorded, or ``directory`` exists or is not writable.
        """
        if self.is_armed or self.is_recording:
            problem = f'{self.directory} is being recorded'
            raise RefusalError('record', problem, 'Stop this recording first')
        self._place = _new_place(directory)
        self._limits = {'max_size': max_size, 'max_duration': max_duration}
        self.state, self.directory, self.error = 'armed', str(directory), ''
        self._begin()

    def describe(self, custom_data: Mapping[str, str]) -> None:
        """Open the chosen bag with a description, or replace the description of the open bag."""
        if self._writer is not None:
            self._writer.set_custom_data(custom_data)
        if not self.is_armed:
            return
        self.state = 'off'
        try:
            if Path(self.directory).resolve() != self._place:
                raise OSError('its path now contains a symbolic link')
            self._writer = BagWriter(self._place, custom_data=custom_data, **self._limits)
            self.state, self.files = 'recording', 1
        except (OSError, LavaError) as error:
            self.error = f'cannot record to {self.directory}: {error}'

    def write(
        self, topic: str, message_type: str, data: bytes, stamp_ns: int, *, qos: QosProfile
    ) -> None:
        """Write a message if a bag is open; ``stamp_ns`` is the ROS time [ns]."""
        log_time_ns = self._log_time(stamp_ns)
        self._attempt(
            lambda bag: bag.write(
                topic, message_type, data, stamp_ns, qos=qos, log_time_ns=log_time_ns
            )
        )

    def attach(self, name: str, media_type: str, data: bytes, stamp_ns: int) -> None:
        """Write an attachment if a bag is open, and flush the bag."""
        log_time_ns = self._log_time(stamp_ns)
        self._attempt(lambda bag: bag.attach(name, media_type, data, log_time_ns))
        self.flush()

    def _log_time(self, stamp_ns: int) -> int:
        """Return the log time [ns] of a ROS time [ns], which is the newest one."""
        newest = self.log_time_ns
        ahead = 1e-9 * (stamp_ns + self._shift_ns - newest)
        if newest and not -JITTER < ahead <= MAX_GAP:
            self._shift_ns = newest + 1 - stamp_ns
        self.log_time_ns = max(newest, stamp_ns + self._shift_ns)
        return self.log_time_ns

    def flush(self) -> None:
        """Flush the bag, so that its data survives the end of the process."""
        self._attempt(lambda bag: bag.flush())

    def _attempt(self, action: Callable[[BagWriter], None]) -> None:
        """Run ``action`` on the bag if one is open; an error ends the recording."""
        writer = self._writer
        if writer is None:
            return
        try:
            action(writer)
            self.files, self.messages = writer.file_count, writer.message_count
        except (OSError, LavaError) as error:
            self.stop()
            self.error = f'recording to {self.directory} stopped: {error}'

    def stop(self) -> None:
        """Finish the bag if one is open."""
        writer, self._writer = self._writer, None
        if self.is_armed:
            # there is no such bag
            self.directory = ''
        self.state = 'off'
        try:
            if writer is not None:
                writer.close()
        except OSError as error:
            self.error = f'cannot finish {self.directory}: {error}'


def _new_place(directory: Path) -> Path:
    """Return the resolved path of a new bag; raise LavaError if it cannot be created."""
    name = str(directory)
    with refusing('bag_directory', name, 'a path', OSError, RuntimeError):
        place = directory.resolve()
        if directory.exists() or directory.is_symlink():
            raise LavaError('bag_directory', name, 'a folder that does not exist yet')
        parent = next(path for path in directory.absolute().parents if path.exists())
        is_usable = parent.is_dir() and os.access(parent, os.W_OK | os.X_OK)
    if not is_usable:
        expected = f'a new folder in a writable one; {parent} is not writable'
        raise LavaError('bag_directory', name, expected)
    return place


def _unused(path: Path) -> Path:
    """Return the path, or add the first number, starting at 2, with which it does not exist."""
    names = chain([path.name], (f'{path.name}_{number}' for number in count(2)))
    # An unreadable folder seems empty: opening the bag then raises an error with the reason.
    return next(new for new in map(path.with_name, names) if not os.path.exists(new))


class BagFolder:
    """Converts names of bags to paths.

    The bag that the user names at the start may be anywhere. A name that is set while the node
    runs may come from any node in the graph: that bag must be inside the root after resolving
    symbolic links and ``..``.
    """

    def __init__(self, root: str, given: str, *, node: str = DEFAULT_NODE) -> None:
        """Initialize from the parameters at the start.

        Args:
            root: Folder of the bags; empty: the folder of ``given``, otherwise ``bags``.
            given: Bag that the user has named, otherwise empty.
            node: Full name of the node. Unless it is the default, it is part of the names of its
                bags, because nodes may share a folder.
        """
        self._given = given
        self._suffix = '' if node == DEFAULT_NODE else node.replace('/', '_')
        self._root = Path(root) if root else Path(given).parent if given else Path('bags')

    def restart_path(self, token: str) -> Path:
        """Return the path of the file with the progress of the run that has a token."""
        return self._root / f'restart{self._suffix}_{token}.json'

    def path(self, name: str, *, is_next: bool = False) -> Path:
        """Return the path of a bag; an empty name becomes the current time.

        With ``is_next`` a number is added to the name of a bag that exists.

        Raises:
            LavaError: If the path is outside the root.
        """
        if not name:
            return _unused(self._root / (time.strftime('%Y-%m-%dT%H-%M-%S') + self._suffix))
        if name == self._given:
            return _unused(Path(name)) if is_next else Path(name)
        with refusing('bag_directory', name, 'a path', OSError, RuntimeError, ValueError):
            root, path = self._root.resolve(), Path(name).resolve()
        if root not in path.parents:
            raise LavaError('bag_directory', name, f'a new folder inside {root} (bag_root)')
        return _unused(Path(name)) if is_next else Path(name)
