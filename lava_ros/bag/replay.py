# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Timing of a replay: when to publish each message of a bag."""

from collections.abc import Callable, Collection, Iterator
from itertools import count, takewhile
import math
from typing import NamedTuple

from lava_ros import validation
from lava_ros.bag.reader import BagMessage, BagReader
from lava_ros.errors import LavaError, RefusalError

#: Wall time between the last message and the first of the next round of a loop [s].
LOOP_PAUSE = 1.0

#: Time between two clock ticks [s].
TICK = 0.01


#: Last part of the name of a topic whose messages do not replace each other: each publisher has
#: transforms to other frames.
STATIC_TRANSFORMS = 'tf_static'


class Step(NamedTuple):
    """A message to publish or, without one, a tick of the clock.

    ``at`` is the wall time since the start of the replay [s], ``clock_ns`` the bag time [ns], and
    ``round`` the number of earlier passes through the bag.
    """

    at: float
    clock_ns: int
    message: BagMessage | None
    round: int


def schedule(
    bag: BagReader,
    *,
    rate: float = 1.0,
    loop: bool = False,
    start_offset: float = 0.0,
    topics: Collection[str] | None = None,
) -> Iterator[Step]:
    """Schedule the messages of a bag.

    With a start offset, earlier messages are skipped, except the newest one of each latched
    (transient_local) topic, and all static transforms, which are due immediately: a map that was
    published early is still valid.

    ``rate`` is bag time per wall time [s/s], ``start_offset`` is bag time after the first message
    [s]. A ``loop`` starts again at the offset after the end, without limit. ``topics`` are the
    names of the topics to schedule, None for all.

    Raises:
        LavaError: If an argument is out of range, or the bag is empty.
    """
    rate = validation.number('rate', rate, above=0.0)
    start_offset = validation.number('start_offset', start_offset, at_least=0.0, unit='s')
    if bag.start_ns is None or bag.end_ns is None:
        raise RefusalError('bag', f'{bag.path} contains no messages', 'Choose another bag')
    begin = bag.start_ns + round(start_offset * 1e9)
    if begin > bag.end_ns:
        expected = f'at most {bag.duration_ns / 1e9:g} s, the duration of the bag'
        raise LavaError('start_offset', start_offset, expected)
    chosen = bag.topics.keys() if topics is None else bag.topics.keys() & topics
    latched = [name for name in bag.topics if name in chosen and bag.topics[name].qos.is_latched]
    duration = (bag.end_ns - begin) / 1e9 / rate + LOOP_PAUSE

    def steps() -> Iterator[Step]:
        for number in count() if loop else range(1):
            start = number * duration
            for message in _still_valid(bag, latched, begin):
                yield Step(start, begin, message, number)
            for message in bag.messages(topics, start_ns=begin):
                at = start + (message.stamp_ns - begin) / 1e9 / rate
                yield Step(at, message.stamp_ns, message, number)

    return steps()


def _still_valid(bag: BagReader, latched: Collection[str], begin: int) -> Iterator[BagMessage]:
    """Yield the messages before a log time [ns] that latched topics still have."""
    static = {name for name in latched if name.rpartition('/')[2] == STATIC_TRANSFORMS}
    earlier = bag.messages(static) if static else iter(())
    yield from takewhile(lambda message: message.stamp_ns < begin, earlier)
    yield from bag.newest([name for name in latched if name not in static], begin)


def pace(
    dues: Iterator[Step],
    *,
    rate: float,
    now: Callable[[], float],
    wait: Callable[[float], bool],
    tick: float | None = TICK,
) -> Iterator[Step]:
    """Yield each message of a schedule when it is due, and clock ticks while waiting for it.

    The clock follows wall time times ``rate``, but not beyond the next message, so that a late
    message does not set it back. ``now`` returns monotonic wall time [s]. ``wait`` sleeps for at
    most a time [s], and returns True to stop. ``tick`` is the time between clock ticks [s].
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
                # in the pause between two rounds the clock stays at the end of the bag
                if due.round in (current_round, 0):
                    behind = max(at - moment, 0.0) * rate
                    clock_ns = max(clock_ns, due.clock_ns - round(behind * 1e9))
                yield Step(moment - start, clock_ns, None, max(current_round, 0))
        if wait(0.0):
            return
        clock_ns, current_round = due.clock_ns, due.round
        yield due
