# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava ros feed`: a scene as topics."""

import argparse
import signal

from lava_ros import validation
from lava_ros.cli.options import argument, command
from lava_ros.cli.ros import require_ros
from lava_ros.cli.scene_options import SCENE
from lava_ros.errors import RefusalError


@command(
    *SCENE,
    argument('--frame', None, 'frame ID of the messages', 'map'),
    argument(
        '--no-vents', None, 'publish the terrain only; the node keeps its vents',
        action='store_true',
    ),
    argument(
        '--no-tf', None, 'publish no static transform from utm or earth to the frame',
        action='store_true',
    ),
)
def feed(args: argparse.Namespace) -> int:
    """Publish terrain and vents as topics.

    The command publishes the latched topics terrain, terrain_info, terrain_georeference and vents
    until it is interrupted, and a new terrain at the times of --terrain-at and of the events of
    the scene. If the terrain has a coordinate system, it also publishes the static transform from
    utm (a UTM zone of WGS 84) or earth to the frame. It passes --ros-args and everything after it
    to ROS, for example: lava ros feed --ros-args -r __ns:=/etna.
    """
    from lava_ros.cli.scenes import scene_from_arguments

    require_ros()
    for name in ('vent', 'vents'):
        if args.no_vents and getattr(args, name):
            raise validation.conflict(f'--{name}', '--no-vents')
    # without vents no flow determines how fine the cells have to be
    scene = scene_from_arguments(args, as_given=args.no_vents)
    if scene.emplaced_flows:
        problem = f'The emplaced flow {scene.emplaced_flows[0].source} cannot be sent on a topic'
        remedy = 'Give the scene to the node instead: -p scene:=FILE'
        raise RefusalError('scene.emplaced_flows', problem, remedy)
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from lava_ros.clients.feed import SceneFeed
    from lava_ros.ros.executor import start_ros

    start_ros(args.ros_args)
    stopping: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: stopping.append(number))
    publisher = SceneFeed(
        scene, frame_id=args.frame, has_vents=not args.no_vents, publish_tf=not args.no_tf
    )
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
