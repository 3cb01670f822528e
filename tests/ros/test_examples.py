# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The examples of robots that avoid lava or leave in time: path search, and robots in a graph."""

import itertools
import json
from pathlib import Path
import time

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from lava_ros.effects import Effects
from lava_ros.forecast.forecast_run import ForecastRun
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from scripts import load_script
from waiting import PATIENCE

EXAMPLES = Path(__file__).parents[2] / 'examples'

CELL = 10.0

NEVER = None


keep_out = load_script(EXAMPLES / 'keep_out.py')
leave_in_time = load_script(EXAMPLES / 'leave_in_time.py')


@pytest.mark.parametrize(('name', 'most'), [('keep_out', 200), ('leave_in_time', 265)])
def test_examples_are_short(name, most):
    assert len((EXAMPLES / f'{name}.py').read_text(encoding='utf-8').splitlines()) <= most


class Robot:
    """An example and the rest of its robot, in one graph."""

    def __init__(self, graph, example, topic, *parameters):
        words = ['--ros-args', '-r', f'__ns:=/robot_{topic}']
        options = [word for item in parameters for word in ('-p', item)]
        self.example = graph.process(str(EXAMPLES / example), *words, *options)
        robot = Path(__file__).with_name('graph_robot.py')
        self.rest = graph.process(str(robot), topic, *words)
        assert self.rest.line(PATIENCE) == 'ready'

    def publish(self, **messages):
        self.rest.child.stdin.write(json.dumps(messages) + '\n')
        self.rest.child.stdin.flush()

    def plan(self, condition=lambda plan: len(plan) > 1, timeout=PATIENCE):
        """Return the next plan that fulfils a condition, by default that is not empty."""
        end = time.monotonic() + timeout
        while True:
            assert time.monotonic() < end, self.example.log
            try:
                line = self.rest.line(timeout)
            except AssertionError as error:
                raise AssertionError(f'{error}; the example:\n{self.example.log}') from error
            plan = np.array(json.loads(line)).reshape(-1, 2)
            if condition(plan):
                return plan

    def stops(self, reason):
        """Wait until the plan is to stop, with the reason in the log."""
        self.plan(lambda plan: len(plan) == 0)
        self.example.wait_for_log(reason)


def _shortest(blocked, near, start):
    """Return the lengths of the shortest paths from a cell, by scipy's Dijkstra."""
    rows, columns = blocked.shape
    links = []
    for row, column in np.argwhere(~blocked):
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1), (0, -1), (-1, 0), (-1, -1), (-1, 1)):
            r, c = row + dr, column + dc
            if not (0 <= r < rows and 0 <= c < columns) or blocked[r, c]:
                continue
            if blocked[row, c] or blocked[r, column]:
                continue
            length = np.hypot(dr, dc) * (10.0 if near[r, c] else 1.0)
            links.append((row * columns + column, r * columns + c, length))
    tails, heads, lengths = zip(*links, strict=True)
    graph = coo_array((lengths, (tails, heads)), shape=(blocked.size, blocked.size))
    return dijkstra(graph.tocsr(), indices=start[0] * columns + start[1]).reshape(blocked.shape)


@pytest.mark.parametrize('seed', range(6))
def test_path_is_the_shortest(seed):
    random = np.random.default_rng(seed)
    blocked, near = random.random((18, 25)) < 0.3, random.random((18, 25)) < 0.3
    blocked[0, 0] = False
    lengths = _shortest(blocked, near, (0, 0))
    for goal in [(17, 24), (9, 12), (0, 24), (17, 0), (3, 5)]:
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


def test_robot_avoids_lava(graph):
    robot = Robot(graph, 'keep_out.py', 'hazard', 'clearance:=20.0')
    low = _map(4)
    robot.publish(hazard=low, pose=[15.0, 95.0], goal=[285.0, 95.0])
    plan = robot.plan()
    assert plan[0].tolist() == [15.0, 95.0]
    assert plan[-1].tolist() == [285.0, 95.0]
    assert _distance_to_lava(plan, low) > 20.0
    assert plan[np.abs(plan[:, 0] - 145.0) < 5.0][0, 1] == pytest.approx(45.0, abs=10.0)
    assert np.abs(np.diff(plan, axis=0)).max() == 10.0

    # the gap closes and another one opens
    robot.publish(hazard=_map())
    robot.stops('no way leads around the lava')
    high = _map(14)
    robot.publish(hazard=high)
    plan = robot.plan()
    assert _distance_to_lava(plan, high) > 20.0
    assert plan[np.abs(plan[:, 0] - 145.0) < 5.0][0, 1] == pytest.approx(145.0, abs=10.0)

    for goal, reason in (
        ([145.0, 5.0], 'the goal is in lava: hazard 60'),
        ([295.0, 195.0], 'the goal is on unknown ground, which counts as not passable'),
        ([125.0, 5.0], 'the goal is nearer than 20 m'),
        ([1e9, 5.0], 'the goal is outside the map'),
        ([float('nan'), 5.0], 'the goal is outside the map'),
        ([285.0, 95.0, 'odom'], "the goal is in frame 'odom', the map in 'map'"),
    ):
        robot.publish(goal=goal)
        robot.stops(f'stop: {reason}')

    # lava is near: the path leads away from it first
    robot.publish(goal=[25.0, 45.0])
    robot.plan()
    robot.publish(pose=[125.0, 95.0])
    plan = robot.plan(lambda plan: len(plan) > 1 and plan[0, 0] == 125.0)
    assert _distance_to_lava(plan[:1], high) == 20.0
    assert _distance_to_lava(plan[1:], high) > 20.0

    robot.publish(leave=True)
    robot.stops('stop: there is no hazard map')


def _arrivals_by_waves(until, start, duration):
    """Return the earliest times at all cells by Bellman-Ford, which is slow but simple."""
    times = np.full(until.shape, np.inf)
    times[start] = 0.0
    steps = [step for step in itertools.product((-1, 0, 1), repeat=2) if step != (0, 0)]
    for _ in range(until.size):
        before = times.copy()
        for row, column in np.argwhere(np.isfinite(times)):
            for dr, dc in steps:
                r, c = row + dr, column + dc
                if not (0 <= r < until.shape[0] and 0 <= c < until.shape[1]):
                    continue
                after = times[row, column] + np.hypot(dr, dc) * duration
                corners = (until[row, column], until[r, c], until[row, c], until[r, column])
                if after < min(corners):
                    times[r, c] = min(times[r, c], after)
        if (times == before).all():
            return times
    raise AssertionError('no end')


@pytest.mark.parametrize('seed', range(5))
def test_path_is_the_fastest_without_lava(seed):
    random = np.random.default_rng(seed)
    until = np.where(random.random((9, 12)) < 0.3, np.inf, random.uniform(0.0, 30.0, (9, 12)))
    until[0, 0] = 20.0
    times = _arrivals_by_waves(until, (0, 0), 1.0)
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


class Machine:
    """A machine that drives along its plans more slowly than the lava."""

    speed, clearance, margin = 0.25, 20.0, 30.0

    def __init__(self, place):
        self.place = np.array(place)
        self.is_lost = False

    @property
    def cell(self):
        return tuple(int(index) for index in self.place[::-1] // CELL)

    def drive(self, arrival, age, duration, lava):
        """Plan, and drive for a time [s]; lava in its cell destroys the machine."""
        self.is_lost |= bool(lava[self.cell])
        if self.is_lost:
            return
        way = leave_in_time.way_out(
            arrival - age, self.cell, None, duration=CELL / self.speed,
            clearance=self.clearance / CELL, margin=self.margin,
        )
        if len(way) > 1:
            ahead = CELL * (np.array(way[1][::-1]) + 0.5) - self.place
            self.place += ahead * min(1.0, self.speed * duration / np.linalg.norm(ahead))


def test_machine_survives_with_a_forecast_but_not_with_the_current_map():
    y, x = np.mgrid[0:40, 0:60] * CELL
    ground = 400.0 - 0.12 * x + 8e-4 * (y - 200.0) ** 2
    scene = Scene(
        Terrain(ground, CELL), (Vent((45.0, 205.0), 30.0, radius=15.0),), Lava(viscosity=1e3)
    )
    simulation = Simulation(
        scene, effects=Effects(steep=True), accuracy=Accuracy(spacing=8.0, thickness=2.0),
        device='cpu',
    )
    # with one limit, stops do not change the flow
    end = 960.0
    simulation.advance(60.0, limit=end)
    checkpoint = simulation.checkpoint()
    forecast = ForecastRun(checkpoint, horizon=900.0, threshold=0.01, device='cpu').run()
    with_forecast, with_map = (Machine((405.0, 205.0)) for _ in range(2))
    assert 300.0 < forecast.arrival[with_map.cell] < 700.0
    while simulation.time < end:
        thickness = simulation.snapshot().thickness
        lava = thickness >= 0.01
        mask = np.where(lava, 0.0, np.nan)
        with_forecast.drive(forecast.arrival, simulation.time - forecast.time, 5.0, lava)
        with_map.drive(mask, 0.0, 5.0, lava)
        simulation.advance(min(simulation.time + 5.0, end), limit=end)
    assert with_map.is_lost
    assert not with_forecast.is_lost
    distance = np.hypot(*(CELL * np.argwhere(lava)[:, ::-1] + 5.0 - with_forecast.place).T)
    assert distance.min() >= Machine.clearance
    assert np.isnan(forecast.arrival[with_forecast.cell])


def _coming(soon, late):
    """Return a map of 300 x 200 m with lava that spreads from the left up to column 24."""
    rows = [[0.0] * 5 + list(np.linspace(soon, late, 20)) + [NEVER] * 5 for _ in range(20)]
    rows[19][:] = [NEVER] * 30
    return rows


def _ends_at(x, y):
    return lambda plan: len(plan) > 1 and abs(plan[-1] - (x, y)).max() < 5.0


def test_robot_leaves_in_time_or_stops(graph):
    parameters = ('speed:=1.0', 'margin:=30.0', 'max_age:=900.0')
    robot = Robot(graph, 'leave_in_time.py', 'arrival', *parameters)
    robot.publish(arrival=_coming(200.0, 900.0), pose=[95.0, 95.0])
    # down is nearer; to the right is also safe, but farther
    plan = robot.plan()
    assert plan[0].tolist() == [95.0, 95.0]
    assert plan[-1][0] >= 270.0 or plan[-1][1] >= 190.0
    times = np.append(0.0, np.cumsum(np.hypot(*np.diff(plan, axis=0).T)))
    front = np.interp(plan[:, 0], 10.0 * np.arange(5, 25) + 5.0, np.linspace(200.0, 900.0, 20))
    assert (times + 30.0 <= front).all()

    # a goal that remains free is accepted, another one is not
    robot.publish(goal=[285.0, 45.0])
    robot.plan(_ends_at(285.0, 45.0))
    robot.publish(goal=[205.0, 45.0])
    robot.plan(lambda plan: len(plan) > 1 and plan[-1][0] != 205.0)
    robot.example.wait_for_log('not to the goal, but to where no lava comes')

    # a much older forecast
    robot.publish(arrival=_coming(200.0, 900.0), age=600.0)
    robot.stops('no way leads out in time')

    robot.publish(arrival=_coming(2000.0, 9000.0), pose=[95.0, 95.0])
    robot.plan()
    robot.publish(arrival=_coming(2000.0, 9000.0), age=3600.0)
    robot.example.wait_for_log('stop: there is no forecast')

    robot.publish(arrival=_coming(2000.0, 9000.0))
    robot.plan()
    robot.publish(arrival=[[-1.0] * 30] * 20)
    robot.stops('stop: the forecast has been withdrawn')

    # no publisher
    robot.publish(arrival=_coming(2000.0, 9000.0))
    robot.plan()
    robot.publish(leave=True)
    robot.stops('')
