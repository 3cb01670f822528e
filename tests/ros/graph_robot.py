# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A process that acts as node and robot: it publishes maps, poses and goals, and prints plans.

{"hazard": ROWS} publishes a grid of cells of 10 m, {"arrival": ROWS} a forecast on such cells
(null: never); with {"age": SECONDS} it started so long ago. {"pose": [X, Y]} and {"goal": [X, Y]}
publish poses, {"leave": true} ends the map's publisher. Each plan is printed as a JSON list of
positions. The argument ``hazard`` or ``arrival`` selects the maps of the robot.
"""

import json
import sys
import threading
import time

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image

from lava_ros.ros import codec
from lava_ros.scene import Terrain

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
RESOLUTION = 10.0


def grid(rows):
    cells = np.array(rows, dtype=np.int8)
    info = codec.map_metadata(Terrain(np.zeros(cells.shape), RESOLUTION), 0)
    return codec.occupancy_grid(cells, info, codec.header('map', 0))


def pose(x, y, frame='map'):
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = float(x), float(y)
    message.pose.orientation.w = 1.0
    return message


def main():
    """Execute the lines of stdin."""
    rclpy.init()
    node = rclpy.create_node('test_robot')
    maps = [node.create_publisher(OccupancyGrid, sys.argv[1], LATCHED)]
    if sys.argv[1] == 'arrival':
        maps.append(node.create_publisher(Image, 'arrival_time', LATCHED))
    poses = {
        'pose': node.create_publisher(PoseStamped, 'pose', LATCHED),
        'goal': node.create_publisher(PoseStamped, 'goal_pose', LATCHED),
    }

    def show(path):
        places = [[item.pose.position.x, item.pose.position.y] for item in path.poses]
        print(json.dumps(places), flush=True)

    node.create_subscription(Path, 'plan', show, LATCHED)
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    while any(item.get_subscription_count() == 0 for item in (*maps, *poses.values())):
        time.sleep(0.01)
    print('ready', flush=True)
    for line in sys.stdin:
        order = json.loads(line)
        if 'hazard' in order:
            maps[0].publish(grid(order['hazard']))
        if 'arrival' in order:
            times = np.array(order['arrival'], dtype=np.float32)
            start_ns = time.time_ns() - int(order.get('age', 0.0) * 1e9)
            maps[1].publish(codec.float_image(times, codec.header('map', start_ns)))
            maps[0].publish(grid(np.zeros(times.shape)))
        for name in poses.keys() & order.keys():
            poses[name].publish(pose(*order[name]))
        if 'leave' in order:
            node.destroy_publisher(maps[-1])


if __name__ == '__main__':
    main()
