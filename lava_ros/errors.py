# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The exception for bad input, sentences about failed imports, and the guard of threads."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import logging
import re
import reprlib
import sys
import threading
import time
from typing import Any

_LOG = logging.getLogger(__name__)

#: Maximum length of a value in a message [characters]; the middle of a longer one is left out.
MAX_VALUE_LENGTH = 120

#: Maximum length of a field name [characters]; the name may contain a path.
MAX_FIELD_LENGTH = 400

#: Maximum length of an expectation [characters]; it may quote the error of a library.
MAX_EXPECTED_LENGTH = 1000

#: Maximum size of a printed integer [bits]; Python does not format more than 4,300 digits.
MAX_INTEGER_BITS = 1024


class Typed(float):
    """A number with the text that a user typed, which errors show.

    The text of a number that was typed in another unit has that unit: 5min, 500 Celsius.
    """

    __slots__ = ('text',)

    text: str

    def __new__(cls, value: float, text: str = '') -> 'Typed':
        """Give a number its text."""
        self = super().__new__(cls, value)
        self.text = text.strip()
        return self

    @property
    def has_unit(self) -> bool:
        """True if the text has a unit."""
        return self.text[-1:].isalpha()


class LavaError(ValueError):
    """Input that cannot be used.

    The message is one sentence with the field, the value and the expectation, which a node can log
    and a command can print unchanged.

    Attributes:
        field: Dotted name of the field, for example ``vents[0].discharge``.
        value: The wrong value; None if it is missing.
        expected: Description of a valid value, as a phrase.
    """

    def __init__(self, field: str, value: object, expected: str) -> None:
        """Compose the sentence from its three parts."""
        self.field = field
        self.value = value
        self.expected = expected
        shown = 'missing' if value is None else _cut(_Shown().repr(value), MAX_VALUE_LENGTH)
        phrase = one_line(expected, MAX_EXPECTED_LENGTH)
        super().__init__(self._sentence(one_line(field, MAX_FIELD_LENGTH), shown, phrase))

    @staticmethod
    def _sentence(field: str, shown: str, expected: str) -> str:
        return f'{field} is {shown}, expected {expected}'

    def named(self, field: str) -> 'LavaError':
        """Return the same error about a field with another name."""
        return type(self)(field, self.value, self.expected)

    def __reduce__(self) -> tuple[type['LavaError'], tuple[str, object, str]]:
        """Return the arguments from which another process rebuilds the exception."""
        return type(self), (self.field, self.value, self.expected)


class UnknownKeyError(LavaError):
    """A key of a mapping that does not exist, with its value, and the keys that do."""

    @staticmethod
    def _sentence(field: str, shown: str, expected: str) -> str:
        return f'{field}: unknown key, expected {expected}'


class RefusalError(LavaError):
    """A request that cannot be met although no value is wrong, such as one without a package.

    Attributes:
        field: Name of the request, such as an option.
        value: The problem, as a sentence without a full stop.
        expected: The remedy, as a sentence without a full stop.
    """

    def __init__(self, field: str, problem: str, remedy: str) -> None:
        """Compose the message from the problem and its remedy."""
        super().__init__(field, problem, remedy)
        texts = one_line(problem, MAX_EXPECTED_LENGTH), one_line(remedy, MAX_EXPECTED_LENGTH)
        self.args = ('{}. {}.'.format(*texts),)


#: Message of the loader about a shared library: its file, and what is wrong.
_LIBRARY = re.compile(r'(\S+\.so[.\d]*): (.+)')


def import_failure(error: BaseException) -> str | None:
    """Return a sentence about a package or a shared library that cannot be imported.

    None is returned for an error of another kind, or about a module of lava_ros.
    """
    cause: BaseException | None = error
    while cause is not None:
        library = _LIBRARY.match(str(cause)) if isinstance(cause, ImportError | OSError) else None
        name = str(getattr(cause, 'name', None) or '') if isinstance(cause, ImportError) else ''
        if library:
            return (
                f'the shared library {printable(library[1])} cannot be loaded for '
                f'{sys.executable} ({printable(library[2])}); if it is one of ROS 2, source the '
                'setup file of ROS 2 in this shell; docs/install.md describes the installation'
            )
        if isinstance(cause, ModuleNotFoundError) and name.partition('.')[0] != 'lava_ros':
            return (
                f'the Python package {name} is not installed for {sys.executable}; '
                'docs/install.md describes the installation'
            )
        # rosidl raises an error of its own if the messages of a package cannot be imported
        is_rosidl = type(cause).__module__.startswith('rosidl')
        cause = cause.__context__ if is_rosidl else None
    return None


@contextmanager
def refusing(
    field: str, value: object, expected: str, *kinds: type[Exception]
) -> Iterator[None]:
    """Raise LavaError for exceptions of some kinds; without kinds, for all that are errors.

    The text of the exception follows ``expected`` in brackets. A LavaError is not changed.
    """
    kinds = kinds or (Exception,)
    try:
        yield
    except (LavaError, MemoryError):
        raise
    except kinds as error:
        reason = str(error) or type(error).__name__
        raise LavaError(field, value, f'{expected} ({reason})') from error


class _Shown(reprlib.Repr):
    """A ``repr`` that reads only as much of a value as a message can show."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 3
        self.maxlist = self.maxtuple = self.maxset = self.maxfrozenset = self.maxdict = 10
        self.maxstring = self.maxlong = self.maxother = MAX_VALUE_LENGTH

    def repr1(self, x: Any, level: int) -> str:
        # the repr of a scalar of numpy names its type
        is_scalar = type(x).__module__ == 'numpy' and getattr(x, 'ndim', None) == 0
        if isinstance(x, Typed):
            return x.text
        return super().repr1(x.item() if is_scalar else x, level)

    def repr_int(self, x: int, level: int) -> str:
        if x.bit_length() > MAX_INTEGER_BITS:
            return f'<integer of {x.bit_length()} bits>'
        return super().repr_int(x, level)

    def repr_bytes(self, x: Any, level: int) -> str:
        return self.repr_str(x, level)


def one_line(text: str, longest: int) -> str:
    """Return a text on one line, shortened to a maximum length [characters]."""
    text = _cut(text, longest)
    if not text.isprintable():
        text = _cut(printable(' '.join(text.split())), longest)
    return text


def printable(text: str) -> str:
    """Return a text with its control characters escaped, except line ends and tabs."""
    if text.replace('\n', '').replace('\t', '').isprintable():
        return text
    return ''.join(
        item if item.isprintable() or item in '\n\t' else ascii(item)[1:-1] for item in text
    )


def _cut(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    # keep the end too: it identifies a path
    half = (longest - 3) // 2
    return f'{text[:half]}...{text[-half:]}'


#: Pause of a thread after an unexpected exception, so that one that recurs does not use the CPU
#: [s].
PAUSE = 0.1

#: Wall time for which an unexpected exception is reported [s].
REPORT_TIME = 10.0


class Guard:
    """Runs the work of a background thread, and reports its unexpected exceptions.

    Attributes:
        name: Name of the thread in reports.
    """

    def __init__(self, name: str, *expected: type[Exception]) -> None:
        """Initialize without an exception; ``expected`` ones are not logged (``run``)."""
        self.name = name
        self._expected: tuple[type[Exception], ...] = LavaError, *expected
        self._newest: tuple[str, float] | None = None

    @property
    def error(self) -> str:
        """Description of an exception of the last ``REPORT_TIME``, empty without one."""
        newest = self._newest
        is_recent = newest is not None and time.monotonic() - newest[1] < REPORT_TIME
        return newest[0] if newest is not None and is_recent else ''

    def run(
        self, work: Callable[[], None], on_error: Callable[[Exception], None] | None = None
    ) -> None:
        """Run ``work``, and handle an exception by ``on_error`` or, without it, by ``error``.

        An exception that is not expected is also logged with its traceback, once while it recurs.
        """
        try:
            try:
                work()
            except Exception as error:
                if on_error is None:
                    raise
                if not isinstance(error, self._expected):
                    self._log(error)
                on_error(error)
        except Exception as error:
            text = f'{self.name}: {type(error).__name__}: {error}'
            if text != self.error:
                self._log(error)
            self._newest = text, time.monotonic()
            threading.Event().wait(PAUSE)

    def _log(self, error: Exception) -> None:
        _LOG.error('%s: %s: %s', self.name, type(error).__name__, error, exc_info=error)
