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
from difflib import get_close_matches
import re
import sys
import textwrap
from typing import Any, NoReturn

#: Column at which the summaries of commands begin.
SUMMARY_COLUMN = 17

#: Widest line of the page.
WIDTH = 88

PAGE_END = """\
EXAMPLES
    lava demo                                     watch lava flow down a mountain
    lava node --ros-args -p scene:=etna.yaml      simulate a scene, in the ROS graph
    lava feed --terrain etna.tif                  give the node terrain and a vent
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


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence, with the way out."""

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and where to read more, and exit with status 2."""
        for pattern, plain in _PLAIN:
            message = re.sub(pattern, plain, message)
        hint = f"'{self.prog} --help' lists what it takes"
        print(f'{self.prog}: {message}; {hint}', file=sys.stderr)
        sys.exit(2)

    def parse_args(self, args=None, namespace=None):  # type: ignore[no-untyped-def]
        """Parse, and name the options that are closest to those that are unknown."""
        words = sys.argv[1:] if args is None else args
        if words and words[0].startswith('-') and words[0] not in self._option_string_actions:
            # Without this the error would be that there is no command.
            self._refuse(words[0])
        parsed, unknown = self.parse_known_args(args, namespace)
        if unknown:
            self._commands().get(parsed.command, self)._refuse(unknown[0])
        return parsed

    def _refuse(self, word: str) -> NoReturn:
        known = list(self._option_string_actions)
        self.error(f'{word!r} is not known here{_closest(word, known)}')

    def _commands(self) -> dict[str, Parser]:
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                return action.choices
        return {}

    def _check_value(self, action: argparse.Action, value: str) -> None:
        if action.choices is not None and value not in action.choices:
            words = [str(word) for word in action.choices]
            what = 'a command' if isinstance(action, argparse._SubParsersAction) else 'known'
            close = _closest(str(value), words) or f'; there are {", ".join(words)}'
            raise argparse.ArgumentError(action, f'{value!r} is not {what}{close}')


class Manual(Parser):
    """The parser in front of the commands."""

    def __init__(self, *, prog: str, description: str) -> None:
        """Begin a page without commands."""
        super().__init__(prog=prog, description=description)
        self._headings: list[tuple[str, int]] = []

    def add_subparsers(self, **options: Any) -> Any:
        """Add the commands: parsers that are no pages of their own."""
        self._listed = super().add_subparsers(parser_class=Parser, **options)
        return self._listed

    def begin_group(self, heading: str) -> None:
        """Put the commands that are added from here on under a heading."""
        self._headings.append((heading, len(self._listed._choices_actions)))

    def format_help(self) -> str:
        """The page."""
        summaries = self._listed._choices_actions
        lines = ['NAME', f'    {self.prog} - {self.description}', '']
        lines += ['SYNOPSIS', f'    {self.prog} COMMAND [argument ...]']
        lines += [f'    {self.prog} --version | --help', '', 'COMMANDS']
        starts = [start for _, start in self._headings] + [len(summaries)]
        for index, (heading, start) in enumerate(self._headings):
            lines.append(f'  {heading}')
            for action in summaries[start : starts[index + 1]]:
                first = f'    {action.dest} '.ljust(SUMMARY_COLUMN)
                lines += textwrap.wrap(
                    action.help or '',
                    WIDTH,
                    initial_indent=first,
                    subsequent_indent=' ' * SUMMARY_COLUMN,
                )
        return '\n'.join(lines) + '\n\n' + PAGE_END

    def format_usage(self) -> str:
        """The synopsis in a line."""
        return f'usage: {self.prog} COMMAND [argument ...]\n'


def _closest(word: str, known: list[str]) -> str:
    close = get_close_matches(word.split('=')[0], known, 1)
    return f', {close[0]!r} is the closest' if close else ''
