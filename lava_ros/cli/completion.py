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

"""Print a script with which the shell completes commands and options.

Write the script to a file that the shell reads when it needs it. bash: lava completion bash >
~/.local/share/bash-completion/completions/lava. zsh: lava completion zsh > DIRECTORY/_lava, where
fpath contains DIRECTORY.
"""

import argparse

from lava_ros.cli.manual import COMMANDS, parser_of, summary_of
from lava_ros.files.optional import require

#: Shells there is a script for.
SHELLS = ('bash', 'zsh')

#: Arguments that are files or folders.
_PATHS = frozenset(
    ('bag', 'bags', 'json', 'msg_config', 'output', 'scene', 'terrain', 'directory', 'csv')
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('shell', choices=SHELLS, help='shell that reads the script')


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    require('shtab', 'lava completion')
    import shtab

    parser = argparse.ArgumentParser('lava')
    parser.add_argument('--version', action='store_true')
    commands = parser.add_subparsers()
    for name in COMMANDS:
        command = commands.add_parser(
            name, help=summary_of(name), parents=[parser_of(name)], add_help=False
        )
        for action in command._actions:
            if action.dest in _PATHS or action.metavar in ('FILE', 'DIR', 'FOLDER'):
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(parser, shell=args.shell))
    return 0
