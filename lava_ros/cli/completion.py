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

"""`lava completion`: a script that lets the shell complete `lava`."""

from __future__ import annotations

import argparse

from lava_ros.errors import LavaError

#: Shells there is a script for.
SHELLS = ('bash', 'zsh')

#: Arguments that are files or folders.
_PATHS = frozenset(
    ('bag', 'bags', 'json', 'msg_config', 'output', 'scene', 'terrain', 'directory', 'csv')
)


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'completion',
        help='print a script that lets the shell complete commands and options',
        description='Print a script for the shell. bash: eval "$(lava completion bash)" in '
        '~/.bashrc. zsh: lava completion zsh > DIRECTORY/_lava, with DIRECTORY in fpath.',
    )
    parser.add_argument('shell', choices=SHELLS, help='the shell it is for')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the script.

    Raises:
        LavaError: The library that writes it is not installed.
    """
    try:
        import shtab
    except ImportError:
        raise LavaError(
            'Python package shtab', None, "pip install 'lava_ros[completion]'"
        ) from None
    _mark_paths(args.parser, shtab.FILE)
    print(shtab.complete(args.parser, shell=args.shell))
    return 0


def _mark_paths(parser: argparse.ArgumentParser, complete: object) -> None:
    """Let the arguments that are files complete to files, in every command."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                _mark_paths(command, complete)
        elif action.dest in _PATHS or action.metavar in ('FILE', 'DIR', 'FOLDER'):
            action.complete = complete  # type: ignore[attr-defined]
