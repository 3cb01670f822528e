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

A finished file has a summary that says so. A file whose writer was killed has none: one pass over
it finds every whole record before the place where it breaks off. Either way the messages are then
read block by block (a chunk, or a run of messages outside of chunks), so that memory is bounded
by the blocks that overlap in time.
"""

from collections import deque
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
import heapq
from io import BytesIO
from pathlib import Path
import struct
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk
import zstandard

from lava_ros.errors import LavaError

MAGIC = b'\x89MCAP0\r\n'

#: Largest block that is read into memory [bytes]; a message of 1 GiB is an error, not a map.
MAX_BLOCK_SIZE = 1 << 30

# Length at which a run of messages outside of chunks ends its block [bytes].
_RUN_SIZE = 4 * 1024 * 1024

# Opcode and length of a record.
_FRAME = struct.Struct('<BQ')

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
        metadata: MCAP metadata records by name, the latest of each name.
    """

    path: Path
    finished: bool
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    counts: dict[int, int] | None = None
    blocks: list[Block] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)

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


def open_mcap(path: Path) -> McapFile:
    """Find out what an MCAP file holds.

    Raises:
        LavaError: The file does not exist, cannot be read, is empty, or is no MCAP file.
    """
    try:
        with path.open('rb') as stream:
            start = stream.read(len(MAGIC))
            if not start:
                raise LavaError('bag', str(path), 'an MCAP file; this one is empty')
            if start != MAGIC:
                raise LavaError('bag', str(path), 'an MCAP file; it does not start like one')
            return _from_summary(stream, path) or _scan(stream, path)
    except FileNotFoundError:
        raise LavaError('bag', str(path), 'an MCAP file that exists') from None
    except OSError as error:
        raise LavaError('bag', str(path), f'a readable MCAP file ({error})') from error


def _from_summary(stream: BinaryIO, path: Path) -> McapFile | None:
    """Take the contents from the summary; None when the file has none that serves."""
    size = path.stat().st_size
    if not _has_end(stream, size):
        return None
    try:
        stream.seek(0)
        summary = SeekingReader(stream, record_size_limit=MAX_BLOCK_SIZE).get_summary()
        if summary is None or summary.statistics is None:
            return None
        result = McapFile(path, finished=True, channels=summary.channels, schemas=summary.schemas)
        for index in sorted(summary.metadata_indexes, key=lambda item: item.offset):
            stream.seek(index.offset)
            for frame in _frames(stream.read(min(index.length, MAX_BLOCK_SIZE))):
                for record in _parse(*frame):
                    if isinstance(record, Metadata):
                        result.metadata[record.name] = record.metadata
    except _DAMAGE:
        return None
    if summary.statistics.message_count and not summary.chunk_indexes:
        return None
    if any(item.chunk_start_offset + item.chunk_length > size for item in summary.chunk_indexes):
        return None
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


def _scan(stream: BinaryIO, path: Path) -> McapFile:
    """Read the records from the first on, up to the end of the data or the first broken one."""
    size = path.stat().st_size
    result = McapFile(path, finished=False, counts={})
    position = len(MAGIC)
    is_run = False
    while position + _FRAME.size <= size:
        stream.seek(position)
        opcode, length = _FRAME.unpack(stream.read(_FRAME.size))
        end = position + _FRAME.size + length
        if opcode == Opcode.DATA_END:
            result.finished = _has_end(stream, size)
            break
        if opcode == 0 or end > size:
            break
        if opcode in _PARSED:
            try:
                _check_size(length)
                records = _parse(opcode, stream.read(length))
            except UnsupportedCompressionError as error:
                raise LavaError(
                    'bag', str(path), f'a compression that can be read here ({error})'
                ) from error
            except _DAMAGE:
                break
            block = _add(result, records, position, end - position)
            last = result.blocks[-1] if result.blocks else None
            if block and last and is_run and opcode == Opcode.MESSAGE and _follows(last, block):
                result.blocks[-1] = _joined(last, block)
            elif block:
                result.blocks.append(block)
            is_run = opcode == Opcode.MESSAGE
        position = end
    return result


def _has_end(stream: BinaryIO, size: int) -> bool:
    stream.seek(max(size - len(MAGIC), len(MAGIC)))
    return stream.read() == MAGIC


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
        opcode, length = _FRAME.unpack_from(data, position)
        start = position + _FRAME.size
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
