# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava ros demo`, and the child processes of commands."""

import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from rosbags.highlevel import AnyReader

from lava_ros.cli import demo, ros
from lava_ros.cli.ros import Child, ChildError, SHOWN_LINES
from lava_ros.errors import LavaError
from ros_domain import own_domain
from waiting import wait_until

ROOT = Path(__file__).parents[2]


def start(directory: Path, *words: str) -> subprocess.Popen[str]:
    """Start the demo on the CPU, without a terminal."""
    return subprocess.Popen(
        [sys.executable, '-m', 'lava_ros.cli.main', 'ros', 'demo', '--device', 'cpu', *words],
        cwd=directory, env=os.environ | {'PYTHONPATH': str(ROOT), 'PYTHONUNBUFFERED': '1'},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )


def test_demo_refuses_a_domain_in_use(monkeypatch):
    busy = own_domain()
    chosen = SimpleNamespace(sample=lambda *_: [busy])
    monkeypatch.setattr(ros.random, 'SystemRandom', lambda: chosen)
    with pytest.raises(LavaError, match='--domain'):
        ros.domain_of(None)


def test_demo_keeps_the_bags_of_earlier_demos(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert demo._unused('bags/demo') == Path('bags/demo')
    (tmp_path / 'bags/demo').mkdir(parents=True)
    (tmp_path / 'bags/demo_2').symlink_to('nowhere')
    assert demo._unused('bags/demo') == Path('bags/demo_3')
    assert capsys.readouterr().out == (
        'bags/demo exists and is kept; this demo records to bags/demo_3\n'
    )


@pytest.mark.nightly
def test_demo_reports_a_failed_node_with_its_log(tmp_path):
    demo = start(tmp_path, '--device', 'cuda:77', '--until', '600')
    _, errors = demo.communicate(timeout=300)
    assert demo.returncode == 1
    assert 'the node' in errors
    assert 'cuda:77' in errors
    assert 'Traceback' not in errors


@pytest.mark.nightly
def test_ctrl_c_leaves_a_finished_bag_and_no_processes(tmp_path):
    demo = start(tmp_path, '--until', '7200')
    assert demo.stdout is not None
    line = ''
    deadline = time.monotonic() + 300.0
    while 'particles' not in line and time.monotonic() < deadline:
        line = demo.stdout.readline()
    assert 'particles' in line
    demo.send_signal(signal.SIGINT)
    _, errors = demo.communicate(timeout=300)
    assert demo.returncode == 130, errors
    assert 'Traceback' not in errors
    with AnyReader([tmp_path / 'bags/demo']) as reader:
        assert reader.message_count > 0
    running = subprocess.run(['ps', '-eo', 'args'], capture_output=True, text=True, check=True)
    assert str(tmp_path) not in running.stdout


#: A program that prints 100 lines and has a given handler for SIGINT.
PROGRAM = """
import signal, sys, time
signal.signal(signal.SIGINT, {})
print('\\n'.join(f'line {{number}}' for number in range(100)), flush=True)
time.sleep(60)
"""

ENDS_WELL, FAILS = (PROGRAM.format(f'lambda *_: sys.exit({status})') for status in (0, 3))
STUBBORN = PROGRAM.format('signal.SIG_IGN')


@pytest.fixture
def child_of(tmp_path, monkeypatch):
    """Return a function that starts a program from its source and waits for its output."""
    monkeypatch.syspath_prepend(tmp_path)

    def begin(text: str) -> Child:
        (tmp_path / 'a_program.py').write_text(text)
        log = tmp_path / 'a.log'
        child = Child('program', 'a_program', log=log, env=os.environ)
        end = time.monotonic() + 120.0
        while not log.read_text():
            assert time.monotonic() < end
            time.sleep(0.01)
        return child

    return begin


def test_child_stops_when_asked(child_of):
    child = child_of(ENDS_WELL)
    child.check()
    child.stop()
    assert child.end() == 0
    with pytest.raises(ChildError, match=r'the program ended by itself with status 0; its log'):
        child.check()


@pytest.mark.parametrize(
    ('program', 'outcome', 'status'),
    [(STUBBORN, 'did not end within 0.2 s', -9), (FAILS, 'ended with status 3', 3)],
)
def test_error_of_a_child_has_the_end_of_its_log(program, outcome, status, child_of):
    child = child_of(program)
    with pytest.raises(ChildError) as caught:
        child.stop(0.2 if program == STUBBORN else 20.0)
    first, *lines = str(caught.value).splitlines()
    assert first == f'the program {outcome}; its log ends with'
    assert lines == [f'    line {number}' for number in range(100 - SHOWN_LINES, 100)]
    assert child.end(0.2) == status


#: A command that sends itself a signal and prints its child's exit status.
COMMAND = """
import os
from pathlib import Path
import signal
import sys
import time
from lava_ros.cli.ros import Child
# the test runner may ignore it, as nohup does
signal.signal(signal.SIGHUP, signal.SIG_DFL)
child = Child('program', 'a_program', log=Path('a.log'), env=os.environ)
try:
    while not Path('a.log').read_text():
        time.sleep(0.01)
    os.kill(os.getpid(), getattr(signal, sys.argv[1]))
    time.sleep(60.0)
finally:
    print('child', child.end(), flush=True)
"""

#: Ends in order, with a file that tells so.
ENDS_IN_ORDER = PROGRAM.format("lambda *_: (open('ended', 'w'), sys.exit(0))")


@pytest.mark.parametrize(('name', 'status', 'output'), [
    ('SIGTERM', 128 + signal.SIGTERM, 'child 0\n'), ('SIGHUP', 128 + signal.SIGHUP, 'child 0\n'),
    # it cannot ask its children to end
    ('SIGKILL', -signal.SIGKILL, ''),
])
def test_children_end_in_order_after_a_signal_to_their_command(tmp_path, name, status, output):
    (tmp_path / 'a_program.py').write_text(ENDS_IN_ORDER)
    (tmp_path / 'command.py').write_text(COMMAND)
    env = os.environ | {'PYTHONPATH': f'{ROOT}{os.pathsep}{tmp_path}'}
    ended = subprocess.run(
        [sys.executable, 'command.py', name], cwd=tmp_path, env=env, stdout=subprocess.PIPE,
        text=True, timeout=300.0, check=False,
    )
    assert (ended.stdout, ended.returncode) == (output, status)
    wait_until((tmp_path / 'ended').exists)
