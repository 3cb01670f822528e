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

"""The queue of the simulation's thread: in order, bounded, of some kinds the newest alone."""

from concurrent.futures import Future
import queue
import threading

import pytest

from lava_ros.errors import LavaError
from lava_ros.ros.commands import Command, CommandQueue


def put(commands, name, kind=''):
    """Add a command that is nothing but its name."""
    future = Future()
    commands.put(Command(name, future, kind))
    return future


def taken(commands):
    """The names of all that wait, oldest first."""
    return [commands.get(0.0).action for _ in range(len(commands))]


def test_commands_come_in_order():
    """What was put first comes first, and nothing comes from nothing."""
    commands = CommandQueue()
    for name in 'abc':
        put(commands, name)
    assert taken(commands) == ['a', 'b', 'c']
    with pytest.raises(queue.Empty):
        commands.get(0.0)


def test_the_newest_of_a_kind_replaces_the_one_that_waits():
    """The older one is cancelled; the newer one comes after what was put between them."""
    commands = CommandQueue()
    old = put(commands, 'old vents', 'vents')
    put(commands, 'terrain', 'terrain')
    put(commands, 'step')
    new = put(commands, 'new vents', 'vents')
    assert old.cancelled()
    assert not new.done()
    assert taken(commands) == ['terrain', 'step', 'new vents']
    later = put(commands, 'later vents', 'vents')
    assert not later.done()
    assert taken(commands) == ['later vents']


def test_too_many_are_refused():
    """Beyond the limit a command is refused, but for one that has a kind."""
    commands = CommandQueue(limit=3)
    for _ in range(3):
        put(commands, 'click')
    refused = put(commands, 'click')
    with pytest.raises(LavaError, match='3 waiting'):
        refused.result(0.0)
    for _ in range(100):
        put(commands, 'vents', 'vents')
    assert len(commands) == 4


def test_a_callback_may_put_another():
    """What a cancelled or refused command calls back may use the queue."""
    commands = CommandQueue(limit=1)
    first = put(commands, 'vents', 'vents')
    first.add_done_callback(lambda _: put(commands, 'from callback'))
    put(commands, 'vents', 'vents')
    assert first.cancelled()
    refused = Future()
    refused.add_done_callback(lambda _: put(commands, 'terrain', 'terrain'))
    commands.put(Command('click', refused, ''))
    assert taken(commands) == ['vents', 'terrain']


def test_a_closed_queue_refuses_what_waits_and_what_comes():
    """Nobody waits for ever: each future holds the reason, and the thread is woken."""
    commands = CommandQueue()
    futures = [put(commands, 'a'), put(commands, 'b', 'vents')]
    commands.close(LavaError('simulation', 'stopped', 'one that runs'))
    futures += [put(commands, 'c', 'vents'), put(commands, 'd')]
    for future in futures:
        with pytest.raises(LavaError, match='stopped'):
            future.result(0.0)
    assert len(commands) == 0
    with pytest.raises(queue.Empty):
        commands.get()


def test_a_waiting_thread_is_woken():
    """A command wakes the thread that waits for one."""
    commands = CommandQueue()
    seen = []
    thread = threading.Thread(target=lambda: seen.append(commands.get(10.0).action))
    thread.start()
    put(commands, 'late')
    thread.join(10.0)
    assert seen == ['late']
