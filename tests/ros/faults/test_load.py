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

"""What others in the graph can throw at the node: it goes on, and says what it refused."""

from pathlib import Path
import signal

import numpy as np
import pytest

HERE = Path(__file__).parent
CONFIGS = HERE.parents[2] / 'msg_configs'
GRIDS = ('height', 'temperature', 'hazard')

#: Rate of the grids here [Hz].
RATE = 10.0

#: Longest time between two grids or heartbeats under load that passes on a busy machine [s].
LONGEST_GAP = 30.0

#: What memory may grow by under load [MiB].
MOST_GROWTH = 64.0


class Loaded:
    """A node that simulates, with someone who loads it and someone who listens."""

    def __init__(self, graph):
        self.graph = graph
        config = graph.directory / 'often.yaml'
        default = (CONFIGS / 'default.yaml').read_text(encoding='utf-8')
        config.write_text(default.replace('rate: 1.0 ', f'rate: {RATE} '), encoding='utf-8')
        self.node = graph.node(
            device='cpu', time_scale=10.0, msg_config=str(config), max_terrain_cells=1_000_000
        )
        self.publisher = graph.publisher()
        self.listener = graph.listener(*GRIDS)
        self.publisher.publish('vents', 'terrain_info', 'terrain')
        self.listener.wait_for_topic('height', lambda grid: grid['wet'] > 0, timeout=90.0)

    def memory(self):
        """Resident memory of the node [MiB]."""
        status = Path(f'/proc/{self.node.child.pid}/status').read_text(encoding='utf-8')
        (line,) = [line for line in status.splitlines() if line.startswith('VmRSS')]
        return int(line.split()[1]) / 1024.0

    def gap(self, topic, since):
        """Longest time between two messages of a topic from one on [s]."""
        self.listener.hear()
        seen = [item for item in self.listener.seen[since:] if item['topic'] == topic]
        assert len(seen) > 2, f'{topic}: {len(seen)} messages'
        return float(np.diff([item['stamp_ns'] for item in seen]).max()) / 1e9

    def status(self, task, condition=lambda _: True):
        """The state of a task in diagnostics of now or later that fulfil a condition."""
        return self.listener.status_now(task, condition)

    def wait_for_discharge(self, expected):
        """Wait until between two heartbeats the vents give this [m3/s]."""
        self.listener.hear()
        points = []

        def is_reached(status):
            points.append((float(status['simulated_time_s']), float(status['volume_emitted_m3'])))
            (t0, v0), (t1, v1) = points[-2:] if len(points) > 1 else points * 2
            return t1 > t0 and (v1 - v0) / (t1 - t0) == pytest.approx(expected, rel=1e-3)

        self.status('simulation', is_reached)


@pytest.fixture(scope='module')
def loaded(graph):
    """One node for all loads, one after the other."""
    return Loaded(graph)


def test_a_flood_of_vents(loaded):
    """1,000 vents messages a second: time and maps go on, memory stays, the last ones count."""
    before = float(loaded.status('simulation')['simulated_time_s'])
    accepted = int(loaded.status('inputs')['accepted'])
    since, memory = loaded.listener.hear(), loaded.memory()
    loaded.publisher.flood(count=3000, rate=1000.0, last=33.0)
    loaded.status('simulation', lambda status: float(status['simulated_time_s']) > before)
    loaded.wait_for_discharge(33.0)
    assert loaded.gap('height', since) < LONGEST_GAP
    assert loaded.gap('diagnostics', since) < LONGEST_GAP
    assert loaded.memory() - memory < MOST_GROWTH
    inputs = loaded.status('inputs')
    assert inputs['rejected'] == '0'
    assert int(inputs['accepted']) > accepted
    assert int(inputs['superseded']) > 0
    assert float(loaded.status('simulation')['volume_error']) < 1e-5


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


def test_what_is_too_large_is_refused(loaded):
    """Each is named, counted and forgotten; maps go on."""
    since, memory = loaded.listener.hear(), loaded.memory()
    before = int(loaded.status('inputs')['rejected'])
    for case, words in TOO_LARGE.items():
        loaded.publisher.publish(case)
        loaded.node.wait_for_log(words)
    after = loaded.status(
        'inputs', lambda status: int(status['rejected']) >= before + len(TOO_LARGE)
    )
    assert int(after['rejected']) == before + len(TOO_LARGE)
    assert after['level'] == 2
    loaded.listener.wait_for_topic('diagnostics')
    assert loaded.gap('height', since) < LONGEST_GAP
    # What the message of 64 MB took on its way is kept by the middleware for the next one.
    assert loaded.memory() - memory < 5 * 64.0


def test_new_terrain_under_a_moving_flow(loaded):
    """The flow goes on over another terrain of another size; one without the vents is refused."""
    before = float(loaded.status('simulation')['simulated_time_s'])
    since = loaded.listener.hear()
    for size, names in ((48, ('higher', 'higher_info')), (40, ('terrain', 'terrain_info'))) * 2:
        loaded.publisher.publish(*names)
        grid = loaded.listener.wait_for_topic('height', lambda grid: grid['shape'] == [30, size])  # noqa: B023
        assert grid['wet'] > 0
        assert grid['min'] == 0
    refused = loaded.status('inputs')['rejected']
    loaded.publisher.publish('away', 'terrain')
    status = loaded.status('inputs', lambda status: status['rejected'] != refused)
    assert 'position' in status['last_error']
    grid = loaded.listener.wait_for_topic('height')
    assert grid['origin'] == [0.0, 0.0]
    status = loaded.status(
        'simulation', lambda status: float(status['simulated_time_s']) > before
    )
    assert float(status['volume_error']) < 1e-5
    assert status['state'] == 'running'
    assert loaded.gap('height', since) < LONGEST_GAP
    loaded.publisher.publish('terrain_info', 'terrain')


def test_subscribers_that_never_read(loaded):
    """One that keeps all and reads none, and a process that is stopped: others get their maps."""
    deaf = loaded.graph.process(str(HERE / 'deaf_listener.py'), *GRIDS)
    assert deaf.line(60.0) == 'deaf'
    stopped = loaded.graph.listener(*GRIDS)
    stopped.wait_for_topic('height')
    stopped.child.send_signal(signal.SIGSTOP)
    since, memory = loaded.listener.hear(), loaded.memory()
    for _ in range(11):
        loaded.listener.wait_for_topic('height')
    loaded.listener.wait_for_topic('diagnostics')
    loaded.listener.wait_for_topic('diagnostics')
    assert loaded.gap('height', since) < LONGEST_GAP
    assert loaded.gap('diagnostics', since) < LONGEST_GAP
    assert loaded.memory() - memory < MOST_GROWTH
    stopped.child.send_signal(signal.SIGCONT)
    heard = len(stopped.seen)
    stopped.wait(lambda _: len(stopped.seen) > heard + 3)
