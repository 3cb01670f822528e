# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Planner that keeps a robot out of lava: a path to the goal around the hazard, or no path.

It needs the pose of the robot (/pose) and its goal (/goal_pose, RViz's 2D Goal Pose):

    python3 keep_out.py --ros-args -p clearance:=30.0

It publishes the path as /plan, and plans again after each change of the hazard map, the goal or
the robot's cell. A plan without poses means stop: no path exists, the goal is not valid, or there
is no current map. Unknown ground (-1) is not passable. Near lava, the path leads away from it.
"""

from heapq import heappop, heappush
from math import hypot, sqrt

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from lava_ros.layers.layer import within

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STEPS = [(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if dr or dc]


def find_path(blocked, near, start, goal):
    """Find the shortest path with A*, across sides and corners of free cells.

    Args:
        blocked: Cells not to enter, bool, shape [rows, columns].
        near: Cells to avoid: a step into one counts as ten.
        start: First cell (row, column).
        goal: Last cell.

    Returns:
        The cells of the path, including both ends; empty if no path exists.
    """

    def left(cell):
        """Return the minimum length of a path from a cell to the goal."""
        rows, columns = abs(cell[0] - goal[0]), abs(cell[1] - goal[1])
        return max(rows, columns) + (sqrt(2.0) - 1.0) * min(rows, columns)

    def is_free(row, column):
        inside = 0 <= row < blocked.shape[0] and 0 <= column < blocked.shape[1]
        return inside and not blocked[row, column]

    came_from, lengths, done = {}, {start: 0.0}, set()
    waiting = [(left(start), start)]
    while waiting:
        cell = heappop(waiting)[1]
        if cell == goal:
            way = [cell]
            while way[-1] != start:
                way.append(came_from[way[-1]])
            return way[::-1]
        if cell in done:
            continue
        done.add(cell)
        for dr, dc in STEPS:
            other = cell[0] + dr, cell[1] + dc
            # no diagonal step past a blocked corner
            sides = (cell[0], other[1]), (other[0], cell[1])
            if not all(is_free(*item) for item in (other, *sides)):
                continue
            length = lengths[cell] + hypot(dr, dc) * (10.0 if near[other] else 1.0)
            if length < lengths.get(other, np.inf):
                lengths[other], came_from[other] = length, cell
                heappush(waiting, (length + left(other), other))
    return []


class KeepOut(Node):
    """Node that plans a path around the hazard."""

    def __init__(self):
        """Declare parameters and create publishers, subscriptions and a timer."""
        super().__init__('keep_out')
        #: Maximum hazard of a passable cell.
        self.max_hazard = self.declare_parameter('max_hazard', 0).value
        #: Minimum distance from lava and from unknown ground [m].
        self.clearance = self.declare_parameter('clearance', 20.0).value
        self.grid = self.pose = self.goal = self.reported = None
        self.plan = self.create_publisher(Path, 'plan', LATCHED)
        self.create_subscription(OccupancyGrid, 'hazard', self.on_hazard, LATCHED)
        self.create_subscription(PoseStamped, 'pose', self.on_pose, 10)
        self.create_subscription(PoseStamped, 'goal_pose', self.on_goal, 10)
        self.create_timer(1.0, self.watch)

    def on_hazard(self, grid):
        """Store the new map and plan again."""
        self.grid = grid
        values = np.array(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)
        self.values, self.walls = values, (values > self.max_hazard) | (values < 0)
        self.near = within(self.walls, self.clearance / grid.info.resolution)
        self.replan()

    def on_pose(self, pose):
        """Store the pose of the robot, and plan again if its cell has changed."""
        before, self.pose = self.pose, pose
        if before is None or (self.grid and self.cell(before) != self.cell(pose)):
            self.replan()

    def on_goal(self, goal):
        """Store the new goal and plan again."""
        self.goal = goal
        self.replan()

    def watch(self):
        """Discard the map if it has no publisher."""
        if self.grid is not None and self.count_publishers('hazard') == 0:
            self.grid = None
            self.replan()

    def cell(self, pose):
        """Return the cell of a pose (row, column), None outside the map."""
        info, point = self.grid.info, pose.pose.position
        row = (point.y - info.origin.position.y) // info.resolution
        column = (point.x - info.origin.position.x) // info.resolution
        inside = 0 <= row < info.height and 0 <= column < info.width
        return (int(row), int(column)) if inside else None

    def refusal(self, what, pose):
        """Return the reason why a pose cannot be an end of the path, or an empty text."""
        if pose.header.frame_id != self.grid.header.frame_id:
            frames = f'{pose.header.frame_id!r}, the map in {self.grid.header.frame_id!r}'
            return f'{what} is in frame {frames}'
        cell = self.cell(pose)
        if cell is None:
            return f'{what} is outside the map'
        if self.values[cell] < 0:
            return f'{what} is on unknown ground, which counts as not passable'
        return f'{what} is in lava: hazard {self.values[cell]}' if self.walls[cell] else ''

    def replan(self):
        """Publish the new path, or a plan without poses."""
        cells, problem = [], ''
        if self.goal is None or self.pose is None:
            return
        if self.grid is None:
            problem = 'there is no hazard map'
        else:
            problem = self.refusal('the goal', self.goal) or self.refusal('the robot', self.pose)
        if not problem:
            start, goal = self.cell(self.pose), self.cell(self.goal)
            if self.near[goal]:
                problem = f'the goal is nearer than {self.clearance:g} m to lava or unknown ground'
            else:
                blocked = self.walls if self.near[start] else self.near
                cells = find_path(blocked, self.near, start, goal)
                problem = '' if cells else 'no way leads around the lava'
        self.plan.publish(self.path(cells))
        if problem and problem != self.reported:
            self.get_logger().warning(f'stop: {problem}')
        self.reported = problem

    def path(self, cells):
        """Return the message of a path through the centres of cells."""
        path = Path()
        path.header.frame_id = self.grid.header.frame_id if self.grid else 'map'
        path.header.stamp = self.get_clock().now().to_msg()
        for row, column in cells:
            pose = PoseStamped(header=path.header)
            info = self.grid.info
            pose.pose.position.x = info.origin.position.x + (column + 0.5) * info.resolution
            pose.pose.position.y = info.origin.position.y + (row + 0.5) * info.resolution
            pose.pose.orientation.w = 1.0
            path.poses.append(pose)
        return path


def main():
    """Plan until Ctrl+C."""
    rclpy.init()
    try:
        rclpy.spin(KeepOut())
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        print('keep_out: stopped')


if __name__ == '__main__':
    main()
