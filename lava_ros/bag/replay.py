# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""When to publish which message of a bag: the timing of a replay."""

from collections.abc import Callable, Iterator
import math
import time
from typing import NamedTuple

from lava_ros import validation
from lava_ros.bag.reader import BagMessage, BagReader
from lava_ros.errors import LavaError

#: Wall time between the last message and the first of the next round of a loop [s].
LOOP_PAUSE = 1.0

#: Time between two clock ticks [s]: 100 Hz, as ros2 bag play can do it.
TICK = 0.01


class Step(NamedTuple):
    """A message to publish or, without one, a tick of the clock.

    ``at`` is the wall time since the start of the replay [s], ``clock_ns`` the bag's time then
    [ns], and ``round`` counts the passes through the bag from 0 on.
    """

    at: float
    clock_ns: int
    message: BagMessage | None
    round: int


def schedule(
    bag: BagReader, *, rate: float = 1.0, loop: bool = False, start_offset: float = 0.0
) -> Iterator[Step]:
    """Say when each message of a bag is to be published, at a rate [s of bag time / s].

    A start offset [s of bag time] skips what lies before it, save that the newest message of every
    latched (transient_local) topic is due at once: a map that was published early still holds. A
    ``loop`` starts over there at the end, for ever.

    Raises:
        LavaError: An argument is out of range, or the bag is empty.
    """
    rate = validation.number('rate', rate, above=0.0)
    start_offset = validation.number('start_offset', start_offset, at_least=0.0, unit='s')
    if bag.start_ns is None or bag.end_ns is None:
        raise LavaError('bag', 'without messages', 'at least one message to replay')
    begin = bag.start_ns + round(start_offset * 1e9)
    if begin > bag.end_ns:
        right = f'at most the {bag.duration_ns / 1e9:g} s the bag lasts'
        raise LavaError('start_offset', start_offset, right)
    return _schedule(bag, rate, loop, begin)


def _schedule(bag: BagReader, rate: float, loop: bool, start: int) -> Iterator[Step]:
    assert bag.end_ns is not None
    latched = [name for name, topic in bag.topics.items() if topic.qos.is_latched]
    count, base = 0, 0.0
    while True:
        for message in bag.newest(latched, start):
            yield Step(base, start, message, count)
        for message in bag.messages(start_ns=start):
            at = base + (message.stamp_ns - start) / 1e9 / rate
            yield Step(at, message.stamp_ns, message, count)
        if not loop:
            return
        base += (bag.end_ns - start) / 1e9 / rate + LOOP_PAUSE
        count += 1


def pace(
    dues: Iterator[Step],
    *,
    rate: float,
    now: Callable[[], float],
    wait: Callable[[float], bool],
    tick: float | None = TICK,
) -> Iterator[Step]:
    """Yield each message of a schedule when it is due, and clock ticks [s] while waiting for it.

    The clock follows wall time times the rate and never passes the next message, so that a late
    message does not turn it back. ``now`` is a clock that only goes forward [s]; ``wait`` sleeps
    for a time [s] or less, and true means stop.
    """
    start = now()
    next_tick = math.inf if tick is None else start + tick
    clock_ns = 0
    current_round = -1
    for due in dues:
        at = start + due.at
        while (moment := now()) < at:
            if wait(max(min(at, next_tick) - moment, 0.0)):
                return
            moment = now()
            if tick is not None and moment >= next_tick:
                next_tick = moment + tick
                # In the pause between two rounds the clock stands at the end of the bag.
                if due.round in (current_round, 0):
                    behind = max(at - moment, 0.0) * rate
                    clock_ns = max(clock_ns, due.clock_ns - round(behind * 1e9))
                yield Step(moment - start, clock_ns, None, max(current_round, 0))
        if wait(0.0):
            return
        clock_ns, current_round = due.clock_ns, due.round
        yield due


class StopRequest:
    """A request to stop that the handler of a signal can make.

    A handler runs in the main thread, also while that thread waits for the request. The ``set`` of
    a ``threading.Event`` then blocks for ever: it needs the lock that the ``wait`` below it holds.
    """

    def __init__(self) -> None:
        """Begin without a request."""
        self._is_set = False

    def set(self) -> None:
        """Request a stop."""
        self._is_set = True

    def is_set(self) -> bool:
        """Return whether a stop has been requested."""
        return self._is_set

    def wait(self, seconds: float) -> bool:
        """Wait for a short time [s] unless there is a request; return whether there is one."""
        if not self._is_set:
            time.sleep(seconds)
        return self._is_set

