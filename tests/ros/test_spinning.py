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

import pytest

from lava_ros.ros import spinning


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


def test_an_interrupt_ends_it():
    """What is no error of a callback is not held back."""
    executor = Scripted(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        spinning.spin(executor, until=lambda: False, on_error=print)
