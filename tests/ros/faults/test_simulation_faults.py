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

"""Faults of the simulation in a running node: said, survived, and never shown as a map."""

from pathlib import Path

import pytest

HERE = Path(__file__).parent
GRIDS = ('height', 'temperature', 'hazard')
ERROR = 2


class Faulty:
    """A node that simulates, with a fault to switch on, someone who feeds it and a listener."""

    def __init__(self, graph):
        self.graph = graph
        self._fault = graph.directory / 'fault'
        self.node = graph.node(
            program=[str(HERE / 'faulty_node.py'), str(self._fault)],
            time_scale=20.0,
            device='cpu',
        )
        self.publisher = graph.publisher()
        self.listener = graph.listener(*GRIDS)
        self.publisher.publish('vents', 'terrain_info', 'terrain')
        self.wait_for_lava()

    def wait_for_lava(self):
        """Wait for a map with lava on it."""
        self.listener.wait_for_topic('height', lambda grid: grid['wet'] > 0, timeout=90.0)

    def begin(self, name):
        """Switch a fault on."""
        partial = self._fault.with_suffix('.partial')
        partial.write_text(name, encoding='utf-8')
        partial.replace(self._fault)

    def end(self):
        """Switch it off."""
        self._fault.unlink(missing_ok=True)

    def status(self, condition=lambda _: True):
        """The state of the simulation in diagnostics that fulfil a condition."""
        return self.listener.status_now('simulation', condition)


@pytest.fixture(scope='module')
def faulty(graph):
    """One node for all faults, one after the other."""
    return Faulty(graph)


@pytest.mark.parametrize(
    ('fault', 'words'),
    [
        ('raise', ('RuntimeError: device lost',)),
        (
            'memory',
            (
                'out of memory',
                'particles',
                'Failed to allocate 1342177280 bytes',
                'larger spacing',
            ),
        ),
        ('broken', ('not a number', 'left=nan')),
        ('map', ('thickness is not a number of metres in 1 cell',)),
    ],
)
def test_a_fault_is_told_and_the_last_maps_stay(faulty, fault, words):
    """Error state with the reason, maps of before for who comes late, and a reset helps."""
    logged = len(faulty.node.log)
    faulty.begin(fault)
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

    faulty.end()
    assert faulty.publisher.call('reset')['success']
    again = faulty.status(lambda status: status['state'] == 'running')
    assert again['level'] != ERROR
    faulty.wait_for_lava()


def test_no_memory_to_start_again(faulty):
    """A reset that finds no memory says so, and works as soon as there is some."""
    faulty.begin('memory')
    faulty.status(lambda status: status['state'] == 'failed')
    assert faulty.publisher.call('reset')['success']
    status = faulty.status(lambda status: status['state'] == 'failed')
    assert 'out of memory' in status['message']
    faulty.end()
    assert faulty.publisher.call('reset')['success']
    faulty.status(lambda status: status['state'] == 'running')
    faulty.wait_for_lava()


def test_the_limit_of_particles(faulty):
    """Beyond max_particles the simulation stops with the reason; a higher limit lets it go on."""
    answer = faulty.publisher.set(max_particles=0)
    assert not answer['success']
    assert faulty.publisher.set(max_particles=30)['success']
    assert faulty.publisher.set(time_scale=60.0)['success']
    status = faulty.status(lambda status: status['state'] == 'failed')
    # The last map shows what there was when it stopped.
    assert f"{status['particles']} particles, expected at most 30 (max_particles)" in (
        status['message']
    )
    assert int(status['particles']) > 30
    assert faulty.publisher.set(max_particles=100_000, time_scale=20.0)['success']
    assert faulty.publisher.call('reset')['success']
    faulty.status(lambda status: status['state'] == 'running')
    faulty.wait_for_lava()


def test_a_step_that_does_not_end_is_told(faulty):
    """In diagnostics, in the log once, and to whoever asks for something; then all goes on."""
    # where kernels are compiled a step may have taken as long before
    logged = len(faulty.node.log)
    faulty.begin('slow')
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
    faulty.end()
    faulty.status(lambda status: 'a step takes' not in status['message'])
    faulty.wait_for_lava()
