# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava ros replay`: publish a recorded bag."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from lava_ros.cli.console import Progress
from lava_ros.cli.options import argument, command, seconds_of
from lava_ros.cli.ros import require_ros

if TYPE_CHECKING:
    from lava_ros.bag.replay import Step


@command(
    'bag',
    argument(
        '--node', 'NAME', 'replay only the topics of this node of a bag with several, and those '
        'that all nodes share: its full name, such as /etna/lava, or its namespace',
    ),
    argument('--rate', 'X', 'play X times as fast as it was recorded', 1.0),
    argument('--loop', None, 'start again at the end', action='store_true'),
    argument(
        '--start-offset', 'TIME', 'time to skip at the start: 90s, 2min; latched maps and static '
        'transforms of that time are still published', default='0s',
    ),
    argument(
        '--clock', None, 'publish the time of the bag on /clock (default: yes)',
        True, action=argparse.BooleanOptionalAction,
    ),
    argument(
        '--wait-for-subscribers', 'TIME', 'longest time to wait for a subscriber to each topic',
        '0s',
    ),
)
def replay(args: argparse.Namespace) -> int:
    """Publish a recorded bag into the ROS graph.

    Each topic has the QoS with which it was recorded, and /clock has the time of the bag. A bag
    whose recording was cut off is played up to its last complete message. The command passes
    --ros-args and everything after it to ROS: with -r __ns:=/etna the topics are those of a node
    in the namespace /etna.
    """
    from lava_ros.bag.reader import BagReader

    offset = seconds_of('--start-offset', args.start_offset, may_be_zero=True)
    wait = seconds_of('--wait-for-subscribers', args.wait_for_subscribers, may_be_zero=True)
    bag = BagReader(args.bag)
    bag.warn_if_cut_off()
    require_ros()
    from lava_ros.clients.player import play

    start, duration = bag.start_ns or 0, max(bag.duration_ns, 1)
    with Progress(has_lines=False) as progress:

        def show(step: Step) -> None:
            topic = step.message.topic if step.message else ''
            progress.show(topic, (step.clock_ns - start) / duration)

        count = play(
            bag,
            node=args.node,
            rate=args.rate,
            loop=args.loop,
            start_offset=offset,
            clock=args.clock,
            wait_for_subscribers=wait,
            on_step=show,
            ros_arguments=args.ros_args,
        )
    print(f'{count} messages published')
    return 0
