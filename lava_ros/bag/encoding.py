# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages as plain data, and their serialisation to CDR, without rclpy.

Numbers are little-endian and aligned to their own size, counted from the end of the encapsulation
header (OMG DDS-XTypes 1.3, section 7.4.1.1, plain CDR version 1).
"""

from collections.abc import Mapping, Sequence
from functools import cache
import struct
from typing import Any, NamedTuple

import numpy as np

from lava_ros.bag.schemas import Field, fields_of, message_schema, SEPARATOR

#: numpy type of each primitive type of a definition.
_NUMBERS = {
    'bool': '?', 'byte': 'u1', 'char': 'u1', 'float32': '<f4', 'float64': '<f8',
    **{f'{sign}int{8 * size}': f'<{kind}{size}'
       for sign, kind in (('', 'i'), ('u', 'u')) for size in (1, 2, 4, 8)},
}

#: Encapsulation header of little-endian CDR.
_LITTLE_ENDIAN = b'\0\1\0\0'


class Message(NamedTuple):
    """A message as plain data.

    Attributes:
        kind: Its type, such as ``sensor_msgs/msg/Image``.
        fields: Values by field name; nested messages are mappings, and arrays of numbers are numpy
            arrays. A missing field has its default value.
    """

    kind: str
    fields: Mapping[str, Any]


def encode(message: Message) -> bytes:
    """Serialise a message to CDR.

    Raises:
        LavaError: If the type of the message is not known.
    """
    encoder = _Encoder(_definitions(message.kind))
    encoder.add_fields(message.kind.replace('/msg/', '/'), message.fields)
    return _LITTLE_ENDIAN + bytes(encoder.data)


@cache
def _definitions(kind: str) -> dict[str, list[Field]]:
    """Return the fields of a type and of its dependencies, by names without ``msg``."""
    first, *others = message_schema(kind).text.split(f'\n{SEPARATOR}\n')
    texts = {kind.replace('/msg/', '/'): first}
    for other in others:
        heading, _, text = other.partition('\n')
        texts[heading.removeprefix('MSG: ').strip()] = text
    return {name: fields_of(text, name.partition('/')[0]) for name, text in texts.items()}


class _Encoder:
    """Serialises values one after the other."""

    def __init__(self, definitions: Mapping[str, Sequence[Field]]) -> None:
        self.data = bytearray()
        self._definitions = definitions

    def add_fields(self, kind: str, values: Mapping[str, Any]) -> None:
        """Append the fields of a nested message."""
        for field in self._definitions[kind]:
            value = values.get(field.name)
            if field.length is None:
                self._add(field.kind, field.default if value is None else value)
                continue
            items: Sequence[Any] = () if value is None else value
            if not field.length:
                self._add_number('<u4', len(items))
            elif not len(items):
                items = [''] * field.length
            self._add_items(field.kind, items)

    def _add_items(self, kind: str, items: Sequence[Any]) -> None:
        if isinstance(items, np.ndarray):
            # an empty sequence has no alignment
            if items.size:
                numbers = np.ascontiguousarray(items, _NUMBERS[kind])
                self._align(numbers.itemsize)
                self.data += numbers.data.cast('B')
            return
        for item in items:
            self._add(kind, item)

    def _add(self, kind: str, value: Any) -> None:
        """Append a value; an empty text stands for the default value."""
        if kind == 'string':
            text = str(value).encode() + b'\0'
            self._add_number('<u4', len(text))
            self.data += text
        elif kind in _NUMBERS:
            self._add_number(_NUMBERS[kind], value or 0)
        else:
            self.add_fields(kind, value or {})

    def _add_number(self, kind: str, value: Any) -> None:
        number = np.dtype(kind)
        self._align(number.itemsize)
        as_number = float(value) if number.kind == 'f' else int(value)
        self.data += struct.pack(f'<{number.char}', as_number)

    def _align(self, size: int) -> None:
        self.data += bytes(-len(self.data) % size)
