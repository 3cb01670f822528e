# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The examples of robots that avoid lava or leave in time: path search, and plans of the nodes."""

from pathlib import Path
import time
from types import SimpleNamespace

from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest
import rclpy

from lava_ros.ros import codec
from lava_ros.scene import Terrain
from ros_domain import own_domain
from ros_messages import float_image
from scripts import load_script

EXAMPLES = Path(__file__).parents[2] / 'examples'

CELL = 10.0

keep_out = load_script(EXAMPLES / 'keep_out.py')
leave_in_time = load_script(EXAMPLES / 'leave_in_time.py')


@pytest.mark.parametrize(('name', 'most'), [('keep_out', 200), ('leave_in_time', 265)])
def test_examples_are_short(name, most):
    assert len((EXAMPLES / f'{name}.py').read_text(encoding='utf-8').splitlines()) <= most


@pytest.fixture
def planner():
    """Return a function that makes a planner's node; its plans are kept, not published."""
    rclpy.init(args=[], domain_id=own_domain())
    nodes = []

    def make(kind):
        plans = []
        nodes.append(kind())
        nodes[-1].plan = SimpleNamespace(publish=plans.append)

        def newest():
            places = [[item.pose.position.x, item.pose.position.y] for item in plans[-1].poses]
            return np.array(places).reshape(-1, 2)

        return nodes[-1], newest

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


def grid(rows):
    cells = np.array(rows, dtype=np.int8)
    ground = Terrain(np.zeros(cells.shape), CELL)
    return codec.occupancy_grid(cells, ground, codec.header('map', 0))


def pose(x, y, frame='map'):
    message = PoseStamped(header=codec.header(frame, 0))
    message.pose.position.x, message.pose.position.y = x, y
    return message


def _least(shape, start, after):
    """Return the least value at each cell by Bellman-Ford, which is slow but simple.

    ``after`` returns the value after a step from the value before it, its length, and the cells
    that it touches, of which the second is its end.
    """
    values, before = np.full(shape, np.inf), None
    values[start] = 0.0
    while before is None or (values != before).any():
        before = values.copy()
        for row, column in np.argwhere(np.isfinite(values)):
            for r, c in np.add(np.argwhere(np.ones((3, 3))), (row - 1, column - 1)):
                if (r, c) != (row, column) and 0 <= r < shape[0] and 0 <= c < shape[1]:
                    length = np.hypot(r - row, c - column)
                    touched = ((row, column), (r, c), (row, c), (r, column))
                    values[r, c] = min(values[r, c], after(values[row, column], length, touched))
    return values


@pytest.mark.parametrize('seed', range(5))
def test_path_is_the_shortest(seed):
    random = np.random.default_rng(seed)
    blocked, near = random.random((10, 13)) < 0.3, random.random((10, 13)) < 0.3
    blocked[0, 0] = False

    def after(value, length, touched):
        is_free = not any(blocked[cell] for cell in touched)
        return value + length * (10.0 if near[touched[1]] else 1.0) if is_free else np.inf

    lengths = _least(blocked.shape, (0, 0), after)
    for goal in [(9, 12), (5, 6), (0, 12), (9, 0), (3, 5)]:
        if blocked[goal]:
            continue
        way = keep_out.find_path(blocked, near, (0, 0), goal)
        if not np.isfinite(lengths[goal]):
            assert way == []
            continue
        assert (way[0], way[-1]) == ((0, 0), goal)
        steps = np.diff(way, axis=0)
        assert np.abs(steps).max() == 1
        costs = [10.0 if near[cell] else 1.0 for cell in way[1:]]
        assert np.hypot(*steps.T) @ costs == pytest.approx(lengths[goal])


def _map(*gaps):
    """Return a map of 300 x 200 m with unknown cells and a wall of lava at x = 140 m."""
    rows = np.zeros((20, 30), dtype=int)
    rows[:, 14] = 60
    for gap in gaps:
        rows[gap - 3 : gap + 4, 14] = 0
    rows[18:, 27:] = -1
    return rows.tolist()


def _distance_to_lava(plan, rows):
    cells = np.argwhere(np.array(rows) != 0)
    centres = 10.0 * cells[:, ::-1] + 5.0
    return np.linalg.norm(plan[:, None] - centres[None], axis=2).min()


def test_robot_avoids_lava(planner):
    node, plan = planner(keep_out.KeepOut)
    low = _map(4)
    node.on_hazard(grid(low))
    node.on_pose(pose(15.0, 95.0))
    node.on_goal(pose(285.0, 95.0))
    assert plan()[0].tolist() == [15.0, 95.0]
    assert plan()[-1].tolist() == [285.0, 95.0]
    assert _distance_to_lava(plan(), low) > 20.0
    assert plan()[np.abs(plan()[:, 0] - 145.0) < 5.0][0, 1] == pytest.approx(45.0, abs=10.0)
    assert np.abs(np.diff(plan(), axis=0)).max() == 10.0

    # the gap closes and another one opens
    node.on_hazard(grid(_map()))
    assert (len(plan()), node.reported) == (0, 'no way leads around the lava')
    high = _map(14)
    node.on_hazard(grid(high))
    assert _distance_to_lava(plan(), high) > 20.0
    assert plan()[np.abs(plan()[:, 0] - 145.0) < 5.0][0, 1] == pytest.approx(145.0, abs=10.0)

    for goal, reason in (
        (pose(145.0, 5.0), 'the goal is in lava: hazard 60'),
        (pose(295.0, 195.0), 'the goal is on unknown ground, which counts as not passable'),
        (pose(125.0, 5.0), 'the goal is nearer than 20 m to lava or unknown ground'),
        (pose(1e9, 5.0), 'the goal is outside the map'),
        (pose(float('nan'), 5.0), 'the goal is outside the map'),
        (pose(285.0, 95.0, 'odom'), "the goal is in frame 'odom', the map in 'map'"),
    ):
        node.on_goal(goal)
        assert (len(plan()), node.reported) == (0, reason)

    # lava is near: the path leads away from it first
    node.on_goal(pose(25.0, 45.0))
    node.on_pose(pose(125.0, 95.0))
    assert _distance_to_lava(plan()[:1], high) == 20.0
    assert _distance_to_lava(plan()[1:], high) > 20.0

    # nobody publishes the map
    node.watch()
    assert (len(plan()), node.reported) == (0, 'there is no hazard map')


@pytest.mark.parametrize('seed', range(5))
def test_path_is_the_fastest_without_lava(seed):
    random = np.random.default_rng(seed)
    until = np.where(random.random((9, 12)) < 0.3, np.inf, random.uniform(0.0, 30.0, (9, 12)))
    until[0, 0] = 20.0

    def after(value, length, touched):
        time = value + length
        return time if all(time < until[cell] for cell in touched) else np.inf

    times = _least(until.shape, (0, 0), after)
    for is_goal in (np.isinf(until), np.arange(108).reshape(9, 12) == 107):
        way = leave_in_time.find_path(until, (0, 0), is_goal, 1.0)
        if not np.isfinite(times[is_goal]).any():
            assert way == []
            continue
        assert way[0] == (0, 0) and is_goal[way[-1]]
        took = np.cumsum(np.hypot(*np.diff(way, axis=0).T)) if len(way) > 1 else np.zeros(1)
        assert took[-1] == pytest.approx(times[is_goal].min())
        assert all(time < until[cell] for time, cell in zip(took, way[1:], strict=False))


def test_deadline_is_the_earliest_arrival_within_the_clearance():
    arrival = np.full((5, 9), np.nan)
    arrival[2, 4], arrival[2, 8] = 50.0, -1.0
    until = leave_in_time.deadlines(arrival, 2.0)
    assert until[2].tolist() == [np.inf, np.inf, 50.0, 50.0, 50.0, 50.0, -1.0, -1.0, -1.0]
    assert until[0].tolist() == [np.inf] * 4 + [50.0] + [np.inf] * 3 + [-1.0]
    assert until[1, 2] == np.inf
    assert leave_in_time.deadlines(arrival, 0.0)[2, 4:].tolist() == [50.0, *[np.inf] * 3, -1.0]


def _coming(soon, late):
    """Return arrivals on 300 x 200 m of lava that spreads from the left up to column 24."""
    rows = np.full((20, 30), np.nan, np.float32)
    rows[:19, :5] = 0.0
    rows[:19, 5:25] = np.linspace(soon, late, 20)
    return rows


def test_robot_leaves_in_time_or_stops(planner):
    node, plan = planner(leave_in_time.LeaveInTime)
    node.margin, node.max_age = 30.0, 900.0

    def forecast(times, age=0.0):
        header = codec.header('map', time.time_ns() - int(age * 1e9))
        node.on_image(float_image(times, header))

    soon, later = _coming(200.0, 900.0), _coming(2000.0, 9000.0)
    node.on_grid(grid(np.zeros(soon.shape)))
    node.on_pose(pose(95.0, 95.0))
    forecast(soon)
    # down is nearer; to the right is also safe, but farther
    path = plan()
    assert path[0].tolist() == [95.0, 95.0]
    assert path[-1][0] >= 270.0 or path[-1][1] >= 190.0
    times = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
    front = np.interp(path[:, 0], 10.0 * np.arange(5, 25) + 5.0, np.linspace(200.0, 900.0, 20))
    assert (times + 30.0 <= front).all()

    # a goal that remains free is accepted, another one is not
    node.on_goal(pose(285.0, 45.0))
    assert plan()[-1].tolist() == [285.0, 45.0] and not node.reported
    node.on_goal(pose(205.0, 45.0))
    assert len(plan()) > 1 and plan()[-1][0] != 205.0
    assert node.reported == 'not to the goal, but to where no lava comes'

    for times, age, reason in (
        (soon, 600.0, 'no way leads out in time'),
        (np.full(soon.shape, -1.0, np.float32), 0.0, 'stop: the forecast has been withdrawn'),
    ):
        forecast(times, age)
        assert (len(plan()), node.reported) == (0, reason)
        forecast(later)
        assert len(plan()) > 1
    # a forecast that is too old, and one without a publisher
    for age, count in ((3600.0, 1), (0.0, 0)):
        node.count_publishers = lambda topic, count=count: count
        forecast(later, age)
        node.watch()
        assert (len(plan()), node.reported) == (0, 'stop: there is no forecast')
