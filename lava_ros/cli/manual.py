# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The parsers of `lava`: help like a page of a manual, and errors in one sentence."""

import argparse
import ast
from difflib import get_close_matches
from functools import cache
from importlib import import_module, resources
import re
import sys
import textwrap
from typing import NoReturn

import lava_ros
from lava_ros.errors import LONGEST_EXPECTED, one_line

#: The commands by heading of the page, and the module that each is a function of.
GROUPS = {
    'run': {
        'demo': 'demo', 'node': 'node', 'feed': 'node', 'ensemble': 'ensemble',
        'forecast-demo': 'forecast_demo',
    },
    'record': {'replay': 'replay', 'info': 'info', 'recover': 'info'},
    'look': {
        'watch': 'show', 'report': 'show', 'plot': 'show', 'places': 'show', 'animate': 'show',
        'export': 'show',
        'effects': 'prepare', 'materials': 'prepare', 'barrier': 'prepare',
    },
    'measure': {
        'hindcast': 'eruptions', 'calibrate': 'eruptions', 'plan': 'ensemble',
        'accuracy': 'measure', 'verify': 'measure', 'bench': 'measure',
    },
    'set up': {'doctor': 'set_up', 'completion': 'set_up'},
}

#: Commands that pass ``--ros-args`` and everything after it to ROS.
ROS_COMMANDS = ('node', 'feed', 'replay')

COMMANDS = {name: module for group in GROUPS.values() for name, module in group.items()}

#: Column at which the summaries of commands begin, and the widest line of the page.
SUMMARY_COLUMN, WIDTH = 19, 88

PAGE_START = """\
NAME
    lava - simulate, record, forecast and evaluate lava flows in ROS 2

SYNOPSIS
    lava COMMAND [argument ...]
    lava --version | --help

COMMANDS
"""

PAGE_END = """
EXAMPLES
    lava demo                                     simulate a flow on a mountain
    lava node --ros-args -p scene:=etna.yaml      simulate a scene as a ROS node
    lava feed --terrain etna.tif                  send terrain and a vent to the node
    lava watch                                    show the running node in the browser
    lava replay bags/demo --rate 10               replay a bag ten times as fast
    lava doctor                                   check the installation

ENVIRONMENT
    ROS_DOMAIN_ID                   ID of the ROS graph
    ROS_AUTOMATIC_DISCOVERY_RANGE   LOCALHOST keeps the graph on this machine
    WARP_CACHE_PATH                 folder of the compiled kernels

EXIT STATUS
    0 if all went well, 1 if something failed or part of a bag is damaged or
    missing (--incomplete accepts that), 2 if the input cannot be used, 130 after
    Ctrl+C.

SEE ALSO
    'lava COMMAND --help' describes a command and its options.
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
    """Prints an error as one sentence, with what to do about it."""

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and where to read more, and exit with status 2."""
        for pattern, plain in _PLAIN:
            message = re.sub(pattern, plain, message)
        message = _CHOICES.sub(_plain_choice, message)
        # it quotes words as they were typed, of any length
        message = one_line(message, LONGEST_EXPECTED)
        hint = f"'{self.prog} --help' lists what it takes"
        print(f'{self.prog}: {message}; {hint}', file=sys.stderr)
        sys.exit(2)

    def refuse(self, word: str) -> NoReturn:
        """Exit because of a word that is not known, and name the option that is closest."""
        known = list(self._option_string_actions)
        self.error(f'{word!r} is not known here{_closest(word, known)}')


class Manual(Parser):
    """The parser of what comes before a command."""

    def __init__(self) -> None:
        """Declare what comes before a command."""
        super().__init__(prog='lava', usage='lava COMMAND [argument ...]')
        self.add_argument(
            '--version', action='version', version=f'lava_ros {lava_ros.__version__}'
        )
        self.add_argument('command', metavar='COMMAND', choices=COMMANDS)

    def format_help(self) -> str:
        """The page, with a line for each command."""
        lines = []
        for heading, names in GROUPS.items():
            lines.append(f'  {heading}')
            for name in names:
                lines += textwrap.wrap(
                    summary_of(name),
                    WIDTH,
                    initial_indent=f'    {name} '.ljust(SUMMARY_COLUMN),
                    subsequent_indent=' ' * SUMMARY_COLUMN,
                )
        return PAGE_START + '\n'.join(lines) + '\n' + PAGE_END


@cache
def _helps(module: str) -> dict[str, str]:
    """The docstrings of a module's functions, read without importing it."""
    text = resources.files(__package__).joinpath(f'{module}.py').read_text('utf-8')
    functions = (item for item in ast.parse(text).body if isinstance(item, ast.FunctionDef))
    return {item.name: ast.get_docstring(item) or '' for item in functions}


def summary_of(name: str) -> str:
    """What a command does: the first line of its help."""
    first = _helps(COMMANDS[name])[_function(name)].partition('.\n')[0]
    return first[:1].lower() + first[1:]


def parser_of(name: str) -> Parser:
    """The parser of a command, which sets ``command`` and ``run``, its function."""
    module = import_module(f'{__package__}.{COMMANDS[name]}')
    command = getattr(module, _function(name))
    parser = Parser(prog=f'lava {name}', description=command.run.__doc__)
    for names, options in command.arguments:
        parser.add_argument(*names, **options)
    if name in ROS_COMMANDS:
        parser.usage = f'{parser.format_usage().removeprefix("usage: ").rstrip()} [--ros-args ...]'
    parser.set_defaults(command=name, run=command.run, **command.defaults)
    return parser


def parsed(words: list[str]) -> argparse.Namespace:
    """Parse a command line; exits with status 2 where a word is wrong."""
    parser: Parser = Manual()
    first = words[0] if words else ''
    if first in COMMANDS:
        parser, words = parser_of(first), words[1:]
    elif first.startswith('-') and first not in parser._option_string_actions:
        # without this the error would be that there is no command
        parser.refuse(first)
    result, unknown = parser.parse_known_args(words)
    if unknown:
        parser.refuse(unknown[0])
    return result


def _function(name: str) -> str:
    return name.replace('-', '_')


def _plain_choice(found: re.Match[str]) -> str:
    word, known = found[1], re.findall(r"[^\s,']+", found[2])
    what = 'a command' if known == list(COMMANDS) else 'known'
    close = _closest(word, known) or f'; there are {", ".join(known)}'
    return f"'{word}' is not {what}{close}"


def _closest(word: str, known: list[str]) -> str:
    close = get_close_matches(word.split('=')[0], known, 1)
    return f', {close[0]!r} is the closest' if close else ''
