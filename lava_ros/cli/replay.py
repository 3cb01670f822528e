# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava replay`, and the keys that steer it."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack
import os
import select
import signal
import sys
import termios
import time
import tty

from lava_ros.bag.reader import BagReader
from lava_ros.bag.replay import Step, Transport
from lava_ros.cli.options import argument, command, seconds_of
from lava_ros.cli.output import terminal
from lava_ros.cli.ros import require_ros
from lava_ros.errors import printable

#: Names of keys; terminals send arrows in either of two modes.
_NAMES = {
    b' ': 'space',
    **{
        lead + letter: name
        for lead in (b'\x1b[', b'\x1bO')
        for letter, name in ((b'A', 'up'), (b'B', 'down'), (b'C', 'right'), (b'D', 'left'))
    },
}

#: How long the rest of an arrow may take [s].
_REST = 0.05


@command(
    'bag',
    argument('--rate', 'X', 'play X times as fast as it was recorded', 1.0),
    argument('--loop', None, 'start again at the end', action='store_true'),
    argument(
        '--start-offset', 'TIME', 'time to skip at the start: 90s, 2min; latched maps of that '
        'time are still published', default='0s',
    ),
    argument(
        '--clock', None, 'publish the time of the bag on /clock (default: yes)',
        True, action=argparse.BooleanOptionalAction,
    ),
    argument(
        '--wait-for-subscribers', 'TIME', 'longest time to wait for a subscriber to each topic',
        '0s',
    ),
)
def replay(args: argparse.Namespace) -> int:
    """Publish a recorded bag into the ROS graph.

    Each topic has the QoS with which it was recorded, and /clock has the time of the bag. A bag
    whose recording was cut off is played up to its last complete message. Keys in a terminal:
    space pauses and resumes, left and right jump 5 s back and ahead (in bag time, times the rate),
    up and down double and halve the speed, q quits. The command passes --ros-args and everything
    after it to ROS: with -r __ns:=/etna the topics are those of a node in the namespace /etna.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    offset = seconds_of('--start-offset', args.start_offset, may_be_zero=True)
    wait = seconds_of('--wait-for-subscribers', args.wait_for_subscribers, may_be_zero=True)
    bag = BagReader(args.bag)
    require_ros()
    from lava_ros.ros.player import play

    total = bag.duration_ns / 1e9
    bar = Progress(
        TextColumn('replay'),
        BarColumn(),
        TextColumn('{task.completed:.1f} of {task.total:.1f} s'),
        TextColumn('{task.fields[state]}'),
        TextColumn('{task.description}', markup=False),
        TimeElapsedColumn(),
        console=terminal(),
        disable=not sys.stdout.isatty(),
        transient=True,
    )
    with ExitStack() as stack:
        stack.enter_context(bar)
        task = bar.add_task('', total=total, state='')
        transport = None
        if sys.stdin.isatty() and sys.stdout.isatty():
            read = stack.enter_context(keys_of(sys.stdin.fileno()))
            transport = Transport(
                read, on_change=lambda item: bar.update(task, state=_state(item))
            )

        def show(step: Step) -> None:
            seconds = (step.clock_ns - (bag.start_ns or 0)) / 1e9
            topic = printable(step.message.topic) if step.message else None
            bar.update(task, completed=seconds, description=topic)

        count = play(
            bag,
            rate=args.rate,
            loop=args.loop,
            start_offset=offset,
            clock=args.clock,
            wait_for_subscribers=wait,
            on_step=show,
            transport=transport,
            ros_arguments=args.ros_args,
        )
    print(f'{count} messages published')
    return 0


def _state(transport: Transport) -> str:
    speed = f'x{transport.speed:g}' if transport.speed != 1.0 else ''
    return ' '.join(filter(None, ['held' if transport.is_paused else '', speed]))


@contextmanager
def keys_of(descriptor: int) -> Iterator[Callable[[float], str]]:
    """Have a terminal give its keys at once and without echo, and restore it afterwards.

    Call it from the main thread. In the background the terminal is left alone. The function that
    it gives waits for a key, for at most a time [s]: ``space``, ``up``, ``down``, ``left``,
    ``right`` or the character; empty when there was none, or one without a name.
    """
    typed = b''

    def fetch(timeout: float) -> None:
        nonlocal typed
        if not _is_in_foreground(descriptor):
            # to read now would stop the process
            time.sleep(timeout)
        elif select.select([descriptor], [], [], timeout)[0]:
            typed += os.read(descriptor, 64)

    def read(timeout: float) -> str:
        nonlocal typed
        if not typed:
            fetch(timeout)
        if typed in (b'\x1b', b'\x1b[', b'\x1bO'):
            fetch(_REST)
        length = 3 if typed[:2] in (b'\x1b[', b'\x1bO') else 1
        key, typed = typed[:length], typed[length:]
        return _NAMES.get(key, key.decode('ascii', 'ignore') if key.isalnum() else '')

    def set_up(*_: object) -> None:
        if _is_in_foreground(descriptor):
            tty.setcbreak(descriptor, termios.TCSADRAIN)

    saved = termios.tcgetattr(descriptor)
    set_up()
    # after Ctrl+Z the shell has restored the terminal
    previous = signal.signal(signal.SIGCONT, set_up)
    try:
        yield read
    finally:
        signal.signal(signal.SIGCONT, previous)
        if _is_in_foreground(descriptor):
            termios.tcsetattr(descriptor, termios.TCSADRAIN, saved)


def _is_in_foreground(descriptor: int) -> bool:
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:
        # the terminal of another session has no jobs
        return True
