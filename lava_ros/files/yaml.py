# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""YAML and JSON from anywhere -> plain data of bounded size. What others write is read here."""

import json
from pathlib import Path
import re
from typing import Any, ClassVar

import yaml

from lava_ros.errors import LavaError, LONGEST_VALUE, one_line
from lava_ros.files import open_input

#: Longest text that is read [bytes].
MOST_BYTES = 16 * 2**20

#: Most values, those behind an alias counted wherever it stands.
MOST_VALUES = 500_000

#: Most levels of lists and mappings in each other.
MOST_LEVELS = 50

#: Most characters of a number.
MOST_DIGITS = 100


def read_yaml(field: str, path: str | Path, expected: str = 'a readable YAML file') -> Any:
    """Read a YAML file as plain data; LavaError where ``parse_yaml`` refuses it or none is there.

    ``expected`` describes a right file in errors, followed by the reason in brackets.
    """
    try:
        with open_input(path) as file:
            text = file.read(MOST_BYTES + 1).decode()
    except (OSError, ValueError) as error:
        raise LavaError(field, str(path), f'{expected} ({error})') from error
    return parse_yaml(field, text, expected, value=str(path))


def parse_yaml(field: str, text: str, expected: str = 'YAML', *, value: str | None = None) -> Any:
    """Parse YAML into plain data; errors show ``value`` instead of the text.

    Dates stay text. LavaError where the text is not YAML, or is longer, larger or deeper than
    allowed; or has tags of Python, a value that does not fit its tag, a value that contains
    itself, or a value that YAML 1.1 reads as another one than is written there: ``010``, ``1:30``
    or ``no``.
    """
    source = '' if value is None else f' of {value}'
    value = text if value is None else value
    if len(text) > MOST_BYTES:
        raise LavaError(field, value, f'{expected} (at most {MOST_BYTES} bytes)')
    try:
        return yaml.load(text, _Loader)
    except _MisreadError as error:
        mark = error.problem_mark
        place = f'line {mark.line + 1}, column {mark.column + 1}{source}'
        raise LavaError(field + error.place, error.typed, f'{error.problem} ({place})') from error
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        where = f' in line {mark.line + 1}, column {mark.column + 1}' if mark else ''
        parts = (getattr(error, 'context', None), getattr(error, 'problem', None))
        reason = one_line(', '.join(filter(None, parts)) or str(error), LONGEST_VALUE)
        raise LavaError(field, value, f'{expected} ({reason}{where})') from error


def parse_json(field: str, text: str | bytes) -> Any:
    """Parse JSON into plain data; numbers are finite and of no more than ``MOST_DIGITS`` digits.

    LavaError also where the text is too deep or no JSON.
    """
    try:
        # without aliases it is as large as its text
        return json.loads(text, parse_int=_integer, parse_constant=_integer)
    except (ValueError, RecursionError) as error:
        raise LavaError(field, text, f'JSON ({error})') from error


def _integer(text: str) -> int:
    if len(text) > MOST_DIGITS:
        raise ValueError(f'a number of more than {MOST_DIGITS} characters')
    # NaN and Infinity are none
    return int(text)


#: Integers that YAML 1.1 does not read as decimal numbers: 010 is 8, 0x1F is 31.
_OTHER_BASE = re.compile(r'([-+]?)0([0-9_]+|[bx].*)')


class _MisreadError(yaml.composer.ComposerError):
    """A value that YAML 1.1 reads as another one than is written there.

    ``place`` is its place below the document, such as ``.vents[0].discharge``.
    """

    def __init__(self, place: str, typed: str, expected: str, mark: Any) -> None:
        super().__init__(None, None, expected, mark)
        self.place, self.typed = place, typed


class _Loader(yaml.SafeLoader):
    """The safe loader, which stops where a text would become more than is allowed."""

    yaml_implicit_resolvers: ClassVar[Any] = {
        first: [item for item in resolvers if item[0] != 'tag:yaml.org,2002:timestamp']
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def __init__(self, text: str) -> None:
        super().__init__(text)
        # keys and indices of the values around the present one
        self._place: list[str] = []
        self._depth = self._deepest = self._values = 0
        # values and levels of what has an anchor, once its end is read
        self._sizes: dict[str, tuple[int, int]] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        event: Any = self.peek_event()
        is_alias = isinstance(event, yaml.AliasEvent)
        wrong = ''
        if is_alias and event.anchor in self.anchors and event.anchor not in self._sizes:
            wrong = 'an alias inside the value that it refers to'
        values, levels = self._sizes.get(event.anchor, (1, 1)) if is_alias else (1, 1)
        before, outer = self._values, self._deepest
        self._values += values
        self._deepest = self._depth + levels
        if self._values > MOST_VALUES:
            wrong = f'more than {MOST_VALUES} values, those behind aliases counted each time,'
        elif self._deepest > MOST_LEVELS:
            wrong = f'more than {MOST_LEVELS} levels of lists and mappings'
        if wrong:
            raise yaml.composer.ComposerError(None, None, wrong, event.start_mark)
        self._depth += 1
        if parent is not None:
            key = index.value if isinstance(index, yaml.ScalarNode) else index
            # a key has no index
            place = '' if key is None else f'[{key}]' if isinstance(key, int) else f'.{key}'
            self._place.append(place)
        node = super().compose_node(parent, index)
        if isinstance(node, yaml.ScalarNode) and node.style is None and not is_alias:
            self._check_plain(node, event.tag is not None)
        if parent is not None:
            self._place.pop()
        self._depth -= 1
        if event.anchor and not is_alias:
            self._sizes[event.anchor] = self._values - before, self._deepest - self._depth
        self._deepest = max(self._deepest, outer)
        return node

    def _check_plain(self, node: Any, has_tag: bool) -> None:
        """Refuse a plain scalar that YAML 1.1 reads as another value than is written there."""
        kind, typed = node.tag.rpartition(':')[2], node.value
        expected = ''
        if has_tag or len(typed) > MOST_DIGITS:
            return
        if kind in ('int', 'float') and ':' in typed:
            expected = 'a number such as 90, or text in quotes: YAML 1.1 reads 1:30 as 90'
        elif kind == 'int' and (other := _OTHER_BASE.fullmatch(typed)):
            read = self.construct_yaml_int(node)
            digits = other[2].lstrip('0_') or '0'
            meant = str(read) if digits[0] in 'bx' else other[1] + digits
            expected = f'{meant}, or text in quotes: YAML 1.1 reads it as {read}'
        elif kind == 'bool' and typed.lower() not in ('true', 'false'):
            meant = str(self.construct_yaml_bool(node)).lower()
            expected = f'{meant}, or text in quotes: YAML 1.1 reads it as {meant}'
        if expected:
            raise _MisreadError(''.join(self._place), typed, expected, node.start_mark)

    def compose_mapping_node(self, anchor: Any) -> Any:
        node = super().compose_mapping_node(anchor)
        known = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in known:
                    right = f'the key {key.value} twice'
                    raise yaml.composer.ComposerError(None, None, right, key.start_mark)
                known.add((key.tag, key.value))
        return node

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        kind = node.tag.rpartition(':')[2]
        wrong = ''
        if kind in ('int', 'float') and len(node.value) > MOST_DIGITS:
            wrong = f'a number of more than {MOST_DIGITS} characters'
        if wrong:
            raise yaml.constructor.ConstructorError(None, None, wrong, node.start_mark)
        try:
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            right = f'a value that is no {kind}'
            raise yaml.constructor.ConstructorError(None, None, right, node.start_mark) from error
