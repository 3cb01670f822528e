# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Child processes end with their parent, whatever both do, and leave nothing behind."""

import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest

from lava_ros.errors import LavaError
from lava_ros.processes.child import Child
from lava_ros.processes.requests import ChildProcess
from processes.loops import reply_of
from processes.owners import LOOP, OWNERS
from waiting import PATIENCE, wait_until


def is_gone(pid: int) -> bool:
    """Return True if a process has ended, reaped or not."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] == 'Z'
    except OSError:
        return True


def blocked_signals(pid: int) -> int:
    """Return the mask of the signals that a process blocks."""
    lines = Path(f'/proc/{pid}/status').read_text(encoding='ascii').splitlines()
    (mask,) = [line.split()[1] for line in lines if line.startswith('SigBlk')]
    return int(mask, 16)


@pytest.mark.parametrize('end', ['SIGKILL', 'Ctrl+C', 'returns'])
@pytest.mark.parametrize('name', OWNERS)
def test_process_ends_with_its_owner(name, end, tmp_path):
    then = 'returns' if end == 'returns' else 'waits'
    code = f'from processes.owners import main; main({name!r}, {then!r})'
    path = os.pathsep.join(map(str, [Path(__file__).parents[1], *sys.path]))
    with subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, 'PYTHONPATH': path, 'LAVA_TEST_FOLDER': str(tmp_path)},
        start_new_session=True,
    ) as owner:
        try:
            pids = [int(pid) for pid in owner.stdout.readline().split()]
            if end == 'SIGKILL':
                assert all(blocked_signals(pid) & 1 << signal.SIGINT - 1 for pid in pids)
                owner.kill()
            elif end == 'Ctrl+C':
                os.killpg(owner.pid, signal.SIGINT)
            status = {'SIGKILL': -9, 'Ctrl+C': -2, 'returns': 0}[end]
            assert owner.wait(PATIENCE) == status and pids
            wait_until(lambda: all(map(is_gone, pids)))
            # only the owner is interrupted
            assert owner.stderr.read().count('Traceback') == (end == 'Ctrl+C')
        finally:
            owner.kill()


def forget(child):
    """Leave a process to the garbage collector."""


@pytest.mark.parametrize('let_go', [Child.end, forget])
def test_ended_process_is_no_zombie(let_go):
    child = ChildProcess(LOOP)
    child.request('compute')
    pid = reply_of(child)['pids'][0]
    let_go(child)
    del child
    assert not Path(f'/proc/{pid}').exists()


def test_process_ends_when_its_connection_is_closed_beside_others():
    children = [ChildProcess(LOOP) for _ in range(3)]
    for child in children:
        child.request('wait')
        reply_of(child)
    for child in children:
        child.channel.close()
        assert child.exit_status() == 0


def test_killed_process_of_a_process_is_reported_by_its_parent():
    child = ChildProcess(LOOP)
    child.request('start')
    own, other = reply_of(child)['pids']
    os.kill(other, signal.SIGKILL)
    with pytest.raises(ChildProcessError, match=r'killed by signal 9\)$'):
        child.reply(PATIENCE)
    assert own == child.pid and child.is_usable


def test_killed_process_takes_its_own_processes_along():
    child = ChildProcess(LOOP)
    child.request('start')
    own, other = reply_of(child)['pids']
    os.kill(own, signal.SIGKILL)
    wait_until(lambda: is_gone(other))


def test_process_inherits_no_descriptors(tmp_path):
    with open(tmp_path / 'file', 'wb') as file:
        os.set_inheritable(file.fileno(), True)
        children = [ChildProcess(LOOP) for _ in range(2)]
        for child in children:
            child.request('describe')
            files = reply_of(child)['files']
            assert len([name for name in files if name.startswith('socket:')]) == 1
            assert not any(str(tmp_path) in name for name in files)
            child.end()


def test_process_that_cannot_be_started_is_reported(monkeypatch):
    monkeypatch.setattr(sys, 'executable', '/nowhere/python')
    with pytest.raises(LavaError, match=r'cannot be started: .*/nowhere/python.*\. Check'):
        ChildProcess(LOOP)


def test_process_of_a_parent_is_not_used_by_its_copy():
    child = ChildProcess(LOOP)
    copy = os.fork()
    if not copy:
        try:
            is_usable = child.is_usable
            child.end()
            os._exit(is_usable)
        finally:
            os._exit(2)
    assert os.waitpid(copy, 0)[1] == 0
    # the copy has not ended it
    child.request('wait')
    assert reply_of(child)['pids'] == [child.pid] and child.is_usable
    child.end()
    assert not child.is_usable
