# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Hostile bags with wrong parts; mutations.py has other files.

Each is a valid file in which a record, a field, a size or a count is changed, so that it passes
checks of the whole.
"""

from array import array
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import takewhile
import math
from pathlib import Path
import random
import struct
from typing import Any
import zlib

from diagnostic_msgs.msg import DiagnosticArray
import lz4.frame
from mcap.opcode import Opcode
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, PointCloud2
import zstandard

from lava_ros.bag import BagReader, BagWriter
from lava_ros.bag.records import DATA_END, FRAME, MAGIC

#: Values of sizes, counts, times and offsets.
INTEGERS = (
    *(0, 1, 2, 7, 255, 256, 32767, 32768, 65535, 2**20, 2**28, 2**31 - 1, 2**31, 2**32 - 1),
    *(2**40, 2**63 - 1, 2**63, 2**64 - 1),
)

FLOATS = (
    *(0.0, -0.0, 1.0, -1.0, 1e-300, 1e-30, 1e9, 1e30, 1e300, 1.7e308),
    *(math.nan, math.inf, -math.inf),
)

TEXTS = (
    *('', '\0', '\x1b[2J', '\x9b31m', '<b>', '9' * 5000, '1e999', 'nan', '../../x', 'ä' * 300),
    *('[' * 3000, '{"a": NaN}', '[{"time": 1%s, "effects": {"a": "on"}}]' % ('0' * 500)),
    *('{terrain: 5}', '{terrain: {epsg: [1], offset: x}}', 'layers: 5', '&a [*a]', '!!a/x {}'),
)

_TYPES = {
    'sensor_msgs/msg/Image': Image, 'sensor_msgs/msg/PointCloud2': PointCloud2,
    'nav_msgs/msg/MapMetaData': MapMetaData, 'nav_msgs/msg/OccupancyGrid': OccupancyGrid,
    'diagnostic_msgs/msg/DiagnosticArray': DiagnosticArray,
}

#: Definitions that are invalid, or larger than the message.
_DEFINITIONS = (
    'uint8[4000000000] data', 'Part[4000000000] parts\n===\nMSG: a/Part\nuint8[1] x',
    'Part[] parts\n===\nMSG: a/Part\nuint8[1] x', 'Image self', 'no definition', '',
)


def hostile_bag(chance: random.Random, source: Path, target: Path) -> None:
    """Write a bag with changed messages, texts or records."""
    change_it = chance.choice((_messages, _messages, _described, _redefined, _records, _records))
    change_it(chance, source, target)


def _copied(
    source: Path, target: Path, *, edit: Callable[..., bytes] = lambda _, data: data,
    **changes: Any,
) -> None:
    """Copy a bag with edited messages, other ``texts`` or another ``definition``."""
    bag = BagReader(source)
    with BagWriter(target, custom_data=changes.get('texts', bag.custom_data)) as writer:
        for item in bag.messages():
            topic = bag.topics[item.topic]
            schema = replace(topic.schema, text=changes.get('definition', topic.schema.text))
            writer.write(
                topic.name, topic.message_type, edit(topic, item.data), item.publish_ns,
                qos=topic.qos, schema=schema, log_time_ns=item.stamp_ns,
            )


def _messages(chance: random.Random, source: Path, target: Path) -> None:
    name = chance.choice(list(_TYPES))
    seed = chance.random()

    def edit(topic: Any, data: bytes) -> bytes:
        if topic.message_type != name:
            return data
        same = random.Random(seed)
        if same.random() < 0.15:
            # the writer needs at least the header of CDR
            return data[: same.randrange(4, len(data))]
        message = deserialize_message(data, _TYPES[name])
        for _ in range(same.choice((1, 1, 1, 2, 3))):
            change(same, message)
        return serialize_message(message)

    _copied(source, target, edit=edit)


def change(chance: random.Random, message: Any) -> None:
    """Set a field, at any depth, to another value of its type."""
    name = chance.choice(list(message.get_fields_and_field_types()))
    value = getattr(message, name)
    if isinstance(value, list) and value and hasattr(value[0], 'get_fields_and_field_types'):
        if chance.random() < 0.2:
            setattr(message, name, [])
            return
        value = chance.choice(value)
    if hasattr(value, 'get_fields_and_field_types'):
        change(chance, value)
        return
    # rclpy refuses some values
    with suppress(AssertionError, OverflowError, TypeError, ValueError, UnicodeError):
        setattr(message, name, _other(chance, value))


def _other(chance: random.Random, value: Any) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        limit = 2 ** chance.choice((8, 16, 31, 32))
        return chance.choice(INTEGERS) % limit
    if isinstance(value, float):
        return chance.choice(FLOATS)
    if isinstance(value, str):
        return chance.choice(TEXTS)
    if isinstance(value, array):
        part = value[: chance.randrange(len(value) + 1)]
        pattern = struct.pack('<f', chance.choice((math.nan, math.inf, 3.4e38, -1.0, 0.0)))
        filled = array(value.typecode, (pattern * (len(value) // 4 + 1))[: len(value)])
        return chance.choice((part, filled, value + value, array(value.typecode)))
    return value


def _described(chance: random.Random, source: Path, target: Path) -> None:
    texts = dict(BagReader(source).custom_data)
    names = [*texts, 'effects', 'parameters', 'resumed_from', 'msg_config', 'version']
    texts[chance.choice(names)] = chance.choice(TEXTS)
    _copied(source, target, texts=texts)


def _redefined(chance: random.Random, source: Path, target: Path) -> None:
    _copied(source, target, definition=chance.choice(_DEFINITIONS))


def split(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the opcode and content of each record of a valid file."""
    place = len(MAGIC)
    while place < len(data) - len(MAGIC):
        opcode, length = FRAME.unpack_from(data, place)
        yield opcode, data[place + FRAME.size : place + FRAME.size + length]
        place += FRAME.size + length


def data_section(path: Path) -> list[tuple[int, bytes]]:
    """Return the opcode and content of each record of a valid file before its end and index."""
    return list(takewhile(lambda item: item[0] != Opcode.DATA_END, split(path.read_bytes())))


def joined(records: list[tuple[int, bytes]], end: bytes = MAGIC) -> bytes:
    """Return a file of records, without checksums over the whole."""
    parts = []
    for opcode, content in records:
        if opcode == Opcode.DATA_END:
            content = bytes(DATA_END.size)
        elif opcode == Opcode.FOOTER:
            content = content[:-4] + bytes(4)
        parts.append(FRAME.pack(opcode, len(content)) + content)
    return MAGIC + b''.join(parts) + end


def chunk(
    records: bytes, *, compression: str = 'zstd', size: int | None = None, times: bytes = bytes(16)
) -> bytes:
    """Return the content of a chunk record."""
    packed = {
        '': lambda: records,
        'lz4': lambda: lz4.frame.compress(records, store_size=False),
        'zstd': lambda: zstandard.compress(records),
    }[compression]()
    size = len(records) if size is None else size
    head = times + struct.pack('<QII', size, zlib.crc32(records), len(compression))
    return head + compression.encode() + struct.pack('<Q', len(packed)) + packed


def _set(chance: random.Random, content: bytes) -> bytes:
    """Return content of the same length with one number changed, mostly near its start."""
    width = chance.choice((1, 2, 4, 8))
    if len(content) < width:
        return content
    near = chance.random() < 0.8
    place = chance.randrange(min(len(content) - width, 60 if near else len(content)) + 1)
    number = chance.choice(INTEGERS) % 2 ** (8 * width)
    return content[:place] + number.to_bytes(width, 'little') + content[place + width :]


def _records(chance: random.Random, source: Path, target: Path) -> None:
    data = (source / f'{source.name}_0.mcap').read_bytes()
    records = list(split(data))
    for _ in range(chance.choice((1, 1, 2, 4))):
        index = chance.randrange(len(records))
        opcode, content = records[index]
        draw = chance.random()
        if opcode == Opcode.CHUNK and draw < 0.7:
            inner = zstandard.decompress(content[content.index(b'\x28\xb5\x2f\xfd') :], 2**24)
            parts = list(split(MAGIC + inner + MAGIC))
            place = chance.randrange(len(parts))
            parts[place] = parts[place][0], _set(chance, parts[place][1])
            again = joined(parts, b'')[len(MAGIC) :]
            compression = chance.choice(('', 'lz4', 'zstd'))
            records[index] = opcode, chunk(again, compression=compression, times=content[:16])
        elif draw < 0.8:
            records[index] = opcode, _set(chance, content)
        elif draw < 0.87:
            records.insert(chance.randrange(len(records)), records[index])
        elif draw < 0.93:
            del records[index]
        else:
            records[index] = chance.randrange(256), content
    again = joined(records)
    if chance.random() < 0.3:
        again = again[: chance.randrange(len(MAGIC), len(again))]
    target.mkdir()
    (target / f'{target.name}_0.mcap').write_bytes(again)
