# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The one exception this package raises for bad input."""

import reprlib
from typing import Any

#: Longest text of a value in a message [characters]; of a longer one the middle is left out.
LONGEST_VALUE = 120

#: Longest name of what is wrong [characters]: it may have a path, which is of no use cut.
LONGEST_FIELD = 400

#: Longest text of what would be right [characters]: it may quote the error of a library.
LONGEST_EXPECTED = 1000

#: Integers of more bits are not printed: Python itself refuses those of 4,300 digits.
LONGEST_INTEGER = 1024


class LavaError(ValueError):
    """Input that cannot be used.

    The message is one sentence that names the field, the value and what would be right, so that a
    node can log it and a command can print it as it is.

    Attributes:
        field: Dotted name of what is wrong, for example ``vents[0].discharge``.
        value: The offending value; None: it is missing.
        expected: What would be right, as a phrase.
    """

    def __init__(self, field: str, value: object, expected: str) -> None:
        """Compose the sentence from its three parts."""
        self.field = field
        self.value = value
        self.expected = expected
        shown = 'missing' if value is None else _cut(_Shown().repr(value), LONGEST_VALUE)
        right = one_line(expected, LONGEST_EXPECTED)
        super().__init__(f'{one_line(field, LONGEST_FIELD)} is {shown}, expected {right}')

    def __reduce__(self) -> tuple[type['LavaError'], tuple[str, object, str]]:
        """Make it again in another process, which raises it there as it was raised here."""
        return type(self), (self.field, self.value, self.expected)


class _Shown(reprlib.Repr):
    """What ``repr`` gives, made of no more parts of a value than a message can show."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 3
        self.maxlist = self.maxtuple = self.maxset = self.maxfrozenset = self.maxdict = 10
        self.maxstring = self.maxlong = self.maxother = LONGEST_VALUE

    def repr_int(self, x: int, level: int) -> str:
        if x.bit_length() > LONGEST_INTEGER:
            return f'<integer of {x.bit_length()} bits>'
        return super().repr_int(x, level)

    def repr_bytes(self, x: Any, level: int) -> str:
        return self.repr_str(x, level)


def one_line(text: str, longest: int) -> str:
    """Return a text on one line, cut to a length: a key of a file may have any."""
    text = _cut(text, longest)
    if not text.isprintable():
        text = _cut(printable(' '.join(text.split())), longest)
    return text


def printable(text: str) -> str:
    """Return a text with its control characters, but ends of lines and tabs, as escapes."""
    if text.replace('\n', '').replace('\t', '').isprintable():
        return text
    return ''.join(
        item if item.isprintable() or item in '\n\t' else ascii(item)[1:-1] for item in text
    )


def _cut(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    # of a path the end says most
    half = (longest - 3) // 2
    return f'{text[:half]}...{text[-half:]}'
