# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava node` and `lava feed`: the simulation as a node, and a scene as topics for it."""

import argparse
import json
import signal

from lava_ros.cli.options import argument, command
from lava_ros.cli.ros import require_ros
from lava_ros.cli.scenes import scene_as_given, scene_from_arguments, SCENE_OPTIONS
from lava_ros.errors import LavaError


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
    argument(
        '--no-vents', None, 'publish the terrain only; the node keeps its vents',
        action='store_true',
    ),
)
def feed(args: argparse.Namespace) -> int:
    """Publish terrain and vents as topics.

    The command publishes the latched topics terrain, terrain_info and vents until it is
    interrupted, and a new terrain at the times of --terrain-at and of the events of the scene. It
    passes --ros-args and everything after it to ROS, for example: lava feed --ros-args -r
    __ns:=/etna.
    """
    require_ros()
    # without vents no flow says how fine its cells have to be
    scene = scene_as_given(args) if args.no_vents else scene_from_arguments(args)
    if scene.emplaced_flows:
        right = 'flows that are ground: lava at the start is a part of the scene of a node '
        right += '(-p scene:=FILE), and no topic has it'
        raise LavaError('scene.emplaced_flows', scene.emplaced_flows[0].source, right)
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from lava_ros.ros.arguments import start_ros
    from lava_ros.ros.monitor import SceneFeed

    start_ros(args.ros_args)
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopping.append(number))
    publisher = SceneFeed(scene, frame_id=args.frame, has_vents=not args.no_vents)
    parts = [f'terrain of {scene.terrain.shape[1]} x {scene.terrain.shape[0]} cells']
    parts += [] if args.no_vents else [f'{len(scene.vents)} vents']
    parts += [f'{event.text} at {event.time:g} s' for event in scene.events]
    publisher.get_logger().info(f'publishing {", ".join(parts)}')
    executor = SingleThreadedExecutor()
    executor.add_node(publisher)
    while not stopping:
        executor.spin_once(timeout_sec=0.2)
    executor.shutdown()
    publisher.destroy_node()
    rclpy.shutdown()
    return 0
