# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Drive a robot with rolling costmaps of Nav2 into a keepout mask that does not change.

In a shell with ROS 2 and Nav2, from the root of the project:

    python docs/benchmarks/rolling_window.py 'MACHINE' --node '.venv/bin/lava ros node' \
        > docs/benchmarks/rolling_window.csv

The simulation has ended, so that the masks come by their heartbeat alone. Costmaps of several
windows follow one robot across the edge of the mask. The rows count the published costmaps in
which the robot is on cells of the mask, and those of them in which all these cells are lethal.

With ``--steps MASK COSTMAP`` it drives across the edge of an existing mask in an existing costmap,
whatever the speed of the machine: after each mask, the robot moves as far as it would until the
next one and one update of the costmap, and waits there for the costmap at each step.
"""

import argparse
from collections.abc import Callable, Iterator
import csv
import json
import math
import os
from pathlib import Path
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

from geometry_msgs.msg import TransformStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import OccupancyGrid
import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage
import yaml

ROOT = Path(__file__).parents[2]
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

#: Sides of the windows [m], speeds [m/s], and heartbeats of the mask [s].
WINDOWS, SPEEDS, HEARTBEATS = (3, 5, 10), (0.25, 0.5, 1.0), (0.5, 1.0, 5.0)

#: Frame of the robot.
FRAME = 'moving_robot'

#: Cells of a costmap [m], and its updates and maximum publications per second.
RESOLUTION, UPDATES, PUBLICATIONS = 0.05, 5.0, 10.0

#: Radius around the robot in which the mask must be lethal [m].
RADIUS = 0.3

#: Distance to the edge at the start, and from the edge at the end of a drive [m].
BEFORE, BEYOND = 6.0, 10.0

#: Number of drives of each kind.
DRIVES = 2

#: Maximum wait for a process or a message [s].
PATIENCE = 120.0

SCENE = """
terrain: {file: st_helens.npz}
vents: [{position: [4050.0, 3300.0], discharge: 60.0, radius: 30.0}]
"""

#: A mask and costmaps are lethal in cells of this value.
LETHAL = 100


class Grid:
    """The lethal cells of an occupancy grid.

    Attributes:
        stamp: Stamp of the message.
        x: Position of the centre of each column [m].
        y: Position of the centre of each row [m].
    """

    def __init__(self, message: OccupancyGrid) -> None:
        """Read a message."""
        info, corner = message.info, message.info.origin.position
        stamp = message.header.stamp
        self.stamp = stamp.sec, stamp.nanosec
        self.lethal = np.array(message.data, np.int8).reshape(info.height, info.width) == LETHAL
        self.x = corner.x + (np.arange(info.width) + 0.5) * info.resolution
        self.y = corner.y + (np.arange(info.height) + 0.5) * info.resolution
        self._corner, self._resolution = corner, info.resolution

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return True for each row y and column x of positions [m] that is in a lethal cell."""
        columns = np.floor((x - self._corner.x) / self._resolution).astype(int)
        rows = np.floor((y - self._corner.y) / self._resolution).astype(int)
        return self.lethal[np.ix_(rows, columns)]


class Robot:
    """A robot at ``position`` (x, y) [m], its costmaps and the mask.

    Attributes:
        mask_times: Steady time of each mask [s].
        repeated: Number of masks since the last one with another stamp.
        costmaps: New costmaps, with their topics.
    """

    def __init__(self, mask: str, costmaps: tuple[str, ...]) -> None:
        """Subscribe to a mask and to costmaps, and publish transforms."""
        self.node = rclpy.create_node('robot')
        self.position: Callable[[], tuple[float, float]] = lambda: (0.0, 0.0)
        self.mask: Grid | None = None
        self.mask_times: list[float] = []
        self.repeated = 0
        self.costmaps: list[tuple[str, Grid]] = []
        self._entities: list[Any] = []
        self.listen(mask, costmaps)
        self._transforms = self.node.create_publisher(TFMessage, '/tf', 100)
        self.node.create_timer(0.05, self._publish_transform)

    def listen(self, mask: str, costmaps: tuple[str, ...]) -> None:
        """Subscribe to these topics only."""
        for entity in self._entities:
            self.node.destroy_subscription(entity)
        self._entities = [self.node.create_subscription(OccupancyGrid, mask, self._keep, LATCHED)]
        for topic in costmaps:

            def add(grid: OccupancyGrid, topic: str = topic) -> None:
                self.costmaps.append((topic, Grid(grid)))

            self._entities.append(
                self.node.create_subscription(OccupancyGrid, topic, add, LATCHED)
            )

    def _keep(self, mask: OccupancyGrid) -> None:
        grid = Grid(mask)
        # a mask of the same state keeps its stamp
        is_same = self.mask is not None and self.mask.stamp == grid.stamp
        self.repeated, self.mask = (self.repeated + 1) * is_same, grid
        self.mask_times.append(time.monotonic())

    def _publish_transform(self) -> None:
        item = TransformStamped()
        item.header.frame_id, item.child_frame_id = 'map', FRAME
        item.header.stamp = self.node.get_clock().now().to_msg()
        place = item.transform.translation
        place.x, place.y = map(float, self.position())
        item.transform.rotation.w = 1.0
        self._transforms.publish(TFMessage(transforms=[item]))

    def spin(self, until: Callable[[], Any], timeout: float = PATIENCE) -> Any:
        """Run callbacks until a condition holds, and return its value."""
        end = time.monotonic() + timeout
        while not (value := until()):
            if time.monotonic() > end:
                raise TimeoutError(f'nothing in {timeout} s')
            rclpy.spin_once(self.node, timeout_sec=0.02)
        return value

    def call(self, kind: Any, name: str, request: Any) -> None:
        """Call a service."""
        client = self.node.create_client(kind, name)
        self.spin(client.service_is_ready)
        future = client.call_async(request)
        self.spin(future.done)
        self.node.destroy_client(client)

    def edge(self) -> tuple[float, float]:
        """Return the position of the mask's eastern edge, in the middle of its rows [m]."""
        mask = self.spin(lambda: self.mask)
        rows, columns = np.nonzero(mask.lethal)
        row = int(np.median(rows))
        half = 0.5 * (mask.x[1] - mask.x[0])
        # not on a line of the grid
        return mask.x[columns[rows == row].max()] + half + 0.013, mask.y[row] + 0.017

    def under(self, costmap: Grid) -> tuple[int, int]:
        """Return the number of mask cells under the robot, and of those that are lethal."""
        mask = self.spin(lambda: self.mask)
        # the robot is in the middle of its window
        x, y = costmap.x - costmap.x.mean(), costmap.y - costmap.y.mean()
        cells = mask.at(costmap.x, costmap.y) & (np.hypot(*np.meshgrid(x, y)) < RADIUS)
        return int(cells.sum()), int((cells & costmap.lethal).sum())

    def has_whole_mask(self, costmap: Grid) -> bool:
        """Return True if all cells of the mask are lethal in the whole window."""
        mask = self.spin(lambda: self.mask)
        return bool(np.all(costmap.lethal | ~mask.at(costmap.x, costmap.y)))


class Counts:
    """The costmaps with mask cells under the robot: all, and those with all or none lethal."""

    def __init__(self) -> None:
        """Count no costmap."""
        self.costmaps = self.whole = self.none = 0

    def add(self, cells: int, lethal: int) -> None:
        """Count a costmap by its mask cells under the robot, and those of them that are lethal."""
        if cells:
            self.costmaps += 1
            self.whole += lethal == cells
            self.none += lethal == 0


def drive(robot: Robot, speed: float, counts: dict[str, Counts]) -> float:
    """Drive across the edge, and add the costmaps to their counts, by topic.

    Returns:
        The longest time between two masks [s].
    """
    x, y = robot.edge()
    robot.position = lambda: (x + BEFORE, y)
    for topic in counts:
        # at the start of the drive, with a mask there
        def is_there(topic: str = topic) -> bool:
            return any(
                name == topic and abs(grid.x.mean() - x - BEFORE) < 0.1
                for name, grid in robot.costmaps
            )

        robot.spin(is_there)
    count = len(robot.mask_times)
    robot.spin(lambda: len(robot.mask_times) > count + 1)
    begin, masks = time.monotonic(), len(robot.mask_times) - 1
    robot.position = lambda: (x + BEFORE - speed * (time.monotonic() - begin), y)
    robot.costmaps.clear()
    while time.monotonic() - begin < (BEFORE + BEYOND) / speed:
        rclpy.spin_once(robot.node, timeout_sec=0.02)
        while robot.costmaps:
            topic, grid = robot.costmaps.pop(0)
            counts[topic].add(*robot.under(grid))
    return float(np.diff(robot.mask_times[masks:]).max())


def drive_in_steps(robot: Robot, speed: float, heartbeat: float) -> Counts:
    """Drive across the edge by steps of the costmap's updates, and return the counts."""
    edge, y = robot.edge()
    counts, x = Counts(), edge + BEFORE
    steps = math.ceil(heartbeat * UPDATES) + 1

    def wait(condition: Callable[[Grid], bool] = lambda grid: True) -> Grid:
        def found() -> Grid | None:
            while robot.costmaps:
                _, grid = robot.costmaps.pop(0)
                # Nav2 moves a window by whole cells, and may be late
                if abs(grid.x.mean() - x) < 1.5 * RESOLUTION and condition(grid):
                    return grid
            return None

        grid: Grid = robot.spin(found)
        return grid

    robot.position = lambda: (x, y)
    while x > edge - BEYOND:
        count = len(robot.mask_times)
        robot.spin(lambda: len(robot.mask_times) > count)  # noqa: B023
        wait(robot.has_whole_mask)
        for _ in range(steps):
            x -= speed / UPDATES
            counts.add(*robot.under(wait()))
    return counts


class Programs:
    """Programs of one sweep, and their files in ``folder``."""

    def __init__(self, folder: Path) -> None:
        """Start none."""
        self.folder, self._started = folder, list[subprocess.Popen[bytes]]()

    def start(self, words: list[str], env: dict[str, str] | None = None) -> None:
        """Start a program that logs to a file of the folder."""
        with (self.folder / f'{len(self._started)}.log').open('wb') as log:
            self._started.append(
                subprocess.Popen(words, stdout=log, stderr=log, env=env, start_new_session=True)
            )

    def ros(self, package: str, name: str, parameters: dict[str, Any], *words: str) -> None:
        """Start a program of a ROS package with parameters."""
        path = self.folder / f'{len(self._started)}.yaml'
        path.write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters}}))
        self.start(
            ['ros2', 'run', package, name, '--ros-args', '--params-file', str(path), *words]
        )

    def end(self, keep: int = 0) -> None:
        """End all programs but the first ones."""
        while len(self._started) > keep:
            child = self._started.pop()
            if child.poll() is None:
                os.killpg(child.pid, signal.SIGINT)
                try:
                    child.wait(10.0)
                except subprocess.TimeoutExpired:
                    os.killpg(child.pid, signal.SIGKILL)
                    child.wait()


def mask_topic(heartbeat: float) -> str:
    """Return the topic of the mask with a heartbeat [s]."""
    return f'keepout_mask_{1000.0 * heartbeat:.0f}_ms'


def start_node(programs: Programs, command: str, environment: dict[str, str]) -> None:
    """Start the node with the shipped mask at each heartbeat."""
    layers = yaml.safe_load((ROOT / 'msg_configs/nav2_keepout.yaml').read_text())['layers']
    masks = {
        mask_topic(heartbeat): {**layers['keepout_mask'], 'heartbeat': heartbeat}
        for heartbeat in HEARTBEATS
    }
    config, scene = programs.folder / 'layers.yaml', programs.folder / 'scene.yaml'
    config.write_text(yaml.safe_dump({'layers': masks}))
    scene.write_text(SCENE)
    values = f'device:=cpu preset:=draft time_scale:=60.0 end_time:=600.0 scene:={scene} '
    values += f'msg_config:={config}'
    words = [word for value in values.split() for word in ('-p', value)]
    programs.start([*shlex.split(command), '--ros-args', *words], environment)


def start_nav2(
    programs: Programs, robot: Robot, mask: str, has_static_layer: bool
) -> tuple[str, ...]:
    """Start the shipped server and costmaps on a mask; return the topics of the costmaps."""
    recipe = yaml.safe_load((ROOT / 'params/nav2_filters.yaml').read_text())
    info = recipe['/**/keepout_filter_info_server']['ros__parameters']
    name = 'keepout_filter_info_server'
    programs.ros(
        'nav2_map_server', 'costmap_filter_info_server', {**info, 'mask_topic': f'/{mask}'},
        '-r', f'__node:={name}',
    )
    managed = [f'/{name}']
    static = {
        'plugin': 'nav2_costmap_2d::StaticLayer', 'map_topic': '/map',
        'map_subscribe_transient_local': True,
    }
    for window in WINDOWS:
        values = {
            'global_frame': 'map', 'robot_base_frame': FRAME, 'rolling_window': True,
            'width': window, 'height': window, 'resolution': RESOLUTION, 'robot_radius': 0.22,
            'update_frequency': UPDATES, 'publish_frequency': PUBLICATIONS,
            'always_send_full_costmap': True, 'static_layer': static,
            'plugins': ['static_layer'] * has_static_layer + ['inflation_layer'],
            'inflation_layer': {
                'plugin': 'nav2_costmap_2d::InflationLayer', 'inflation_radius': 0.55
            },
            **recipe['local_costmap']['local_costmap']['ros__parameters'],
        }
        space = f'/w{window}'
        programs.ros(
            'nav2_costmap_2d', 'nav2_costmap_2d', values, '-r', f'__ns:={space}',
            '-r', f'__node:=window_{window}',
        )
        managed.append(f'{space}/window_{window}')
    for node in managed:
        for change in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
            request = ChangeState.Request(transition=Transition(id=change))
            robot.call(ChangeState, f'{node}/change_state', request)
    return tuple(f'/w{window}/costmap' for window in WINDOWS)


def map_around(x: float, y: float) -> OccupancyGrid:
    """Return the robot's own map, free cells of 1 m around a position [m]."""
    grid = OccupancyGrid(data=bytes(60 * 60))
    grid.header.frame_id, grid.info.resolution = 'map', 1.0
    grid.info.width = grid.info.height = 60
    grid.info.origin.position.x, grid.info.origin.position.y = x - 30.0, y - 30.0
    grid.info.origin.orientation.w = 1.0
    return grid


def sweep(folder: Path, command: str, environment: dict[str, str]) -> Iterator[dict[str, Any]]:
    """Yield a row for each window, speed, heartbeat and kind of costmap."""
    programs = Programs(folder)
    try:
        start_node(programs, command, environment)
        robot = Robot(mask_topic(HEARTBEATS[0]), ())
        # until the simulation has ended
        robot.spin(lambda: robot.repeated > 5 and robot.mask.lethal.any())
        maps = robot.node.create_publisher(OccupancyGrid, '/map', LATCHED)
        kinds = [(heartbeat, False) for heartbeat in HEARTBEATS] + [(HEARTBEATS[-1], True)]
        for heartbeat, has_static_layer in kinds:
            mask = mask_topic(heartbeat)
            maps.publish(map_around(*robot.edge()))
            topics = start_nav2(programs, robot, mask, has_static_layer)
            robot.mask, robot.mask_times = None, []
            robot.listen(mask, topics)
            for speed in SPEEDS:
                counts = {topic: Counts() for topic in topics}
                gap = max(drive(robot, speed, counts) for _ in range(DRIVES))
                for window, topic in zip(WINDOWS, topics, strict=True):
                    found = counts[topic]
                    yield {
                        'window_m': window, 'speed_m_s': speed, 'heartbeat_s': heartbeat,
                        'static_layer': has_static_layer, 'drives': DRIVES,
                        'costmaps': found.costmaps, 'whole': found.whole, 'none': found.none,
                        'max_gap_s': f'{gap:.2f}',
                    }
            programs.end(keep=1)
    finally:
        programs.end()


def main() -> int:
    """Print the table, or drive in steps; return 1 if a drive in steps was not whole."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('machine', nargs='?', default='', help='name of the machine')
    parser.add_argument(
        '--node', default='ros2 run lava_ros lava_node', help='command of the node'
    )
    parser.add_argument('--steps', nargs=2, metavar=('MASK', 'COSTMAP'))
    parser.add_argument('--speed', type=float, default=1.0)
    parser.add_argument('--heartbeat', type=float, default=0.5)
    given = parser.parse_args()
    rclpy.init()
    if given.steps is not None:
        mask, costmap = given.steps
        counts = drive_in_steps(Robot(mask, (costmap,)), given.speed, given.heartbeat)
        print(json.dumps(vars(counts)))
        return int(not 0 < counts.whole == counts.costmaps)
    # a node of another Python environment must not load the libraries of this shell
    dropped = () if given.node.startswith('ros2') else ('LD_LIBRARY_PATH', 'AMENT_PREFIX_PATH')
    dropped += ('PYTHONPATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE') * bool(dropped)
    environment = {name: value for name, value in os.environ.items() if name not in dropped}
    command = f"python docs/benchmarks/rolling_window.py '{given.machine}' --node '{given.node}'"
    writer = None
    with tempfile.TemporaryDirectory() as folder:
        for row in sweep(Path(folder), given.node, environment):
            line = {**row, 'machine': given.machine, 'command': command}
            if writer is None:
                writer = csv.DictWriter(sys.stdout, line, lineterminator='\n')
                writer.writeheader()
            writer.writerow(line)
            sys.stdout.flush()
    return 0


if __name__ == '__main__':
    sys.exit(main())
