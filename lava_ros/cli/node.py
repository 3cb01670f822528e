# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava node` and `lava feed`: the simulation as a node, and a scene as topics for it."""

import argparse
import json
import signal

from lava_ros.cli.options import argument, command
from lava_ros.cli.ros import require_ros
from lava_ros.cli.scenes import scene_from_arguments, SCENE_OPTIONS


@command(
    argument(
        '--resume', 'BAG', 'continue from the newest checkpoint of a bag, even if its recording '
        'was cut off',
    ),
)
def node(args: argparse.Namespace) -> int:
    """Run the simulation as a ROS 2 node.

    The command passes --ros-args and everything after it to ROS, for example: lava node --ros-args
    -p scene:=scene.yaml -p time_scale:=60.0. The program lava_node does the same.
    """
    require_ros()
    from lava_ros.ros.node import main

    # ROS reads the value as YAML, where quoted it can be nothing but text
    bag = json.dumps(args.resume, ensure_ascii=False)
    more = [] if args.resume is None else ['--ros-args', '-p', f'resume:={bag}']
    return main([*args.ros_args, *more])


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
