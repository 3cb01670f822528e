# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Contents of one MCAP file, finished or not.

A finished file has a summary and checksums over all data, which are checked when the file is
opened. A file whose writer was killed has no summary: a scan finds every complete record up to the
truncation. A damaged file is scanned too, including the records after the damage. In all cases the
messages are then read block by block (a chunk, or a run of messages outside of chunks), so that
memory is bounded by the blocks that overlap in time.
"""

from array import array
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
import heapq
from itertools import accumulate
import mmap
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Message, Metadata, Schema
from mcap.summary import Summary
import numpy as np

from lava_ros.bag import metadata as bag_metadata
from lava_ros.bag import records
from lava_ros.bag.records import MAGIC
from lava_ros.errors import LavaError, refusing
from lava_ros.files import open_input, similar_file

# Length at which a run of messages outside of chunks ends its block [bytes].
_RUN_SIZE = 4 * 1024 * 1024

#: Maximum size of the messages of blocks that overlap in time, uncompressed, with their headers
#: and the index by time [bytes].
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
            for block in sorted(self.blocks, key=lambda item: item[:3])
            if block.end_ns >= start_ns and block.may_hold(wanted)
        )
        # blocks in memory by the log time of their next message, position and number
        due: list[tuple[int, int, int, _Messages]] = []
        held = number = 0
        with self._opened() as stream:
            while waiting or due:
                while waiting and (not due or waiting[0].start_ns <= due[0][0]):
                    block = waiting.popleft()
                    loaded = self._load(stream, block, wanted, start_ns)
                    held += loaded.size
                    if held > MAX_HELD:
                        expected = f'at most {MAX_HELD} bytes of messages at one time, not {held}'
                        raise LavaError('bag', str(self.path), expected)
                    number += 1
                    if (time := loaded.next_time) is not None:
                        heapq.heappush(due, (time, block.offset, number, loaded))
                if due:
                    _, offset, order, loaded = heapq.heappop(due)
                    yield loaded.take()
                    if (time := loaded.next_time) is not None:
                        heapq.heappush(due, (time, offset, order, loaded))
                    else:
                        held -= loaded.size

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
                with self._reading(block):
                    data = self._records(stream, block)
                    newer: dict[int, records.Head] = {}
                    for head in _heads(data, open_ids):
                        channel_id, time = head.channel_id, head.log_time
                        best = newer.get(channel_id) or found.get(channel_id)
                        if time < before_ns and (best is None or time >= best.log_time):
                            newer[channel_id] = head
                for channel_id, head in newer.items():
                    found[channel_id] = records.message_at(data, head.start)
        return found

    def _opened(self) -> BinaryIO:
        with refusing('bag', str(self.path), 'a readable file', OSError):
            return open_input(self.path)

    def _reading(self, block: Block) -> AbstractContextManager[None]:
        expected = f'a readable file; {block.length} bytes at byte {block.offset} are not readable'
        return refusing('bag', str(self.path), expected, OSError, *records.DAMAGE)

    def _records(self, stream: BinaryIO, block: Block) -> bytes:
        records.check_size(block.length, records.MAX_RECORD_SIZE)
        stream.seek(block.offset)
        return records.contents(stream.read(block.length))

    def _load(
        self, stream: BinaryIO, block: Block, channel_ids: frozenset[int], start_ns: int
    ) -> '_Messages':
        """Read the messages of a block since a log time [ns]."""
        result = _Messages()
        with self._reading(block):
            data = self._records(stream, block)
            for head in _heads(data, channel_ids):
                if head.log_time >= start_ns:
                    result.add(head, data)
        result.sort()
        return result


class _Messages:
    """Messages of a block, as the bytes of their records, to be taken in the order of log time.

    Objects of tiny messages would take many times the memory of their bytes.
    """

    def __init__(self) -> None:
        self._data = bytearray()
        self._times, self._positions = array('Q'), array('Q')
        self._next = 0

    @property
    def size(self) -> int:
        """Size of the records and of their index [bytes]."""
        return len(self._data) + 2 * self._times.itemsize * len(self._times)

    @property
    def next_time(self) -> int | None:
        """Log time of the next message [ns], None after the last one."""
        return self._times[self._next] if self._next < len(self._times) else None

    def add(self, head: records.Head, data: bytes) -> None:
        """Add a message of ``data``."""
        self._times.append(head.log_time)
        self._positions.append(len(self._data))
        self._data += memoryview(data)[head.start : head.end]

    def sort(self) -> None:
        """Sort the messages by log time; messages with equal times keep the order of the file."""
        times = np.asarray(self._times)
        if (times[1:] < times[:-1]).any():
            order = np.argsort(times, kind='stable')
            self._positions = array('Q', np.asarray(self._positions)[order].tobytes())
            self._times = array('Q', times[order].tobytes())

    def take(self) -> Message:
        """Return the next message."""
        self._next += 1
        return records.message_at(self._data, self._positions[self._next - 1])


def _heads(data: bytes, channel_ids: frozenset[int]) -> Iterator[records.Head]:
    """Yield the messages of some channels among records."""
    for item in records.parse(data):
        if isinstance(item, records.Head) and item.channel_id in channel_ids:
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
        raise LavaError('bag', str(path), f'an MCAP file that exists{similar_file(path)}')
    with refusing('bag', str(path), 'a readable MCAP file', OSError), open_input(path) as stream:
        if not stream.read(1):
            raise LavaError('bag', str(path), 'an MCAP file; this one is empty')
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            # a file with damaged magic bytes is still an MCAP file if a record follows
            if data[: len(MAGIC)] != MAGIC and not records.fits(data, len(MAGIC)):
                raise LavaError('bag', str(path), 'an MCAP file; this one has another format')
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
            _add(result, data[index.offset : index.offset + index.length], 0)
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
    """Return True if the data match their checksum or, without one, the checksums of all parts."""
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
        inside = records.contents(data[start : start + chunk.chunk_length])
        deque(records.parse(inside), maxlen=0)
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
                _add(result, data[offset:end], offset, joins=opcode == Opcode.MESSAGE)
            except UnsupportedCompressionError as error:
                damage.append((offset, end, f'a chunk ({error})'))
            except records.DAMAGE:
                damage.append((offset, end, f'a {Opcode(opcode).name.lower()} record'))
    result.damage = list(_sentences(result, damage))
    if is_finished and not records.has_index(data):
        result.damage.append(f'the index at the end of {path} is damaged; the file is read anyway')
    lost = sum(result.counts.pop(key) for key in set(result.counts) - set(result.channels))
    if lost:
        text = f'{lost} messages of {path} are left out: only a damaged part defines their topics'
        result.damage.append(text)
    return result


def _sentences(contents: McapFile, damage: list[tuple[int, int, str]]) -> Iterator[str]:
    """Describe damaged parts, each with the times of the messages before and after it."""
    blocks = contents.blocks
    offsets = [block.offset for block in blocks]
    newest = list(accumulate((block.end_ns for block in blocks), max))
    oldest = list(accumulate((block.start_ns for block in reversed(blocks)), min))[::-1]
    first = oldest[0] if oldest else 0
    for start, end, what in damage:
        before, after = bisect_left(offsets, start), bisect_left(offsets, end)
        times = [
            *([f'after {(newest[before - 1] - first) / 1e9:.3f} s'] if before else []),
            *([f'before {(oldest[after] - first) / 1e9:.3f} s'] if after < len(blocks) else []),
        ]
        where = f' ({" and ".join(times)} of its messages)' if times else ''
        yield f'{what} is damaged: bytes {start} to {end} of {contents.path}{where}'


def _add(contents: McapFile, data: bytes, offset: int, *, joins: bool = False) -> None:
    """Add the contents of a record, of a chunk those inside, and a block if it has messages.

    Nothing is added of a damaged record. If ``joins``, the block is merged with a preceding
    adjacent block. Chunks are not merged, because they are read one at a time.
    """
    length = len(data)
    first, last = 2**64, -1
    counts: Counter[int] = Counter()
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    metadata: dict[str, dict[str, str]] = {}
    for item in records.parse(records.contents(data)):
        if isinstance(item, records.Head):
            first, last = min(first, item.log_time), max(last, item.log_time)
            counts[item.channel_id] += 1
        elif isinstance(item, Schema):
            schemas[item.id] = item
        elif isinstance(item, Channel):
            channels[item.id] = item
        elif isinstance(item, Metadata):
            if not bag_metadata.is_whole(item.name, item.metadata):
                raise McapError('its checksum does not match')
            metadata[item.name] = item.metadata
    contents.schemas.update(schemas)
    contents.channels.update(channels)
    contents.metadata.update(metadata)
    for key, count in counts.items():
        contents.counts[key] = contents.counts.get(key, 0) + count
    if not counts:
        return
    channel_ids = frozenset(counts)
    block = contents.blocks[-1] if contents.blocks else None
    if joins and block and block.offset + block.length == offset and block.length < _RUN_SIZE:
        contents.blocks.pop()
        first, last = min(first, block.start_ns), max(last, block.end_ns)
        channel_ids |= block.channels or frozenset()
        offset, length = block.offset, block.length + length
    contents.blocks.append(Block(first, last, offset, length, channel_ids))
