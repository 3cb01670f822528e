# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Declared keys of YAML files: one declaration is the check, the JSON Schema and the reference."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, Field, field
from functools import partial
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError

Schema = dict[str, Any]

#: Check of a value: returns the valid value, or raises LavaError that names the field.
Check = Callable[[str, object], Any]

#: Check of the name of a file.
FILE_NAME = partial(validation.text, expected='the name of a file')

#: Schemas of values that their readers check.
FLAG: Schema = {'type': 'boolean'}
TEXT: Schema = {'type': 'string'}
DATE: Schema = {'type': 'string', 'pattern': r'^\s*\d{4}'}

#: Keyword of JSON Schema for each limit of ``validation.number`` and ``validation.whole``.
_LIMITS = {'above': 'exclusiveMinimum', 'at_least': 'minimum', 'at_most': 'maximum'}


@dataclass(frozen=True)
class Key:
    """A key of a mapping.

    Attributes:
        values: Check of the value: one of ``validation`` with its options, or ``Keys``. If only
            its reader can check it, its schema, or None with ``schema``.
        text: Description for people.
        is_required: True if a file must have the key.
        schema: Schema of the value, or a function that returns it; None for that of the check.
    """

    values: Check | Schema | None = None
    text: str = ''
    is_required: bool = False
    schema: Schema | Callable[[], Schema] | None = None

    @property
    def check(self) -> Check | None:
        """Check of the value; None if only its reader can check it."""
        return self.values if callable(self.values) else None

    def as_schema(self) -> Schema:
        """Return the JSON Schema of the value."""
        own = self.schema() if callable(self.schema) else self.schema
        if own is None:
            assert self.values is not None
            own = schema_of(self.values) if callable(self.values) else self.values
        return {'description': self.text, **own} if self.text else own

    @classmethod
    def of_field(cls, item: Field[Any]) -> 'Key':
        """Return the key of a field declared by ``effect.number``, ``choice`` or ``flag``."""
        about = item.metadata
        text = about['text'] + (f' [{about["unit"]}]' if about.get('unit') else '')
        if 'limits' in about:
            least, most = about['limits']
            limits = {'at_least': least, 'at_most': most, 'unit': about.get('unit', '')}
            return cls(partial(validation.number, **limits), text)
        if 'choices' in about:
            return cls(partial(validation.choice, allowed=about['choices']), text)
        return cls(validation.flag, text)


@dataclass(frozen=True)
class Keys:
    """All keys of a mapping in a file; it is a check itself.

    Attributes:
        keys: The keys by name.
        conditions: Conditions on the mapping, of ``either``, which the reader checks.
    """

    keys: Mapping[str, Key]
    conditions: tuple[Schema, ...] = field(default=())

    def names(self, where: str, value: object) -> dict[str, Any]:
        """Return a mapping after a check of its keys, not of its values.

        Raises:
            LavaError: If the value is not a mapping with these keys, or a key has no value.
        """
        required = [name for name, key in self.keys.items() if key.is_required]
        found = validation.keys(where, value, allowed=self.keys, required=required)
        for name in (name for name, item in found.items() if item is None):
            if (check := self.keys[name].check) is not None:
                check(f'{where}.{name}', None)
            raise LavaError(f'{where}.{name}', None, 'a value; to leave it out, leave out the key')
        return found

    def values(self, where: str, data: Mapping[str, Any]) -> dict[str, Any]:
        """Return valid values in place of those of a mapping; others have no check here.

        Raises:
            LavaError: If a value is not valid.
        """
        checks = {name: self.keys[name].check for name in data if name in self.keys}
        return {
            name: data[name] if (check := checks.get(name)) is None
            else check(f'{where}.{name}', data[name])
            for name in data
        }

    def __call__(self, where: str, value: object) -> dict[str, Any]:
        """Return a mapping after a check of its keys and values; raise LavaError for bad data."""
        return self.values(where, self.names(where, value))

    def as_schema(self, **more: Any) -> Schema:
        """Return the JSON Schema of the mapping, with ``more`` keywords."""
        properties = {name: key.as_schema() for name, key in self.keys.items()}
        required = [name for name, key in self.keys.items() if key.is_required]
        one = self.conditions[0] if len(self.conditions) == 1 else {}
        several = {'allOf': list(self.conditions)} if len(self.conditions) > 1 else {}
        return {
            'type': 'object', 'additionalProperties': False, 'properties': properties,
            **one, **several, **more, **({'required': required} if required else {}),
        }


def schema_of(check: Check) -> Schema:
    """Return the JSON Schema of the values that a check accepts."""
    if isinstance(check, Keys):
        return check.as_schema()
    options = check.keywords if isinstance(check, partial) else {}
    function: Any = check.func if isinstance(check, partial) else check
    if function is validation.flag:
        return FLAG
    if function is validation.text:
        return TEXT
    if function is validation.choice:
        return {'enum': list(options['allowed'])}
    if function is validation.pair:
        most = options.get('most')
        return list_of(number(at_least=None if most is None else -most, at_most=most), 2, 2)
    kind = {validation.number: 'number', validation.whole: 'integer'}[function]
    limits = {_LIMITS[name]: value for name, value in options.items() if name in _LIMITS}
    return {'type': kind} | {name: value for name, value in limits.items() if value is not None}


def number(**limits: float | None) -> Schema:
    """Return the schema of a number within the limits of ``validation.number``."""
    return schema_of(partial(validation.number, **limits))  # type: ignore[arg-type]


def list_of(item: Schema, least: int = 0, most: int | None = None) -> Schema:
    """Return the schema of a list."""
    limits = {'minItems': least} if most is None else {'minItems': least, 'maxItems': most}
    return {'type': 'array', 'items': item, **limits}


def any_of(*schemas: Schema) -> Schema:
    """Return the schema of values of several kinds."""
    return {'anyOf': list(schemas)}


def either(*names: str, optional: bool = False) -> Schema:
    """Return a condition on a mapping: exactly one of some keys, or at most one if optional."""
    options: list[Schema] = [{'required': [name]} for name in names]
    if optional:
        options.append({'not': {'anyOf': list(options)}})
    return {'oneOf': options}


def same_keys(names: Iterable[str], values: Check | Schema, **more: Any) -> dict[str, Key]:
    """Return a key for each name, all with the same values."""
    return {name: Key(values, **more) for name in names}
