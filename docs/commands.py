# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write the tables of commands into commands.md and upgrading.md: `python docs/commands.py`."""

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
import re

from lava_ros.cli.options import long_name
from lava_ros.cli.parser import command_line_parser, GROUPS, RENAMED, RENAMED_OPTIONS

PAGE = Path(__file__).with_name('commands.md')

#: The commands of each table of the page.
PARTS = ('simulate', 'before', 'results', 'ros', 'bags', 'check')
JOBS = dict(zip(PARTS, GROUPS.values(), strict=True))

#: Minimum number of commands that have an option of the last table.
MIN_COMMANDS = 3


def command_rows(names: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each command, from the first sentence of its help."""
    yield ('command', 'task', '`--json`')
    for name in names:
        parser = command_line_parser().commands[name]
        summary = (parser.description or '').partition('.\n')[0]
        yield (f'`lava {name}`', summary, 'yes' if '--json' in parser.options else '')


def option_rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each option that several commands have with the same meaning."""
    yield ('option', 'meaning', 'commands')
    found: dict[tuple[str, str], dict[str, str]] = {}
    for names in JOBS.values():
        for name in names:
            for action in command_line_parser().commands[name]._actions:
                if action.option_strings and action.dest != 'help':
                    meaning = _meaning(action)
                    # commands may have different defaults
                    key = _form(action), meaning.partition(' (default')[0]
                    found.setdefault(key, {})[name] = meaning
    for (form, short), users in sorted(found.items()):
        if len(users) >= MIN_COMMANDS:
            full = set(users.values())
            yield (f'`{form}`', full.pop() if len(full) == 1 else short, ', '.join(users))


def renamed_rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each command and each option with another name in earlier versions."""
    yield ('old', 'new')
    for old, new in RENAMED.items():
        yield (f'`lava {old}`', f'`lava {new}`')
    for old, new in RENAMED_OPTIONS.items():
        yield (f'`{old}`', f'`{new}`')


def _form(action: argparse.Action) -> str:
    """Return an option with its value as in the help."""
    name, value = long_name(action.option_strings), action.metavar
    if action.nargs == 0:
        return name
    if isinstance(value, tuple):
        return ' '.join([name, *value])
    if not value:
        value = f'{{{",".join(action.choices)}}}' if action.choices else action.dest.upper()
    return f'{name} [{value}]' if action.nargs == '?' else f'{name} {value}'


def _meaning(action: argparse.Action) -> str:
    text = (action.help or '') % vars(action)
    return re.sub(r'([|<*])', r'\\\1', ' '.join(text.split()))


def table(rows: Iterator[tuple[str, ...]]) -> str:
    """Return a Markdown table; the first row is its head."""
    head, *rest = rows
    lines = [head, ('---',) * len(head), *rest]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)


def tables() -> dict[str, str]:
    """Return the generated parts of the page by name."""
    parts = {name: table(command_rows(names)) for name, names in JOBS.items()}
    parts['options'] = table(option_rows())
    # the page itself describes --help
    _, _, status = (command_line_parser().epilog or '').partition('options. ')
    parts['status'] = re.sub(r'\b[A-Z]+(_[A-Z]+)+\b', r'`\g<0>`', ' '.join(status.split()))
    return parts


def page(text: str, parts: Mapping[str, str]) -> str:
    """Return a page with its generated parts up to date."""
    for name, part in parts.items():
        begin, end = f'<!-- {name}: begin -->\n', f'<!-- {name}: end -->\n'
        before, found, rest = text.partition(begin)
        if not found:
            raise ValueError(f'the page has no part {name}')
        text = f'{before}{begin}\n{part}\n\n{end}{rest.partition(end)[2]}'
    return text


def pages() -> dict[Path, str]:
    """Return the pages with generated tables, up to date."""
    parts = {
        PAGE: tables(), PAGE.with_name('upgrading.md'): {'renamed': table(renamed_rows())},
    }
    return {path: page(path.read_text(encoding='utf-8'), part) for path, part in parts.items()}


if __name__ == '__main__':
    for path, text in pages().items():
        path.write_text(text, encoding='utf-8')
