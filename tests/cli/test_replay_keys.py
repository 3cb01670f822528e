# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The keys of a replay, in a real terminal."""

from collections.abc import Callable
from contextlib import suppress
import os
from pathlib import Path
import select
import signal
import subprocess
import sys
import termios
import threading
import time

import pytest
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from lava_ros.bag import BagWriter, LATCHED, QosProfile
from lava_ros.cli.replay import keys_of
from lava_ros.ros.spinning import Watcher
from ros_domain import own_domain

SECOND = 1_000_000_000
TEXT = 'std_msgs/msg/String'
ROOT = Path(__file__).parents[2]
LENGTH = 120.0

#: What a shell has a terminal do, and who reads keys one by one does not.
SHELL_FLAGS = termios.ECHO | termios.ICANON

UP, DOWN, RIGHT, LEFT = '\x1b[A', '\x1b[B', '\x1b[C', '\x1b[D'

#: As a shell does for the program in front: the terminal is its own.
IN_FRONT = """
import fcntl, os, sys, termios
os.setsid()
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


@pytest.fixture
def terminal():
    """Both ends of a terminal: the side that people are at, and the one of programs."""
    outside, inside = os.openpty()
    yield outside, inside
    os.close(outside)
    os.close(inside)


@pytest.mark.parametrize(
    ('typed', 'names'),
    [
        (b' q', ['space', 'q']),
        (b'\x1b[A\x1b[B\x1b[C\x1b[D', ['up', 'down', 'right', 'left']),
        (b'\x1bOC', ['right']),
        (b'\x1b', ['']),
        ('é'.encode(), ['', '']),
        (b'\n', ['']),
    ],
)
def test_keys_have_names(terminal, typed, names):
    """Arrows in both modes of terminals; other keys are themselves, or nothing."""
    outside, inside = terminal
    with keys_of(inside) as read:
        os.write(outside, typed)
        assert [read(1.0) for _ in names] == names
        assert read(0.0) == ''


def test_an_arrow_may_come_in_pieces(terminal):
    """A slow line does not make three keys of it."""
    outside, inside = terminal
    with keys_of(inside) as read:
        os.write(outside, b'\x1b')
        rest = threading.Timer(0.01, os.write, (outside, b'[D'))
        rest.start()
        assert read(1.0) in ('left', '')
        rest.join()


def test_the_terminal_is_put_back(terminal):
    """Echo and lines are off while keys are read, and on again also after an error."""
    _, inside = terminal
    before = termios.tcgetattr(inside)
    assert before[3] & SHELL_FLAGS == SHELL_FLAGS
    with suppress(RuntimeError), keys_of(inside):
        assert termios.tcgetattr(inside)[3] & SHELL_FLAGS == 0
        raise RuntimeError
    assert termios.tcgetattr(inside) == before


class Heard(Watcher):
    """What comes on /text in a graph of the test's own, as seconds of the bag."""

    def __init__(self, domain: int) -> None:
        """Subscribe."""
        super().__init__('listener', domain)
        self.places: list[float] = []
        self._node.create_subscription(
            String, '/text', lambda message: self.places.append(float(message.data)),
            QoSProfile(depth=1000),
        )

    def during(self, seconds: float) -> list[float]:
        """What comes within a time."""
        before, end = len(self.places), time.monotonic() + seconds
        while time.monotonic() < end:
            self.listen(0.02)
        return self.places[before:]

    def until(self, condition: Callable[[], bool], timeout: float = 30.0) -> None:
        """Listen until something is so."""
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, self.places[-5:]
            self.listen(0.02)


@pytest.fixture
def heard():
    """A listener in a domain of this test process's own."""
    result = Heard(own_domain())
    yield result
    result.close()


def replay_of(bag: Path, seconds: float) -> list[str]:
    """Record ten texts a second and a latched one, and return the command that replays them."""
    with BagWriter(bag, custom_data={}) as writer:
        for tenth in range(int(10 * seconds) + 1):
            text = serialize_message(String(data=str(tenth / 10)))
            writer.write('/text', TEXT, text, tenth * SECOND // 10, qos=QosProfile(depth=100))
            if tenth == 0:
                writer.write('/map', TEXT, text, 0, qos=LATCHED)
    return ['-m', 'lava_ros.cli.main', 'replay', str(bag)]


@pytest.fixture
def replay(tmp_path, terminal, heard):
    """`lava replay` of two minutes with ten texts a second, which is this terminal's program."""
    _, inside = terminal
    words = ['-c', IN_FRONT, *replay_of(tmp_path / 'bag', LENGTH)]
    process = subprocess.Popen(
        [sys.executable, *words], stdin=inside, stdout=inside, stderr=inside, cwd=ROOT
    )
    yield process
    process.kill()
    process.wait()


@pytest.fixture
def screen(terminal):
    """What a program has written to its terminal so far; it would block if nobody read it."""
    shown: list[str] = []
    is_over = threading.Event()

    def read() -> None:
        with suppress(OSError):
            while not is_over.is_set():
                if select.select([terminal[0]], [], [], 0.1)[0]:
                    shown.append(os.read(terminal[0], 4096).decode('utf-8', 'replace'))

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    yield shown
    is_over.set()
    thread.join()


def test_keys_in_a_terminal(replay, terminal, screen, heard):
    """Space holds, arrows move and quicken, q ends with status 0 and a terminal as before."""
    outside, inside = terminal

    def press(key: str) -> None:
        os.write(outside, key.encode())

    heard.until(lambda: len(heard.places) > 5, timeout=60.0)
    press(' ')
    heard.until(lambda: 'held' in ''.join(screen))
    # messages that were sent before arrive first
    heard.until(lambda: heard.during(0.6) == [])
    place = heard.places[-1]

    press(RIGHT)
    press(RIGHT)
    heard.during(0.3)
    press(' ')
    heard.until(lambda: heard.places[-1] > place + 10.5)
    # by two jumps of five seconds; of what lies between at most the place of the first
    between = [item for item in heard.places if place < item < place + 9.5]
    assert len(between) <= 1 and all(4.8 < item - place < 5.2 for item in between)
    assert any(place + 9.5 <= item <= place + 10.5 for item in heard.places)

    press(UP)
    press(UP)
    heard.until(lambda: 'x4' in ''.join(screen))
    begin, was = time.monotonic(), heard.places[-1]
    heard.until(lambda: heard.places[-1] >= was + 4.0, timeout=60.0)
    assert time.monotonic() - begin > 0.75
    press(DOWN)
    press(DOWN)

    # as a shell does with what is stopped by Ctrl+Z and brought back
    replay.send_signal(signal.SIGSTOP)
    usual = termios.tcgetattr(inside)
    usual[3] |= SHELL_FLAGS
    termios.tcsetattr(inside, termios.TCSANOW, usual)
    replay.send_signal(signal.SIGCONT)
    heard.until(lambda: termios.tcgetattr(inside)[3] & SHELL_FLAGS == 0)

    was = heard.places[-1]
    press(LEFT)
    heard.until(lambda: heard.places[-1] < was)
    assert was - 6.0 <= heard.places[-1]

    # once it has put the terminal back, and before all of the bag is over
    press('q')
    assert replay.wait(60.0) == 0
    assert heard.places[-1] < LENGTH - 5.0
    heard.until(lambda: 'messages published' in ''.join(screen))
    assert 'Traceback' not in ''.join(screen)
    assert termios.tcgetattr(inside)[3] & SHELL_FLAGS == SHELL_FLAGS


def test_without_a_terminal_there_are_no_keys(tmp_path, heard):
    """What comes on the standard input of a script is not taken for keys."""
    done = subprocess.run(
        [sys.executable, *replay_of(tmp_path / 'bag', 0.5)],
        input='q ' * 100, capture_output=True, text=True, cwd=ROOT, timeout=60.0,
    )
    assert (done.returncode, done.stdout) == (0, '7 messages published\n'), done.stderr
