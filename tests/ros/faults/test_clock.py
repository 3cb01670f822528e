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

"""A ROS clock that jumps: simulated time neither leaps nor goes back, and maps keep coming."""

import time

import pytest

#: Simulated seconds per second of the clock, and what of the clock is made up for at most [s].
SCALE, LAG = 10.0, 1.0


class Clocked:
    """A node under /clock, whoever sends that, and a listener."""

    def __init__(self, graph):
        self.node = graph.node(device='cpu', time_scale=SCALE, use_sim_time=True)
        self.publisher = graph.publisher()
        self.listener = graph.listener('height')
        self.jump(1000.0)
        self.publisher.publish('vents', 'terrain_info', 'terrain')
        self.node.wait_for_log('simulation running', timeout=90.0)

    def jump(self, to):
        """Put the clock to a time."""
        self.now = to
        self.publisher.clock(to)

    def run(self, seconds):
        """Let the clock run for some time and return the map of its last second."""
        for _ in range(round(seconds / 0.25)):
            self.jump(self.now + 0.25)
            time.sleep(0.02)
        last = (self.now - 1.1) * 1e9
        return self.listener.wait_for_topic(
            'height', lambda grid: last < grid['stamp_ns'] <= self.now * 1e9
        )

    def simulated(self):
        """Simulated time once it stands, as it does with the clock [s]."""
        told = []
        while len(told) < 2 or told[-1] != told[-2]:
            status = self.listener.wait_for_status(
                'simulation', lambda status: 'simulated_time_s' in status
            )
            assert status['state'] == 'running'
            told.append(status['simulated_time_s'])
        return float(told[-1])


@pytest.fixture(scope='module')
def clocked(graph):
    """One node for all jumps, one after the other."""
    result = Clocked(graph)
    result.run(5.0)
    return result


def test_a_clock_that_jumps(clocked):
    """Ahead, back and to 0: no leap, no way back, stamps as the clock has them, maps go on."""
    before = clocked.simulated()
    for to in (1e6, 500.0, 0.0):
        clocked.jump(to)
        after = clocked.simulated()
        assert before <= after <= before + SCALE * LAG + 1e-3
        grid = clocked.run(3.0)
        assert to < grid['stamp_ns'] / 1e9 <= to + 3.0
        before = clocked.simulated()
        assert after < before <= after + SCALE * 3.0 + 1e-3


def test_a_clock_that_shows_no_time(clocked):
    """A time before 0 is refused, once in the log, and the node goes on."""
    before = clocked.simulated()
    for _ in range(3):
        clocked.jump(-20.0)
        time.sleep(0.2)
    # /clock keeps the newest alone, so that not each of them need have been seen.
    status = clocked.listener.wait_for_status(
        'inputs', lambda status: 'rejected.message' in status
    )
    assert status['level'] == 1
    assert clocked.node.log.count('must not be negative') == 1
    clocked.jump(2000.0)
    clocked.run(2.0)
    assert clocked.simulated() > before
    assert clocked.node.end() == 0
