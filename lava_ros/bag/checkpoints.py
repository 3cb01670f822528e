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

"""Attachments of MCAP files, finished or not, and the checkpoints among them.

A finished file has an index of its attachments. In a file whose writer was killed they are found
by going from record to record, which reads a few bytes of each. Damaged ones are found, too, and
refuse to be read.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import mmap
from pathlib import Path
import struct
from typing import NamedTuple

from mcap.opcode import Opcode

from lava_ros.bag.mcap_file import has_begun, mapped, read_summary
from lava_ros.bag.reader import mcap_names
from lava_ros.bag.records import BROKEN, CUT, FRAME, is_whole, MAX_RECORD_SIZE, walk
from lava_ros.errors import LavaError
from lava_ros.files import open_input
from lava_ros.simulation.checkpoint import Checkpoint, from_bytes, MEDIA_TYPE, summary_of

#: Name of the attachments.
NAME = 'lava checkpoint'

#: Name of what is too damaged to tell its own.
UNREADABLE = 'without a readable name'


@dataclass(frozen=True)
class Attachment:
    """An attachment in a file.

    Attributes:
        name: Its name.
        media_type: What kind of data it is.
        log_time_ns: When it was recorded [ns].
        size: Size of its data [bytes].
        path: The file.
        offset: Where its record's content starts in the file [bytes].
        length: Size of that content [bytes].
    """

    name: str
    media_type: str
    log_time_ns: int
    size: int
    path: Path
    offset: int
    length: int

    def read(self) -> bytes:
        """Read its data.

        Raises:
            LavaError: It is damaged, too large or cannot be read.
        """
        if self.length > MAX_RECORD_SIZE:
            raise LavaError(self._label, f'{self.length} bytes', f'at most {MAX_RECORD_SIZE}')
        content = self._content(self.length)
        if self.name == UNREADABLE or not is_whole(content):
            raise LavaError(self._label, f'{self.length} bytes', 'undamaged data')
        return content[-4 - self.size : -4]

    @property
    def _label(self) -> str:
        return f'attachment {self.name} at byte {self.offset} of {self.path}'

    def _content(self, size: int) -> bytes:
        try:
            with open_input(self.path) as stream:
                stream.seek(self.offset)
                content = stream.read(size)
        except OSError as error:
            raise LavaError(self._label, str(error), 'a readable file') from error
        if len(content) < size:
            raise LavaError(self._label, f'{len(content)} bytes', f'{size} bytes')
        return content


def attachments_of(bag: str | Path) -> list[Attachment]:
    """Return all attachments of a bag or an .mcap file in order, damaged ones included.

    Raises:
        LavaError: The bag does not exist, or one of its files cannot be read.
    """
    path = Path(bag)
    files = [path / name for name in mcap_names(path)] if path.is_dir() else [path]
    if not files:
        raise LavaError('bag', str(bag), 'a directory with .mcap files; this one has none')
    return [item for file in files for item in attachments_in(file)]


def attachments_in(path: Path) -> list[Attachment]:
    """The attachments of a file, damaged ones included, in the order of the file.

    Raises:
        LavaError: The file cannot be read, or is no MCAP file.
    """
    if path.is_file() and not has_begun(path):
        # cut off before it began
        return []
    with mapped(path) as data:
        return [_attachment(path, data, *place) for place in _places(data)]


def _places(data: mmap.mmap) -> Iterator[tuple[int, int]]:
    """Where their contents start and end."""
    summary = read_summary(data)
    if summary is not None:
        for index in sorted(summary.attachment_indexes, key=lambda item: item.offset):
            yield index.offset + FRAME.size, index.offset + index.length
        return
    for opcode, start, end in walk(data):
        # what was cut off while it was written is no attachment yet
        is_cut = opcode == CUT and data[start] == Opcode.ATTACHMENT
        if opcode in (Opcode.ATTACHMENT, BROKEN) or is_cut:
            yield start, end


def _attachment(path: Path, data: mmap.mmap, offset: int, end: int) -> Attachment:
    # log and create time, two texts with their lengths, the data's length
    try:
        log_time, _, name_length = struct.unpack_from('<QQI', data, offset)
        place = offset + 20
        name = data[place : min(place + name_length, end)].decode()
        place += name_length
        (type_length,) = struct.unpack_from('<I', data, place)
        place += 4
        media_type = data[place : min(place + type_length, end)].decode()
        place += type_length
        (size,) = struct.unpack_from('<Q', data, place)
    except (struct.error, UnicodeDecodeError):
        size = place = -1
    if place + 8 + size + 4 != end:
        return Attachment(UNREADABLE, '', 0, 0, path, offset, end - offset)
    return Attachment(name, media_type, log_time, size, path, offset, end - offset)


class StoredCheckpoint(NamedTuple):
    """What a list of checkpoints says of one.

    Attributes:
        time: Simulated time [s].
        log_time_ns: ROS time at which it was taken [ns].
        particle_count: Particles there are.
        size: Size in the bag [bytes].
    """

    time: float
    log_time_ns: int
    particle_count: int
    size: int


class FoundCheckpoint(NamedTuple):
    """The newest checkpoint that can be read.

    Attributes:
        checkpoint: The checkpoint.
        log_time_ns: ROS time at which it was taken [ns].
        refused: Newer attachments that cannot be read, and why.
    """

    checkpoint: Checkpoint
    log_time_ns: int
    refused: tuple[LavaError, ...]


def checkpoints_of(
    bag: str | Path, on_refused: Callable[[LavaError], None] | None = None
) -> list[StoredCheckpoint]:
    """List the checkpoints of a bag, finished or not, oldest first, without unpacking their state.

    ``on_refused`` is called with the error of each attachment that is damaged or has a later
    format version.

    Raises:
        LavaError: The bag does not exist, or cannot be read.
    """
    result = []
    for item in attachments_of(bag):
        try:
            data = item.read()
            # a damaged one may no longer say that it is a checkpoint
            if item.media_type != MEDIA_TYPE:
                continue
            summary = summary_of(data)
        except LavaError as error:
            if on_refused is not None:
                on_refused(error)
        else:
            result.append(
                StoredCheckpoint(
                    summary.time, item.log_time_ns, summary.particle_count, item.size
                )
            )
    return result


def newest_checkpoint(bag: str | Path) -> FoundCheckpoint:
    """Read the newest undamaged checkpoint of a bag, finished or not.

    Raises:
        LavaError: The bag does not exist, or has no checkpoint that can be read.
    """
    refused: list[LavaError] = []
    for item in reversed(attachments_of(bag)):
        try:
            data = item.read()
            if item.media_type == MEDIA_TYPE:
                return FoundCheckpoint(from_bytes(data), item.log_time_ns, tuple(refused))
        except LavaError as error:
            refused.append(error)
    if refused:
        raise refused[0]
    raise LavaError('bag', str(bag), 'a bag with a checkpoint in it; this one has none')
