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

"""The example of a robot that leaves in time: its search, against the lava, and in a graph."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.forecast.lookahead import LookAhead
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from ros.conftest import Robot

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / 'examples/leave_in_time.py'

CELL = 10.0

NEVER = None


def _arrivals_by_waves(until, start, duration):
    """Earliest times at all cells by Bellman's sweeps, as slow as they are simple."""
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
def test_ways_are_the_quickest_that_are_not_overtaken(example, seed):
    """On random maps: never in a cell when its lava comes, and nobody is sooner at the goal."""
    random = np.random.default_rng(seed)
    until = np.where(random.random((9, 12)) < 0.3, np.inf, random.uniform(0.0, 30.0, (9, 12)))
    until[0, 0] = 20.0
    times = _arrivals_by_waves(until, (0, 0), 1.0)
    for is_goal in (np.isinf(until), np.arange(108).reshape(9, 12) == 107):
        way = example.find_way(until, (0, 0), is_goal, 1.0)
        if not np.isfinite(times[is_goal]).any():
            assert way == []
            continue
        assert way[0] == (0, 0) and is_goal[way[-1]]
        took = np.cumsum(np.hypot(*np.diff(way, axis=0).T)) if len(way) > 1 else np.zeros(1)
        assert took[-1] == pytest.approx(times[is_goal].min())
        assert all(time < until[cell] for time, cell in zip(took, way[1:], strict=False))


def test_deadlines_are_those_of_the_surroundings(example):
    """The earliest within the clearance; unknown ground counts as lava."""
    arrival = np.full((5, 9), np.nan)
    arrival[2, 4], arrival[2, 8] = 50.0, -1.0
    until = example.deadlines(arrival, 2.0)
    assert until[2].tolist() == [np.inf, np.inf, 50.0, 50.0, 50.0, 50.0, -1.0, -1.0, -1.0]
    assert until[0].tolist() == [np.inf] * 4 + [50.0] + [np.inf] * 3 + [-1.0]
    assert until[1, 2] == np.inf
    assert example.deadlines(arrival, 0.0)[2, 4:].tolist() == [50.0, *[np.inf] * 3, -1.0]


class Machine:
    """A machine that drives along its plans, slower than the lava."""

    speed, clearance, margin = 0.25, 20.0, 30.0

    def __init__(self, example, place):
        self.place = np.array(place)
        self.is_lost = False
        self._example = example

    @property
    def cell(self):
        """The cell it is in."""
        return tuple(int(index) for index in self.place[::-1] // CELL)

    def drive(self, arrival, age, duration, lava):
        """Plan, and drive for a time [s]; it is lost where the lava is."""
        self.is_lost |= bool(lava[self.cell])
        if self.is_lost:
            return
        way = self._example.way_out(
            arrival - age,
            self.cell,
            None,
            duration=CELL / self.speed,
            clearance=self.clearance / CELL,
            margin=self.margin,
        )
        if len(way) > 1:
            ahead = CELL * (np.array(way[1][::-1]) + 0.5) - self.place
            self.place += ahead * min(1.0, self.speed * duration / np.linalg.norm(ahead))


def test_who_sees_ahead_leaves_in_time(example):
    """In a valley: with the forecast a machine is safe, with the map of now the same is lost."""
    y, x = np.mgrid[0:40, 0:60] * CELL
    ground = 400.0 - 0.12 * x + 8e-4 * (y - 200.0) ** 2
    scene = Scene(
        Terrain(ground, CELL), (Vent((45.0, 205.0), 30.0, radius=15.0),), Lava(viscosity=1e3)
    )
    simulation = Simulation(
        scene,
        effects=Effects(steep=True),
        accuracy=Accuracy(spacing=8.0, thickness=2.0),
        device='cpu',
    )
    simulation.advance(60.0)
    checkpoint = simulation.checkpoint()
    forecast = LookAhead(checkpoint, horizon=900.0, threshold=0.01, device='cpu').run()
    sees_ahead, sees_now = (Machine(example, (405.0, 205.0)) for _ in range(2))
    assert 300.0 < forecast.arrival[sees_now.cell] < 700.0
    while simulation.time < 960.0:
        thickness = simulation.snapshot().thickness
        lava = thickness >= 0.01
        mask = np.where(lava, 0.0, np.nan)
        sees_ahead.drive(forecast.arrival, simulation.time - forecast.time, 5.0, lava)
        sees_now.drive(mask, 0.0, 5.0, lava)
        simulation.advance(simulation.time + 5.0)
    assert sees_now.is_lost
    assert not sees_ahead.is_lost
    distance = np.hypot(*(CELL * np.argwhere(lava)[:, ::-1] + 5.0 - sees_ahead.place).T)
    assert distance.min() >= Machine.clearance
    assert np.isnan(forecast.arrival[sees_ahead.cell])


def _coming(soon, late):
    """300 x 200 m: lava on the left comes to columns 5 to 24, from the left on; free beyond."""
    rows = [[0.0] * 5 + list(np.linspace(soon, late, 20)) + [NEVER] * 5 for _ in range(20)]
    rows[19][:] = [NEVER] * 30
    return rows


def _ends_at(x, y):
    return lambda plan: len(plan) > 1 and abs(plan[-1] - (x, y)).max() < 5.0


def test_a_robot_leaves(graph):
    """It goes where no lava comes, in time or not at all, and trusts no forecast that is gone."""
    parameters = ('speed:=1.0', 'margin:=30.0', 'max_age:=900.0')
    robot = Robot(graph, EXAMPLE, 'arrival', *parameters)
    robot.tell(arrival=_coming(200.0, 900.0), pose=[95.0, 95.0])
    # down is nearer; right it would be overtaken by nothing, but later
    plan = robot.plan(lambda plan: len(plan) > 1)
    assert plan[0].tolist() == [95.0, 95.0]
    assert plan[-1][0] >= 270.0 or plan[-1][1] >= 190.0
    times = np.append(0.0, np.cumsum(np.hypot(*np.diff(plan, axis=0).T)))
    front = np.interp(plan[:, 0], 10.0 * np.arange(5, 25) + 5.0, np.linspace(200.0, 900.0, 20))
    assert (times + 30.0 <= front).all()

    # a goal that stays free is taken, one that does not is not
    robot.tell(goal=[285.0, 45.0])
    robot.plan(_ends_at(285.0, 45.0))
    robot.tell(goal=[205.0, 45.0])
    robot.plan(lambda plan: len(plan) > 1 and plan[-1][0] != 205.0)
    robot.says('not to the goal, but to where no lava comes')

    # the same forecast, much older: what was far off is near
    robot.tell(arrival=_coming(200.0, 900.0), age=600.0)
    robot.plan(lambda plan: len(plan) == 0)
    robot.says('no way leads out in time')

    # older than anybody should trust
    robot.tell(arrival=_coming(2000.0, 9000.0), pose=[95.0, 95.0])
    robot.plan(lambda plan: len(plan) > 1)
    robot.tell(arrival=_coming(2000.0, 9000.0), age=3600.0)
    robot.says('stop: there is no forecast')

    # taken back by the node
    robot.tell(arrival=_coming(2000.0, 9000.0))
    robot.plan(lambda plan: len(plan) > 1)
    robot.tell(arrival=[[-1.0] * 30] * 20)
    robot.plan(lambda plan: len(plan) == 0)
    robot.says('stop: the forecast has been withdrawn')

    # nobody is there to take it back
    robot.tell(arrival=_coming(2000.0, 9000.0))
    robot.plan(lambda plan: len(plan) > 1)
    robot.tell(leave=True)
    robot.plan(lambda plan: len(plan) == 0)


def test_the_example_is_short():
    """A few pages to read, the license included."""
    assert len(EXAMPLE.read_text(encoding='utf-8').splitlines()) <= 265
