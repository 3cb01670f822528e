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

"""One MCAP file, finished or not: what is in it and where.

A finished file has a summary that says so, and checksums over everything, which are checked when
the file is opened. A file whose writer was killed has no summary: one pass over it finds every
whole record before the place where it breaks off. Such a pass also finds what is damaged, and what
comes after that. Either way the messages are then read block by block (a chunk, or a run of
messages outside of chunks), so that memory is bounded by the blocks that overlap in time.
"""

from collections import deque
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
import heapq
from io import BytesIO
import mmap
from pathlib import Path
import re
import struct
from typing import BinaryIO, NamedTuple
import zlib

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk
from mcap.summary import Summary
import zstandard

from lava_ros.bag import metadata as bag_metadata
from lava_ros.errors import LavaError

MAGIC = b'\x89MCAP0\r\n'

#: Largest block that is read into memory [bytes]; a message of 1 GiB is an error, not a map.
MAX_BLOCK_SIZE = 1 << 30

# Length at which a run of messages outside of chunks ends its block [bytes].
_RUN_SIZE = 4 * 1024 * 1024

#: Opcode and length of a record.
FRAME = struct.Struct('<BQ')

# Contents of the records that end the data and the file, each with a checksum at its end.
_DATA_END = struct.Struct('<I')
_FOOTER = struct.Struct('<QQI')

#: In place of an opcode: bytes that are no record.
BROKEN = -1

#: In place of an opcode: the start of a record at the end of a file that was cut off.
CUT = -2

# Records of the data section: bytes before the lengths, the lengths of what is in it one after the
# other, bytes after.
_LAYOUTS = {
    Opcode.HEADER: (0, 'II', 0),
    Opcode.SCHEMA: (2, 'III', 0),
    Opcode.CHANNEL: (4, 'III', 0),
    Opcode.CHUNK: (28, 'IQ', 0),
    Opcode.MESSAGE_INDEX: (2, 'I', 0),
    Opcode.ATTACHMENT: (16, 'IIQ', 4),
    Opcode.METADATA: (0, 'II', 0),
    Opcode.DATA_END: (_DATA_END.size, '', 0),
}

# Least size of a message outside of chunks [bytes].
_LEAST_MESSAGE = 22

# Where a record may begin that is shorter than 4 GiB.
_BEGINNING = re.compile(rb'[\x03\x04\x06\x07\x09\x0c\x0f].{4}\0{4}', re.DOTALL)

# What parsing of damaged bytes raises.
_DAMAGE = (
    McapError,
    OverflowError,
    RuntimeError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
)


class Block(NamedTuple):
    """A part of the file that holds messages and is read at once.

    Attributes:
        start_ns: Earliest log time in it [ns].
        end_ns: Latest log time in it [ns].
        offset: Place in the file [bytes].
        length: Size in the file [bytes].
        channels: Ids of the channels with messages in it, None when unknown.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    channels: frozenset[int] | None


@dataclass
class McapFile:
    """The contents of an MCAP file.

    Attributes:
        path: The file.
        finished: Whether its writer closed it and the summary is usable.
        channels: Channels by id.
        schemas: Schemas by id.
        counts: Messages by channel id, None when the file does not say.
        blocks: Where the messages are, in file order.
        metadata: MCAP metadata records by name, the latest whole one of each name.
        damage: What is damaged, and what is left out for it, each a sentence.
        rest: Bytes at the end of a file that was cut off which are no whole record.
    """

    path: Path
    finished: bool
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    counts: dict[int, int] | None = None
    blocks: list[Block] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)
    rest: int = 0

    def messages(
        self,
        channel_ids: Collection[int],
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Message]:
        """Yield messages in the order of log time, then of the file.

        Args:
            channel_ids: Channels to read.
            start_ns: Earliest log time [ns].
            end_ns: Log time to stop before [ns].

        Raises:
            LavaError: The file is damaged or cannot be read.
        """
        wanted = frozenset(channel_ids)
        waiting = deque(
            block for block in sorted(self.blocks) if _overlaps(block, wanted, start_ns, end_ns)
        )
        loaded: list[tuple[int, int, int, Message]] = []
        try:
            stream = self.path.open('rb')
        except OSError as error:
            raise LavaError('bag', str(self.path), f'a readable file ({error})') from error
        with stream:
            while waiting or loaded:
                while waiting and (not loaded or waiting[0].start_ns <= loaded[0][0]):
                    block = waiting.popleft()
                    for index, message in enumerate(self._read(stream, block)):
                        if message.channel_id in wanted and _within(
                            message.log_time, start_ns, end_ns
                        ):
                            item = (message.log_time, block.offset, index, message)
                            heapq.heappush(loaded, item)
                if loaded:
                    yield heapq.heappop(loaded)[3]

    def newest(self, channel_ids: Collection[int], before_ns: int) -> dict[int, Message]:
        """The newest message of each channel that is logged before a time.

        Reads backwards and stops as soon as no earlier block can hold a newer one.

        Args:
            channel_ids: Channels to look at.
            before_ns: Log time [ns] the messages are older than.

        Raises:
            LavaError: The file is damaged or cannot be read.
        """
        found: dict[int, Message] = {}
        with self.path.open('rb') as stream:
            for block in sorted(self.blocks, key=lambda item: item.end_ns, reverse=True):
                open_ids = frozenset(
                    item
                    for item in channel_ids
                    if item not in found or found[item].log_time <= block.end_ns
                )
                if not open_ids:
                    break
                if not _overlaps(block, open_ids, None, before_ns):
                    continue
                for message in self._read(stream, block):
                    if message.channel_id not in open_ids or message.log_time >= before_ns:
                        continue
                    best = found.get(message.channel_id)
                    if best is None or message.log_time >= best.log_time:
                        found[message.channel_id] = message
        return found

    def _read(self, stream: BinaryIO, block: Block) -> Iterator[Message]:
        try:
            _check_size(block.length)
            stream.seek(block.offset)
            data = stream.read(block.length)
            records = [record for frame in _frames(data) for record in _parse(*frame)]
        except UnsupportedCompressionError as error:
            raise LavaError(
                'bag', str(self.path), f'a compression that can be read here ({error})'
            ) from error
        except (OSError, *_DAMAGE) as error:
            raise LavaError(
                'bag',
                str(self.path),
                f'an undamaged file; {block.length} bytes from byte {block.offset} on cannot be '
                f'read ({type(error).__name__}: {error})',
            ) from error
        return (record for record in records if isinstance(record, Message))


def has_begun(path: Path) -> bool:
    """Whether a file holds as much as the magic bytes at its start.

    Raises:
        LavaError: The file cannot be read.
    """
    try:
        return path.stat().st_size >= len(MAGIC)
    except OSError as error:
        raise LavaError('bag', str(path), f'a readable MCAP file ({error})') from error


@contextmanager
def mapped(path: Path) -> Iterator[mmap.mmap]:
    """The bytes of an MCAP file, finished or not.

    Raises:
        LavaError: The file does not exist, cannot be read, is empty, or is no MCAP file.
    """
    try:
        with path.open('rb') as stream:
            if not stream.read(1):
                raise LavaError('bag', str(path), 'an MCAP file; this one is empty')
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                # one damaged byte at the start does not make it another file
                if data[: len(MAGIC)] != MAGIC and not _fits(data, len(MAGIC)):
                    right = 'an MCAP file; it does not start like one'
                    raise LavaError('bag', str(path), right)
                yield data
    except FileNotFoundError:
        raise LavaError('bag', str(path), 'an MCAP file that exists') from None
    except OSError as error:
        raise LavaError('bag', str(path), f'a readable MCAP file ({error})') from error


def open_mcap(path: Path) -> McapFile:
    """Find out what an MCAP file holds, and whether it is damaged.

    Raises:
        LavaError: The file does not exist, cannot be read, is empty, or is no MCAP file.
    """
    with mapped(path) as data:
        summary = read_summary(data)
        contents = summary and _from_summary(data, path, summary)
        return contents or _scan(data, path, summary)


def read_summary(data: mmap.mmap) -> Summary | None:
    """The index at the end of a file; None where it is missing, incomplete or damaged."""
    footer = _footer(data)
    if footer is None or not _has_end(data) or not _fits_footer(data, footer):
        return None
    try:
        data.seek(0)
        reader = SeekingReader(data, record_size_limit=MAX_BLOCK_SIZE)
        summary = reader.get_summary()
    except _DAMAGE:
        return None
    if summary is None or summary.statistics is None:
        return None
    if summary.statistics.message_count and not summary.chunk_indexes:
        return None
    if summary.statistics.attachment_count != len(summary.attachment_indexes):
        return None
    places = [(item.chunk_start_offset, item.chunk_length) for item in summary.chunk_indexes]
    places += [(item.offset, item.length) for item in summary.attachment_indexes]
    return summary if all(sum(place) <= len(data) for place in places) else None


def walk(data: mmap.mmap) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the content of each record, up to the end of the data section.

    What is no record is passed over, up to the next that is one: its opcode is ``BROKEN``, or
    ``CUT`` at the end of a file that was cut off, and its start and end are all of it.
    """
    position = len(MAGIC)
    has_chunks = False
    while position < len(data):
        if _fits(data, position, has_chunks=has_chunks):
            opcode, length = FRAME.unpack_from(data, position)
            has_chunks = has_chunks or opcode == Opcode.CHUNK
            start = position + FRAME.size
            position = start + length
            yield opcode, start, position
            if opcode == Opcode.DATA_END:
                return
            continue
        found = _BEGINNING.search(data, position + 1)
        while found is not None and not _fits(data, found.start(), has_chunks=True):
            found = _BEGINNING.search(data, found.start() + 1)
        if found is None and _is_cut(data, position):
            yield CUT, position, len(data)
            return
        end = len(data) if found is None else found.start()
        yield BROKEN, position, end
        position = end


def is_whole(content: bytes) -> bool:
    """Whether the content of an attachment's record fits the checksum at its end."""
    (stored,) = struct.unpack('<I', content[-4:])
    return stored in (0, zlib.crc32(content[:-4]))


def _fits(data: mmap.mmap, position: int, *, has_chunks: bool = False) -> bool:
    """Whether a whole record is there: the lengths of what is in it make up its own."""
    place = position + FRAME.size
    if place > len(data):
        return False
    opcode, length = FRAME.unpack_from(data, position)
    end = place + int(length)
    if end > len(data):
        return False
    if opcode == Opcode.MESSAGE:
        # nothing in it tells; beside chunks it is more likely a damaged index
        return int(length) >= _LEAST_MESSAGE and not has_chunks
    if opcode not in _LAYOUTS:
        return False
    before, kinds, after = _LAYOUTS[opcode]
    place += before
    for kind in kinds:
        size = struct.calcsize(f'<{kind}')
        if place + size > end:
            return False
        place += size + int(struct.unpack_from(f'<{kind}', data, place)[0])
    return place + after == end


def _is_cut(data: mmap.mmap, position: int) -> bool:
    """Whether a file ends here within a record, or in zeros after a loss of power."""
    if data[position] == 0 or len(data) - position < FRAME.size:
        return True
    opcode, length = FRAME.unpack_from(data, position)
    is_known = opcode in _LAYOUTS or opcode == Opcode.MESSAGE
    return is_known and position + FRAME.size + int(length) > len(data)


def _has_end(data: mmap.mmap) -> bool:
    return len(data) >= 2 * len(MAGIC) and data[-len(MAGIC) :] == MAGIC


def _footer(data: mmap.mmap) -> Footer | None:
    """The record that a finished file ends with."""
    start = len(data) - len(MAGIC) - _FOOTER.size
    if start < len(MAGIC) + FRAME.size:
        return None
    if FRAME.unpack_from(data, start - FRAME.size) != (Opcode.FOOTER, _FOOTER.size):
        return None
    return Footer(*_FOOTER.unpack_from(data, start))


def _fits_footer(data: mmap.mmap, footer: Footer) -> bool:
    """Whether summary and footer, but for the checksum in it, fit that checksum."""
    end = len(data) - len(MAGIC) - 4
    return footer.summary_crc in (0, _checksum(data, footer.summary_start, end))


def _checksum(data: mmap.mmap, start: int, end: int) -> int:
    with memoryview(data) as whole, whole[start:end] as part:
        return zlib.crc32(part)


def _from_summary(data: mmap.mmap, path: Path, summary: Summary) -> McapFile | None:
    """Take the contents from the summary; None when they are not as whole as it says."""
    result = McapFile(path, finished=True, channels=summary.channels, schemas=summary.schemas)
    try:
        if not _is_sound(data, summary):
            return None
        for index in sorted(summary.metadata_indexes, key=lambda item: item.offset):
            content = data[index.offset : index.offset + min(index.length, MAX_BLOCK_SIZE)]
            for frame in _frames(content):
                for record in _parse(*frame):
                    if isinstance(record, Metadata):
                        if not bag_metadata.is_whole(record.name, record.metadata):
                            return None
                        result.metadata[record.name] = record.metadata
    except _DAMAGE:
        return None
    assert summary.statistics is not None
    result.counts = dict(summary.statistics.channel_message_counts)
    result.blocks = [
        Block(
            item.message_start_time,
            item.message_end_time,
            item.chunk_start_offset,
            item.chunk_length,
            frozenset(item.message_index_offsets) or None,
        )
        for item in summary.chunk_indexes
    ]
    return result


def _is_sound(data: mmap.mmap, summary: Summary) -> bool:
    """Whether the data fit their checksum, or those of their parts where they have none."""
    footer = _footer(data)
    assert footer is not None
    end = footer.summary_start - FRAME.size - _DATA_END.size
    if FRAME.unpack_from(data, end) != (Opcode.DATA_END, _DATA_END.size):
        return False
    (stored,) = _DATA_END.unpack_from(data, end + FRAME.size)
    if stored:
        return int(stored) == _checksum(data, 0, end)
    for index in summary.attachment_indexes:
        content = data[index.offset : index.offset + index.length]
        if content[0] != Opcode.ATTACHMENT or not is_whole(content):
            return False
    for chunk in summary.chunk_indexes:
        start = chunk.chunk_start_offset
        for opcode, content in _frames(data[start : start + chunk.chunk_length]):
            if opcode != Opcode.CHUNK:
                return False
            _parse(opcode, content)
    return data[: len(MAGIC)] == MAGIC


def _scan(data: mmap.mmap, path: Path, summary: Summary | None) -> McapFile:
    """Read the records from the first on, and note which are damaged."""
    has_end = _has_end(data)
    footer = _footer(data)
    result = McapFile(path, finished=has_end or footer is not None, counts={})
    if summary is not None:
        # it repeats what damaged chunks define
        result.channels, result.schemas = dict(summary.channels), dict(summary.schemas)
    damage: list[tuple[int, int, str]] = []
    if data[: len(MAGIC)] != MAGIC:
        damage.append((0, len(MAGIC), 'the start of the file'))
    is_run = False
    for opcode, start, end in walk(data):
        offset = start - FRAME.size
        if opcode == CUT:
            result.rest = end - start
        elif opcode == BROKEN:
            damage.append((start, end, 'a record'))
        elif opcode == Opcode.DATA_END:
            (stored,) = _DATA_END.unpack_from(data, start)
            if stored not in (0, _checksum(data, 0, offset)) and not damage:
                damage.append((0, end, 'the data outside of chunks and attachments'))
        elif opcode == Opcode.ATTACHMENT:
            if end - start <= MAX_BLOCK_SIZE and not is_whole(data[start:end]):
                damage.append((offset, end, 'an attachment'))
        elif opcode in _PARSED:
            try:
                _check_size(end - start)
                records = _parse(opcode, data[start:end])
                block = _add(result, records, offset, end - offset)
            except UnsupportedCompressionError as error:
                damage.append((offset, end, f'a chunk ({error})'))
                continue
            except _DAMAGE:
                damage.append((offset, end, f'a {Opcode(opcode).name.lower()} record'))
                continue
            last = result.blocks[-1] if result.blocks else None
            if block and last and is_run and opcode == Opcode.MESSAGE and _follows(last, block):
                result.blocks[-1] = _joined(last, block)
            elif block:
                result.blocks.append(block)
        is_run = opcode == Opcode.MESSAGE
    result.damage = [_sentence(result, *item) for item in damage]
    if result.finished and not (has_end and footer is not None and _fits_footer(data, footer)):
        result.damage.append(f'the index at the end of {path} is damaged; it is read without')
    assert result.counts is not None
    lost = sum(result.counts.pop(key) for key in set(result.counts) - set(result.channels))
    if lost:
        result.damage.append(
            f'{lost} messages of {path} are of topics that only a damaged part defines; they are '
            'left out'
        )
    return result


def _sentence(contents: McapFile, start: int, end: int, what: str) -> str:
    """Say what is damaged, and which time it leaves a gap in."""
    first = min((block.start_ns for block in contents.blocks), default=0)
    before = [block.end_ns for block in contents.blocks if block.offset < start]
    after = [block.start_ns for block in contents.blocks if block.offset >= end]
    times = [
        *([f'after {(max(before) - first) / 1e9:.3f} s'] if before else []),
        *([f'before {(min(after) - first) / 1e9:.3f} s'] if after else []),
    ]
    where = f' ({" and ".join(times)} of its messages)' if times else ''
    return f'{what} is damaged: bytes {start} to {end} of {contents.path}{where}'


def _add(contents: McapFile, records: list[McapRecord], offset: int, length: int) -> Block | None:
    """Note what the records hold; returns the block they make when messages are among them."""
    assert contents.counts is not None
    times: list[int] = []
    channel_ids: set[int] = set()
    for record in records:
        if isinstance(record, Schema):
            contents.schemas[record.id] = record
        elif isinstance(record, Channel):
            contents.channels[record.id] = record
        elif isinstance(record, Metadata):
            if not bag_metadata.is_whole(record.name, record.metadata):
                raise McapError('its checksum does not fit')
            contents.metadata[record.name] = record.metadata
        elif isinstance(record, Message):
            times.append(record.log_time)
            channel_ids.add(record.channel_id)
            contents.counts[record.channel_id] = contents.counts.get(record.channel_id, 0) + 1
    if not times:
        return None
    return Block(min(times), max(times), offset, length, frozenset(channel_ids))


def _follows(last: Block, block: Block) -> bool:
    return last.offset + last.length == block.offset and last.length < _RUN_SIZE


def _joined(last: Block, block: Block) -> Block:
    return Block(
        min(last.start_ns, block.start_ns),
        max(last.end_ns, block.end_ns),
        last.offset,
        last.length + block.length,
        (last.channels or frozenset()) | (block.channels or frozenset()),
    )


def _overlaps(
    block: Block, channel_ids: frozenset[int], start_ns: int | None, end_ns: int | None
) -> bool:
    return (
        (start_ns is None or block.end_ns >= start_ns)
        and (end_ns is None or block.start_ns < end_ns)
        and (block.channels is None or not block.channels.isdisjoint(channel_ids))
    )


def _within(time_ns: int, start_ns: int | None, end_ns: int | None) -> bool:
    return (start_ns is None or time_ns >= start_ns) and (end_ns is None or time_ns < end_ns)


_PARSED: dict[Opcode, Callable[..., McapRecord]] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.MESSAGE: Message.read,
}


def _check_size(size: int) -> None:
    if size > MAX_BLOCK_SIZE:
        raise McapError(f'{size} bytes at once, more than {MAX_BLOCK_SIZE}')


def _frames(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Split whole records into opcode and content."""
    position = 0
    while position < len(data):
        opcode, length = FRAME.unpack_from(data, position)
        start = position + FRAME.size
        position = start + length
        if position > len(data):
            raise McapError(f'a record of {length} bytes where {len(data) - start} are left')
        yield opcode, data[start:position]


def _parse(opcode: int, content: bytes) -> list[McapRecord]:
    """Parse a record; a chunk gives the records inside it."""
    stream = ReadDataStream(BytesIO(content))
    if opcode == Opcode.MESSAGE:
        return [Message.read(stream, len(content))]
    if opcode != Opcode.CHUNK:
        return [_PARSED[Opcode(opcode)](stream)] if opcode in _PARSED else []
    chunk = Chunk.read(stream)
    if chunk.compression not in ('', 'lz4', 'zstd'):
        raise UnsupportedCompressionError(chunk.compression)
    _check_size(chunk.uncompressed_size)
    if chunk.compression == 'zstd':
        # The decompressor trusts the frame, which may claim another size than the chunk.
        size = zstandard.frame_content_size(chunk.data)
        if size not in (-1, chunk.uncompressed_size):
            raise McapError(f'a chunk of {chunk.uncompressed_size} bytes that holds {size}')
    return list(breakup_chunk(chunk, validate_crc=True))
