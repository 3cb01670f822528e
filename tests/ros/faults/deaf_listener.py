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

"""A process that subscribes to the node's grids, asks for every message, and never reads one."""

import sys
import time

from nav_msgs.msg import OccupancyGrid
import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

EVERYTHING = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


def main():
    """Subscribe, say so once the publishers are there, and do nothing until the end."""
    rclpy.init()
    node = rclpy.create_node('deaf_listener')
    for topic in sys.argv[1:]:
        node.create_subscription(OccupancyGrid, topic, print, EVERYTHING)
    while not all(node.count_publishers(topic) for topic in sys.argv[1:]):
        time.sleep(0.1)
    print('deaf', flush=True)
    while True:
        time.sleep(60.0)


if __name__ == '__main__':
    main()
