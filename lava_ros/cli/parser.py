# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The parser of `lava` and of its commands."""

import argparse
from functools import cache
from importlib import import_module
import re
from typing import Any, NoReturn

import lava_ros
from lava_ros import validation
from lava_ros.cli.options import long_name, seconds_of
from lava_ros.errors import LavaError, MAX_EXPECTED_LENGTH, one_line, RefusalError, UnknownKeyError

#: The commands, each a function in the module of its name.
COMMANDS = (
    'run', 'ensemble', 'demo', 'node', 'feed',
    'replay', 'info', 'recover',
    'watch', 'report', 'plot', 'places', 'animate', 'export',
    'effects', 'materials', 'barrier',
    'hindcast', 'calibrate', 'plan', 'accuracy', 'verify', 'bench',
    'doctor',
)

#: Commands that pass ``--ros-args`` and everything after it to ROS.
ROS_COMMANDS = ('node', 'feed', 'replay')

#: Removed options and their replacements, by command.
GONE = {'demo': {'--forecast': 'run examples/narrow_forecast.py instead'}}

_EPILOG = """\
'lava COMMAND --help' describes a command and its options. Exit status: 0 if all
went well, 1 if something failed or part of a bag is damaged or missing, 2 if the
input cannot be used, 130 after Ctrl+C. ROS_DOMAIN_ID selects the ROS graph, and
WARP_CACHE_PATH the folder of the compiled kernels.
"""


#: Messages of argparse: arguments that are missing, one that is wrong, and the error of its type.
_MISSING = re.compile(r'the following arguments are required: ([^,]+)')
_WRONG = re.compile(r'argument (\S+): (.*)', re.DOTALL)
_TYPE = re.compile(r'argument \S+: (\S+ is .*)', re.DOTALL)


class _Parser(argparse.ArgumentParser):
    """Prints an error in one line, without the usage.

    Attributes:
        commands: The parsers of commands, by name.
        options: Names of the options.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        self.options: list[str] = []
        super().__init__(*args, **options)
        self.commands: dict[str, _Parser] = {}

    def add_argument(self, *names: Any, **options: Any) -> argparse.Action:
        """Add an argument, and note the names of an option."""
        self.options += [name for name in names if name.startswith('-')]
        return super().add_argument(*names, **options)

    def check_options(self, words: list[str]) -> None:
        """Exit with status 2 for an option that does not exist, and suggest one that does."""
        for word in words:
            name = word.partition('=')[0]
            if word == '--':
                return
            # not a number, nor a text with spaces
            if not re.match(r'-[^\s\d.]\S*$', word):
                continue
            known = [item for item in self.options if item.startswith(name)]
            # a short option may precede its value, unless that makes the name of a long one
            is_short = name[:2] in self.options and name[1] != '-'
            if not known and (not is_short or f'-{name}' in self.options):
                remark = validation.meant(f'--{name.lstrip("-")}', self.options)
                if self.commands:
                    remark = f', expected a command first: lava COMMAND {name}'
                self.error(f'{name}: unknown option{remark}')

    def error(self, message: str) -> NoReturn:
        text = one_line(self._explained(message), MAX_EXPECTED_LENGTH)
        self.exit(2, f"{self.prog}: {text}; '{self.prog} --help' lists the arguments\n")

    def _explained(self, message: str) -> str:
        """Return a message of argparse as the other errors, with the help of the argument."""
        if found := _TYPE.fullmatch(message):
            return found[1]
        found = _MISSING.match(message) or _WRONG.fullmatch(message)
        actions = [item for item in self._actions if found and found[1] in _names(item)]
        if not found or not actions:
            return message
        name = long_name(found[1].split('/'))
        text = (actions[0].help or 'a value') % vars(actions[0])
        if choices := actions[0].choices:
            text = f'one of {", ".join(choices)}'
        if found.re is _MISSING:
            return f'{name} is missing, expected {text}'
        return f'{name}: {found[2]}: {text}'


def _names(action: argparse.Action) -> set[str]:
    """Return the names of an argument in messages of argparse."""
    own = [item for item in (action.metavar, action.dest) if isinstance(item, str)]
    return {'/'.join(action.option_strings), *own}


def as_typed(error: LavaError, args: argparse.Namespace) -> LavaError:
    """Name the option of a wrong value, and show the value as the user typed it.

    Other rooms name a field that an option sets, such as ``members`` or ``lava.material``.
    """
    field = re.split(r'[.\]]', error.field)[-1]
    for action in command_line_parser().commands[args.command]._actions:
        typed = getattr(args, action.dest, None)
        if not action.option_strings or typed is None or isinstance(error, RefusalError):
            continue
        option = long_name(action.option_strings)
        if isinstance(error, UnknownKeyError) and isinstance(typed, list) and field in typed:
            return LavaError(option, field, error.expected)
        if isinstance(typed, list) and len(typed) == 1:
            (typed,) = typed
        is_field = action.dest == field or action.dest.endswith(f'_{field}')
        if is_field and option != error.field and _is_same(typed, error.value):
            return LavaError(option, typed, error.expected)
    return error


def _is_same(typed: object, value: object) -> bool:
    """Return True if an argument has the value of an error, which may be a time [s]."""
    if str(typed) == str(value):
        return True
    try:
        return seconds_of('', str(typed), may_be_zero=True) == value
    except LavaError:
        return False


@cache
def command_line_parser() -> _Parser:
    """Return the parser of the command line, which sets ``command`` and its function ``run``."""
    parser = _Parser(
        'lava',
        description='Simulate, record, forecast and evaluate lava flows in ROS 2.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--version', action='version', version=f'lava_ros {lava_ros.__version__}'
    )
    commands = parser.add_subparsers(title='commands', metavar='COMMAND', required=True)
    for name in COMMANDS:
        command = getattr(import_module(f'{__package__}.{name}'), name)
        text = command.run.__doc__
        summary = text.partition('.\n')[0]
        known = commands.add_parser(
            name, description=text, help=f'{summary[:1].lower()}{summary[1:]}'
        )
        for names, options in command.arguments:
            known.add_argument(*names, **options)
        known.set_defaults(command=name, run=command.run, **command.defaults)
        parser.commands[name] = known
    return parser


def parse_command_line(words: list[str]) -> argparse.Namespace:
    """Parse a command line without ROS arguments; exit with status 2 if it is not valid."""
    parser = command_line_parser()
    try:
        if words and not words[0].startswith('-'):
            validation.choice('COMMAND', words[0], COMMANDS)
    except LavaError as error:
        parser.error(str(error))
    known = parser.commands[words[0]] if words and words[0] in parser.commands else parser
    for name, remedy in GONE.get(words[0] if words else '', {}).items():
        if name in words:
            known.error(f'{name} is gone: {remedy}')
    known.check_options(words if known is parser else words[1:])
    found, others = parser.parse_known_args(words)
    if others:
        known.error(f'unexpected argument {others[0]!r}; put quotes around a text with spaces')
    return found
