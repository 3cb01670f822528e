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

"""Attachments of MCAP files, finished or not: found without reading the messages.

A finished file has an index of them. In a file whose writer was killed they are found by going
from record to record, which reads a few bytes of each.
"""

from dataclasses import dataclass
import mmap
from pathlib import Path
import struct
import zlib

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader

from lava_ros.bag.mcap_file import MAGIC, MAX_BLOCK_SIZE
from lava_ros.errors import LavaError

_FRAME = struct.Struct('<BQ')

#: Size of a finished file without anything in it: magic, footer, magic [bytes].
_LEAST_FINISHED = 2 * len(MAGIC) + _FRAME.size + 20

_DAMAGE = (McapError, OverflowError, RuntimeError, ValueError, struct.error)


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
        if self.length > MAX_BLOCK_SIZE:
            raise LavaError(self._label, f'{self.length} bytes', f'at most {MAX_BLOCK_SIZE}')
        content = self._content(self.length)
        (stored,) = struct.unpack('<I', content[-4:])
        if stored not in (0, zlib.crc32(content[:-4])):
            raise LavaError(self._label, f'checksum {stored}', 'undamaged data')
        return content[-4 - self.size : -4]

    def start(self, size: int) -> bytes:
        """Read the first bytes of its data; what they are is not checked.

        Raises:
            LavaError: They cannot be read.
        """
        before = self.length - 4 - self.size
        return self._content(before + min(size, self.size))[before:]

    @property
    def _label(self) -> str:
        return f'attachment {self.name} of {self.path}'

    def _content(self, size: int) -> bytes:
        try:
            with self.path.open('rb') as stream:
                stream.seek(self.offset)
                content = stream.read(size)
        except OSError as error:
            raise LavaError(self._label, str(error), 'a readable file') from error
        if len(content) < size:
            raise LavaError(self._label, f'{len(content)} bytes', f'{size} bytes')
        return content


def attachments_of(bag: str | Path) -> list[Attachment]:
    """The whole attachments of a bag, in the order of their log time.

    Args:
        bag: The bag's directory, or an .mcap file.

    Raises:
        LavaError: There is no such bag, or a file of it cannot be read.
    """
    path = Path(bag)
    files = sorted(path.glob('*.mcap')) if path.is_dir() else [path]
    if not files:
        raise LavaError('bag', str(bag), 'a directory with .mcap files; this one has none')
    found = [item for file in files for item in attachments_in(file)]
    return sorted(found, key=lambda item: item.log_time_ns)


def attachments_in(path: Path) -> list[Attachment]:
    """The whole attachments of a file, in the order of the file.

    Raises:
        LavaError: The file cannot be read, or is no MCAP file.
    """
    try:
        with path.open('rb') as stream:
            start = stream.read(len(MAGIC))
            if not MAGIC.startswith(start):
                raise LavaError('bag', str(path), 'an MCAP file; it does not start like one')
            if len(start) < len(MAGIC):
                # cut off before it began
                return []
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                stream.seek(0)
                places = _indexed(SeekingReader(stream), data)
                if places is None:
                    places = _walked(data)
                return [_attachment(path, data, *place) for place in places]
    except FileNotFoundError:
        raise LavaError('bag', str(path), 'a bag directory or an .mcap file that exists') from None
    except OSError as error:
        raise LavaError('bag', str(path), f'a readable MCAP file ({error})') from error


def _indexed(reader: SeekingReader, data: mmap.mmap) -> list[tuple[int, int]] | None:
    """Offset and length of the contents by the file's index; None without a complete one."""
    if len(data) < _LEAST_FINISHED or data[-len(MAGIC) :] != MAGIC:
        return None
    try:
        summary = reader.get_summary()
    except _DAMAGE:
        return None
    if summary is None or summary.statistics is None:
        return None
    places = []
    for index in sorted(summary.attachment_indexes, key=lambda item: item.offset):
        place = _record_at(data, index.offset)
        if place is None or data[index.offset] != Opcode.ATTACHMENT:
            return None
        places.append(place)
    return places if len(places) == summary.statistics.attachment_count else None


def _walked(data: mmap.mmap) -> list[tuple[int, int]]:
    """Offset and length of the contents, up to the end of the data or the first broken record."""
    places = []
    position = len(MAGIC)
    while (place := _record_at(data, position)) is not None:
        opcode = data[position]
        if opcode in (0, Opcode.DATA_END):
            break
        if opcode == Opcode.ATTACHMENT:
            places.append(place)
        position = sum(place)
    return places


def _record_at(data: mmap.mmap, position: int) -> tuple[int, int] | None:
    """Offset and length of a record's content, None where there is no whole record."""
    start = position + _FRAME.size
    if start > len(data):
        return None
    length = _FRAME.unpack_from(data, position)[1]
    return (start, length) if start + length <= len(data) else None


def _attachment(path: Path, data: mmap.mmap, offset: int, length: int) -> Attachment:
    end = offset + length
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
    except (struct.error, UnicodeDecodeError) as error:
        raise LavaError('bag', str(path), f'an undamaged attachment ({error})') from error
    if place + 8 + size + 4 != end:
        raise LavaError('bag', str(path), f'an undamaged attachment at byte {offset}')
    return Attachment(name, media_type, log_time, size, path, offset, length)
