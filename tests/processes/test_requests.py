# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Requests and replies of child processes, and the errors of those that fail or are killed."""

import os
from queue import SimpleQueue
import signal
import threading

import pytest

from lava_ros.processes import child as parents_end
from lava_ros.processes.received import receive_in_thread
from lava_ros.processes.requests import ChildProcess
from processes.loops import ERRORS, LARGE, reply_of
from processes.owners import LOOP
from waiting import PATIENCE, wait_until


@pytest.fixture
def child():
    process = ChildProcess(LOOP)
    yield process
    process.end()


def test_both_ends_send_more_than_the_connection_buffers(child):
    for number in range(8):
        child.request('echo', data=bytes([number]) * LARGE)
    for number in range(8):
        assert reply_of(child)['data'] == bytes([number]) * LARGE


@pytest.mark.parametrize('request_name', ['wait', 'compute', 'send'])
def test_killed_process_is_reported(child, request_name):
    child.request(request_name)
    reply_of(child)
    if request_name == 'send':
        # in the middle of a reply
        wait_until(lambda: child.channel.poll(0.0))
    os.kill(child.pid, signal.SIGKILL)
    for use in (lambda: child.reply(PATIENCE), lambda: child.request('wait')):
        with pytest.raises(ChildProcessError, match=r'process has ended \(killed by signal 9\)'):
            use()


def test_process_killed_while_it_starts_is_reported():
    child = ChildProcess('processes.hanging:Loop')
    os.kill(child.pid, signal.SIGKILL)
    with pytest.raises(ChildProcessError, match='killed by signal 9'):
        child.reply(PATIENCE)


@pytest.mark.parametrize(('status', 'reason'), [
    (0, 'exit status 0'), (3, 'exit status 3'), (-signal.SIGSEGV, 'killed by signal 11'),
])
def test_end_of_a_process_is_described(child, status, reason):
    child.request('leave', status=status)
    with pytest.raises(ChildProcessError, match=reason):
        child.reply(PATIENCE)


def test_process_that_lives_without_a_connection_is_described(child, monkeypatch):
    monkeypatch.setattr(parents_end, '_END_TIMEOUT', 0.01)
    os.kill(child.pid, signal.SIGSTOP)
    child.channel.close()
    with pytest.raises(ChildProcessError, match='or no longer answers'):
        child.request('wait')


@pytest.mark.parametrize('name', ERRORS)
def test_exception_of_a_request_arrives_with_its_traceback(child, name):
    _, kind, text = ERRORS[name]
    child.request('fail', kind=name)
    with pytest.raises(kind) as caught:
        child.reply(PATIENCE)
    assert type(caught.value) is kind and str(caught.value) == text
    assert 'in fail' in str(caught.value.__cause__)
    # a request to a process that has failed must not end the parent or wait
    child.request('wait')


@pytest.mark.parametrize(('loop', 'request_name', 'kind', 'text'), [
    (LOOP, 'send_what_cannot_be_pickled', TypeError, 'cannot pickle'),
    (LOOP, 'nothing', AttributeError, 'nothing'),
    ('processes.nothing:Loop', 'wait', ImportError, 'processes.nothing'),
    ('processes.loops:Nothing', 'wait', AttributeError, 'Nothing'),
])
def test_fault_of_a_loop_is_raised(loop, request_name, kind, text):
    child = ChildProcess(loop)
    child.request(request_name)
    with pytest.raises(kind, match=text):
        child.reply(PATIENCE)


@pytest.mark.parametrize(('error', 'status'), [
    (EOFError(), 0), (OSError('odd'), 0), (RuntimeError('odd'), 1), (MemoryError('odd'), 1),
])
def test_thread_that_receives_ends_the_process(monkeypatch, capfd, error, status):
    ended, statuses = threading.Event(), []
    monkeypatch.setattr('os._exit', lambda status: (statuses.append(status), ended.set()))

    def receive():
        raise error

    receive_in_thread(receive, SimpleQueue())
    assert ended.wait(PATIENCE) and statuses == [status]
    # the parent reports the end of a process, but not the reason
    assert (f'{type(error).__name__}: odd' in capfd.readouterr().err) == bool(status)
