# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Message definitions and type hashes, from the share directories of installed packages.

``interfaces.json`` has the types of a run's messages, for machines without ROS 2 Jazzy.
"""

from dataclasses import dataclass
from functools import cache
import json
import os
from pathlib import Path
import re
import sys
from typing import NamedTuple

from lava_ros.errors import LavaError, refusing

_TYPE_NAME = re.compile(r'([A-Za-z]\w*)/msg/([A-Za-z]\w*)')

# Type, bound of a string, array suffix, name, and default value of a field or value of a constant.
_FIELD = re.compile(r'\s*([A-Za-z][\w/]*)(?:<=\d+)?(\[[^\]]*\])?\s+([A-Za-z]\w*)\s*(.*?)\s*$')

_PRIMITIVE = re.compile(r'bool|byte|char|float(32|64)|u?int(8|16|32|64)|w?string')

#: Line between the definitions of a type and of its dependencies.
SEPARATOR = '=' * 80


class Field(NamedTuple):
    """A field of a definition; ``length`` is None for a single value, 0 for any number of them.

    ``kind`` is a primitive type, or the name of a message without ``msg``.
    """

    name: str
    kind: str
    length: int | None
    default: str

    @property
    def is_primitive(self) -> bool:
        """True unless the field has a message."""
        return _PRIMITIVE.fullmatch(self.kind) is not None


def fields_of(text: str, package: str) -> list[Field]:
    """Return the fields of a definition, whose package is that of types without one."""
    found = []
    for line in text.splitlines():
        match = _FIELD.match(line.split('#', 1)[0])
        # a constant has a value after an equals sign
        if match is None or match[4].startswith('='):
            continue
        kind, suffix, name, default = match.groups()
        if not _PRIMITIVE.fullmatch(kind):
            owner, _, last = kind.replace('/msg/', '/').rpartition('/')
            kind = f'{owner or package}/{last}'
        size = (suffix or '').strip('[]')
        length = None if suffix is None else int(size) if size.isdigit() else 0
        found.append(Field(name, kind, length, default))
    return found


@dataclass(frozen=True)
class MessageSchema:
    """The definition of a message type, with which any program can decode its messages.

    ``text`` contains the definition of the type, then the definition of each dependency once, in
    the format ``encoding``. The hash is RIHS01.
    """

    name: str
    text: str
    type_hash: str
    encoding: str = 'ros2msg'


def message_schema(message_type: str) -> MessageSchema:
    """Look up a message type such as ``nav_msgs/msg/OccupancyGrid`` among installed packages.

    Packages are searched in ``share`` of each prefix in AMENT_PREFIX_PATH, of the interpreter
    and of each site-packages directory on the import path, then in ``interfaces.json``.

    Raises:
        LavaError: If the name is not a message type, or the type or a dependency is not installed.
    """
    return _message_schema(message_type, _prefixes())


def _prefixes() -> tuple[Path, ...]:
    prefixes = [Path(item) for item in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
    prefixes = [item for item in prefixes if item.is_absolute()]
    prefixes.append(Path(sys.prefix))
    for entry in map(Path, sys.path):
        if entry.name in ('site-packages', 'dist-packages') and len(entry.parts) > 3:
            prefixes.append(entry.parents[2])
    return tuple(dict.fromkeys(prefixes))


@cache
def _message_schema(message_type: str, prefixes: tuple[Path, ...]) -> MessageSchema:
    if not isinstance(message_type, str) or not _TYPE_NAME.fullmatch(message_type):
        raise LavaError('message_type', message_type, 'a name such as nav_msgs/msg/OccupancyGrid')
    package, _, name = message_type.split('/')
    try:
        path = _definition_file(f'{package}/{name}', prefixes)
    except LavaError:
        if (known := _packaged().get(message_type)) is None:
            raise
        return MessageSchema(message_type, **known)
    text = _full_text(f'{package}/{name}', prefixes, set())
    return MessageSchema(message_type, text, _type_hash(message_type, path.with_suffix('.json')))


@cache
def _packaged() -> dict[str, dict[str, str]]:
    """Return text and hash of the types in ``interfaces.json``."""
    text = Path(__file__).with_name('interfaces.json').read_text(encoding='utf-8')
    found: dict[str, dict[str, str]] = json.loads(text)
    return found


def _definition_file(resource: str, prefixes: tuple[Path, ...]) -> Path:
    package, name = resource.split('/')
    for prefix in prefixes:
        path = prefix / 'share' / package / 'msg' / f'{name}.msg'
        if path.is_file():
            return path
    expected = f'a type of an installed package: no share/{package}/msg/{name}.msg under '
    expected += f'{", ".join(map(str, prefixes))}; install {package} or source its workspace'
    raise LavaError('message_type', f'{package}/msg/{name}', expected)


def _full_text(resource: str, prefixes: tuple[Path, ...], seen: set[str]) -> str:
    seen.add(resource)
    text = _definition_file(resource, prefixes).read_text(encoding='utf-8')
    parts = [text]
    known = fields_of(text, resource.split('/')[0])
    for dependency in sorted({item.kind for item in known if not item.is_primitive}):
        if dependency not in seen:
            parts.append(f'\n{SEPARATOR}\nMSG: {dependency}\n')
            parts.append(_full_text(dependency, prefixes, seen))
    return ''.join(parts)


def _type_hash(message_type: str, path: Path) -> str:
    expected = f'a type whose hash is in {path.name} next to its definition, as packages built '
    with refusing('message_type', message_type, f'{expected}for ROS 2 Jazzy have it'):
        hashes = json.loads(path.read_text(encoding='utf-8'))['type_hashes']
        found = {item['type_name']: item['hash_string'] for item in hashes}
        return str(found[message_type])
