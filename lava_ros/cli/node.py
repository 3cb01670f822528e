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

"""Run the simulation as a ROS 2 node.

The command passes --ros-args and everything after it to ROS, for example: lava node --ros-args
-p scene:=scene.yaml -p time_scale:=60.0. The program lava_node does the same.
"""

import argparse
import json

from lava_ros.cli.ros import require_ros


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.usage = 'lava node [--resume BAG] [--ros-args ...]'
    parser.add_argument(
        '--resume', metavar='BAG',
        help='continue from the newest checkpoint of a bag, even if its recording was cut off',
    )


def run(args: argparse.Namespace) -> int:
    """Run the node until SIGINT or SIGTERM."""
    require_ros()
    from lava_ros.ros.node import main

    # ROS reads the value as YAML, where quoted it can be nothing but text
    bag = json.dumps(args.resume, ensure_ascii=False)
    more = [] if args.resume is None else ['--ros-args', '-p', f'resume:={bag}']
    return main([*args.ros_args, *more])
