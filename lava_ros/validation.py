# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of user input: each returns the valid value or raises LavaError."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, MISSING
from datetime import datetime, MAXYEAR, timezone
import math
import re
from typing import Any, TypeVar

from lava_ros.errors import LavaError, RefusalError, Typed, UnknownKeyError

Built = TypeVar('Built')

#: Positive numbers below this count as 0: ratios and powers of them overflow or underflow.
TINY = 1e-100

_DECIMAL_COMMA = re.compile(r'\s*[-+]?\d+,\d+\s*')

#: A number that is followed by a unit, such as 8 m3/s.
_WITH_UNIT = re.compile(r'\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*[A-Za-z%°].*')

#: Minimum similarity of a word and the one that was meant, from 0 to 1.
_SIMILARITY = 0.68


def as_typed(value: object) -> object:
    """Return a value for an error: text that is a finite number becomes that number."""
    with suppress(TypeError, ValueError, OverflowError):
        if isinstance(value, str) and math.isfinite(found := float(value)):
            return Typed(found, value)
    return value


def closest(word: object, known: Iterable[str]) -> str:
    """Return the known word that is most similar to a mistyped one, or an empty text."""
    from difflib import SequenceMatcher

    text = str(word).lower()

    def similarity(item: str) -> float:
        """Compare with a word and with its beginning; a part of the text is similar too."""
        parts = {item.lower(), item.lower()[: len(text)]}
        found = max(SequenceMatcher(None, text, part).ratio() for part in parts)
        return max(found, _SIMILARITY) if len(item) > 2 and item.lower() in text else found

    best = max(known, key=similarity, default='')
    return best if best and similarity(best) >= _SIMILARITY else ''


def meant(word: object, known: Iterable[str]) -> str:
    """Return a remark about the known word that is most similar to a mistyped one, or nothing."""
    best = closest(word, known)
    return f'; did you mean {best}?' if best else ''


def conflict(one: str, other: str) -> RefusalError:
    """Return the error about two arguments that exclude each other."""
    return RefusalError(one, f'{one} and {other} exclude each other', 'Leave out one of them')


def surplus(field: str, reason: str) -> RefusalError:
    """Return the error about a field that does not apply, with the reason as a phrase."""
    return RefusalError(field, f'{field} does not apply {reason}', 'Leave it out')


def dependence(one: str, other: str) -> RefusalError:
    """Return the error about an argument that has no effect without another one."""
    remedy = f'Add {other}, or leave out {one}'
    return RefusalError(one, f'{one} has no effect without {other}', remedy)


def number(
    field: str,
    value: object,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    unit: str = '',
) -> float:
    """Return ``value`` as a finite float inside the given limits.

    Text that represents a number is valid: the cells of tables are text. The result of text or of
    an integer has that text, which the errors of later checks show. A positive number below
    ``TINY`` is read as 0.

    Raises:
        LavaError: If the value is not a finite number or is outside the limits.
    """
    try:
        result = math.nan if isinstance(value, bool | bytes | bytearray) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if 0.0 < result < TINY:
        result = 0.0
    if (
        math.isfinite(result)
        and (above is None or result > above)
        and (at_least is None or result >= at_least)
        and (at_most is None or result <= at_most)
    ):
        # an error of a later check shows 5 as 5, and 1e3 as 1e3
        if isinstance(value, Typed):
            return Typed(result, value.text)
        return Typed(result, str(value)) if isinstance(value, str | int) else result
    suffix = f' {unit}' if unit else ''
    alone = f' in {unit}' if unit else ''
    limits = {'above': above, 'at least': at_least, 'at most': at_most}
    phrases = [f' {word} {limit:g}{suffix}' for word, limit in limits.items() if limit is not None]
    expected = f'a finite number{" and".join(phrases) or alone}'
    slip = _slip(value, at_least, at_most, unit)
    raise LavaError(field, as_typed(value), expected + slip)


def _slip(value: object, least: float | None, most: float | None, unit: str) -> str:
    """Return a remark about a comma, a unit, or a temperature in Celsius; empty without these."""
    if isinstance(value, str) and _DECIMAL_COMMA.fullmatch(value):
        return f', with a decimal point: {value.strip().replace(",", ".")}'
    if isinstance(value, str) and _WITH_UNIT.fullmatch(value):
        return ', without a unit'
    if unit == 'K' and isinstance(value, int | float) and abs(value) < 1e6:
        kelvin = value + 273.15
        if (least is None or kelvin >= least) and (most is None or kelvin <= most):
            return f' ({value:g} Celsius are {kelvin:g} K)'
    return ''


def whole(field: str, value: object, *, at_least: int, at_most: int) -> int:
    """Return ``value`` as an integer inside the given limits.

    Raises:
        LavaError: If the value is not a whole number or is outside the limits.
    """
    try:
        result = number(field, value, at_least=at_least, at_most=at_most)
    except LavaError:
        result = math.nan
    if not result.is_integer():
        raise LavaError(field, value, f'a whole number from {at_least} to {at_most}')
    return int(result)


def pair(
    field: str, value: object, *, unit: str = 'm', most: float | None = None
) -> tuple[float, float]:
    """Return ``value`` as two finite floats between -``most`` and ``most``.

    Raises:
        LavaError: If the value is not a sequence of two such numbers.
    """
    is_array = hasattr(value, 'tolist') and getattr(value, 'ndim', 0) == 1
    is_list = isinstance(value, Sequence) and not isinstance(value, str | bytes | bytearray)
    items: list[object] = list(value) if is_list or is_array else []  # type: ignore[call-overload]
    if len(items) != 2:
        raise LavaError(field, value, f'two numbers [x, y] {unit}')
    least = None if most is None else -most
    x, y = (
        number(f'{field}[{index}]', item, at_least=least, at_most=most, unit=unit)
        for index, item in enumerate(items)
    )
    return x, y


def flag(field: str, value: object) -> bool:
    """Return ``value`` if it is a bool.

    Raises:
        LavaError: If it is not.
    """
    if not isinstance(value, bool):
        raise LavaError(field, value, 'true or false')
    return value


def date(field: str, value: object, other: str = '') -> datetime:
    """Return text in ISO 8601 as a date and time, in UTC unless it has another time zone.

    Every date of files, options and parameters is read here.

    Raises:
        LavaError: If it is not such text. The error expects ``other`` or a date.
    """
    try:
        if not isinstance(value, str):
            raise ValueError
        # Python 3.10 cannot parse the Z
        found = datetime.fromisoformat(value.strip().upper().replace('Z', '+00:00'))
        found = found if found.tzinfo else found.replace(tzinfo=timezone.utc)
        # local times of the first and the last day may have no year
        if not 1 < found.year < MAXYEAR:
            raise ValueError
    except ValueError:
        expected = f'{other}a date such as 2021-09-19T14:10:00Z, in UTC unless it has a time zone'
        raise LavaError(field, value, expected) from None
    return found


def choice(field: str, value: object, allowed: Iterable[str]) -> str:
    """Return ``value`` if it is one of the allowed words.

    Raises:
        LavaError: If it is not.
    """
    words = list(allowed)
    if not isinstance(value, str) or value not in words:
        raise LavaError(field, value, f'one of {", ".join(words)}{meant(value, words)}')
    return value


def text(field: str, value: object, expected: str = 'text') -> str:
    """Return ``value`` if it is text.

    Raises:
        LavaError: If it is not.
    """
    if not isinstance(value, str):
        raise LavaError(field, value, expected)
    return value


def items(
    field: str, value: object, expected: str, *, least: int = 0, most: int | None = None
) -> list[tuple[str, Any]]:
    """Return the items of a list, each after its name in errors.

    Raises:
        LavaError: If ``value`` is not a list of ``least`` to ``most`` items.
    """
    if not isinstance(value, list | tuple) or not least <= len(value) <= (most or len(value)):
        raise LavaError(field, value, expected)
    return [(f'{field}[{index}]', item) for index, item in enumerate(value)]


def keys(
    field: str, value: object, *, allowed: Iterable[str], required: Iterable[str] = ()
) -> dict[str, object]:
    """Return ``value`` as a dict with only allowed keys and all required keys.

    Raises:
        LavaError: If it is not a mapping, a key is unknown, or a required key is missing.
    """
    names = list(allowed)
    if not isinstance(value, Mapping):
        raise LavaError(field, value, f'a mapping with keys {", ".join(names)}')
    for key in value:
        if key not in names:
            expected = f'one of {", ".join(names)}{meant(key, names)}'
            raise UnknownKeyError(f'{field}.{key}', value[key], expected)
    for key in required:
        if key not in value:
            raise LavaError(f'{field}.{key}', None, 'a value: this key is required')
    return dict(value)


def build(kind: type[Built], label: str, data: object) -> Built:
    """Build a dataclass from a mapping with its fields.

    Raises:
        LavaError: If the data are not such a mapping, or a field is not valid. The error names
            ``label`` in place of the name of the class.
    """
    # mypy does not know that the class is a dataclass
    names = {
        item.name: item.default is MISSING and item.default_factory is MISSING
        for item in fields(kind)  # type: ignore[arg-type]
    }
    required = [name for name, has_no_default in names.items() if has_no_default]
    values: dict[str, Any] = keys(label, data, allowed=names, required=required)
    try:
        return kind(**values)
    except LavaError as error:
        _, dot, name = error.field.partition('.')
        raise error.named(label + dot + name) from None
