# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Time on /clock: absent, of a replay, and stopped."""

import signal

import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from lava_ros.bag import BagWriter, QosProfile
from ros.conftest import QUICK

SECOND = 10**9

#: Simulated seconds per second of the clock.
SCALE = 2.0

#: Start and maximum length of the replayed bag [s], and rate of the replay.
START, LENGTH, RATE = 1000, 600, 10

#: Program that warns of a clock that stands still after one second.
IMPATIENT = 'from lava_ros.live import clock\nclock.PATIENCE = 1.0\n'

CONFIG = """
layers:
  depth: {source: thickness, message: sensor_msgs/Image, threshold: 0.0, rate: 1.0}
  danger: {source: hazard, message: nav_msgs/OccupancyGrid, rate: 1.0}
"""


@pytest.mark.nightly
def test_node_waits_for_the_clock_of_a_replay_and_follows_it(graph, tmp_path):
    (graph.directory / 'mine.yaml').write_text(CONFIG, encoding='utf-8')
    node = graph.node(
        program=('-c', IMPATIENT + QUICK), device='cpu', time_scale=SCALE, use_sim_time=True,
        msg_config='mine.yaml',
    )
    publisher, listener = graph.publisher(), graph.listener('depth:image', 'danger', 'height')
    publisher.publish('vents', 'terrain_info', 'terrain')
    silent = listener.wait_for_status(
        'simulation',
        # the first status of a running simulation may come before its first readback
        lambda item: '/clock' in item['message'] and item['simulated_time_s'] == '0.0',
    )
    assert silent['level'] == 1
    assert silent['message'].startswith('/clock does not arrive, so simulated time stands still')
    assert listener.seen[-1]['stamp_ns'] == 0
    node.wait_for_log('/clock does not arrive')

    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        # a graph without lava that publishes /clock
        for second in range(LENGTH + 1):
            data = serialize_message(String(data=f'{second}'))
            stamp = (START + second) * SECOND
            writer.write('/text', 'std_msgs/msg/String', data, stamp, qos=QosProfile())
    words = ('ros', 'replay', '--rate', f'{RATE}', str(tmp_path / 'bag'))
    player = graph.process('-m', 'lava_ros.cli.main', *words)
    found = listener.newest(
        'depth', 'danger',
        condition=lambda newest: newest['depth']['max'] > 0.0 and newest['danger']['max'] == 100,
    )
    assert (found['depth']['shape'], found['depth']['encoding']) == ([30, 40], '32FC1')
    # a busy machine may have published no later map by now
    shown_ns = found['danger']['stamp_ns']
    listener.wait_for_topic('danger', lambda grid: grid['stamp_ns'] > shown_ns)
    player.end(signal.SIGINT)
    stopped = listener.wait_for_status(
        'simulation', lambda item: 'clock stands still' in item['message']
    )
    node.wait_for_log('/clock stands still')
    warnings = [line for line in node.log.splitlines() if '/clock' in line]
    assert all('[WARN]' in line for line in warnings), warnings
    end = listener.seen[-1]['stamp_ns']
    # at most the time of the clock; a busy machine may lose some
    assert float(stopped['simulated_time_s']) <= SCALE * (end / SECOND - START)
    stamps = [item['stamp_ns'] for item in listener.seen if item['topic'] == 'danger']
    stamps = [stamp for stamp in stamps if stamp > 0]
    assert stamps == sorted(stamps) and START * SECOND <= stamps[0] and stamps[-1] <= end
    # at most one map per second of the clock
    assert 1 < len(stamps) <= (stamps[-1] - stamps[0]) / SECOND + 2
    assert 'height' not in {item['topic'] for item in listener.seen}
