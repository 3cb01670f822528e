# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Records of MCAP files: positions, also in a damaged file, checksums and contents.

A size in a file is checked before memory is allocated for it.
"""

from collections.abc import Iterator
from io import BytesIO
import mmap
import re
import struct
from typing import NamedTuple
import zlib

import lz4.frame
from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, McapRecord, Message
from mcap.stream_reader import StreamReader
import zstandard

MAGIC = b'\x89MCAP0\r\n'

#: Maximum size of a record [bytes].
MAX_RECORD_SIZE = 1 << 30

#: Maximum size of a chunk, uncompressed [bytes]. The node accepts no larger messages either.
MAX_CHUNK_SIZE = 1 << 29

#: Opcode and length of a record.
FRAME = struct.Struct('<BQ')

#: Content of the record at the end of the data: a checksum of the data.
DATA_END = struct.Struct('<I')

#: Pseudo-opcode of bytes that are not a record.
BROKEN = -1

#: Pseudo-opcode of an incomplete record at the end of a truncated file.
TRUNCATED = -2

#: Exceptions that parsing of damaged bytes raises.
DAMAGE = (
    McapError,
    OverflowError,
    RuntimeError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
)

# Content of the record that ends the file, with a checksum at its end.
_FOOTER = struct.Struct('<QQI')

#: A message before its data: channel, sequence, log and publish time.
MESSAGE = struct.Struct('<HIQQ')

# Layout of the records of the data section: number of bytes before the variable-length items,
# format of the length before each of these items, number of bytes after them.
_LAYOUTS = {
    Opcode.HEADER: (0, 'II', 0),
    Opcode.SCHEMA: (2, 'III', 0),
    Opcode.CHANNEL: (4, 'III', 0),
    Opcode.CHUNK: (28, 'IQ', 0),
    Opcode.MESSAGE_INDEX: (2, 'I', 0),
    Opcode.ATTACHMENT: (16, 'IIQ', 4),
    Opcode.METADATA: (0, 'II', 0),
    Opcode.DATA_END: (DATA_END.size, '', 0),
}

# Possible beginning of a record that is shorter than 4 GiB.
_BEGINNING = re.compile(rb'[\x03\x04\x06\x07\x09\x0c\x0f].{4}\0{4}', re.DOTALL)

#: Opcodes of records that define or contain messages, or describe the recording.
PARSED = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.CHUNK, Opcode.MESSAGE)


def iter_records(data: mmap.mmap) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of the content of each record up to the end of the data section.

    Bytes before the next record that are not a record have the opcode ``BROKEN``, or
    ``TRUNCATED`` at the end of a truncated file; start and end are then those of all these bytes.
    """
    position = len(MAGIC)
    has_chunks = False
    while position < len(data):
        if fits(data, position, has_chunks=has_chunks):
            opcode, length = FRAME.unpack_from(data, position)
            has_chunks = has_chunks or opcode == Opcode.CHUNK
            start = position + FRAME.size
            position = start + length
            yield opcode, start, position
            if opcode == Opcode.DATA_END:
                return
            continue
        if data[position] != Opcode.MESSAGE and _end_of(data, position) is not None:
            # the records inside a cut chunk are not records of the file
            yield TRUNCATED, position, len(data)
            return
        found = _BEGINNING.search(data, position + 1)
        while found is not None and not fits(data, found.start(), has_chunks=True):
            found = _BEGINNING.search(data, found.start() + 1)
        if found is None and _is_cut(data, position):
            yield TRUNCATED, position, len(data)
            return
        end = len(data) if found is None else found.start()
        yield BROKEN, position, end
        position = end


def is_whole(content: bytes) -> bool:
    """Return True if the content of an attachment's record matches the checksum at its end."""
    (stored,) = struct.unpack('<I', content[-4:])
    return stored in (0, zlib.crc32(content[:-4]))


def fits(data: mmap.mmap, position: int, *, has_chunks: bool = False) -> bool:
    """Return True if a complete record is there: the lengths of its items add up to its own."""
    end = _end_of(data, position, has_chunks=has_chunks)
    return end is not None and end <= len(data)


def _end_of(data: mmap.mmap, position: int, *, has_chunks: bool = False) -> int | None:
    """Return the end of a record, beyond the end of a file that was cut off; None without one."""
    place = position + FRAME.size
    if place > len(data):
        return None
    opcode, length = FRAME.unpack_from(data, position)
    end = place + int(length)
    if opcode == Opcode.MESSAGE:
        # a message has no item to check; in a file with chunks it is probably a damaged index
        return end if int(length) >= MESSAGE.size and not has_chunks else None
    if opcode not in _LAYOUTS:
        return None
    before, kinds, after = _LAYOUTS[opcode]
    place += before
    for kind in kinds:
        size = struct.calcsize(f'<{kind}')
        if place + size > min(end, len(data)):
            return None
        place += size + int(struct.unpack_from(f'<{kind}', data, place)[0])
    return end if place + after == end else None


def _is_cut(data: mmap.mmap, position: int) -> bool:
    """Return True if a file ends here within a record, or in zeros after a loss of power."""
    if data[position] == 0 or len(data) - position < FRAME.size:
        return True
    opcode, length = FRAME.unpack_from(data, position)
    is_known = opcode in _LAYOUTS or opcode == Opcode.MESSAGE
    return is_known and position + FRAME.size + int(length) > len(data)


def has_end(data: mmap.mmap) -> bool:
    """Return True if a file ends like a finished one."""
    return len(data) >= 2 * len(MAGIC) and data[-len(MAGIC) :] == MAGIC


def footer_of(data: mmap.mmap) -> Footer | None:
    """Return the record at the end of a finished file, None without one."""
    start = len(data) - len(MAGIC) - _FOOTER.size
    if start < len(MAGIC) + FRAME.size:
        return None
    if FRAME.unpack_from(data, start - FRAME.size) != (Opcode.FOOTER, _FOOTER.size):
        return None
    return Footer(*_FOOTER.unpack_from(data, start))


def has_index(data: mmap.mmap) -> bool:
    """Return True if a file ends like a finished one, with an index that matches its checksum."""
    footer, end = footer_of(data), len(data) - len(MAGIC) - 4
    if footer is None or not has_end(data):
        return False
    return footer.summary_crc in (0, checksum(data, footer.summary_start, end))


def checksum(data: mmap.mmap, start: int, end: int) -> int:
    """Compute the CRC-32 of a part of a file."""
    with memoryview(data) as whole, whole[start:end] as part:
        return zlib.crc32(part)


def check_size(size: int, maximum: int) -> None:
    """Raise McapError if a size exceeds a maximum [bytes]."""
    if size > maximum:
        raise McapError(f'{size} bytes at once, more than {maximum}')


class Head(NamedTuple):
    """A message among records: IDs and times [ns], and the position of its record [bytes]."""

    channel_id: int
    sequence: int
    log_time: int
    publish_time: int
    start: int
    end: int


def contents(data: bytes) -> bytes:
    """Return the records inside a chunk; records that are not a chunk are returned unchanged.

    Raises:
        UnsupportedCompressionError: If the compression of a chunk is neither lz4 nor zstd.
        DAMAGE: If a chunk is damaged or too large, or differs from its header.
    """
    if data[:1] != bytes([Opcode.CHUNK]):
        return data
    (chunk,) = _parsed(data)
    return unpacked(chunk)


def parse(data: bytes) -> Iterator[Head | McapRecord]:
    """Yield the position of each message, and the definitions and metadata among records.

    Messages are not copied: a chunk may contain a hundred times more bytes than its file.

    Raises:
        DAMAGE: If a record is damaged.
    """
    position = 0
    while position < len(data):
        opcode, length = FRAME.unpack_from(data, position)
        start, end = position + FRAME.size, position + FRAME.size + length
        if end > len(data):
            raise McapError(f'a record of {length} bytes in {len(data) - start}')
        if opcode == Opcode.MESSAGE:
            if length < MESSAGE.size:
                raise McapError(f'a message of {length} bytes')
            channel_id, sequence, log_time, publish_time = MESSAGE.unpack_from(data, start)
            yield Head(channel_id, sequence, log_time, publish_time, position, end)
        elif opcode in PARSED and opcode != Opcode.CHUNK:
            yield from _parsed(data[position:end])
        position = end


def message_at(data: bytes | bytearray, position: int) -> Message:
    """Copy the message whose record begins at a position [bytes]."""
    start = position + FRAME.size
    (_, length), fields = FRAME.unpack_from(data, position), MESSAGE.unpack_from(data, start)
    channel_id, sequence, log_time, publish_time = fields
    content = bytes(data[start + MESSAGE.size : start + length])
    return Message(
        channel_id=channel_id, sequence=sequence, log_time=log_time, publish_time=publish_time,
        data=content,
    )


def _parsed(data: bytes) -> Iterator[McapRecord]:
    # the reader expects the end of a file
    end = FRAME.pack(Opcode.FOOTER, _FOOTER.size) + bytes(_FOOTER.size) + MAGIC
    limit = len(data) + len(end)
    reader = StreamReader(BytesIO(data + end), True, emit_chunks=True, record_size_limit=limit)
    return (item for item in reader.records if not isinstance(item, Footer))


def unpacked(chunk: Chunk) -> bytes:
    """Return the uncompressed records of a chunk; errors as in ``contents``."""
    size = chunk.uncompressed_size
    data: bytes = chunk.data
    check_size(size, MAX_CHUNK_SIZE)
    # reading one byte more than the stated size detects a larger chunk
    if chunk.compression == 'lz4':
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif chunk.compression == 'zstd':
        reader = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True)
        data = reader.read(size + 1)
    elif chunk.compression:
        raise UnsupportedCompressionError(chunk.compression)
    if len(data) != size:
        raise McapError(f'a chunk of {size} bytes that contains {len(data)} or more')
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise McapError('a chunk that does not match its checksum')
    return data
