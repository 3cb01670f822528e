# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Comparison of a robot's costmaps with its own map and with a keepout mask.

Arguments: the topic of the mask, then those of costmaps (nav_msgs/OccupancyGrid). The map has a
wall. Prints a JSON line for each costmap: its topic, a number for the newest mask, the numbers of
lethal and of all cells of wall and mask, and the number of other lethal cells.
"""

import json
import sys

from nav_msgs.msg import OccupancyGrid
import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile

from lava_ros.ros import codec
from lava_ros.scene import Terrain

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

#: Cells of the robot's map, their side [m], its corner [m], and its wall.
SHAPE, RESOLUTION, ORIGIN = (400, 500), 0.5, (3951.3, 3222.7)
WALL = (slice(180, 184), slice(80, 420))

#: The value of a lethal cell in a costmap's grid.
LETHAL = 100


def own_map():
    cells = np.zeros(SHAPE, np.int8)
    cells[WALL] = LETHAL
    ground = Terrain(np.zeros(SHAPE), RESOLUTION, ORIGIN)
    return codec.occupancy_grid(cells, ground, codec.header('map', 0))


def centres(grid):
    """Return the positions x and y [m] of the columns and rows of a grid."""
    corner, info = grid.info.origin.position, grid.info
    return (
        start + (np.arange(count) + 0.5) * info.resolution
        for start, count in ((corner.x, info.width), (corner.y, info.height))
    )


def lethal(grid, x, y):
    info, corner = grid.info, grid.info.origin.position
    values = np.array(grid.data, np.int8).reshape(info.height, info.width) == LETHAL
    columns = np.floor((x - corner.x) / info.resolution).astype(int)
    rows = np.floor((y - corner.y) / info.resolution).astype(int)
    padded = np.pad(values, 1)
    return padded[
        np.ix_(np.clip(rows + 1, 0, info.height + 1), np.clip(columns + 1, 0, info.width + 1))
    ]


def main():
    """Publish and compare until the process is terminated."""
    rclpy.init()
    node = rclpy.create_node('test_costmap')
    robot, masks = own_map(), []
    node.create_publisher(OccupancyGrid, '/map', LATCHED).publish(robot)

    def compare(topic, costmap):
        if not masks:
            return
        x, y = centres(costmap)
        values = np.array(costmap.data, np.int8).reshape(len(y), len(x)) == LETHAL
        wall, lava = lethal(robot, x, y), lethal(masks[-1], x, y)
        elsewhere = int((values & ~wall & ~lava).sum())
        line = {'topic': topic, 'mask': len(masks), 'elsewhere': elsewhere}
        for name, cells in (('wall', wall), ('lava', lava)):
            line[name] = [int((values & cells).sum()), int(cells.sum())]
        print(json.dumps(line), flush=True)

    def keep(mask):
        if not masks or masks[-1].data != mask.data:
            masks.append(mask)

    node.create_subscription(OccupancyGrid, sys.argv[1], keep, LATCHED)
    for topic in sys.argv[2:]:
        node.create_subscription(
            OccupancyGrid, topic, lambda grid, topic=topic: compare(topic, grid), LATCHED
        )
    rclpy.spin(node)


if __name__ == '__main__':
    try:
        main()
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        sys.exit(0)
