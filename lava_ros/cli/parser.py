# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The parser of `lava` and of its commands."""

import argparse
from functools import cache
from importlib import import_module
from typing import NoReturn

import lava_ros
from lava_ros.errors import MAX_EXPECTED_LENGTH, one_line

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

_EPILOG = """\
'lava COMMAND --help' describes a command and its options. Exit status: 0 if all
went well, 1 if something failed or part of a bag is damaged or missing, 2 if the
input cannot be used, 130 after Ctrl+C. ROS_DOMAIN_ID selects the ROS graph, and
WARP_CACHE_PATH the folder of the compiled kernels.
"""


class _Parser(argparse.ArgumentParser):
    """Prints an error in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        text = one_line(message, MAX_EXPECTED_LENGTH)
        self.exit(2, f"{self.prog}: {text}; '{self.prog} --help' lists the arguments\n")


@cache
def command_line_parser() -> argparse.ArgumentParser:
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
    return parser


def parse_command_line(words: list[str]) -> argparse.Namespace:
    """Parse a command line without ROS arguments; exit with status 2 if it is not valid."""
    return command_line_parser().parse_args(words)
