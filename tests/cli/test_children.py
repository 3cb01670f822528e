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

"""Processes that a command starts: how they end is told, and none is left behind."""

import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest

from lava_ros.cli.ros import Child, ChildError, SHOWN_LINES

ROOT = Path(__file__).parents[2]

#: Says that it is there, and takes SIGINT for nothing.
STUBBORN = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
print('here', flush=True)
time.sleep(60)
"""

ENDS_WELL = """
import time
try:
    print('here', flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    pass
"""

FAILS = """
import signal, sys, time
signal.signal(signal.SIGINT, lambda *_: sys.exit(3))
print('\\n'.join(f'line {number}' for number in range(100)), flush=True)
time.sleep(60)
"""


@pytest.fixture
def start(tmp_path):
    """Starts a child of a program's text, and waits until it has said something."""

    def begin(text: str) -> Child:
        (tmp_path / 'a_program.py').write_text(text)
        log = tmp_path / 'a.log'
        env = os.environ | {'PYTHONPATH': str(tmp_path)}
        child = Child('program', 'a_program', [], log=log, env=env)
        end = time.monotonic() + 30.0
        while not log.read_text():
            assert time.monotonic() < end
            time.sleep(0.01)
        return child

    return begin


def test_a_child_that_follows(start):
    """It ends when it is asked to; asking again does no harm."""
    child = start(ENDS_WELL)
    child.check()
    child.stop()
    assert child.end() == 0
    with pytest.raises(ChildError, match=r'the program ended by itself with status 0; its log'):
        child.check()


def test_a_child_that_does_not_follow_is_killed(start):
    """That is an error for one that had to end well."""
    child = start(STUBBORN)
    with pytest.raises(ChildError, match=r'did not end within 0.2 s; its log ends with\n    here'):
        child.stop(0.2)
    assert child.end(0.2) == -9


def test_a_child_that_fails_shows_the_end_of_its_log(start):
    """Its last lines, and its status."""
    child = start(FAILS)
    with pytest.raises(ChildError, match='ended with status 3') as caught:
        child.stop()
    lines = str(caught.value).splitlines()
    assert lines[-1] == '    line 99'
    assert len(lines) == 1 + SHOWN_LINES


#: A command with a child, which says whether it was ended.
COMMAND = """
import os
from pathlib import Path
import signal
import sys
import time
from lava_ros.cli.ros import Child
# whoever runs the tests may ignore it, as nohup does
signal.signal(signal.SIGHUP, signal.SIG_DFL)
child = Child('program', 'a_program', [], log=Path('a.log'), env=os.environ)
try:
    while not Path('a.log').read_text():
        time.sleep(0.01)
    os.kill(os.getpid(), getattr(signal, sys.argv[1]))
    time.sleep(60.0)
finally:
    print('child', child.end(), flush=True)
"""


@pytest.mark.parametrize('name', ['SIGTERM', 'SIGHUP'])
def test_children_end_with_their_command(tmp_path, name):
    """One that is told to end, or loses its terminal, ends its children first."""
    (tmp_path / 'a_program.py').write_text(ENDS_WELL)
    (tmp_path / 'command.py').write_text(COMMAND)
    env = os.environ | {'PYTHONPATH': f'{ROOT}{os.pathsep}{tmp_path}'}
    ended = subprocess.run(
        [sys.executable, 'command.py', name],
        cwd=tmp_path,
        env=env,
        stdout=subprocess.PIPE,
        text=True,
        timeout=50.0,
        check=False,
    )
    assert ended.stdout == 'child 0\n'
    assert ended.returncode == 128 + getattr(signal, name)
