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

"""The managed node in a real graph: transitions, those that fail, and what a state holds."""

from pathlib import Path
import time

import numpy as np
import pytest

from lava_ros.bag import BagReader
from ros.graph_publisher import wait_until

GRIDS = ('/hazard', '/height', '/temperature')
SCALE = 20.0


class Managed:
    """A node that waits for its manager, that manager, someone who feeds it and a listener."""

    def __init__(self, graph):
        self.graph, self.directory = graph, graph.directory
        self.terrain = graph.directory / 'slope.npz'
        (graph.directory / 'bags' / 'there').mkdir(parents=True)
        self.node = graph.faulty_node(
            autostart=False,
            device='cpu',
            time_scale=SCALE,
            terrain_file=str(self.terrain),
            record=True,
            bag_root=str(graph.directory / 'bags'),
            bag_directory=str(graph.directory / 'bags' / 'there'),
        )
        self.publisher = graph.publisher()
        self.listener = graph.listener('height')

    def change(self, *names, state):
        """Make transitions that go well, and see where they lead."""
        for name in names:
            assert self.publisher.change(name), self.node.log
        assert self.publisher.state() == state

    def refuse(self, name, *, state, words):
        """Ask for a transition that goes wrong; the log says why."""
        before = len(self.node.log)
        assert not self.publisher.change(name)
        assert self.publisher.state() == state
        self.node.wait_for_log(words, after=before)
        self.node.wait_for_log('[ERROR]', after=before)

    def status(self, condition=lambda _: True):
        """The simulation's status that is told from now on and fulfils a condition."""
        return self.listener.status_now('simulation', condition)

    def is_alone(self):
        """Whether nothing is left in the graph but what the node has unconfigured."""
        return self.publisher.names(self.alone, only=True) == self.alone

    def activate(self):
        """Activate, and wait for the map that comes then."""
        since_ns = time.time_ns()
        self.change('activate', state='active')
        return self.listener.wait_for_topic(
            'height', lambda grid: grid['stamp_ns'] >= since_ns
        )

    def use_bag(self, name):
        """Name the next bag."""
        bag = self.directory / 'bags' / name
        assert self.publisher.set(bag_directory=str(bag) if name else '')['success']
        return bag

    def resources(self):
        """Threads, and resident memory [MiB]."""
        status = Path(f'/proc/{self.node.child.pid}/status').read_text(encoding='utf-8')
        values = dict(line.split(':') for line in status.splitlines())
        return int(values['Threads']), int(values['VmRSS'].split()[0]) / 1024.0


@pytest.fixture(scope='module')
def managed(graph):
    """One node for all tests here, one after the other."""
    result = Managed(graph)
    result.alone = result.publisher.names()
    return result


def test_unconfigured(managed):
    """There is nothing of the simulation; what the state does not have is refused.

    Configuring fails by a missing file, or an error nobody expected: nothing stays, and it can be
    tried again.
    """
    assert managed.publisher.state() == 'unconfigured'
    assert '/lava/change_state' in managed.alone
    expected = {*GRIDS, '/terrain', '/diagnostics', '/lava/step'}
    assert not expected & {*managed.alone}
    for name in ('activate', 'deactivate', 'cleanup'):
        managed.refuse(name, state='unconfigured', words='no transition of id')
    managed.refuse('configure', state='unconfigured', words='slope.npz')
    _, x = np.mgrid[0:30, 0:40]
    np.savez(managed.terrain, elevation=(300.0 - x).astype(np.float32), resolution=10.0)
    threads, _ = managed.resources()
    managed.graph.fault('configure')
    managed.refuse('configure', state='unconfigured', words='RuntimeError: configure went wrong')
    wait_until(lambda: managed.resources()[0] <= threads)
    assert managed.is_alone()
    managed.graph.fault()
    managed.change('configure', state='inactive')
    assert expected < {*managed.publisher.names(expected)}


def test_inactive(managed):
    """Inputs are taken and diagnostics told, a pause is remembered; no map, no step, no bag."""
    managed.publisher.publish('vents', 'click')
    inputs = managed.listener.wait_for_status('inputs', lambda item: int(item['accepted']) >= 3)
    assert inputs['rejected'] == '0'
    # as soon as nothing is compiled any more; no lava has come to a border, or anywhere
    status = managed.status(lambda item: item['message'] == 'inactive: paused')
    assert (status['lifecycle'], status['state']) == ('inactive', 'paused')
    for name, data in (('step', False), ('save', False), ('record', True)):
        answer = managed.publisher.call(name, data)
        assert not answer['success']
        assert f"{name} is 'inactive', expected an active node" in answer['message']
    assert managed.publisher.call('pause', True)['success']
    assert not [item for item in managed.listener.seen if item['topic'] == 'height']
    managed.refuse('configure', state='inactive', words='no transition of id 1 from')


def test_activating_that_fails(managed):
    """A bag that is there already: inactive as before; another bag, and it goes."""
    managed.refuse('activate', state='inactive', words='a folder that does not exist yet')
    assert managed.status()['lifecycle'] == 'inactive'
    managed.first_bag = managed.use_bag('first')
    assert managed.activate()['wet'] == 0
    # the pause of before
    status = managed.status()
    assert (status['lifecycle'], status['state']) == ('active', 'paused')
    assert float(status['simulated_time_s']) == 0.0
    assert managed.publisher.call('pause', False)['success']
    managed.listener.wait_for_topic('height', lambda grid: grid['wet'] > 0)


def test_time_stands_still_while_inactive(managed):
    """Deactivated there is no map and no time; active again it goes on with no leap."""
    # The map of a pause is that of its moment: diagnostics tell the time of the last map.
    assert managed.publisher.call('pause', True)['success']
    managed.listener.at_rest('height')
    managed.change('deactivate', state='inactive')
    assert managed.publisher.call('pause', False)['success']
    since = managed.listener.hear()
    paused, before = managed.status(), managed.status()
    assert before['lifecycle'] == 'inactive'
    assert before['simulated_time_s'] == paused['simulated_time_s']
    assert 'height' not in {item['topic'] for item in managed.listener.seen[since:]}
    recorder = managed.listener.seen[-1]['status']['lava: recorder']
    assert (recorder['state'], recorder['bag']) == ('recording', str(managed.first_bag))
    start = time.monotonic()
    managed.activate()
    after = managed.status(lambda item: item['simulated_time_s'] != before['simulated_time_s'])
    passed = float(after['simulated_time_s']) - float(before['simulated_time_s'])
    assert 0.0 < passed <= SCALE * (time.monotonic() - start)


def test_a_step_ends_with_the_deactivation(managed):
    """Inactive means that time stands still, also in the middle of a step."""
    assert managed.publisher.call('pause', True)['success']
    before = managed.listener.at_rest('height')
    # longer than any machine takes to hear of the deactivation
    assert managed.publisher.set(time_scale=1e6)['success']
    assert managed.publisher.call('step')['success']
    managed.change('deactivate', state='inactive')
    assert managed.publisher.set(time_scale=SCALE)['success']
    assert managed.activate()['stamp_ns'] > before['height']['stamp_ns']
    told = []

    def stands(status):
        told.append(float(status['simulated_time_s']))
        return len(told) > 5 and told[-5:] == 5 * told[-1:]

    assert float(managed.status(stands)['simulated_time_s']) < 1e6
    assert managed.publisher.call('pause', False)['success']


def test_a_failed_simulation_is_not_activated(managed):
    """It says so until a reset, which an inactive node takes."""
    managed.graph.fault('raise')
    managed.status(lambda item: item['state'] == 'failed')
    managed.change('deactivate', state='inactive')
    managed.refuse('activate', state='inactive', words='device lost')
    managed.graph.fault()
    assert managed.publisher.call('reset')['success']
    status = managed.status(lambda item: item['state'] == 'paused')
    # not what it says of the last map, where lava may have reached the border
    assert status['message'].startswith('inactive: ')
    assert 'device lost' not in status['message']
    managed.change('activate', state='active')
    managed.status(lambda item: item['state'] == 'running')


def test_cleaning_up(managed):
    """The bag is finished, and nothing is left in the graph; it can be configured again."""
    managed.change('deactivate', 'cleanup', state='unconfigured')
    assert managed.is_alone()
    bag = BagReader(managed.first_bag)
    assert not bag.recovered
    assert {*GRIDS, '/vents', '/diagnostics'} < set(bag.topics)
    managed.change('configure', state='inactive')
    managed.refuse('activate', state='inactive', words='a folder that does not exist yet')


def test_a_recording_that_was_ended_does_not_begin_again(managed):
    """The bag that is there must not keep the node inactive."""
    bag = managed.use_bag('second')
    managed.activate()
    answer = managed.publisher.call('record', False)
    assert answer == {'success': True, 'message': f'recorded {bag}'}
    managed.change('deactivate', state='inactive')
    managed.change('activate', state='active')
    managed.change('deactivate', state='inactive')
    assert not BagReader(bag).recovered


@pytest.mark.parametrize(
    ('name', 'path'),
    [
        ('activate', ('activate',)),
        ('deactivate', ('activate', 'deactivate')),
        ('cleanup', ('activate', 'deactivate', 'cleanup')),
    ],
)
def test_an_error_nobody_expected(managed, name, path):
    """It leads to where one can begin anew: unconfigured, with nothing left in the graph."""
    managed.use_bag(name)
    managed.change(*path[:-1], state='active' if len(path) == 2 else 'inactive')
    managed.graph.fault(name)
    managed.refuse(path[-1], state='unconfigured', words=f'RuntimeError: {name} went wrong')
    managed.graph.fault()
    assert managed.is_alone()
    # a step that compiles outlasts the cleanup
    wait_until(lambda: managed.publisher.change('configure'))
    assert managed.publisher.state() == 'inactive'


def test_a_step_that_outlasts_the_cleanup(managed):
    """No two simulations run beside each other: the next waits until the last is gone."""
    managed.use_bag('slow')
    managed.activate()
    managed.status(lambda status: status['state'] == 'running')
    managed.graph.fault('slow')
    wait_until((managed.directory / 'fault.slow').exists)
    managed.change('deactivate', 'cleanup', state='unconfigured')
    assert managed.is_alone()
    managed.refuse('configure', state='unconfigured', words='configure again in a while')
    managed.graph.fault()
    # the step ends when it next looks, on a busy machine later
    wait_until(lambda: managed.publisher.change('configure'))
    assert managed.publisher.state() == 'inactive'


def test_many_cycles_leave_nothing_behind(managed):
    """Threads and memory are given back, and bags named by the time do not meet."""
    managed.use_bag('')
    managed.change('cleanup', state='unconfigured')
    used = []
    for _ in range(12):
        managed.change('configure', state='inactive')
        managed.activate()
        managed.change('deactivate', 'cleanup', state='unconfigured')
        used.append(managed.resources())
    threads, memory = zip(*used, strict=True)
    # those of the middleware end a moment later
    wait_until(lambda: managed.resources()[0] <= threads[1])
    assert memory[-1] - memory[1] < 8.0, memory
    assert managed.is_alone()


def test_an_error_at_the_start_ends_the_process(managed, graph):
    """With autostart nobody would see a node that waits unconfigured: 1, and the reason."""
    managed.graph.fault('configure')
    node = graph.faulty_node(aside=True, device='cpu')
    assert node.wait_for_end() == 1
    managed.graph.fault()
    reason = 'lava_node cannot start: RuntimeError: configure went wrong'
    assert node.log.splitlines()[-1] == reason


def test_what_is_read_when_configured_may_be_set_before(managed, graph):
    """Unconfigured, before and after: tools choose scene and device without a restart."""
    managed.other = graph.node(remap=['__node:=other'], device='cpu', autostart=False)
    client, other = managed.publisher, {'node': '/other'}
    answer = client.set(scene='missing.yaml', frame_id='world', **other)
    assert answer['success'], answer
    assert not client.change('configure', **other)
    managed.other.wait_for_log('missing.yaml')
    assert client.set(scene='', **other)['success']
    assert client.change('configure', **other), managed.other.log
    answer = client.set(frame_id='map', **other)
    assert not answer['success']
    assert 'read-only' in answer['message']
    assert client.change('cleanup', **other), managed.other.log
    assert client.set(frame_id='map', **other)['success']
    assert not client.set(autostart=True, **other)['success']
    assert client.change('configure', **other), managed.other.log


def test_shutdown(managed, graph):
    """From each state it is final, the bag is finished, and SIGTERM ends the process with 0."""
    new = graph.node(remap=['__node:=new'], autostart=False, device='cpu')
    bag = managed.use_bag('last')
    managed.change('configure', state='inactive')
    managed.activate()
    managed.change('shutdown', state='finalized')
    assert not BagReader(bag).recovered
    assert managed.is_alone()
    managed.refuse('configure', state='finalized', words='no transition of id 1 from')
    for name, state in (('/other', 'inactive'), ('/new', 'unconfigured')):
        assert managed.publisher.state(node=name) == state
        assert managed.publisher.change('shutdown', node=name)
        assert managed.publisher.state(node=name) == 'finalized'
    for node in (managed.node, managed.other, new):
        assert node.end() == 0
        assert 'stopped' in node.log.splitlines()[-1]
    assert 'Traceback' not in managed.other.log + new.log
