# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rate limits of requests from the graph, and requests without a limit."""

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
    """One more call is allowed each period, also after a rest; each name has its own limit."""
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
    """Services of a node with stand-ins for the functions that they call, and a clock at rest."""

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
        """Call a service and return its answer."""
        kind, answer = self.services[name]
        return answer(request, kind.Response())

    def set_effects(self):
        """Change a setting of the effects and return the result as an answer."""
        node = SimpleNamespace(
            _settings=Settings(), _allowance=self.allowance, _bag_folder=self.active
        )
        try:
            ActiveNode.check(node, Settings(effects_on=('inertia',)))
        except LavaError as error:
            return SimpleNamespace(success=False, message=str(error))
        return SimpleNamespace(success=True)

    def status(self):
        """Return the diagnostics of inputs."""
        status = self.inputs.log.status()
        return status.level, {item.key: item.value for item in status.values}


#: Calls of a client for each limit.
ASKED = {
    'reset': lambda doors: doors.call('reset', NOTHING),
    'record': lambda doors: doors.call('record', ON),
    'save': lambda doors: doors.call('save', NOTHING),
    'effects': Doors.set_effects,
}


@pytest.mark.parametrize('name', LIMITS)
def test_doors_are_limited(name):
    """The first calls of a flood are accepted; the others are refused, counted and logged."""
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
    """Calls that only stop time, or finish a bag, have no rate limit."""
    doors = Doors()
    answers = [doors.call(name, request_) for _ in range(STORM)]
    assert all(answer.success for answer in answers), answers[0].message
    assert 'rejected.' + name not in doors.status()[1]


@pytest.mark.parametrize(
    'kind', ['pause', 'step', 'reset', 'vents', 'terrain', 'effects', 'snapshot']
)
def test_commands_that_wait_replace_one_another(bench, kind):
    """At most one command of each kind waits for a busy simulation."""
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
    """The size of all saves together is limited as well, and refusals are counted."""
    doors = Doors()
    node = SimpleNamespace(
        _worker=doors.worker, _settings=Settings(max_saved_bytes=1000), _saved_bytes=1000,
        _allowance=doors.allowance,
    )
    with pytest.raises(LavaError, match=r"1000 bytes saved so far', expected less than 1000 \("):
        ActiveNode.save(node)
    assert doors.status()[1]['rejected.save'] == '1'
