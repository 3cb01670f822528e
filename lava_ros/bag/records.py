# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Records of MCAP files: where they are, also in a damaged file, their checksums, what they hold.

Sizes that a file claims are checked before memory is taken for them.
"""

from collections.abc import Callable, Iterator
from io import BytesIO
import mmap
import re
import struct
import zlib

import lz4.frame
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, McapRecord, Message, Metadata, Schema
import zstandard

MAGIC = b'\x89MCAP0\r\n'

#: Largest record that is read into memory [bytes].
MAX_RECORD_SIZE = 1 << 30

#: Largest chunk, uncompressed [bytes]: a larger message is no input of the node either.
MAX_CHUNK_SIZE = 1 << 29

#: Opcode and length of a record.
FRAME = struct.Struct('<BQ')

#: Content of the record that ends the data: a checksum over them.
DATA_END = struct.Struct('<I')

#: In place of an opcode: bytes that are no record.
BROKEN = -1

#: In place of an opcode: the start of a record at the end of a file that was cut off.
CUT = -2

#: What parsing of damaged bytes raises.
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

# A message before its data: channel, sequence, log and publish time.
_MESSAGE = struct.Struct('<HIQQ')

# A chunk before its compression: times, uncompressed size and checksum, length of a text.
_CHUNK = struct.Struct('<QQQII')

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
    Opcode.DATA_END: (DATA_END.size, '', 0),
}

# Where a record may begin that is shorter than 4 GiB.
_BEGINNING = re.compile(rb'[\x03\x04\x06\x07\x09\x0c\x0f].{4}\0{4}', re.DOTALL)

_READ: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
}

#: Opcodes of which ``parse`` makes records.
PARSED = frozenset({*_READ, Opcode.CHUNK, Opcode.MESSAGE})


def walk(data: mmap.mmap) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the content of each record, up to the end of the data section.

    What is no record is passed over, up to the next that is one: its opcode is ``BROKEN``, or
    ``CUT`` at the end of a file that was cut off, and its start and end are all of it.
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
        found = _BEGINNING.search(data, position + 1)
        while found is not None and not fits(data, found.start(), has_chunks=True):
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


def fits(data: mmap.mmap, position: int, *, has_chunks: bool = False) -> bool:
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
        return int(length) >= _MESSAGE.size and not has_chunks
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


def has_end(data: mmap.mmap) -> bool:
    """Whether a file ends as a finished one does."""
    return len(data) >= 2 * len(MAGIC) and data[-len(MAGIC) :] == MAGIC


def footer_of(data: mmap.mmap) -> Footer | None:
    """The record that a finished file ends with."""
    start = len(data) - len(MAGIC) - _FOOTER.size
    if start < len(MAGIC) + FRAME.size:
        return None
    if FRAME.unpack_from(data, start - FRAME.size) != (Opcode.FOOTER, _FOOTER.size):
        return None
    return Footer(*_FOOTER.unpack_from(data, start))


def has_index(data: mmap.mmap) -> bool:
    """Whether a file ends as a finished one does, with an index that its checksum fits."""
    footer, end = footer_of(data), len(data) - len(MAGIC) - 4
    if footer is None or not has_end(data):
        return False
    return footer.summary_crc in (0, checksum(data, footer.summary_start, end))


def checksum(data: mmap.mmap, start: int, end: int) -> int:
    """CRC-32 of a part of a file."""
    with memoryview(data) as whole, whole[start:end] as part:
        return zlib.crc32(part)


def check_size(size: int, most: int) -> None:
    """Raise McapError for a record or a chunk of more than so many bytes."""
    if size > most:
        raise McapError(f'{size} bytes at once, more than {most}')


def frames(data: bytes | memoryview) -> Iterator[tuple[int, memoryview]]:
    """Split whole records into opcode and content; McapError or struct.error where one is cut."""
    view = memoryview(data)
    position = 0
    while position < len(view):
        opcode, length = FRAME.unpack_from(view, position)
        start = position + FRAME.size
        position = start + length
        if position > len(view):
            raise McapError(f'a record of {length} bytes where {len(view) - start} are left')
        yield opcode, view[start:position]


def parse(opcode: int, content: bytes | memoryview) -> list[McapRecord]:
    """Parse a record; a chunk gives the records inside it. Raises what ``unpacked`` does.

    The data of a message are a view of the content, or of the chunk.
    """
    if opcode == Opcode.CHUNK:
        return [
            record
            for inner, part in frames(unpacked(content))
            if inner != Opcode.CHUNK
            for record in parse(inner, part)
        ]
    if opcode == Opcode.MESSAGE:
        channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
        data = memoryview(content)[_MESSAGE.size :]
        return [Message(channel, log_time, data, publish_time, sequence)]
    read = _READ.get(opcode)
    return [] if read is None else [read(ReadDataStream(BytesIO(content)))]


def unpacked(content: bytes | memoryview) -> bytes | memoryview:
    """Uncompressed records of a chunk.

    Raises:
        UnsupportedCompressionError: The chunk has another compression than lz4 and zstd.
        DAMAGE: It is damaged, too large, or of another size than it says.
    """
    _, _, size, stored, length = _CHUNK.unpack_from(content)
    check_size(size, MAX_CHUNK_SIZE)
    view = memoryview(content)
    place = _CHUNK.size + length
    compression = bytes(view[_CHUNK.size : place]).decode()
    (length,) = struct.unpack_from('<Q', view, place)
    data: bytes | memoryview = view[place + 8 : place + 8 + length]
    # what is compressed may be more than it says: a byte of that is enough to tell
    if compression == 'lz4':
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif compression == 'zstd':
        reader = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True)
        data = reader.read(size + 1)
    elif compression:
        raise UnsupportedCompressionError(compression)
    if len(data) != size:
        raise McapError(f'a chunk of {size} bytes that holds {len(data)} or more')
    if stored not in (0, zlib.crc32(data)):
        raise McapError('a chunk that its checksum does not fit')
    return data
