# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Contents of one MCAP file, finished or not.

A finished file has a summary and checksums over all data, which are checked when the file is
opened. A file whose writer was killed has no summary: a scan finds every complete record up to the
truncation. A damaged file is scanned too, including the records after the damage. In all cases the
messages are then read block by block (a chunk, or a run of messages outside of chunks), so that
memory is bounded by the blocks that overlap in time.
"""

from collections import deque
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
import heapq
import mmap
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.summary import Summary

from lava_ros.bag import metadata as bag_metadata
from lava_ros.bag import records
from lava_ros.bag.records import MAGIC
from lava_ros.errors import LavaError, refusing
from lava_ros.files import open_input

# Length at which a run of messages outside of chunks ends its block [bytes].
_RUN_SIZE = 4 * 1024 * 1024

#: Maximum size of the messages of blocks that overlap in time, uncompressed [bytes].
MAX_HELD = 2 * records.MAX_CHUNK_SIZE


class Block(NamedTuple):
    """A part of the file that is read at once: log times [ns] and position [bytes].

    ``channels`` are the IDs of the channels with messages in it, None if unknown.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    channels: frozenset[int] | None

    def may_hold(self, channel_ids: frozenset[int]) -> bool:
        """Return True if the block may contain messages of some channels."""
        return self.channels is None or not self.channels.isdisjoint(channel_ids)


@dataclass
class McapFile:
    """Contents of an MCAP file.

    Attributes:
        path: The file.
        finished: Whether its writer closed it.
        channels, schemas, counts: Channels, schemas, and numbers of messages of channels, by ID.
        blocks: Blocks with messages, in file order.
        metadata: MCAP metadata records by name, the newest undamaged one of each name.
        damage: A sentence for each damaged part and for messages left out because of it.
        rest: Size of the incomplete record at the end of a truncated file [bytes].
    """

    path: Path
    finished: bool
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)
    rest: int = 0

    @property
    def size(self) -> int:
        """Size of the file [bytes]."""
        return self.path.stat().st_size

    @property
    def start_ns(self) -> int | None:
        """Log time of the first message [ns], None without messages."""
        return min((block.start_ns for block in self.blocks), default=None)

    @property
    def end_ns(self) -> int | None:
        """Log time of the last message [ns], None without messages."""
        return max((block.end_ns for block in self.blocks), default=None)

    @property
    def message_count(self) -> int:
        """Number of messages in the file."""
        return sum(self.counts.values())

    def messages(self, channel_ids: Collection[int], start_ns: int = 0) -> Iterator[Message]:
        """Yield messages since ``start_ns`` [ns] in the order of log time, then of the file.

        Raises:
            LavaError: If the file is damaged or unreadable, or more than ``MAX_HELD`` bytes of
                messages have to be sorted at once.
        """
        wanted = frozenset(channel_ids)
        waiting = deque(
            block
            for block in sorted(self.blocks)
            if block.end_ns >= start_ns and block.may_hold(wanted)
        )
        loaded: list[tuple[int, int, int, Message]] = []
        held = 0
        with self._opened() as stream:
            while waiting or loaded:
                while waiting and (not loaded or waiting[0].start_ns <= loaded[0][0]):
                    block = waiting.popleft()
                    for index, message in enumerate(self._read(stream, block, wanted)):
                        if message.log_time >= start_ns:
                            item = (message.log_time, block.offset, index, message)
                            heapq.heappush(loaded, item)
                            held += len(message.data)
                    if held > MAX_HELD:
                        expected = f'at most {MAX_HELD} bytes of messages of one time, not {held}'
                        raise LavaError('bag', str(self.path), expected)
                if loaded:
                    message = heapq.heappop(loaded)[3]
                    held -= len(message.data)
                    yield message

    def newest(self, channel_ids: Collection[int], before_ns: int) -> dict[int, Message]:
        """Return the newest message of each channel that was logged before ``before_ns`` [ns].

        Reads backwards, only as far as a block may contain a newer message.

        Raises:
            LavaError: If the file is damaged or unreadable.
        """
        found: dict[int, Message] = {}
        with self._opened() as stream:
            for block in sorted(self.blocks, key=lambda item: item.end_ns, reverse=True):
                open_ids = frozenset(
                    item
                    for item in channel_ids
                    if item not in found or found[item].log_time <= block.end_ns
                )
                if not open_ids:
                    break
                if block.start_ns >= before_ns or not block.may_hold(open_ids):
                    continue
                for message in self._read(stream, block, open_ids):
                    if message.log_time >= before_ns:
                        continue
                    best = found.get(message.channel_id)
                    if best is None or message.log_time >= best.log_time:
                        found[message.channel_id] = message
        return found

    def _opened(self) -> BinaryIO:
        with refusing('bag', str(self.path), 'a readable file', OSError):
            return open_input(self.path)

    def _read(
        self, stream: BinaryIO, block: Block, channel_ids: frozenset[int]
    ) -> Iterator[Message]:
        expected = f'a readable file; {block.length} bytes at byte {block.offset} are not readable'
        with refusing('bag', str(self.path), expected, OSError, *records.DAMAGE):
            records.check_size(block.length, records.MAX_RECORD_SIZE)
            stream.seek(block.offset)
            data = stream.read(block.length)
            found = list(records.parse(data))
        for item in found:
            if isinstance(item, Message) and item.channel_id in channel_ids:
                yield item


def has_begun(path: Path) -> bool:
    """Return True if a file is at least as long as the magic bytes at its start.

    Raises:
        LavaError: If the file is unreadable.
    """
    with refusing('bag', str(path), 'a readable MCAP file', OSError):
        return path.stat().st_size >= len(MAGIC)


@contextmanager
def mapped(path: Path) -> Iterator[mmap.mmap]:
    """Map the bytes of an MCAP file, finished or not; errors as in ``open_mcap``."""
    if not path.exists():
        raise LavaError('bag', str(path), 'an MCAP file that exists')
    with refusing('bag', str(path), 'a readable MCAP file', OSError), open_input(path) as stream:
        if not stream.read(1):
            raise LavaError('bag', str(path), 'an MCAP file; this one is empty')
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            # a file with damaged magic bytes is still an MCAP file if a record follows
            if data[: len(MAGIC)] != MAGIC and not records.fits(data, len(MAGIC)):
                raise LavaError('bag', str(path), 'an MCAP file; it does not start like one')
            yield data


def open_mcap(path: Path) -> McapFile:
    """Read the contents of an MCAP file, and find damage.

    Raises:
        LavaError: If the file is missing, unreadable or not an MCAP file.
    """
    with mapped(path) as data:
        summary = read_summary(data)
        contents = summary and _from_summary(data, path, summary)
        return contents or _scan(data, path, summary)


def read_summary(data: mmap.mmap) -> Summary | None:
    """Return the index at the end of a file, None if it is missing, incomplete or damaged."""
    if not records.has_index(data):
        return None
    try:
        data.seek(0)
        reader = SeekingReader(data, record_size_limit=records.MAX_RECORD_SIZE)
        summary = reader.get_summary()
    except records.DAMAGE:
        return None
    if summary is None or summary.statistics is None:
        return None
    ends = [item.chunk_start_offset + item.chunk_length for item in summary.chunk_indexes]
    ends += [item.offset + item.length for item in summary.attachment_indexes]
    is_complete = (
        (summary.chunk_indexes or not summary.statistics.message_count)
        and len(summary.attachment_indexes) == summary.statistics.attachment_count
        and max(ends, default=0) <= len(data)
    )
    return summary if is_complete else None


def _from_summary(data: mmap.mmap, path: Path, summary: Summary) -> McapFile | None:
    """Return the contents according to the summary, None if the data are damaged."""
    result = McapFile(path, finished=True)
    try:
        if not _is_sound(data, summary):
            return None
        for index in sorted(summary.metadata_indexes, key=lambda item: item.offset):
            records.check_size(index.length, records.MAX_RECORD_SIZE)
            _add(result, records.parse(data[index.offset : index.offset + index.length]), 0, 0)
    except records.DAMAGE:
        return None
    assert summary.statistics is not None
    result.channels, result.schemas = summary.channels, summary.schemas
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
    """Return True if the data match their checksum or, without one, those of their parts."""
    footer = records.footer_of(data)
    assert footer is not None
    end = footer.summary_start - records.FRAME.size - records.DATA_END.size
    if records.FRAME.unpack_from(data, end) != (Opcode.DATA_END, records.DATA_END.size):
        return False
    (stored,) = records.DATA_END.unpack_from(data, end + records.FRAME.size)
    if stored:
        return int(stored) == records.checksum(data, 0, end)
    for index in summary.attachment_indexes:
        attached = data[index.offset : index.offset + index.length]
        if attached[:1] != bytes([Opcode.ATTACHMENT]) or not records.is_whole(attached):
            return False
    for chunk in summary.chunk_indexes:
        start = chunk.chunk_start_offset
        if data[start] != Opcode.CHUNK:
            return False
        deque(records.parse(data[start : start + chunk.chunk_length]), maxlen=0)
    return data[: len(MAGIC)] == MAGIC


def _scan(data: mmap.mmap, path: Path, summary: Summary | None) -> McapFile:
    is_finished = records.has_end(data) or records.footer_of(data) is not None
    result = McapFile(path, finished=is_finished)
    if summary is not None:
        # repeats the definitions that are in damaged chunks
        result.channels, result.schemas = dict(summary.channels), dict(summary.schemas)
    damage: list[tuple[int, int, str]] = []
    if data[: len(MAGIC)] != MAGIC:
        damage.append((0, len(MAGIC), 'the start of the file'))
    for opcode, start, end in records.iter_records(data):
        offset = start - records.FRAME.size
        if opcode == records.TRUNCATED:
            result.rest = end - start
        elif opcode == records.BROKEN:
            damage.append((start, end, 'a record'))
        elif opcode == Opcode.DATA_END:
            (stored,) = records.DATA_END.unpack_from(data, start)
            if stored not in (0, records.checksum(data, 0, offset)) and not damage:
                damage.append((0, end, 'the data outside of chunks and attachments'))
        elif opcode == Opcode.ATTACHMENT:
            if end - start <= records.MAX_RECORD_SIZE and not records.is_whole(data[start:end]):
                damage.append((offset, end, 'an attachment'))
        elif opcode in records.PARSED:
            try:
                records.check_size(end - start, records.MAX_RECORD_SIZE)
                found = list(records.parse(data[offset:end]))
                _add(result, found, offset, end - offset, joins=opcode == Opcode.MESSAGE)
            except UnsupportedCompressionError as error:
                damage.append((offset, end, f'a chunk ({error})'))
            except records.DAMAGE:
                damage.append((offset, end, f'a {Opcode(opcode).name.lower()} record'))
    result.damage = [_sentence(result, *item) for item in damage]
    if is_finished and not records.has_index(data):
        result.damage.append(f'the index at the end of {path} is damaged; the file is read anyway')
    lost = sum(result.counts.pop(key) for key in set(result.counts) - set(result.channels))
    if lost:
        text = f'{lost} messages of {path} are left out: only a damaged part defines their topics'
        result.damage.append(text)
    return result


def _sentence(contents: McapFile, start: int, end: int, what: str) -> str:
    first = contents.start_ns or 0
    before = [block.end_ns for block in contents.blocks if block.offset < start]
    after = [block.start_ns for block in contents.blocks if block.offset >= end]
    times = [
        *([f'after {(max(before) - first) / 1e9:.3f} s'] if before else []),
        *([f'before {(min(after) - first) / 1e9:.3f} s'] if after else []),
    ]
    where = f' ({" and ".join(times)} of its messages)' if times else ''
    return f'{what} is damaged: bytes {start} to {end} of {contents.path}{where}'


def _add(
    contents: McapFile, found: Iterable[McapRecord], offset: int, length: int, *,
    joins: bool = False,
) -> None:
    """Add the contents of records, and a block if messages are among them.

    If ``joins``, the block is merged with a preceding adjacent block. Chunks are not merged,
    because they are read one at a time.
    """
    times: list[int] = []
    channel_ids: set[int] = set()
    for record in found:
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
        return
    last = contents.blocks[-1] if contents.blocks else None
    if joins and last and last.offset + last.length == offset and last.length < _RUN_SIZE:
        contents.blocks.pop()
        times += [last.start_ns, last.end_ns]
        channel_ids |= last.channels or set()
        offset, length = last.offset, last.length + length
    contents.blocks.append(Block(min(times), max(times), offset, length, frozenset(channel_ids)))
