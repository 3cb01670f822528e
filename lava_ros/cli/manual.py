# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The parser of `lava`: help that reads like a page of a manual, errors in one sentence."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from difflib import get_close_matches
import re
import sys
import textwrap
from types import ModuleType
from typing import Any, NoReturn

from lava_ros.errors import LONGEST_EXPECTED, one_line

#: Column at which the summaries of commands begin.
SUMMARY_COLUMN = 17

#: Widest line of the page.
WIDTH = 88

PAGE_END = """\
EXAMPLES
    lava demo                                     watch lava flow down a mountain
    lava node --ros-args -p scene:=etna.yaml      simulate a scene, in the ROS graph
    lava feed --terrain etna.tif                  give the node terrain and a vent
    lava watch                                    see the running node in the browser
    lava replay bags/demo --rate 10               see it again, ten times as fast
    lava doctor                                   find out what is missing here

ENVIRONMENT
    ROS_DOMAIN_ID                   which ROS graph to join
    ROS_AUTOMATIC_DISCOVERY_RANGE   LOCALHOST keeps the graph on this machine
    WARP_CACHE_PATH                 where compiled kernels are kept

EXIT STATUS
    0 when it went well, 1 when something failed, 2 for input that cannot be used,
    130 after Ctrl+C.

SEE ALSO
    'lava COMMAND --help' says more about a command.
"""

# What argparse says, and what people say.
_PLAIN = (
    (r'^the following arguments are required: (.*)', r'\1 is missing'),
    (r'^argument COMMAND: ', ''),
    (r'^argument ', ''),
    (r"invalid float value: (.*)", r'\1 is not a number'),
    (r"invalid int value: (.*)", r'\1 is not a whole number'),
)

# What argparse says of a word that is none of some; versions quote these differently.
_CHOICES = re.compile(r"invalid choice: '(.*)' \(choose from (.*)\)", re.DOTALL)


class Parser(argparse.ArgumentParser):
    """Prints an error as one sentence, with what to do about it.

    Attributes:
        commands: The parsers of its commands, by name.
    """

    def __init__(self, **options: Any) -> None:
        """Take what ``ArgumentParser`` takes."""
        super().__init__(**options)
        self.commands: dict[str, Parser] = {}

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and where to read more, and exit with status 2."""
        for pattern, plain in _PLAIN:
            message = re.sub(pattern, plain, message)
        message = _CHOICES.sub(self._plain_choice, message)
        # it quotes words as they were typed, of any length
        message = one_line(message, LONGEST_EXPECTED)
        hint = f"'{self.prog} --help' lists what it takes"
        print(f'{self.prog}: {message}; {hint}', file=sys.stderr)
        sys.exit(2)

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse, and name the options that are closest to those that are unknown."""
        words = sys.argv[1:] if args is None else args
        if words and words[0].startswith('-') and words[0] not in self._option_string_actions:
            # Without this the error would be that there is no command.
            self._refuse(words[0])
        parsed, unknown = self.parse_known_args(args, namespace)
        if unknown:
            self.commands.get(parsed.command, self)._refuse(unknown[0])
        return parsed

    def _plain_choice(self, found: re.Match[str]) -> str:
        word, known = found[1], re.findall(r"[^\s,']+", found[2])
        what = 'a command' if known == list(self.commands) else 'known'
        close = _closest(word, known) or f'; there are {", ".join(known)}'
        return f"'{word}' is not {what}{close}"

    def _refuse(self, word: str) -> NoReturn:
        known = list(self._option_string_actions)
        self.error(f'{word!r} is not known here{_closest(word, known)}')


class Manual(Parser):
    """The parser in front of the commands."""

    def __init__(
        self, *, prog: str, description: str, groups: Sequence[tuple[str, Sequence[ModuleType]]]
    ) -> None:
        """Declare the commands: headings, each with the modules of its commands.

        A command is named after its module, and the first line of the module's docstring
        summarises it. The module has ``add_arguments(parser)`` and ``run(args)``. ``run`` returns
        the exit status, and raises LavaError for arguments and files that cannot be used.
        """
        super().__init__(prog=prog, description=description)
        subparsers = self.add_subparsers(
            dest='command', metavar='COMMAND', required=True, parser_class=Parser
        )
        self._lines: list[str] = []
        for heading, modules in groups:
            self._lines.append(f'  {heading}')
            for module in modules:
                name = module.__name__.rpartition('.')[2].replace('_', '-')
                first = (module.__doc__ or '.').splitlines()[0].rstrip('.')
                summary = first[:1].lower() + first[1:]
                command = subparsers.add_parser(name, description=module.__doc__, help=summary)
                module.add_arguments(command)
                command.set_defaults(run=module.run)
                self.commands[name] = command
                self._lines += textwrap.wrap(
                    summary,
                    WIDTH,
                    initial_indent=f'    {name} '.ljust(SUMMARY_COLUMN),
                    subsequent_indent=' ' * SUMMARY_COLUMN,
                )

    def format_help(self) -> str:
        """The page."""
        lines = ['NAME', f'    {self.prog} - {self.description}', '']
        lines += ['SYNOPSIS', f'    {self.prog} COMMAND [argument ...]']
        lines += [f'    {self.prog} --version | --help', '', 'COMMANDS', *self._lines]
        return '\n'.join(lines) + '\n\n' + PAGE_END

    def format_usage(self) -> str:
        """The synopsis in a line."""
        return f'usage: {self.prog} COMMAND [argument ...]\n'


def _closest(word: str, known: list[str]) -> str:
    close = get_close_matches(word.split('=')[0], known, 1)
    return f', {close[0]!r} is the closest' if close else ''
