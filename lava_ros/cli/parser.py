# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The parser of `lava` and of its commands."""

import argparse
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
import re
from textwrap import wrap
from typing import Any, NoReturn

import lava_ros
from lava_ros import validation
from lava_ros.cli.options import Command, long_name, seconds_of
from lava_ros.errors import LavaError, MAX_EXPECTED_LENGTH, one_line, RefusalError, UnknownKeyError

#: The commands by their groups in the help. The last word of a command names its module.
GROUPS = {
    'simulate': ('run', 'calibrate'),
    'before a run': ('plan', 'effects', 'materials', 'barrier'),
    'maps, tables and files': ('map', 'places', 'export', 'watch'),
    'ROS 2': ('ros node', 'ros feed', 'ros replay', 'ros demo'),
    'bags': ('bag info', 'bag recover'),
    'checks': ('check install', 'check solver', 'check accuracy', 'check speed'),
}
COMMANDS = tuple(name for names in GROUPS.values() for name in names)

#: Tasks of the commands of two words, by their first word.
FAMILIES = {
    'ros': 'Use the simulation with ROS 2',
    'bag': 'Inspect and repair bags',
    'check': 'Check the installation, the solver and its speed',
}

#: Commands that pass ``--ros-args`` and everything after it to ROS.
ROS_COMMANDS = ('ros node', 'ros feed', 'ros replay')

#: Commands with another name in earlier versions, and what replaces them.
RENAMED = {
    'ensemble': 'run SCENE --members N', 'hindcast': 'run CASE',
    'plot': 'map RUN -o FILE.png', 'animate': 'map RUN -o FILE.gif',
    'report': 'map RUN -o FILE.html',
    'node': 'ros node', 'feed': 'ros feed', 'replay': 'ros replay', 'demo': 'ros demo',
    'info': 'bag info', 'recover': 'bag recover',
    'doctor': 'check install', 'verify': 'check solver', 'accuracy': 'check accuracy',
    'bench': 'check speed',
}

#: Options with another name in earlier versions, and their replacements.
RENAMED_OPTIONS = {
    '--duration': '--until', '--horizon': '--until', '--time': '--at', '--onset': '--start',
    '--eruption-start': '--start', '--overlay': '--places', '--scene': 'SCENE',
}

#: Removed options and their replacements, by command.
GONE = {
    'calibrate': {'--until': 'use --fit-until'},
    'ros demo': {'--forecast': 'run examples/narrow_forecast.py instead'},
}

_EPILOG = """\
'lava COMMAND --help' describes a command and its options. Exit status: 0 if all
went well, 1 if something failed or part of a bag is damaged or missing, 2 if the
input cannot be used, 130 after Ctrl+C (0 from lava watch, which it ends).
ROS_DOMAIN_ID selects the ROS graph, and WARP_CACHE_PATH the folder of the
compiled kernels.
"""


#: Column of the tasks in the list of commands.
_INDENT = 20

#: Messages of argparse: arguments that are missing, one that is wrong, and the error of its type.
_MISSING = re.compile(r'the following arguments are required: ([^,]+)')
_WRONG = re.compile(r'argument (\S+): (.*)', re.DOTALL)
_TYPE = re.compile(r'argument \S+: (\S+ is .*)', re.DOTALL)


class _Parser(argparse.ArgumentParser):
    """Prints an error in one line, without the usage.

    Attributes:
        commands: The parsers of commands, by name.
        families: The parsers of the first words of commands of two words.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.commands: dict[str, _Parser] = {}
        self.families: dict[str, _Parser] = {}

    @property
    def options(self) -> list[str]:
        """Names of the options."""
        return list(self._option_string_actions)

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
            if name in RENAMED_OPTIONS and name not in self.options:
                # not an abbreviation of another option
                known = []
            # a short option may precede its value, unless that makes the name of a long one
            is_short = name[:2] in self.options and name[1] != '-'
            if not known and (not is_short or f'-{name}' in self.options):
                self.error(f'{name}: unknown option{self._remark(name)}')

    def _remark(self, name: str) -> str:
        """Return the end of the error about an unknown option: what may be meant."""
        if self.commands:
            return f', expected a command first: lava COMMAND {name}'
        new = RENAMED_OPTIONS.get(name)
        if new in self.options:
            return f'; its name is now {new}'
        if new is not None and any(new == action.metavar for action in self._actions):
            return f'; give the {new} without an option'
        if remark := validation.meant(f'--{name.lstrip("-")}', self.options):
            return remark
        others = [
            f'lava {item}' for item, known in command_line_parser().commands.items()
            if name in known.options
        ]
        return f' here; it belongs to {", ".join(others)}' if others else ''

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
        if (is_field or option == error.field) and _is_same(typed, error.value):
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


class _Help(argparse.RawDescriptionHelpFormatter):
    """The help of `lava`, whose description has the commands by group."""

    def add_argument(self, action: argparse.Action) -> None:
        """Add an argument, but not the list of all commands."""
        if not isinstance(action, argparse._SubParsersAction):
            super().add_argument(action)


@cache
def command_line_parser() -> _Parser:
    """Return the parser of the command line, which sets ``command`` and its function ``run``."""
    declared = {name: _declared(name) for name in COMMANDS}
    parser = _Parser(
        'lava', description=_overview(declared), epilog=_EPILOG, formatter_class=_Help,
    )
    parser.add_argument(
        '--version', action='version', version=f'lava_ros {lava_ros.__version__}'
    )
    first = parser.add_subparsers(metavar='COMMAND', required=True)
    places = {'': first}
    for name, command in declared.items():
        family, _, word = name.rpartition(' ')
        if family not in places:
            of_family = first.add_parser(family, description=f'{FAMILIES[family]}.')
            parser.families[family] = of_family
            places[family] = of_family.add_subparsers(
                title='commands', metavar='COMMAND', required=True
            )
        known = places[family].add_parser(
            word, description=command.run.__doc__, help=_summary(command)
        )
        groups: dict[str, Any] = {'': known}
        for names, options in command.arguments:
            title = options.get('group', '')
            if title not in groups:
                groups[title] = known.add_argument_group(title)
            own = {key: value for key, value in options.items() if key != 'group'}
            groups[title].add_argument(*names, **own)
        known.set_defaults(command=name, run=command.run, **command.defaults)
        parser.commands[name] = known
    return parser


def _declared(name: str) -> Command:
    """Return the only command that a module declares."""
    module = import_module(f'{__package__}.{name.rpartition(" ")[2]}')
    (found,) = (item for item in vars(module).values() if isinstance(item, Command))
    return found


def _summary(command: Command) -> str:
    """Return the first sentence of the help of a command, without its capital and full stop."""
    summary = (command.run.__doc__ or '').partition('.\n')[0]
    return f'{summary[:1].lower()}{summary[1:]}'


def _overview(declared: Mapping[str, Command]) -> str:
    """Return the description of the program: its commands by group."""
    lines = ['Simulate, map, forecast and evaluate lava flows.']
    for group, names in GROUPS.items():
        lines += ['', f'{group}:']
        for name in names:
            texts = wrap(_summary(declared[name]), 78 - _INDENT)
            lines += [f'  {name:{_INDENT - 2}}{texts[0]}', *(_INDENT * ' ' + x for x in texts[1:])]
    return '\n'.join(lines)


def command_of(words: Sequence[str]) -> str:
    """Return the command with which a command line begins, or an empty text."""
    return next((
        name for name in (' '.join(words[:2]), ' '.join(words[:1])) if name in COMMANDS
    ), '')


def parse_command_line(words: list[str]) -> argparse.Namespace:
    """Parse a command line without ROS arguments; exit with status 2 if it is not valid."""
    parser, name = command_line_parser(), command_of(words)
    known = parser.commands.get(name)
    if known is None:
        _check_command(parser, words)
        known = parser
    for option, remedy in GONE.get(name, {}).items():
        if option in words:
            known.error(f'{option} is gone: {remedy}')
    known.check_options(words[len(name.split()):])
    found, others = parser.parse_known_args(words)
    if others:
        known.error(f'unexpected argument {others[0]!r}; put quotes around a text with spaces')
    return found


def _check_command(parser: _Parser, words: Sequence[str]) -> None:
    """Exit with status 2 if a command line begins with a command that does not exist."""
    place, rest = parser, words
    if words and words[0] in parser.families:
        place, rest = parser.families[words[0]], words[1:]
    if not rest or rest[0].startswith('-'):
        return
    word = rest[0]
    if place is parser and word in RENAMED:
        parser.exit(2, f'lava: lava {word} is now lava {RENAMED[word]}\n')
    known = {name.rpartition(' ')[2]: name for name in COMMANDS}
    known |= {name: name for name in (*COMMANDS, *FAMILIES)} | RENAMED
    close = validation.closest(word, known)
    remark = f'; did you mean lava {known[close]}?' if close else ''
    place.error(str(LavaError('COMMAND', word, f'one of {_names_in(place)}{remark}')))


def _names_in(place: _Parser) -> str:
    (action,) = (item for item in place._actions if isinstance(item, argparse._SubParsersAction))
    return ', '.join(action.choices)
