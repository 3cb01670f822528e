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

"""Faults of the simulation in a running node, and what others in the graph can throw at it.

What goes wrong is said, survived, and never shown as a map.
"""

from pathlib import Path
import signal

import numpy as np
import pytest

GRIDS = ('height', 'temperature', 'hazard')
ERROR = 2

#: Longest time between two grids or heartbeats under load that passes on a busy machine [s].
LONGEST_GAP = 30.0

#: Subscribes to grids, asks for every message, says so once they are published, and reads none.
DEAF = """
import sys, time
from nav_msgs.msg import OccupancyGrid
import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
everything = QoSProfile(
    history=HistoryPolicy.KEEP_ALL, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
rclpy.init()
node = rclpy.create_node('deaf_listener')
ears = [node.create_subscription(OccupancyGrid, i, print, everything) for i in sys.argv[1:]]
while not all(node.count_publishers(topic) for topic in sys.argv[1:]):
    time.sleep(0.1)
print('deaf', flush=True)
time.sleep(600.0)
"""

#: What memory may grow by under load [MiB].
MOST_GROWTH = 64.0


class Faulty:
    """A node that simulates, with a fault to switch on, someone who feeds it and a listener."""

    def __init__(self, graph):
        self.graph = graph
        self.node = graph.faulty_node(time_scale=100.0, device='cpu', max_terrain_cells=1_000_000)
        self.publisher = graph.publisher()
        self.listener = graph.listener(*GRIDS)
        self.publisher.publish('vents', 'terrain_info', 'terrain')
        self.wait_for_lava()

    def wait_for_lava(self):
        """Wait for a map with lava on it."""
        self.listener.wait_for_topic('height', lambda grid: grid['wet'] > 0, timeout=90.0)

    def reset(self):
        """Switch the fault off and start again, until there is lava."""
        self.graph.fault()
        assert self.publisher.call('reset')['success']
        assert self.status(lambda status: status['state'] == 'running')['level'] != ERROR
        self.wait_for_lava()

    def status(self, condition=lambda _: True, task='simulation'):
        """The state of a task in diagnostics of now or later that fulfil a condition."""
        return self.listener.status_now(task, condition)

    def memory(self):
        """Resident memory of the node [MiB]."""
        status = Path(f'/proc/{self.node.child.pid}/status').read_text(encoding='utf-8')
        (line,) = [line for line in status.splitlines() if line.startswith('VmRSS')]
        return int(line.split()[1]) / 1024.0

    def now(self):
        """How much has been heard, and the memory of the node."""
        return self.listener.hear(), self.memory()

    def goes_on(self, before, growth=MOST_GROWTH):
        """Maps and heartbeats have come from a moment on, and memory has not grown by more."""
        since, memory = before
        self.listener.hear()
        for topic in ('height', 'diagnostics'):
            seen = [item for item in self.listener.seen[since:] if item['topic'] == topic]
            assert len(seen) > 2, f'{topic}: {len(seen)} messages'
            assert np.diff([item['stamp_ns'] for item in seen]).max() < LONGEST_GAP * 1e9
        assert self.memory() - memory < growth

    def wait_for_discharge(self, expected):
        """Wait until between two heartbeats the vents give this [m3/s]."""
        self.listener.hear()
        points = []

        def is_reached(status):
            points.append((float(status['simulated_time_s']), float(status['volume_emitted_m3'])))
            (t0, v0), (t1, v1) = points[-2:] if len(points) > 1 else points * 2
            return t1 > t0 and (v1 - v0) / (t1 - t0) == pytest.approx(expected, rel=1e-3)

        self.status(is_reached)


@pytest.fixture(scope='module')
def faulty(graph):
    """One node for all faults, one after the other."""
    return Faulty(graph)


@pytest.mark.parametrize(
    ('fault', 'words'),
    [
        ('raise', ['RuntimeError: device lost']),
        ('memory', ['out of memory', 'particles', 'Failed to allocate 1342', 'larger spacing']),
        ('broken', ['not a number', 'left=nan']),
        ('map', ['thickness is not a number of metres in 1 cell']),
    ],
)
def test_a_fault_is_told_and_the_last_maps_stay(faulty, fault, words):
    """Error state with the reason, maps of before for who comes late, and a reset helps."""
    logged = len(faulty.node.log)
    faulty.graph.fault(fault)
    status = faulty.status(lambda status: status['state'] == 'failed')
    assert status['level'] == ERROR
    assert all(word in status['message'] for word in words), status['message']
    # The pipe of the log is another than the graph.
    faulty.node.wait_for_log('[ERROR]', after=logged)
    error = [line for line in faulty.node.log.splitlines() if '[ERROR]' in line][-1]
    assert all(word in error for word in words), error
    assert '~/reset' in error

    # Nothing new is shown, and what was shown is sound.
    last = faulty.listener.at_rest(*GRIDS)
    assert last['height']['wet'] > 0
    assert last['height']['min'] == 0
    if fault == 'raise':
        # whoever comes late gets the last maps there were
        assert faulty.graph.listener(*GRIDS).newest(*GRIDS) == last

    faulty.reset()


def test_no_memory_to_start_again(faulty):
    """A reset that finds no memory says so, and works as soon as there is some."""
    faulty.graph.fault('memory')
    faulty.status(lambda status: status['state'] == 'failed')
    assert faulty.publisher.call('reset')['success']
    status = faulty.status(lambda status: status['state'] == 'failed')
    assert 'out of memory' in status['message']
    faulty.reset()


def test_the_limit_of_particles(faulty):
    """Beyond max_particles the simulation stops with the reason; a higher limit lets it go on."""
    assert not faulty.publisher.set(max_particles=0)['success']
    assert faulty.publisher.set(max_particles=5)['success']
    status = faulty.status(lambda status: status['state'] == 'failed')
    # The last map shows what there was when it stopped.
    count = int(status['particles'])
    assert f'{count} particles, expected at most 5 (max_particles)' in status['message']
    assert count > 5
    assert faulty.publisher.set(max_particles=100_000)['success']
    faulty.reset()


def test_a_step_that_does_not_end_is_told(faulty):
    """In diagnostics, in the log once, and to whoever asks for something; then all goes on."""
    # where kernels are compiled a step may have taken as long before
    logged = len(faulty.node.log)
    faulty.graph.fault('slow')
    status = faulty.status(lambda status: 'a step takes' in status['message'])
    assert (status['state'], status['level']) == ('running', 1)
    answer = faulty.publisher.call('reset')
    assert answer['success']
    assert answer['message'].startswith('starting again at time 0, but later: a step takes')
    faulty.status(lambda status: 'waiting for it: ' in status['message'])
    faulty.status(lambda status: 'reset' in status['message'])
    faulty.node.wait_for_log('a step takes', after=logged)
    said = [line for line in faulty.node.log[logged:].splitlines() if 'a step takes' in line]
    assert len(said) == 1 and '[WARN]' in said[0], said
    faulty.reset()
    faulty.status(lambda status: 'a step takes' not in status['message'])


def test_a_flood_of_vents(faulty):
    """1,000 vents messages a second: time and maps go on, memory stays, the last ones count."""
    before = float(faulty.status()['simulated_time_s'])
    accepted = int(faulty.status(task='inputs')['accepted'])
    since = faulty.now()
    faulty.publisher.flood(count=1500, rate=1000.0, last=33.0)
    faulty.status(lambda status: float(status['simulated_time_s']) > before)
    faulty.wait_for_discharge(33.0)
    faulty.goes_on(since)
    inputs = faulty.status(task='inputs')
    assert inputs['rejected'] == '0'
    assert int(inputs['accepted']) > accepted
    assert int(inputs['superseded']) > 0
    assert float(faulty.status()['volume_error']) < 1e-5


#: Messages beyond a limit, or larger by their own word than their data, and what is said of them.
TOO_LARGE = {
    'huge': "terrain.size is '4000 x 4000', expected at most 1000000 cells (max_terrain_cells)",
    'lying_image': "terrain.size is '30000 x 30000', expected at most 1000000 cells",
    'lying_info': "terrain_info.size is '4294967295 x 30', expected 2 to 32767 cells a side",
    'lying_cloud': 'terrain_cloud refused: terrain_cloud.',
    'wide_cloud': "'30001 x 30001', expected at most 1000000 cells (max_terrain_cells)",
    'many_vents': 'vents.size is 1001, expected at most 1000 vents (max_vents)',
    'lying_vents': 'expected at most 1000 vents (max_vents)',
}


def test_what_is_too_large_is_refused(faulty):
    """Each is named, counted and forgotten; maps go on."""
    since = faulty.now()
    before = int(faulty.status(task='inputs')['rejected'])
    for case, words in TOO_LARGE.items():
        faulty.publisher.publish(case)
        faulty.node.wait_for_log(words)
    most = before + len(TOO_LARGE)
    after = faulty.status(lambda status: int(status['rejected']) >= most, 'inputs')
    assert int(after['rejected']) == most
    assert after['level'] == 2
    faulty.listener.wait_for_topic('diagnostics')
    # what the message of 64 MB took on its way is kept by the middleware for the next one
    faulty.goes_on(since, 5 * 64.0)


def test_new_terrain_under_a_moving_flow(faulty):
    """The flow goes on over another terrain of another size; one without the vents is refused."""
    before = float(faulty.status()['simulated_time_s'])
    since = faulty.now()
    for size, names in ((48, ('higher', 'higher_info')), (40, ('terrain', 'terrain_info'))) * 2:
        faulty.publisher.publish(*names)
        grid = faulty.listener.wait_for_topic('height', lambda grid: grid['shape'] == [30, size])  # noqa: B023
        assert grid['wet'] > 0
        assert grid['min'] == 0
    refused = faulty.status(task='inputs')['rejected']
    faulty.publisher.publish('away', 'terrain')
    status = faulty.status(lambda status: status['rejected'] != refused, 'inputs')
    assert 'position' in status['last_error']
    grid = faulty.listener.wait_for_topic('height')
    assert grid['origin'] == [0.0, 0.0]
    status = faulty.status(lambda status: float(status['simulated_time_s']) > before)
    assert float(status['volume_error']) < 1e-5
    assert status['state'] == 'running'
    faulty.goes_on(since)
    faulty.publisher.publish('terrain_info', 'terrain')


def test_subscribers_that_never_read(faulty):
    """One that keeps all and reads none, and a process that is stopped: others get their maps."""
    deaf = faulty.graph.process('-c', DEAF, *GRIDS)
    assert deaf.line(60.0) == 'deaf'
    stopped = faulty.graph.listener(*GRIDS)
    stopped.wait_for_topic('height')
    stopped.child.send_signal(signal.SIGSTOP)
    since = faulty.now()
    for topic in (*['height'] * 11, *['diagnostics'] * 2):
        faulty.listener.wait_for_topic(topic)
    faulty.goes_on(since)
    stopped.child.send_signal(signal.SIGCONT)
    heard = len(stopped.seen)
    stopped.wait(lambda _: len(stopped.seen) > heard + 3)
