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

"""`lava`: everything this package does, from a terminal."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import logging
import os
import sys

import lava_ros
from lava_ros.cli import (
    accuracy,
    animate,
    barrier,
    bench,
    calibrate,
    completion,
    demo,
    doctor,
    effects,
    ensemble,
    export,
    feed,
    forecast_demo,
    hindcast,
    info,
    materials,
    node,
    plan,
    plot,
    recover,
    replay,
    report,
    verify,
)
from lava_ros.cli.manual import Manual
from lava_ros.errors import LavaError

#: Exit status for input that cannot be used, as argparse has it.
USAGE_ERROR = 2

#: Exit status of a command that did its work, but not with all of a damaged bag.
DAMAGED = 1

_ROS_ARGS = '--ros-args'

#: The commands under the headings of the manual page.
GROUPS = (
    ('run', (demo, node, feed, ensemble, forecast_demo)),
    ('record', (replay, info, recover)),
    ('look', (report, plot, animate, export, effects, materials, barrier)),
    ('measure', (hindcast, calibrate, plan, accuracy, verify, bench)),
    ('set up', (doctor, completion)),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that the arguments name.

    Args:
        argv: Arguments without the program's name, those of the process when left out.

    Returns:
        The exit status: 0 when it went well, 1 when part of a bag was damaged and left out, 2 for
        input that cannot be used.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    parser = _parser()
    # What follows is ROS's to read, options that argparse would take for its own included.
    ros_args: list[str] = []
    if arguments[:1] == ['node'] and _ROS_ARGS in arguments:
        start = arguments.index(_ROS_ARGS)
        arguments, ros_args = arguments[:start], arguments[start:]
    args = parser.parse_args(arguments)
    args.ros_args = ros_args
    args.parser = parser
    said = _Said(args.command)
    log = logging.getLogger('lava_ros')
    log.addHandler(said)
    level = log.level
    log.setLevel(logging.INFO)
    try:
        return int(args.run(args)) or (DAMAGED if said.has_warned else 0)
    except LavaError as error:
        # Libraries explain themselves over several lines.
        print(f'lava {args.command}: {" ".join(str(error).split())}', file=sys.stderr)
        return USAGE_ERROR
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # The reader of our output has gone: there is nobody to tell, and Python would try at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    finally:
        log.removeHandler(said)
        log.setLevel(level)


class _Said(logging.Handler):
    """Prints what the package logs, once, and remembers whether it was a warning."""

    def __init__(self, command: str) -> None:
        super().__init__()
        self.has_warned = False
        self._command = command
        self._known: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        text = ' '.join(record.getMessage().split())
        if text not in self._known:
            print(f'lava {self._command}: {text}', file=sys.stderr)
        self._known.add(text)
        self.has_warned = self.has_warned or record.levelno >= logging.WARNING


def _parser() -> argparse.ArgumentParser:
    parser = Manual(
        prog='lava',
        description='Lava flow simulation as a ROS 2 node, and its recordings.',
    )
    parser.add_argument('--version', action='version', version=f'lava_ros {lava_ros.__version__}')
    subparsers = parser.add_subparsers(dest='command', metavar='COMMAND', required=True)
    for heading, commands in GROUPS:
        parser.begin_group(heading)
        for command in commands:
            command.add_parser(subparsers)
    return parser


if __name__ == '__main__':
    sys.exit(main())
