# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""One MCAP file, finished or not: what is in it and where.

A finished file has a summary that says so, and checksums over everything, which are checked when
the file is opened. A file whose writer was killed has no summary: one pass over it finds every
whole record before the place where it breaks off. Such a pass also finds what is damaged, and what
comes after that. Either way the messages are then read block by block (a chunk, or a run of
messages outside of chunks), so that memory is bounded by the blocks that overlap in time.
"""

from collections import deque
from collections.abc import Collection, Iterator
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
from lava_ros.errors import LavaError
from lava_ros.files import open_input

# Length at which a run of messages outside of chunks ends its block [bytes].
_RUN_SIZE = 4 * 1024 * 1024

#: Most that is held at once of blocks that overlap in time, uncompressed [bytes].
MAX_HELD = 2 * records.MAX_CHUNK_SIZE


class Block(NamedTuple):
    """A part of the file that holds messages and is read at once: its log times [ns] and place.

    ``channels`` are the ids of the channels with messages in it, None when unknown.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    channels: frozenset[int] | None

    def may_hold(self, channel_ids: frozenset[int]) -> bool:
        """Whether messages of one of some channels may be in it."""
        return self.channels is None or not self.channels.isdisjoint(channel_ids)


@dataclass
class McapFile:
    """The contents of an MCAP file.

    Attributes:
        path: The file.
        finished: Whether its writer closed it and the summary is usable.
        channels, schemas, counts: Channels, schemas, and numbers of messages of channels, by id.
        blocks: Where the messages are, in file order.
        metadata: MCAP metadata records by name, the latest whole one of each name.
        damage: What is damaged, and what is left out for it, each a sentence.
        rest: Bytes at the end of a file that was cut off which are no whole record.
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
        """Messages in the file."""
        return sum(self.counts.values())

    def messages(self, channel_ids: Collection[int], start_ns: int = 0) -> Iterator[Message]:
        """Yield messages of some channels in the order of log time, then of the file.

        ``start_ns`` is the earliest log time [ns]. LavaError where the file is damaged, cannot be
        read, or needs more than ``MAX_HELD`` bytes of messages at once to put them in order.
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
                        right = f'at most {MAX_HELD} bytes of messages of one time, not {held}'
                        raise LavaError('bag', str(self.path), right)
                if loaded:
                    message = heapq.heappop(loaded)[3]
                    held -= len(message.data)
                    yield message

    def newest(self, channel_ids: Collection[int], before_ns: int) -> dict[int, Message]:
        """Return the newest message of each channel that was logged before ``before_ns`` [ns].

        Reads backwards and stops as soon as no earlier block can hold a newer message. LavaError
        where the file is damaged or cannot be read.
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
        try:
            return open_input(self.path)
        except OSError as error:
            raise LavaError('bag', str(self.path), f'a readable file ({error})') from error

    def _read(
        self, stream: BinaryIO, block: Block, channel_ids: frozenset[int]
    ) -> Iterator[Message]:
        try:
            records.check_size(block.length, records.MAX_RECORD_SIZE)
            stream.seek(block.offset)
            data = stream.read(block.length)
            found = [item for frame in records.frames(data) for item in records.parse(*frame)]
        except (OSError, *records.DAMAGE) as error:
            right = f'a file that can be read; {block.length} bytes from byte {block.offset} on '
            right += f'cannot ({type(error).__name__}: {error})'
            raise LavaError('bag', str(self.path), right) from error
        for item in found:
            if isinstance(item, Message) and item.channel_id in channel_ids:
                # a view would keep all of the block
                item.data = bytes(item.data)
                yield item


def has_begun(path: Path) -> bool:
    """Whether a file holds as much as the magic bytes at its start; LavaError if unreadable."""
    try:
        return path.stat().st_size >= len(MAGIC)
    except OSError as error:
        raise LavaError('bag', str(path), f'a readable MCAP file ({error})') from error


@contextmanager
def mapped(path: Path) -> Iterator[mmap.mmap]:
    """The bytes of an MCAP file, finished or not; errors as in ``open_mcap``."""
    try:
        with open_input(path) as stream:
            if not stream.read(1):
                raise LavaError('bag', str(path), 'an MCAP file; this one is empty')
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                # one damaged byte at the start does not make it another file
                if data[: len(MAGIC)] != MAGIC and not records.fits(data, len(MAGIC)):
                    right = 'an MCAP file; it does not start like one'
                    raise LavaError('bag', str(path), right)
                yield data
    except FileNotFoundError:
        raise LavaError('bag', str(path), 'an MCAP file that exists') from None
    except OSError as error:
        raise LavaError('bag', str(path), f'a readable MCAP file ({error})') from error


def open_mcap(path: Path) -> McapFile:
    """Find out what an MCAP file holds, and whether it is damaged; LavaError if it is none."""
    with mapped(path) as data:
        summary = read_summary(data)
        contents = summary and _from_summary(data, path, summary)
        return contents or _scan(data, path, summary)


def read_summary(data: mmap.mmap) -> Summary | None:
    """The index at the end of a file; None where it is missing, incomplete or damaged."""
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
    """Take the contents from the summary; None when they are not as whole as it says."""
    result = McapFile(path, finished=True)
    try:
        if not _is_sound(data, summary):
            return None
        for index in sorted(summary.metadata_indexes, key=lambda item: item.offset):
            records.check_size(index.length, records.MAX_RECORD_SIZE)
            for frame in records.frames(data[index.offset : index.offset + index.length]):
                _add(result, records.parse(*frame), 0, 0)
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
    """Whether the data fit their checksum, or those of their parts where they have none."""
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
        for opcode, content in records.frames(data[start : start + chunk.chunk_length]):
            if opcode != Opcode.CHUNK:
                return False
            records.unpacked(content)
    return data[: len(MAGIC)] == MAGIC


def _scan(data: mmap.mmap, path: Path, summary: Summary | None) -> McapFile:
    """Read the records from the first on, and note which are damaged."""
    is_finished = records.has_end(data) or records.footer_of(data) is not None
    result = McapFile(path, finished=is_finished)
    if summary is not None:
        # it repeats what damaged chunks define
        result.channels, result.schemas = dict(summary.channels), dict(summary.schemas)
    damage: list[tuple[int, int, str]] = []
    if data[: len(MAGIC)] != MAGIC:
        damage.append((0, len(MAGIC), 'the start of the file'))
    for opcode, start, end in records.walk(data):
        offset = start - records.FRAME.size
        if opcode == records.CUT:
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
                found = records.parse(opcode, data[start:end])
                joins = opcode == Opcode.MESSAGE
                _add(result, found, offset, end - offset, joins=joins)
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
    """Say what is damaged, and which time it leaves a gap in."""
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
    contents: McapFile, found: list[McapRecord], offset: int, length: int, *, joins: bool = False
) -> None:
    """Note what records hold, and the block they make when messages are among them.

    One that ``joins`` goes on with the block that ends where it begins; chunks are to be read one
    at a time.
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
