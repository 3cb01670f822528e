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

"""Publish terrain and vents as topics.

The command publishes the latched topics terrain, terrain_info and vents until it is interrupted.
"""

import argparse
import signal

from lava_ros.cli.ros import require_ros
from lava_ros.cli.scenes import add_scene_arguments, scene_from_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_scene_arguments(parser)
    parser.add_argument(
        '--frame', default='map', help='frame ID of the messages (default: %(default)s)'
    )


def run(args: argparse.Namespace) -> int:
    """Publish until SIGINT or SIGTERM."""
    require_ros()
    scene = scene_from_arguments(args)
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from lava_ros.ros.monitor import SceneFeed

    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopping.append(number))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    feed = SceneFeed(scene, frame_id=args.frame)
    feed.get_logger().info(
        f'publishing terrain of {scene.terrain.shape[1]} x {scene.terrain.shape[0]} cells '
        f'and {len(scene.vents)} vents'
    )
    executor = SingleThreadedExecutor()
    executor.add_node(feed)
    while not stopping:
        executor.spin_once(timeout_sec=0.2)
    executor.shutdown()
    feed.destroy_node()
    rclpy.shutdown()
    return 0
