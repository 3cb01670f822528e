# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Answers of services, rate limits of ROS requests, and requests without limits."""

from concurrent.futures import Future
from functools import partial
from types import SimpleNamespace
from unittest.mock import MagicMock, Mock, PropertyMock

import pytest
from rclpy.clock import Clock
from std_srvs.srv import SetBool, Trigger

from lava_ros.errors import LavaError
from lava_ros.live.worker_status import WorkerState
from lava_ros.ros.diagnostics import WARN
from lava_ros.ros.input_log import Allowance, LIMITS
from lava_ros.ros.node_graph import NodeGraph
from lava_ros.ros.parameters import Settings
from lava_ros.ros.runtime import NodeRuntime
from lava_ros.ros.services import create_services
from lava_ros.ros.subscribers import InputSubscribers

N_CALLS = 400

ON, OFF, NOTHING = SetBool.Request(data=True), SetBool.Request(data=False), Trigger.Request()


class NodeServices:
    """Services of a node with stand-ins for their functions, and a clock set by hand.

    ``result`` is the future of all commands of the simulation.
    """

    def __init__(self):
        self.now = 1e6
        self.result = Future()
        entities, self.worker = Mock(), Mock()
        entities.node.get_clock.return_value = Clock()
        entities.wait, entities._calls = partial(NodeGraph.wait, entities), {}
        for command in ('reset', 'step'):
            getattr(self.worker, command).return_value = self.result
        self.worker.status = SimpleNamespace(state=WorkerState.PAUSED)
        self.active = Mock(is_active=True, settings=Settings())
        self.active.pause.return_value = self.result
        self.inputs = InputSubscribers(entities, self.worker, settings=Settings, steady=Clock())
        self.allowance = Allowance(self.inputs.refuse, lambda: self.now)
        entities.create.reset_mock()
        self.active.worker, self.active.inputs = self.worker, self.inputs
        self.active.allowance = self.allowance
        create_services(self.active, entities)
        self.services = {
            call.args[2].removeprefix('~/'): (call.args[1], call.args[3])
            for call in entities.create.call_args_list
        }

    def ask(self, name, request):
        """Return a call that has not begun."""
        kind, answer = self.services[name]
        return answer(request, kind.Response())

    def call(self, name, request):
        """Return the answer to a call whose command the simulation executes."""
        if not self.result.done():
            self.result.set_result(None)
        return answer_to(self.ask(name, request))

    def set_effects(self):
        """Change a setting of the effects and return the result as a response."""
        node = SimpleNamespace(
            settings=Settings(), allowance=self.allowance, _bags=self.active, worker=self.worker
        )
        try:
            NodeRuntime.check(node, Settings(effects_on=('inertia',)))
        except LavaError as error:
            return SimpleNamespace(success=False, message=str(error))
        return SimpleNamespace(success=True)

    def status(self):
        status = self.inputs.log.status()
        return status.level, {item.key: item.value for item in status.values}


def answer_to(call):
    """Continue a call up to its answer, which must not wait."""
    with pytest.raises(StopIteration) as end:
        call.send(None)
    return end.value.value


#: Calls of a client for each limit.
ASKED = {
    'reset': lambda services: services.call('reset', NOTHING),
    'record': lambda services: services.call('record', ON),
    'save': lambda services: services.call('save', NOTHING),
    'effects': NodeServices.set_effects,
}


@pytest.mark.parametrize('name', LIMITS)
def test_service_calls_above_the_limit_are_rejected(name):
    services = NodeServices()
    calls, period = LIMITS[name]
    services.now += 100.0 * period
    answers = [ASKED[name](services) for _ in range(N_CALLS)]
    assert [answer.success for answer in answers] == [True] * calls + [False] * (N_CALLS - calls)
    limit = f'at most {calls} at once and one more every {period:g} s'
    assert answers[-1].message == f'Too many requests: {limit}. Try again later.'
    level, values = services.status()
    assert level == WARN
    assert values[f'rejected.{name}'] == str(N_CALLS - calls)
    assert services.inputs._logger.error.call_count == 1
    assert [other for other in LIMITS if not ASKED[other](services).success] == [name]
    for _ in range(3):
        services.now += 1.01 * period
        assert [ASKED[name](services).success for _ in range(2)] == [True, False]


@pytest.mark.parametrize(
    ('name', 'request_'), [('pause', ON), ('pause', OFF), ('step', NOTHING), ('record', OFF)]
)
def test_cheap_services_have_no_limit(name, request_):
    services = NodeServices()
    answers = [services.call(name, request_) for _ in range(N_CALLS)]
    assert all(answer.success for answer in answers), answers[0].message
    assert 'rejected.' + name not in services.status()[1]


REFUSED = LavaError('spacing', 1e-9, '> 1e-3 m')


@pytest.mark.parametrize(
    ('finish', 'is_success', 'words'),
    [
        (lambda future: future.set_result(None), True, ''),
        (lambda future: future.set_exception(REFUSED), False, str(REFUSED)),
        (lambda future: future.set_exception(ValueError('broken')), False, 'ValueError: broken'),
        (Future.cancel, False, 'A newer call has replaced this one'),
    ],
    ids=['executed', 'refused', 'failed', 'replaced'],
)
@pytest.mark.parametrize(
    ('name', 'request_'), [('reset', NOTHING), ('step', NOTHING), ('pause', ON), ('pause', OFF)]
)
def test_services_answer_when_the_simulation_has_taken_or_refused_their_command(
    name, request_, finish, is_success, words
):
    services = NodeServices()
    call = services.ask(name, request_)
    # waits
    assert call.send(None) is None
    finish(services.result)
    answer = answer_to(call)
    assert answer.success is is_success
    assert words in answer.message


def test_stopped_recording_is_no_longer_wanted():
    node = MagicMock()
    node._bags.is_wanted, node._recorder.error = True, ''
    NodeRuntime.stop_recording(node)
    assert not node._bags.is_wanted


def test_each_save_counts():
    node = MagicMock(settings=Settings(max_saved_bytes=1000), _saved_bytes=0)
    node._bags.finish_checkpoint.return_value = ''
    # before and after each
    type(node._recorder).size = PropertyMock(side_effect=[100, 350, 350, 1000])
    for _ in range(2):
        NodeRuntime.save(node)
    assert node._saved_bytes == 900


def test_total_size_of_saves_is_limited():
    services = NodeServices()
    node = SimpleNamespace(
        worker=services.worker, settings=Settings(max_saved_bytes=1000), _saved_bytes=1000,
        allowance=services.allowance,
    )
    with pytest.raises(LavaError, match='written 1000 bytes of at most 1000'):
        NodeRuntime.save(node)
    assert services.status()[1]['rejected.save'] == '1'
