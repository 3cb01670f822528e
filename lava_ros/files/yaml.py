# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""YAML and JSON of untrusted origin as plain data of bounded size, and YAML from plain data."""

from functools import partial
import json
from pathlib import Path
import re
from typing import Any, ClassVar

import yaml

from lava_ros.errors import LavaError, MAX_VALUE_LENGTH, one_line, refusing, Typed
from lava_ros.files import open_input

#: Maximum size of a text [bytes].
MAX_BYTES = 16 * 2**20

#: Maximum number of values; those of an alias count each time.
MAX_VALUES = 500_000

#: Maximum nesting of lists and mappings.
MAX_DEPTH = 50

#: Maximum length of a number [characters].
MAX_DIGITS = 100


def read_yaml(field: str, path: str | Path, expected: str = 'a readable YAML file') -> Any:
    """Read a YAML file as plain data.

    Args:
        field: Name of the field in errors.
        path: Path of the file.
        expected: Description of a valid file in errors, which the reason follows in brackets.

    Raises:
        LavaError: If the file cannot be read, or as in ``parse_yaml``.
    """
    with refusing(field, str(path), expected, OSError, ValueError), open_input(path) as file:
        data = file.read(MAX_BYTES + 1)
    try:
        text = data.decode()
    except UnicodeDecodeError:
        raise LavaError(field, str(path), f'{expected}; this is not text in UTF-8') from None
    return parse_yaml(field, text, expected, value=str(path))


def parse_yaml(field: str, text: str, expected: str = 'YAML', *, value: str | None = None) -> Any:
    """Parse YAML into plain data; dates stay text, and errors show ``value`` instead of the text.

    Floats follow YAML 1.2, so ``1e3`` is a number.

    Raises:
        LavaError: If the text is not YAML or exceeds a limit; or if it has a Python tag, a value
            that does not fit its tag, a value that contains itself, or a value that YAML 1.1 reads
            differently from how it is written, such as ``010``, ``1:30`` or ``no``.
    """
    source = '' if value is None else f' of {value}'
    value = text if value is None else value
    if len(text) > MAX_BYTES:
        raise LavaError(field, value, f'{expected} (at most {MAX_BYTES} bytes)')
    try:
        return yaml.load(text, partial(_Loader, field=field, source=source))
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        where = f' in {_place(mark)}' if mark else ''
        parts = (getattr(error, 'context', None), getattr(error, 'problem', None))
        reason = one_line(', '.join(filter(None, parts)) or str(error), MAX_VALUE_LENGTH)
        raise LavaError(field, value, f'{expected} ({reason}{where})') from error


def dump_yaml(data: Any, **options: Any) -> str:
    """Convert plain data to YAML that ``parse_yaml`` reads as the same data.

    Text is quoted where YAML 1.1 or 1.2 would read it as another type. ``options`` are further
    arguments of ``yaml.dump``.
    """
    try:
        text: str = yaml.dump(data, Dumper=_QuickDumper, sort_keys=False, **options)
    except UnicodeEncodeError:
        # LibYAML does not write names of files that are not UTF-8
        text = yaml.dump(data, Dumper=_Dumper, sort_keys=False, **options)
    return text


def parse_json(field: str, text: str | bytes) -> Any:
    """Parse JSON into plain data.

    Raises:
        LavaError: If the text is not JSON or too deep, or if a number is not finite or has more
            than ``MAX_DIGITS`` digits.
    """
    with refusing(field, text, 'JSON'):
        # JSON has no aliases, so that the text bounds the size
        return json.loads(text, parse_int=_integer, parse_constant=_integer)


def _integer(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise ValueError(f'a number of more than {MAX_DIGITS} characters')
    # raises ValueError for NaN and Infinity
    return int(text)


#: Floats of the core schema of YAML 1.2. PyYAML needs a point, and a sign of the exponent: for it
#: 1e3 and 1.0e9 are text, and so is -.5. Whole numbers are not of this form.
_FLOAT = re.compile(r'[-+]?(\.[0-9]+|[0-9]+\.[0-9]*|[0-9]+(?=[eE]))([eE][-+]?[0-9]+)?\Z')

#: Integers that are not decimal in YAML 1.1: 010 is 8, 0x1F is 31.
_OTHER_BASE = re.compile(r'([-+]?)0([0-9_]+|[bx].*)')


def _place(mark: Any) -> str:
    return f'line {mark.line + 1}, column {mark.column + 1}'


class _Loader(yaml.SafeLoader):
    """The safe loader with limits on size and nesting; ``field`` of ``source`` is for errors."""

    yaml_implicit_resolvers: ClassVar[Any] = {
        first: [item for item in resolvers if item[0] != 'tag:yaml.org,2002:timestamp']
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def __init__(self, text: str, field: str, source: str) -> None:
        super().__init__(text)
        self._field, self._source = field, source
        # keys and indices of the enclosing values
        self._place: list[str] = []
        self._depth = self._deepest = self._values = 0
        # number of values and levels of each complete node with an anchor
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
        if self._values > MAX_VALUES:
            wrong = f'more than {MAX_VALUES} values, those of an alias counted each time,'
        elif self._deepest > MAX_DEPTH:
            wrong = f'more than {MAX_DEPTH} levels of lists and mappings'
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
        """Raise LavaError for a plain scalar that YAML 1.1 reads differently."""
        kind, typed = node.tag.rpartition(':')[2], node.value
        expected = ''
        if has_tag or len(typed) > MAX_DIGITS:
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
            field = ''.join([self._field, *self._place])
            place = f'{_place(node.start_mark)}{self._source}'
            raise LavaError(field, typed, f'{expected} ({place})')

    def compose_mapping_node(self, anchor: Any) -> Any:
        node = super().compose_mapping_node(anchor)
        known = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in known:
                    expected = f'the key {key.value} twice'
                    raise yaml.composer.ComposerError(None, None, expected, key.start_mark)
                known.add((key.tag, key.value))
        return node

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        kind = node.tag.rpartition(':')[2]
        if kind in ('int', 'float') and len(node.value) > MAX_DIGITS:
            wrong = f'a number of more than {MAX_DIGITS} characters'
            raise yaml.constructor.ConstructorError(None, None, wrong, node.start_mark)
        try:
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            wrong = f'a value that is not of type {kind}'
            raise yaml.constructor.ConstructorError(None, None, wrong, node.start_mark) from error


def _float_as_typed(loader: _Loader, node: yaml.ScalarNode) -> float:
    """Return a float with its text, which errors show."""
    return Typed(loader.construct_yaml_float(node), node.value)


def _plain_float(dumper: Any, value: Typed) -> yaml.ScalarNode:
    node: yaml.ScalarNode = dumper.represent_float(float(value))
    return node


class _Dumper(yaml.SafeDumper):
    """The safe dumper, which also quotes text that the loader would read as a number."""


class _QuickDumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """The same dumper in C (LibYAML), which takes a tenth of the time, if PyYAML includes it."""


for _kind in (_Loader, _Dumper, _QuickDumper):
    _kind.add_implicit_resolver('tag:yaml.org,2002:float', _FLOAT, list('-+.0123456789'))
_Loader.add_constructor('tag:yaml.org,2002:float', _float_as_typed)
# programs that dump the plain data of a scene use the dumper of PyYAML
for _kind in (yaml.SafeDumper, _Dumper, _QuickDumper):
    _kind.add_representer(Typed, _plain_float)
