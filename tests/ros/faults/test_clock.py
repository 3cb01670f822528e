# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Time on /clock: absent, of a replay, or with jumps; and a custom layer file."""

import signal
import time

import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from lava_ros.bag import BagWriter, QosProfile
from ros.conftest import QUICK

SECOND = 10**9

#: Simulated seconds per second of the clock.
SCALE = 2.0

#: Maximum lag of the newest map behind the clock [s of the clock], with maps due once a second.
BEHIND = 2.0

#: Start and maximum length of the replayed bag [s], and rate of the replay.
START, LENGTH, RATE = 1000, 600, 10

#: Program that warns of a clock that stands still after one second.
IMPATIENT = 'from lava_ros.live import clock\nclock.PATIENCE = 1.0\n'

CONFIG = """
layers:
  depth: {source: thickness, message: sensor_msgs/Image, threshold: 0.0, rate: 1.0}
  danger: {source: hazard, message: nav_msgs/OccupancyGrid, rate: 1.0}
"""


class Clocked:
    """A node that follows /clock, and a listener."""

    def __init__(self, graph):
        self.graph, self.now = graph, 0.0
        (graph.directory / 'mine.yaml').write_text(CONFIG, encoding='utf-8')
        self.node = graph.node(
            program=('-c', IMPATIENT + QUICK), device='cpu', time_scale=SCALE, use_sim_time=True,
            msg_config='mine.yaml', effects_off=['cooling'],
        )
        self.publisher = graph.publisher()
        self.listener = graph.listener('depth:image', 'danger', 'height')
        self.publisher.publish('vents', 'terrain_info', 'terrain')
        self.node.wait_for_log('simulation running', timeout=90.0)

    def jump(self, to):
        """Set the clock to a time."""
        self.now = to
        self.publisher.clock(to)

    def run(self, seconds):
        """Advance the clock and return the map of its last second."""
        for _ in range(round(seconds / 0.25)):
            self.jump(self.now + 0.25)
            time.sleep(0.02)
        last = (self.now - 1.1) * 1e9
        return self.listener.wait_for_topic(
            'danger', lambda grid: last < grid['stamp_ns'] <= self.now * 1e9
        )

    def simulated(self):
        """Return simulated time once it stands still with the clock [s]."""
        times = []

        def stands(status):
            times.append(status.get('simulated_time_s'))
            # on a busy machine a step may take longer than a heartbeat and still lag
            is_behind = 'slower' in status['message']
            return len(times) > 5 and times[-5:] == 5 * times[-1:] and not is_behind

        self.listener.hear()
        status = self.listener.wait_for_status('simulation', stands)
        assert status['state'] == 'running'
        return float(status['simulated_time_s'])


@pytest.fixture
def clocked(graph, alone):
    return Clocked(graph)


def test_missing_clock_is_a_warning_and_time_stands_still(clocked):
    silent = clocked.listener.wait_for_status(
        'simulation',
        lambda status: '/clock' in status['message'] and status['state'] == 'running'
        # the first status of a running simulation may come before its first readback
        and status['simulated_time_s'] == '0.0',
    )
    assert silent['level'] == 1
    assert silent['message'].startswith('/clock does not arrive, so simulated time stands still')
    assert clocked.listener.seen[-1]['stamp_ns'] == 0
    clocked.node.wait_for_log('/clock does not arrive')


def test_node_follows_the_clock_of_a_replay(clocked, tmp_path):
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        # a graph without lava that publishes /clock
        for second in range(LENGTH + 1):
            data = serialize_message(String(data=f'{second}'))
            stamp = (START + second) * SECOND
            writer.write('/text', 'std_msgs/msg/String', data, stamp, qos=QosProfile())
    words = ('replay', '--rate', f'{RATE}', str(tmp_path / 'bag'))
    player = clocked.graph.process('-m', 'lava_ros.cli.main', *words)
    listener = clocked.listener
    found = listener.newest(
        'depth', 'danger',
        condition=lambda newest: newest['depth']['max'] > 0.0 and newest['danger']['max'] == 100,
    )
    assert (found['depth']['shape'], found['depth']['encoding']) == ([30, 40], '32FC1')
    most = 4.0 * SCALE
    listener.wait_for_status(
        'simulation',
        lambda item: float(item['simulated_time_s']) > most and '/clock' not in item['message'],
    )
    # a busy machine may have published no later map by now
    shown_ns = found['danger']['stamp_ns']
    listener.wait_for_topic('danger', lambda grid: grid['stamp_ns'] > shown_ns)
    player.end(signal.SIGINT)
    listener.wait_for_status('simulation', lambda item: 'clock stands still' in item['message'])
    clocked.node.wait_for_log('/clock stands still')
    warnings = [line for line in clocked.node.log.splitlines() if '/clock' in line]
    assert all('[WARN]' in line for line in warnings), warnings
    beats = [item['stamp_ns'] for item in listener.seen if item['topic'] == 'diagnostics']
    assert beats[-1] == beats[-2]
    # at most the time of the clock; a busy machine may lose some
    assert clocked.simulated() <= SCALE * (beats[-1] / SECOND - START)
    stamps = [item['stamp_ns'] for item in listener.seen if item['topic'] == 'danger']
    stamps = [stamp for stamp in stamps if stamp > 0]
    assert stamps == sorted(stamps) and START * SECOND <= stamps[0] and stamps[-1] <= beats[-1]
    # at most one map per second of the clock
    assert 1 < len(stamps) <= (stamps[-1] - stamps[0]) / SECOND + 2
    assert 'height' not in {item['topic'] for item in listener.seen}
    assert listener.wait_for_status('effects')['cooling'] == 'off: forced'


@pytest.mark.parametrize(
    'step',
    [
        pytest.param(2.0, marks=pytest.mark.nightly),
        5.0,
        pytest.param(30.0, marks=pytest.mark.nightly),
    ],
)
def test_simulated_time_follows_a_coarse_clock(clocked, step):
    clocked.run(2.0)
    before, count = clocked.simulated(), 4
    for _ in range(count):
        clocked.jump(clocked.now + step)
        time.sleep(0.3)
    after = clocked.simulated()
    # on a busy machine the newest map may be of an earlier step
    assert before + SCALE * (count - 1) * step <= after <= before + SCALE * (count * step + BEHIND)


def test_jump_of_the_clock_does_not_change_simulated_time(clocked):
    clocked.run(2.0)
    before = clocked.simulated()
    for to in (1e6, 500.0, 0.0):
        where = 'ahead' if to > clocked.now else 'back'
        clocked.jump(to)
        status = clocked.listener.wait_for_status(
            'simulation',
            lambda status: f'the clock jumped {where}' in status['message'],  # noqa: B023
        )
        assert status['level'] == 1
        after = clocked.simulated()
        assert before <= after <= before + SCALE * BEHIND
        grid = clocked.run(3.0)
        assert to < grid['stamp_ns'] / 1e9 <= to + 3.0
        before = clocked.simulated()
        assert after < before <= after + SCALE * (3.0 + BEHIND)


def test_rejects_a_negative_time_of_the_clock(clocked):
    clocked.run(2.0)
    before = clocked.simulated()
    for _ in range(3):
        clocked.jump(-20.0)
        time.sleep(0.2)
    # /clock keeps only the newest time, so some may be missed
    status = clocked.listener.wait_for_status(
        'inputs', lambda status: 'rejected.message' in status
    )
    assert status['level'] == 1
    clocked.node.wait_for_log('must not be negative')
    assert clocked.node.log.count('must not be negative') == 1
    clocked.jump(2000.0)
    clocked.run(2.0)
    assert clocked.simulated() > before
    assert clocked.node.end() == 0
