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

"""A process that stands for the rest of a robot: hazard, pose and goal out, plans in.

{"hazard": ROWS} publishes a grid of cells of 10 m, {"pose": [X, Y]} and {"goal": [X, Y]} poses,
{"leave": true} ends the hazard's publisher. Every plan is printed as a JSON list of positions.
"""

import json
import sys
import threading

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
RESOLUTION = 10.0


def grid(rows):
    """The message of a grid."""
    message = OccupancyGrid()
    message.header.frame_id = 'map'
    message.info.height, message.info.width = len(rows), len(rows[0])
    message.info.resolution = RESOLUTION
    message.info.origin.orientation.w = 1.0
    message.data = [value for row in rows for value in row]
    return message


def pose(x, y, frame='map'):
    """The message of a place."""
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = float(x), float(y)
    message.pose.orientation.w = 1.0
    return message


def main():
    """Do as the lines say until there are no more."""
    rclpy.init()
    node = rclpy.create_node('test_robot')
    hazard = node.create_publisher(OccupancyGrid, 'hazard', LATCHED)
    poses = {
        'pose': node.create_publisher(PoseStamped, 'pose', LATCHED),
        'goal': node.create_publisher(PoseStamped, 'goal_pose', LATCHED),
    }

    def show(path):
        places = [[item.pose.position.x, item.pose.position.y] for item in path.poses]
        print(json.dumps(places), flush=True)

    node.create_subscription(Path, 'plan', show, LATCHED)
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    while any(item.get_subscription_count() == 0 for item in (hazard, *poses.values())):
        pass
    print('ready', flush=True)
    for line in sys.stdin:
        for name, value in json.loads(line).items():
            if name == 'hazard':
                hazard.publish(grid(value))
            elif name == 'leave':
                node.destroy_publisher(hazard)
            else:
                poses[name].publish(pose(*value))


if __name__ == '__main__':
    main()
