# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava ros node`: the simulation as a ROS 2 node."""

import argparse
import json

from lava_ros.cli.options import argument, command
from lava_ros.cli.ros import require_ros


@command(
    argument(
        '--resume', 'BAG', 'continue from the newest checkpoint of a bag, even if its recording '
        'was cut off',
    ),
)
def node(args: argparse.Namespace) -> int:
    """Run the simulation as a ROS 2 node.

    The command passes --ros-args and everything after it to ROS, for example: lava ros node
    --ros-args -p scene:=scene.yaml -p time_scale:=60.0. The program lava_node does the same.
    """
    require_ros()
    from lava_ros.ros.node import main

    # ROS reads the value as YAML, in which a quoted value is always a string
    bag = json.dumps(args.resume, ensure_ascii=False)
    more = [] if args.resume is None else ['--ros-args', '-p', f'resume:={bag}']
    return main([*args.ros_args, *more])
