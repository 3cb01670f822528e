# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checkpoints and other attachments of MCAP files, finished or not.

A finished file has an index of its attachments. In a file whose writer was killed, they are found
by stepping through the records, which reads a few bytes of each. Damaged attachments are listed
too, but reading one raises an error.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
import mmap
from pathlib import Path
import struct
from typing import NamedTuple, TypeVar

from mcap.opcode import Opcode

from lava_ros.bag.mcap_file import has_begun, mapped, read_summary
from lava_ros.bag.reader import mcap_files
from lava_ros.bag.records import BROKEN, FRAME, is_whole, iter_records, MAX_RECORD_SIZE, TRUNCATED
from lava_ros.errors import LavaError, RefusalError, refusing
from lava_ros.files import open_input
from lava_ros.simulation.output.checkpoint import (
    Checkpoint,
    from_bytes,
    MEDIA_TYPE,
    method_of,
    summary_of,
)

Parsed = TypeVar('Parsed')

#: Name of the attachments that are checkpoints.
NAME = 'lava checkpoint'

#: Name given to an attachment whose own name is damaged.
UNREADABLE = 'without a readable name'


@dataclass(frozen=True)
class Attachment:
    """An attachment: log time [ns], size of its data [bytes], and position in the file.

    ``offset`` and ``length`` [bytes] refer to the content of its record.
    """

    name: str
    media_type: str
    log_time_ns: int
    size: int
    path: Path
    offset: int
    length: int

    def read(self) -> bytes:
        """Read the data.

        Raises:
            LavaError: If the data are damaged, too large or unreadable.
        """
        label = f'attachment {self.name} at byte {self.offset} of {self.path}'
        if self.length > MAX_RECORD_SIZE:
            raise LavaError(label, f'{self.length} bytes', f'at most {MAX_RECORD_SIZE}')
        with refusing(label, str(self.path), 'a readable file'), open_input(self.path) as stream:
            stream.seek(self.offset)
            content = stream.read(self.length)
        if len(content) < self.length:
            raise LavaError(label, f'{len(content)} bytes', f'{self.length} bytes')
        if self.name == UNREADABLE or not is_whole(content):
            raise RefusalError(label, f'The {label} is damaged', 'Use an older checkpoint')
        return content[-4 - self.size : -4]


def attachments_of(bag: str | Path) -> list[Attachment]:
    """Return the attachments of a bag or an .mcap file in file order.

    Raises:
        LavaError: If a file is unreadable.
    """
    return [item for file in mcap_files(Path(bag)) for item in attachments_in(file)]


def attachments_in(path: Path) -> list[Attachment]:
    """Return the attachments of one file in file order, including damaged ones.

    Raises:
        LavaError: If the file is unreadable.
    """
    if path.is_file() and not has_begun(path):
        # truncated before its first record
        return []
    with mapped(path) as data:
        return [_attachment(path, data, *place) for place in _places(data)]


def _places(data: mmap.mmap) -> Iterator[tuple[int, int]]:
    """Yield the start and the end of the content of each attachment [bytes]."""
    summary = read_summary(data)
    if summary is not None:
        for index in sorted(summary.attachment_indexes, key=lambda item: item.offset):
            yield index.offset + FRAME.size, index.offset + index.length
        return
    for opcode, start, end in iter_records(data):
        # an attachment that was truncated while it was written does not count
        is_cut = opcode == TRUNCATED and data[start] == Opcode.ATTACHMENT
        if opcode in (Opcode.ATTACHMENT, BROKEN) or is_cut:
            yield start, end


def _attachment(path: Path, data: mmap.mmap, offset: int, end: int) -> Attachment:
    # log time, create time, two strings with their lengths, length of the data
    try:
        (log_time,) = struct.unpack_from('<Q', data, offset)
        texts, place = [], offset + 16
        for _ in range(2):
            (length,) = struct.unpack_from('<I', data, place)
            texts.append(data[place + 4 : min(place + 4 + length, end)].decode())
            place += 4 + length
        (size,) = struct.unpack_from('<Q', data, place)
    except (struct.error, UnicodeDecodeError):
        size = place = -1
    if place + 8 + size + 4 != end:
        texts, log_time, size = [UNREADABLE, ''], 0, 0
    return Attachment(texts[0], texts[1], log_time, size, path, offset, end - offset)


class StoredCheckpoint(NamedTuple):
    """A checkpoint: simulated time [s], ROS time [ns], number of carriers, size [bytes].

    ``method`` tells whether particles or cells with lava are counted (``Accuracy.method``).
    """

    time: float
    log_time_ns: int
    particle_count: int
    size: int
    method: str


class FoundCheckpoint(NamedTuple):
    """The newest readable checkpoint, its ROS time [ns], and the errors of newer ones."""

    checkpoint: Checkpoint
    log_time_ns: int
    refused: tuple[LavaError, ...]


def checkpoints_of(
    bag: str | Path, on_refused: Callable[[LavaError], object] = lambda _: None
) -> list[StoredCheckpoint]:
    """List the checkpoints of a bag, finished or not, oldest first, without unpacking their state.

    ``on_refused`` is called with the error of each attachment that is damaged or has a newer
    format version.

    Raises:
        LavaError: If the bag does not exist or cannot be read.
    """
    return [
        StoredCheckpoint(
            summary.time, item.log_time_ns, summary.particle_count, item.size, method
        )
        for item, (summary, method) in _parsed(
            attachments_of(bag), lambda data: (summary_of(data), method_of(data)), on_refused
        )
    ]


def newest_checkpoint(bag: str | Path) -> FoundCheckpoint:
    """Read the newest undamaged checkpoint of a bag, finished or not.

    Raises:
        LavaError: If there is none.
    """
    refused: list[LavaError] = []
    newest_first = reversed(attachments_of(bag))
    for item, checkpoint in _parsed(newest_first, from_bytes, refused.append):
        return FoundCheckpoint(checkpoint, item.log_time_ns, tuple(refused))
    if refused:
        raise refused[0]
    raise LavaError('bag', str(bag), 'a bag with a checkpoint in it; this one has none')


def checkpoint_at(bag: str | Path, time: float) -> Checkpoint | None:
    """Read the newest undamaged checkpoint at or before a simulated time [s], None without one.

    Raises:
        LavaError: If the bag does not exist or cannot be read.
    """
    newest_first = reversed(attachments_of(bag))
    for item, summary in _parsed(newest_first, summary_of, lambda _: None):
        if summary.time <= time:
            with suppress(LavaError):
                return from_bytes(item.read())
    return None


def _parsed(
    items: Iterable[Attachment],
    parse: Callable[[bytes], Parsed],
    on_refused: Callable[[LavaError], object],
) -> Iterator[tuple[Attachment, Parsed]]:
    """Yield the checkpoints among attachments."""
    for item in items:
        try:
            data = item.read()
            # the name of a damaged checkpoint may be unreadable
            if item.media_type == MEDIA_TYPE:
                yield item, parse(data)
        except LavaError as error:
            on_refused(error)
