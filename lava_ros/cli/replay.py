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

"""Publish a recorded bag into the ROS graph.

Each topic has the QoS with which it was recorded, and /clock has the time of the bag. A bag whose
recording was cut off is played up to its last complete message. Keys in a terminal: space pauses
and resumes, left and right jump 5 s back and ahead (in bag time, times the rate), up and down
double and halve the speed, q quits.
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
import sys

from lava_ros.bag.reader import BagReader
from lava_ros.bag.replay import Step, Transport
from lava_ros.cli.keys import is_at_terminal, keys_of
from lava_ros.cli.options import add_options, seconds_of
from lava_ros.cli.output import terminal
from lava_ros.cli.ros import require_ros
from lava_ros.errors import printable


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_options(parser, 'bag')
    parser.add_argument(
        '--rate', type=float, default=1.0, metavar='X',
        help='play X times as fast as it was recorded (default: 1)',
    )
    parser.add_argument('--loop', action='store_true', help='start again at the end')
    parser.add_argument(
        '--start-offset', default='0s', metavar='TIME',
        help='time to skip at the start: 90s, 2min; latched maps of that time are still published',
    )
    parser.add_argument(
        '--clock', action=argparse.BooleanOptionalAction, default=True,
        help='publish the time of the bag on /clock (default: yes)',
    )
    parser.add_argument(
        '--wait-for-subscribers', default='0s', metavar='TIME',
        help='longest time to wait for a subscriber to each topic (default: %(default)s)',
    )


def run(args: argparse.Namespace) -> int:
    """Replay the bag that the arguments name."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


    offset = seconds_of('--start-offset', args.start_offset, may_be_zero=True)
    wait = seconds_of('--wait-for-subscribers', args.wait_for_subscribers, may_be_zero=True)
    bag = BagReader(args.bag)
    require_ros()
    from lava_ros.ros.player import play

    total = bag.duration_ns / 1e9
    columns = (
        TextColumn('replay'),
        BarColumn(),
        TextColumn('{task.completed:.1f} of {task.total:.1f} s'),
        TextColumn('{task.fields[state]}'),
        TextColumn('{task.description}', markup=False),
        TimeElapsedColumn(),
    )
    with ExitStack() as stack:
        progress = stack.enter_context(
            Progress(
                *columns, console=terminal(), disable=not sys.stdout.isatty(), transient=True
            )
        )
        task = progress.add_task('', total=total, state='')
        transport = None
        if is_at_terminal():
            keys = stack.enter_context(keys_of(sys.stdin.fileno()))
            transport = Transport(
                keys.read, on_change=lambda item: progress.update(task, state=_state(item))
            )

        def show(step: Step) -> None:
            seconds = (step.clock_ns - (bag.start_ns or 0)) / 1e9
            topic = printable(step.message.topic) if step.message else None
            progress.update(task, completed=seconds, description=topic)

        count = play(
            bag,
            rate=args.rate,
            loop=args.loop,
            start_offset=offset,
            clock=args.clock,
            wait_for_subscribers=wait,
            on_step=show,
            transport=transport,
        )
    print(f'{count} messages published')
    return 0


def _state(transport: Transport) -> str:
    speed = f'x{transport.speed:g}' if transport.speed != 1.0 else ''
    return ' '.join(filter(None, ['held' if transport.is_paused else '', speed]))
