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

"""Print a script that lets the shell complete commands and options.

bash: eval "$(lava completion bash)" in ~/.bashrc. zsh: lava completion zsh > DIRECTORY/_lava,
with DIRECTORY in fpath.
"""

from __future__ import annotations

import argparse

from lava_ros.files.optional import require

#: Shells there is a script for.
SHELLS = ('bash', 'zsh')

#: Arguments that are files or folders.
_PATHS = frozenset(
    ('bag', 'bags', 'json', 'msg_config', 'output', 'scene', 'terrain', 'directory', 'csv')
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('shell', choices=SHELLS, help='the shell it is for')


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    require('shtab', 'lava completion')
    import shtab

    for command in args.parser.commands.values():
        for action in command._actions:
            if action.dest in _PATHS or action.metavar in ('FILE', 'DIR', 'FOLDER'):
                action.complete = shtab.FILE
    print(shtab.complete(args.parser, shell=args.shell))
    return 0
