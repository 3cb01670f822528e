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

"""What others in the graph may ask for without limit, and what they may not."""

from concurrent.futures import Future
from functools import partial
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from rclpy.clock import Clock
from std_srvs.srv import SetBool, Trigger

from lava_ros.errors import LavaError
from lava_ros.ros.active_node import ActiveNode
from lava_ros.ros.allowance import Allowance, LIMITS
from lava_ros.ros.diagnostics import WARN
from lava_ros.ros.input_topics import InputTopics
from lava_ros.ros.parameters import Settings
from lava_ros.ros.services import create_services
from lava_ros.ros.worker_status import WorkerState
from worker_bench import TERRAIN, VENT

STORM = 400

ON, OFF, NOTHING = SetBool.Request(data=True), SetBool.Request(data=False), Trigger.Request()


@pytest.mark.parametrize('name', LIMITS)
def test_a_storm_is_refused(name):
    """One more comes each period, however long none came before; other names have their own."""
    now, refused = [1e6], []
    allowance = Allowance(lambda *words: refused.append(words), lambda: now[0])
    calls, period = LIMITS[name]
    now[0] += 100.0 * period
    taken = 0
    for _ in range(200):
        try:
            allowance.take(name)
            taken += 1
        except LavaError as error:
            assert refused[-1] == (name, error)
            right = f"at most {calls} at once and one more each {period:g} s"
            assert str(error).startswith(f"{name} is 'too often', expected {right}")
        now[0] += 0.05 * period
    assert taken == calls + 9
    assert len(refused) == 200 - taken
    for other in LIMITS.keys() - {name}:
        allowance.take(other)


class Doors:
    """The services of a node, with what they call in its place, and a clock that stands still."""

    def __init__(self):
        entities, self.worker = Mock(), Mock()
        for command in ('reset', 'step'):
            getattr(self.worker, command).side_effect = lambda *_: Future()
        self.worker.status = SimpleNamespace(state=WorkerState.PAUSED, hold_up='')
        self.active = Mock(is_active=True, step_length=1.0)
        self.active.pause.side_effect = lambda paused: Future()
        self.inputs = InputTopics(entities, self.worker, settings=Settings, steady=Clock())
        self.allowance = Allowance(self.inputs.refuse, lambda: 0.0)
        entities.create.reset_mock()
        create_services(
            self.active, entities, worker=self.worker, inputs=self.inputs,
            allowance=self.allowance,
        )
        self.services = {
            call.args[2].removeprefix('~/'): (call.args[1], call.args[3])
            for call in entities.create.call_args_list
        }

    def call(self, name, request):
        """The answer of a service."""
        kind, answer = self.services[name]
        return answer(request, kind.Response())

    def set_effects(self):
        """The same as an answer, for a change of what the choice of effects goes by."""
        node = SimpleNamespace(
            _settings=Settings(), _allowance=self.allowance, _bag_folder=self.active
        )
        try:
            ActiveNode.check(node, Settings(effects_on=('inertia',)))
        except LavaError as error:
            return SimpleNamespace(success=False, message=str(error))
        return SimpleNamespace(success=True)

    def status(self):
        """What diagnostics say of inputs."""
        status = self.inputs.log.status()
        return status.level, {item.key: item.value for item in status.values}


#: How a client asks for each thing that is limited.
ASKED = {
    'reset': lambda doors: doors.call('reset', NOTHING),
    'record': lambda doors: doors.call('record', ON),
    'save': lambda doors: doors.call('save', NOTHING),
    'effects': Doors.set_effects,
}


@pytest.mark.parametrize('name', LIMITS)
def test_doors_are_limited(name):
    """A storm of calls goes through a few times; the others are refused, counted and logged."""
    doors = Doors()
    answers = [ASKED[name](doors) for _ in range(STORM)]
    calls, period = LIMITS[name]
    assert [answer.success for answer in answers] == [True] * calls + [False] * (STORM - calls)
    assert f'one more each {period:g} s; try again later' in answers[-1].message
    level, values = doors.status()
    assert level == WARN
    assert values[f'rejected.{name}'] == str(STORM - calls)
    assert doors.inputs._logger.error.call_count == 1


@pytest.mark.parametrize(
    ('name', 'request_'), [('pause', ON), ('pause', OFF), ('step', NOTHING), ('record', OFF)]
)
def test_doors_that_cost_nothing_are_open(name, request_):
    """What only holds time, or ends a bag, is never refused for coming too often."""
    doors = Doors()
    answers = [doors.call(name, request_) for _ in range(STORM)]
    assert all(answer.success for answer in answers), answers[0].message
    assert 'rejected.' + name not in doors.status()[1]


@pytest.mark.parametrize(
    'kind', ['pause', 'step', 'reset', 'vents', 'terrain', 'effects', 'snapshot']
)
def test_commands_that_wait_replace_one_another(bench, kind):
    """A busy simulation has one of each kind before it, however many were asked for."""
    bench.start()
    bench.simulation.is_compiled.clear()
    held = bench.worker.set_effects({}, horizon=1.0)
    bench.wait(lambda: bench.worker.status.doing == 'effects')
    ask = {
        'pause': partial(bench.worker.pause, True),
        'step': partial(bench.worker.step, 1.0),
        'reset': bench.worker.reset,
        'vents': partial(bench.worker.set_vents, [VENT]),
        'terrain': partial(bench.worker.set_terrain, TERRAIN),
        'effects': partial(bench.worker.set_effects, {}, horizon=1.0),
        'snapshot': bench.worker.request_snapshot,
    }[kind]
    for _ in range(STORM):
        ask()
    assert bench.worker.status.waiting == (kind,)
    assert len(bench.worker._commands) == 1
    bench.simulation.is_compiled.set()
    bench.run(held)


def test_saves_are_bounded_in_size():
    """What all have written is bounded as well, and that is counted."""
    doors = Doors()
    node = SimpleNamespace(
        _worker=doors.worker, _settings=Settings(max_saved_bytes=1000), _saved_bytes=1000,
        _allowance=doors.allowance,
    )
    with pytest.raises(LavaError, match=r"1000 bytes saved so far', expected less than 1000 \("):
        ActiveNode.save(node)
    assert doors.status()[1]['rejected.save'] == '1'
