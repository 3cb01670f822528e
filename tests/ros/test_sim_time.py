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

"""Simulated time on /clock from a replayed bag: late, ten times as fast, and stopped."""

import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from lava_ros.bag import BagWriter, QosProfile

SECOND = 10**9
START, LENGTH, RATE = 1000, 60, 10


@pytest.fixture
def bag(tmp_path):
    """A minute of a graph without lava: what puts its time on /clock."""
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        for second in range(LENGTH + 1):
            data = serialize_message(String(data=f'{second}'))
            stamp = (START + second) * SECOND
            writer.write('/text', 'std_msgs/msg/String', data, stamp, qos=QosProfile())
    return tmp_path / 'bag'


def test_the_clock_of_a_replay(graph, bag):
    """The node waits for the clock, follows it at its rate, stamps by it and stops with it."""
    node = graph.node(device='cpu', use_sim_time=True)
    publisher, listener = graph.publisher(), graph.listener('height')
    publisher.publish('vents', 'terrain_info', 'terrain')
    node.wait_for_log('simulation running', timeout=90.0)

    def status():
        listener.hear()
        return listener.wait_for_status('simulation')

    # without a clock there is no time, but there is a heartbeat and a first map
    first = status()
    assert (first['state'], first['simulated_time_s']) == ('running', '0.0')
    assert listener.seen[-1]['stamp_ns'] == 0
    silent = listener.wait_for_status('simulation', lambda status: '/clock' in status['message'])
    assert (silent['level'], silent['state']) == (1, 'running')
    assert silent['message'].startswith('/clock does not arrive, so simulated time stands still')
    node.wait_for_log('/clock does not arrive')

    player = graph.process('-m', 'lava_ros.cli.main', 'replay', '--rate', f'{RATE}', str(bag))
    grid = listener.wait_for_topic('height', lambda grid: grid['wet'] > 0, timeout=60.0)
    moving = status()
    assert '/clock' not in moving['message'], moving
    assert START * SECOND <= grid['stamp_ns'] <= (START + LENGTH) * SECOND
    assert player.child.wait(60.0) == 0, player.log
    last = status()
    while (again := status())['simulated_time_s'] != last['simulated_time_s']:
        last = again
    # no second more than there was; a busy machine that falls behind loses some of them
    assert 1.0 < float(last['simulated_time_s']) <= LENGTH + 1.0
    assert last['state'] == 'running'

    grids = [item for item in listener.seen if item['topic'] == 'height']
    stamps = [item['stamp_ns'] for item in grids if item['stamp_ns'] >= START * SECOND]
    assert stamps == sorted(stamps)
    assert stamps[-1] <= (START + LENGTH) * SECOND
    # one for each second of the clock at most
    assert 1 < len(stamps) <= LENGTH + 2
    beats = [item['stamp_ns'] for item in listener.seen if item['topic'] == 'diagnostics']
    assert beats[-1] == beats[-2] <= (START + LENGTH) * SECOND
    listener.wait_for_status('simulation', lambda told: 'clock stands still' in told['message'])
    said = [line for line in node.log.splitlines() if '/clock' in line]
    assert len(said) == 2 and all('[WARN]' in line for line in said), said
    assert node.end() == 0
