# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Planner with which a robot leaves in time: the fastest path to a place that lava will not reach.

It needs the pose of the robot (/pose) and its speed:

    python3 leave_in_time.py --ros-args -p speed:=1.5 -p margin:=60.0

It uses the node's forecast (arrival, arrival_time) and publishes the path as /plan. The robot
leaves each cell at least `margin` seconds before lava arrives. The path leads to /goal_pose if the
goal is safe and can be reached in time, otherwise to the nearest place that stays free throughout
the forecast. It plans again after each forecast and each pose. A plan without poses means that no
path exists, or that there is no current forecast.
"""

from heapq import heappop, heappush
from math import hypot

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import Image

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STEPS = [(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if dr or dc]


def deadlines(arrival, clearance):
    """Return the time until which each cell may be occupied.

    Args:
        arrival: Time to arrival [s], shape [rows, columns]; NaN for never, below 0 for unknown
            cells, which count as lava.
        clearance: Minimum distance from lava [cells].

    Returns:
        The earliest arrival within that distance of each cell [s], inf for never, same shape.
    """
    times = np.where(np.isnan(arrival), np.inf, arrival)
    result, reach = times.copy(), int(clearance)
    wide = np.pad(times, reach, constant_values=np.inf)
    for row in range(2 * reach + 1):
        for column in range(2 * reach + 1):
            if hypot(row - reach, column - reach) <= clearance:
                part = wide[row : row + times.shape[0], column : column + times.shape[1]]
                np.minimum(result, part, out=result)
    return result


def find_path(until, start, is_goal, duration):
    """Find the fastest path on which lava never overtakes the robot, with Dijkstra's algorithm.

    Occupied cells never become free, so only the earliest time at each cell matters.

    Args:
        until: Time until which a cell may be occupied [s], shape [rows, columns].
        start: First cell (row, column).
        is_goal: Goal cells, bool, same shape.
        duration: Time of a step to the next cell of a row [s].

    Returns:
        The cells of the path, including both ends; empty if no path exists.
    """

    def is_free(row, column, time):
        inside = 0 <= row < until.shape[0] and 0 <= column < until.shape[1]
        return inside and time < until[row, column]

    came_from, times, done = {}, {start: 0.0}, set()
    waiting = [(0.0, start)]
    while waiting:
        time, cell = heappop(waiting)
        if is_goal[cell]:
            way = [cell]
            while way[-1] != start:
                way.append(came_from[way[-1]])
            return way[::-1]
        if cell in done:
            continue
        done.add(cell)
        for dr, dc in STEPS:
            other = cell[0] + dr, cell[1] + dc
            after = time + hypot(dr, dc) * duration
            # during a step the robot may touch both cells and two cells at their corner
            passed = (cell, other, (cell[0], other[1]), (other[0], cell[1]))
            if after < times.get(other, np.inf) and all(is_free(*item, after) for item in passed):
                times[other], came_from[other] = after, cell
                heappush(waiting, (after, other))
    return []


def way_out(arrival, start, goal, *, duration, clearance, margin):
    """Find the fastest path to a goal that stays free, or to the nearest place that stays free.

    Args:
        arrival: Time to arrival [s], as for ``deadlines``.
        start: First cell (row, column).
        goal: Preferred cell, or None.
        duration: Time of a step [s].
        clearance: Minimum distance from lava [cells].
        margin: Time between leaving a cell and the arrival of lava [s].

    Returns:
        The cells of the path, without clearance and margin if no path has them.
    """
    for until in (deadlines(arrival, clearance) - margin, deadlines(arrival, 0.0)):
        safe = np.isinf(until) & (until > 0.0)
        places = [safe]
        if goal is not None and safe[goal]:
            only = np.zeros(safe.shape, dtype=bool)
            only[goal] = True
            places = [only, safe]
        for is_goal in places:
            way = find_path(until, start, is_goal, duration)
            if way:
                return way
    return []


class LeaveInTime(Node):
    """Node that plans a path with the forecast."""

    def __init__(self):
        """Declare parameters and create publishers, subscriptions and a timer."""
        super().__init__('leave_in_time')
        #: Speed of the robot [m/s], and time between leaving a cell and the arrival of lava [s].
        self.speed = self.declare_parameter('speed', 1.0).value
        self.margin = self.declare_parameter('margin', 60.0).value
        #: Minimum distance from lava and from unknown ground [m].
        self.clearance = self.declare_parameter('clearance', 20.0).value
        #: Simulated seconds per second of the clock, equal to the node's parameter.
        self.time_scale = self.declare_parameter('time_scale', 1.0).value
        #: Maximum age of a forecast [s of the clock].
        self.max_age = self.declare_parameter('max_age', 3600.0).value
        self.info = self.image = self.pose = self.goal = self.reported = None
        self.plan = self.create_publisher(Path, 'plan', LATCHED)
        self.create_subscription(OccupancyGrid, 'arrival', self.on_grid, LATCHED)
        self.create_subscription(Image, 'arrival_time', self.on_image, LATCHED)
        self.create_subscription(PoseStamped, 'pose', self.on_pose, 10)
        self.create_subscription(PoseStamped, 'goal_pose', self.on_goal, 10)
        self.create_timer(1.0, self.watch)

    def on_grid(self, grid):
        """Store the position of the cells, which an image does not contain."""
        self.info = grid.info
        self.replan()

    def on_image(self, image):
        """Store the new forecast or withdrawal, and plan again."""
        self.image = image
        self.replan()

    def on_pose(self, pose):
        """Store the pose of the robot and plan again."""
        self.pose = pose
        self.replan()

    def on_goal(self, goal):
        """Store the new goal and plan again."""
        self.goal = goal
        self.replan()

    def watch(self):
        """Discard the forecast if it is too old or has no publisher."""
        if self.image is None:
            return
        if self.age > self.max_age or self.count_publishers('arrival_time') == 0:
            self.image = None
            self.replan()

    @property
    def age(self):
        """Time since the start of the forecast [s of the clock]."""
        return (self.get_clock().now() - Time.from_msg(self.image.header.stamp)).nanoseconds * 1e-9

    def cell(self, pose):
        """Return the cell of a pose (row, column), None outside the map."""
        info, point = self.info, pose.pose.position
        row = (point.y - info.origin.position.y) // info.resolution
        column = (point.x - info.origin.position.x) // info.resolution
        inside = 0 <= row < info.height and 0 <= column < info.width
        return (int(row), int(column)) if inside else None

    def replan(self):
        """Publish the new path, or a plan without poses."""
        if self.pose is None or self.info is None:
            return
        cells, problem = self.way()
        self.plan.publish(self.path(cells))
        if problem and problem != self.reported:
            self.get_logger().warning(problem)
        self.reported = problem

    def way(self):
        """Return the cells of the path, and the problem if there is one."""
        image, info = self.image, self.info
        if image is None or (image.height, image.width) != (info.height, info.width):
            return [], 'stop: there is no forecast'
        arrival = np.frombuffer(image.data, np.float32).reshape(image.height, image.width)
        if (arrival < 0.0).all():
            return [], 'stop: the forecast has been withdrawn'
        start = self.cell(self.pose)
        if start is None:
            return [], 'stop: the robot is outside the map'
        goal = self.goal and self.cell(self.goal)
        # seconds of the clock from now
        ahead = np.where(arrival < 0.0, -np.inf, arrival / self.time_scale - self.age)
        cells = way_out(
            ahead,
            start,
            goal,
            duration=info.resolution / self.speed,
            clearance=self.clearance / info.resolution,
            margin=self.margin,
        )
        if not cells:
            return [], 'no way leads out in time'
        is_there = goal is None or cells[-1] == goal
        return cells, '' if is_there else 'not to the goal, but to where no lava comes'

    def path(self, cells):
        """Return the message of a path through the centres of cells."""
        path = Path()
        path.header.frame_id = self.image.header.frame_id if self.image else 'map'
        path.header.stamp = self.get_clock().now().to_msg()
        for row, column in cells:
            pose = PoseStamped(header=path.header)
            info = self.info
            pose.pose.position.x = info.origin.position.x + (column + 0.5) * info.resolution
            pose.pose.position.y = info.origin.position.y + (row + 0.5) * info.resolution
            pose.pose.orientation.w = 1.0
            path.poses.append(pose)
        return path


def main():
    """Plan until Ctrl+C."""
    rclpy.init()
    try:
        rclpy.spin(LeaveInTime())
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        print('leave_in_time: stopped')


if __name__ == '__main__':
    main()
