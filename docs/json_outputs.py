# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write schemas/json_*.schema.json and docs/json.md: `python docs/json_outputs.py`."""

from collections.abc import Iterator
import json
from pathlib import Path
import re

from json_parts import Schema
from json_shapes import COMMANDS, FOLDER, SHARED

PAGE = Path(__file__).with_name('json.md')


def schema(command: str) -> Schema:
    """Return the schema of the JSON of a command."""
    version = {'version': {'const': 1, 'description': 'Version of this format'}}
    shapes = []
    for shape in COMMANDS[command]:
        properties = {**version, **shape['properties']}
        shapes.append({
            **shape, 'properties': properties, 'required': ['version', *shape['required']]
        })
    whole = shapes[0] if len(shapes) == 1 else {'anyOf': shapes}
    title = f'JSON of lava {command}'
    return {'$schema': 'http://json-schema.org/draft-07/schema#', 'title': title, **whole}


def path(command: str) -> Path:
    """Return the path of the schema of a command."""
    return FOLDER / f'json_{command.replace(" ", "_")}.schema.json'


def rows(shape: Schema, before: str = '') -> Iterator[tuple[str, str, str]]:
    """Yield key, type and meaning of each value of a schema, with its parts after it."""
    for name, value in shape.get('properties', {}).items():
        optional = '' if name in shape['required'] else ', optional'
        heading = _heading(value)
        meaning = value.get('description', '')
        if heading:
            link = f'[below](#{heading.lower().replace(" ", "-")})'
            meaning = f'{meaning}: {link}'
        yield f'{before}{name}', _kind(value) + optional, meaning
        if not heading:
            yield from parts(value, f'{before}{name}.')


def parts(value: Schema, before: str) -> Iterator[tuple[str, str, str]]:
    """Yield the rows of the parts of a value, whose keys begin with those before it."""
    yield from rows(value, before)
    for choice in value.get('anyOf', ()):
        yield from parts(choice, before)
    if isinstance(item := value.get('items'), dict):
        yield from parts(item, f'{before.removesuffix(".")}[].')
    if isinstance(item := value.get('additionalProperties'), dict):
        yield from parts(item, f'{before}NAME.')


def _heading(value: Schema) -> str:
    """Return the heading under which the page describes a shared shape, or an empty text."""
    choices = [value, *value.get('anyOf', ())]
    return next((
        heading for heading, shape in SHARED.items()
        if any(
            item.get(key) is shape.get(key) is not None
            for item in choices for key in ('properties', 'items')
        )
    ), '')


def _kind(value: Schema) -> str:
    """Return the type of a value in words."""
    if 'anyOf' in value:
        return ', '.join(_kind(item) for item in value['anyOf'])
    if 'const' in value:
        return json.dumps(value['const'])
    if 'enum' in value:
        return ', '.join(map(str, value['enum']))
    types = value.get('type', 'any')
    return types if isinstance(types, str) else ', '.join(types)


def table(shape: Schema) -> str:
    """Return the keys of a schema as a Markdown table."""
    lines = ['| key | type | meaning |', '|---|---|---|']
    for name, kind, meaning in parts(shape, ''):
        shown = re.sub(r'([|<*])', r'\\\1', meaning)
        lines.append(f'| `{name}` | {kind} | {shown} |')
    return '\n'.join(lines)


HEAD = '''# JSON of the commands

`--json FILE` writes the result of a command as JSON; without a file it goes to stdout, and all
other output to stderr. [Results](results.md#json-of-the-commands) shows examples.
`docs/json_outputs.py` writes this page and the schemas `schemas/json_*.schema.json`.

- `version` is the version of the format. It increases when a key changes its name or its meaning.
- A number has its unit at the end of its key: `_s`, `_m`, `_m2`, `_m3`, `_k`, `_pa_s`, `_percent`,
  `_bytes`, `_ns`. A number without a unit is a count, or its meaning names it: a fraction,
  a ratio, an index, or a value in the `unit` beside it.
- `null` is an unknown value. Dates are in UTC.
- `[]` in a key is an element of a list, and `NAME` a key that is a name.
'''


def page() -> str:
    """Return the page of all commands."""
    written = [HEAD]
    for command, shapes in COMMANDS.items():
        written.append(f'\n## lava {command}\n')
        for shape in shapes:
            if len(shapes) > 1:
                written.append(f'\n### {shape["description"]}\n')
            written.append(f'\n{table(shape)}\n')
    written += [f'\n## {heading}\n\n{table(shape)}\n' for heading, shape in SHARED.items()]
    return ''.join(written)


def files() -> dict[Path, str]:
    """Return the text of each schema and of the page."""
    return {
        **{path(name): json.dumps(schema(name), indent=1) + '\n' for name in COMMANDS},
        PAGE: page(),
    }


if __name__ == '__main__':
    for name, content in files().items():
        name.write_text(content, encoding='utf-8')
