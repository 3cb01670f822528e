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

"""The example of a robot that stays out: its search, and itself in a real graph."""

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from ros.conftest import Robot

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / 'examples/keep_out.py'


def _shortest(blocked, near, start):
    """Lengths of the shortest ways from a cell, by scipy's Dijkstra."""
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
def test_ways_are_the_shortest(example, seed):
    """On random maps each way is as long as Dijkstra's, and there is one when he has one."""
    random = np.random.default_rng(seed)
    blocked, near = random.random((18, 25)) < 0.3, random.random((18, 25)) < 0.3
    blocked[0, 0] = False
    lengths = _shortest(blocked, near, (0, 0))
    for goal in [(17, 24), (9, 12), (0, 24), (17, 0), (3, 5)]:
        if blocked[goal]:
            continue
        way = example.find_way(blocked, near, (0, 0), goal)
        if not np.isfinite(lengths[goal]):
            assert way == []
            continue
        assert (way[0], way[-1]) == ((0, 0), goal)
        steps = np.diff(way, axis=0)
        assert np.abs(steps).max() == 1
        costs = [10.0 if near[cell] else 1.0 for cell in way[1:]]
        assert np.hypot(*steps.T) @ costs == pytest.approx(lengths[goal])


def test_the_example_is_short():
    """A page or two to read, the license included."""
    assert len(EXAMPLE.read_text(encoding='utf-8').splitlines()) <= 200


def _map(*gaps):
    """300 x 200 m with a wall of lava at x = 140 m, open at rows of cells, and unknown ground."""
    rows = np.zeros((20, 30), dtype=int)
    rows[:, 14] = 60
    for gap in gaps:
        rows[gap - 3 : gap + 4, 14] = 0
    rows[18:, 27:] = -1
    return rows.tolist()


def _is_stop(plan):
    return len(plan) == 0


def _is_way(plan):
    return len(plan) > 1


def _distance_to_lava(plan, rows):
    cells = np.argwhere(np.array(rows) != 0)
    centres = 10.0 * cells[:, ::-1] + 5.0
    return np.linalg.norm(plan[:, None] - centres[None], axis=2).min()


def test_a_robot_stays_out(graph):
    """It goes round, plans anew when the map changes, and stops rather than drive into lava."""
    robot = Robot(graph, EXAMPLE, 'hazard', 'clearance:=20.0')
    low = _map(4)
    robot.tell(hazard=low, pose=[15.0, 95.0], goal=[285.0, 95.0])
    plan = robot.plan(_is_way)
    assert plan[0].tolist() == [15.0, 95.0]
    assert plan[-1].tolist() == [285.0, 95.0]
    assert _distance_to_lava(plan, low) > 20.0
    assert plan[np.abs(plan[:, 0] - 145.0) < 5.0][0, 1] == pytest.approx(45.0, abs=10.0)
    assert np.abs(np.diff(plan, axis=0)).max() == 10.0

    # The gap closes, and another one opens.
    robot.tell(hazard=_map())
    robot.plan(_is_stop)
    robot.says('no way leads around the lava')
    high = _map(14)
    robot.tell(hazard=high)
    plan = robot.plan(_is_way)
    assert _distance_to_lava(plan, high) > 20.0
    assert plan[np.abs(plan[:, 0] - 145.0) < 5.0][0, 1] == pytest.approx(145.0, abs=10.0)

    # Goals it does not take, each with the reason.
    for goal, reason in (
        ([145.0, 5.0], 'the goal is in lava: hazard 60'),
        ([295.0, 195.0], 'the goal is on unknown ground, which counts as not passable'),
        ([125.0, 5.0], 'the goal is nearer than 20 m'),
        ([1e9, 5.0], 'the goal is outside the map'),
        ([float('nan'), 5.0], 'the goal is outside the map'),
        ([285.0, 95.0, 'odom'], "the goal is in frame 'odom', the map in 'map'"),
    ):
        robot.tell(goal=goal)
        robot.plan(_is_stop)
        robot.says(f'stop: {reason}')

    # The lava has come near: the way leads out of its surroundings first, and stays out.
    robot.tell(goal=[25.0, 45.0])
    robot.plan(_is_way)
    robot.tell(pose=[125.0, 95.0])
    plan = robot.plan(lambda plan: len(plan) > 1 and plan[0, 0] == 125.0)
    assert _distance_to_lava(plan[:1], high) == 20.0
    assert _distance_to_lava(plan[1:], high) > 20.0

    # Nobody keeps the map any more.
    robot.tell(leave=True)
    robot.plan(_is_stop)
    robot.says('stop: there is no hazard map')
