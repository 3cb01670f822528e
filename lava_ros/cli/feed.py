# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava feed`: a scene as topics."""

import argparse
import signal

from lava_ros.cli.options import argument, command
from lava_ros.cli.ros import require_ros
from lava_ros.cli.scene_options import SCENE_OPTIONS


@command(
    *SCENE_OPTIONS,
    argument('--frame', None, 'frame ID of the messages', 'map'),
)
def feed(args: argparse.Namespace) -> int:
    """Publish terrain and vents as topics.

    The command publishes the latched topics terrain, terrain_info and vents until it is
    interrupted. It passes --ros-args and everything after it to ROS, for example: lava feed
    --ros-args -r __ns:=/etna.
    """
    from lava_ros.cli.scenes import scene_from_arguments

    require_ros()
    scene = scene_from_arguments(args)
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from lava_ros.ros.arguments import start_ros
    from lava_ros.ros.monitor import SceneFeed

    start_ros(args.ros_args)
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopping.append(number))
    publisher = SceneFeed(scene, frame_id=args.frame)
    publisher.get_logger().info(
        f'publishing terrain of {scene.terrain.shape[1]} x {scene.terrain.shape[0]} cells '
        f'and {len(scene.vents)} vents'
    )
    executor = SingleThreadedExecutor()
    executor.add_node(publisher)
    while not stopping:
        executor.spin_once(timeout_sec=0.2)
    executor.shutdown()
    publisher.destroy_node()
    rclpy.shutdown()
    return 0
