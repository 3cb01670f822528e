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

"""A callback that raises does not end the node."""

from collections.abc import Iterator
import signal
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest

from lava_ros.ros import qos, spinning
from lava_ros.ros.spinning import Watcher
from ros_domain import own_domain


class Scripted:
    """An executor whose turns are exceptions to raise, or nothing."""

    def __init__(self, *turns):
        self.turns = list(turns)

    def spin_once(self, timeout_sec):
        assert timeout_sec > 0.0
        turn = self.turns.pop(0)
        if turn is not None:
            raise turn


def test_errors_are_told_and_the_rest_goes_on():
    """Each error is told once, and the callbacks after it run."""
    first, second = ValueError('clock'), RuntimeError('message')
    executor, told = Scripted(None, first, None, second, None), []
    spinning.spin(executor, until=lambda: not executor.turns, on_error=told.append)
    assert told == [first, second]


class Echo(Watcher):
    """Hears what it says."""

    def __init__(self) -> None:
        super().__init__('lava_echo', own_domain('watcher'))
        profile = qos.ros_profile(qos.LATCHED)
        self.heard: list[DiagnosticArray] = []
        self._node.create_subscription(DiagnosticArray, 'echo', self.heard.append, profile)
        self._publisher = self._node.create_publisher(DiagnosticArray, 'echo', profile)

    def say(self) -> None:
        """Send a message with something in it."""
        self._publisher.publish(DiagnosticArray(status=[DiagnosticStatus(message='here')]))

    def listen_for(self, count: int) -> None:
        """Listen until so many messages were heard, for at most a minute."""
        deadline = time.monotonic() + 60.0
        while len(self.heard) < count and time.monotonic() < deadline:
            self.listen(0.1)


@pytest.fixture
def echo(monkeypatch: pytest.MonkeyPatch) -> Iterator[Echo]:
    """A watcher that hears what it says, in a domain of this test run."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    echo = Echo()
    yield echo
    echo.close()


def test_ctrl_c_in_the_middle_of_a_message_is_still_ctrl_c(
    echo: Echo, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes out as KeyboardInterrupt once the message is whole, and not as rclpy's error."""
    make, interrupted = DiagnosticStatus.__init__, []

    def make_interrupted(self: DiagnosticStatus, **fields: object) -> None:
        make(self, **fields)
        if not interrupted:
            interrupted.append(True)
            signal.raise_signal(signal.SIGINT)

    echo.say()
    monkeypatch.setattr(DiagnosticStatus, '__init__', make_interrupted)
    with pytest.raises(KeyboardInterrupt):
        echo.listen_for(1)
    assert interrupted
    echo.listen_for(1)
    assert [item.status[0].message for item in echo.heard] == ['here']
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
