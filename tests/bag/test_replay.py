# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The timing of a replay, against a clock that the test turns."""

from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path
import sys
import threading

import pytest

from bag.conftest import Bag, SECOND, small_bag
from lava_ros.bag import BagReader
from lava_ros.bag.replay import (
    JUMP,
    LOOP_PAUSE,
    pace,
    schedule,
    SPEEDS,
    Step,
    StopRequest,
    Transport,
)
from lava_ros.errors import LavaError


class FakeClock:
    """A clock that waiting moves on, by the time asked for plus a delay."""

    def __init__(self, delay: float = 0.0, stop_at: float = float('inf')) -> None:
        """Start at an arbitrary time."""
        self.time = 1000.0
        self.delay = delay
        self.stop_at = 1000.0 + stop_at

    def now(self) -> float:
        """The time [s]."""
        return self.time

    def wait(self, seconds: float) -> bool:
        """Move on; True once it is time to stop."""
        if seconds > 0.0:
            self.time += seconds + self.delay
        return self.time >= self.stop_at


def steps(
    dues: Iterator[Step], clock: FakeClock, rate: float = 1.0, tick: float | None = None
) -> list[tuple[float, Step]]:
    """The steps with the time at which each is taken."""
    taken = pace(dues, rate=rate, now=clock.now, wait=clock.wait, tick=tick)
    return [(clock.time - 1000.0, step) for step in taken]


@pytest.mark.parametrize('rate', [0.5, 1.0, 4.0])
def test_messages_are_due_at_their_time_over_the_rate(bag: Bag, rate: float) -> None:
    """Without an offset every message is due once, at its distance from the first."""
    directory, written = bag
    dues = list(schedule(BagReader(directory), rate=rate))
    assert [(due.message.topic, due.message.data) for due in dues] == [
        (topic, data) for topic, _, data in written
    ]
    for due, (_, stamp, _) in zip(dues, written, strict=True):
        assert due.at == pytest.approx((stamp - 100 * SECOND) / SECOND / rate)
        assert due.clock_ns == stamp


def test_an_offset_gives_latched_messages_first(bag: Bag) -> None:
    """The newest latched map before the start is due at once, volatile ones are skipped."""
    directory, written = bag
    first, *rest = schedule(BagReader(directory), start_offset=3.25)
    assert (first.message.topic, first.message.stamp_ns) == ('/hazard', 103 * SECOND)
    assert (first.at, first.clock_ns) == (0.0, 103_250_000_000)
    expected = [(topic, stamp) for topic, stamp, _ in written if stamp >= 103_250_000_000]
    assert [(due.message.topic, due.message.stamp_ns) for due in rest] == expected
    assert rest[0].at == pytest.approx(0.25)
    # a map right at the start comes after the one before it, as recorded
    dues = list(islice(schedule(BagReader(directory), start_offset=3.0), 3))
    assert [due.message.stamp_ns for due in dues] == [102 * SECOND, 103 * SECOND, 103 * SECOND]


def test_a_loop_starts_over_after_a_pause(bag: Bag, tmp_path: Path) -> None:
    """Each round is the same, shifted by the length of the bag and the pause.

    A bag of one message, which lasts no time, is not repeated as fast as it can be.
    """
    dues = list(islice(schedule(BagReader(bag[0]), rate=2.0, loop=True, start_offset=9.0), 15))
    rounds = [[due for due in dues if due.round == index] for index in range(3)]
    assert [len(item) for item in rounds] == [4, 4, 4]
    period = 0.5 / 2.0 + LOOP_PAUSE
    for first, second in zip(rounds[0], rounds[1], strict=True):
        assert second.at == pytest.approx(first.at + period)
        assert second.message == first.message
    dues = islice(schedule(small_bag(tmp_path / 'one', (7, bytes(4))), loop=True), 3)
    assert [due.at for due in dues] == [0.0, LOOP_PAUSE, 2 * LOOP_PAUSE]


@pytest.mark.parametrize(
    ('options', 'field'),
    [
        ({'rate': 0.0}, 'rate'),
        ({'rate': -1.0}, 'rate'),
        ({'rate': float('nan')}, 'rate'),
        ({'start_offset': -0.1}, 'start_offset'),
        ({'start_offset': 9.6}, 'start_offset'),
    ],
)
def test_arguments_out_of_range_are_refused(
    bag: Bag, options: dict[str, float], field: str, tmp_path: Path
) -> None:
    """The error comes at the call, before anything is published; so it does for an empty bag."""
    with pytest.raises(LavaError) as caught:
        schedule(BagReader(bag[0]), **options)
    assert caught.value.field == field
    with pytest.raises(LavaError, match='at least one message'):
        schedule(small_bag(tmp_path / 'empty'))


@pytest.mark.parametrize('delay', [0.0, 0.003, 0.3])
@pytest.mark.parametrize('rate', [0.5, 8.0])
def test_the_clock_ticks_and_never_goes_back(bag: Bag, delay: float, rate: float) -> None:
    """Ticks come at 100 Hz as far as the waits allow, ahead of no message, following the rate."""
    dues = schedule(BagReader(bag[0]), rate=rate, start_offset=0.25)
    taken = steps(dues, FakeClock(delay), rate=rate, tick=0.01)
    clocks = [step.clock_ns for _, step in taken]
    assert clocks == sorted(clocks)
    assert (clocks[0], clocks[-1]) == (100_250_000_000, 109_500_000_000)
    for time, step in taken:
        wall = (step.clock_ns - 100_250_000_000) / SECOND / rate
        assert wall <= time + 1e-6
        assert time - wall < 0.011 + 2 * delay
    ticks = [time for time, step in taken if step.message is None]
    if delay == 0.0:
        assert len(ticks) == pytest.approx(9.25 / rate / 0.01, rel=0.2)


def test_the_clock_stands_still_between_rounds(bag: Bag) -> None:
    """In the pause of a loop the clock stays at the end, then starts over."""
    dues = islice(schedule(BagReader(bag[0]), loop=True, start_offset=9.0), 8)
    taken = steps(dues, FakeClock(), tick=0.01)
    pause = [step for time, step in taken if 0.52 < time < 1.48]
    assert len(pause) > 80
    assert {step.clock_ns for step in pause} == {109_500_000_000}
    (back,) = [
        after for before, after in pairwise(taken) if after[1].clock_ns < before[1].clock_ns
    ]
    assert back[0] == pytest.approx(1.5)
    assert back[1].round == 1


def test_a_stop_may_be_requested_at_any_line_of_a_wait() -> None:
    """The handler of a signal runs in the thread that waits, between any two lines of it."""
    stop, lines = StopRequest(), []

    def handle(frame: object, event: str, _: object) -> object:
        lines.append(event)
        stop.set()
        return handle

    def wait() -> None:
        sys.settrace(handle)
        stop.wait(0.01)
        sys.settrace(None)

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    thread.join(60.0)
    assert not thread.is_alive()
    assert len(lines) > 3
    assert stop.is_set() and stop.wait(0.0)


class Desk:
    """Somebody who presses keys at given times, and a clock that moves when waited for."""

    def __init__(self, **presses: float) -> None:
        """Take keys by name, with the wall time of each [s]; digits behind a name do not count."""
        self.time = 0.0
        self.presses = sorted((when, name.rstrip('0123456789')) for name, when in presses.items())
        self.changes: list[tuple[bool, float]] = []
        self.stop = StopRequest()
        self.transport = Transport(
            self.read,
            now=lambda: self.time,
            on_change=lambda item: self.changes.append((item.is_paused, item.speed)),
        )

    def read(self, timeout: float) -> str:
        """The next key that is pressed within a time."""
        assert self.time < 1000.0, 'held for ever'
        if self.presses and self.presses[0][0] <= self.time + timeout:
            when, name = self.presses.pop(0)
            self.time = max(self.time, when)
            return name
        # a real clock moves on, however short the wait
        self.time += max(timeout, 1e-6)
        return ''

    def play(self, bag: Path, rate: float = 1.0) -> list[tuple[float, str, float]]:
        """Wall time, topic and bag time since its start of every message, jumps included."""
        reader = BagReader(bag)
        start = reader.start_ns or 0
        taken, place = [], start
        while True:
            dues = schedule(reader, rate=rate, first_ns=place)
            wait = lambda seconds: self.transport.wait(seconds, self.stop)  # noqa: E731
            for step in pace(dues, rate=rate, now=self.transport.now, wait=wait):
                place = step.clock_ns
                if step.message is not None:
                    topic, stamp_ns = step.message.topic, step.message.stamp_ns
                    taken.append((self.time, topic, (stamp_ns - start) / SECOND))
            jump = self.transport.take_jump()
            if jump == 0.0:
                return taken
            place = min(max(place + round(jump * rate * SECOND), start), reader.end_ns or 0)


@pytest.mark.parametrize(
    ('presses', 'late'), [({}, 0.0), ({'space1': 3.2, 'space2': 20.2}, 17.0)]
)
def test_space_holds_it_and_lets_it_go_on(
    bag: Bag, presses: dict[str, float], late: float
) -> None:
    """Every message comes once, when it is due; what comes after a hold is late by as much."""
    desk = Desk(**presses)
    taken = desk.play(bag[0])
    assert [place for _, _, place in taken] == [(stamp / 1e9) - 100.0 for _, stamp, _ in bag[1]]
    for moment, _, place in taken:
        assert moment == pytest.approx(place if place < 3.2 else place + late, abs=1e-3)
    assert desk.changes == [(True, 1.0), (False, 1.0)][: len(presses)]


def test_up_and_down_change_the_speed(bag: Bag) -> None:
    """Twice as fast from then on, then as before; the bounds of the speed hold."""
    taken = Desk(up=2.25, down=4.25).play(bag[0])
    for moment, _, place in taken:
        if 2.25 < place < 6.25:
            assert moment == pytest.approx(2.25 + (place - 2.25) / 2.0, abs=1e-3)
    assert taken[-1][0] == pytest.approx(9.5 - 2.0, abs=1e-3)
    desk = Desk(**{f'down{index}': 0.0 for index in range(9)})
    for _ in range(9):
        desk.transport.wait(0.0, desk.stop)
    assert desk.transport.speed == SPEEDS[0]


def test_right_goes_ahead_and_left_goes_back(bag: Bag) -> None:
    """The latched map from before is shown at once, and the messages between are left out.

    Back goes no further than to the start; what has been comes again.
    """
    taken = Desk(right=1.25).play(bag[0])
    place = 1.25 + JUMP
    after = [item for item in taken if item[2] > 1.25]
    assert after[0][1:] == ('/hazard', 6.0)
    assert after[0][0] == pytest.approx(1.25, abs=0.06)
    assert [item[2] for item in after[1:]] == [
        stamp / 1e9 - 100.0 for _, stamp, _ in bag[1] if stamp / 1e9 - 100.0 >= place
    ]
    taken = Desk(left=3.25).play(bag[0])
    assert [item[2] for item in taken if item[2] == 0.0] == [0.0] * 4
    assert taken[-1][0] == pytest.approx(9.5 + 3.25, abs=0.06)


@pytest.mark.parametrize('rate', [1.0, 0.5])
def test_a_held_replay_shows_where_it_jumps_to(bag: Bag, rate: float) -> None:
    """Map by map with the arrows, nothing else until it goes on."""
    desk = Desk(space1=0.25 / rate, right=5.0, space2=30.0)
    taken = desk.play(bag[0], rate)
    held = [item for item in taken if 0.25 / rate < item[0] < 30.0]
    place = 0.25 + JUMP * rate
    assert [topic for _, topic, _ in held] == ['/hazard']
    assert held[0][2] == float(int(place))
    assert held[0][0] == pytest.approx(5.0, abs=0.06)
    assert taken[-1][0] == pytest.approx(30.0 + (9.5 - place) / rate, abs=0.1)


def test_q_or_a_stop_ends_it(bag: Bag) -> None:
    """At once, in a loop and while it is held."""
    taken = steps(schedule(BagReader(bag[0]), loop=True), FakeClock(stop_at=30.2), tick=0.01)
    assert taken[-1][0] == pytest.approx(30.2, abs=0.02)
    assert Desk(q=2.25).play(bag[0])[-1][2] == 2.0
    assert Desk(space=2.25, q=9.0).play(bag[0])[-1][2] == 2.0
    desk = Desk(space=2.25)
    desk.stop.set()
    assert desk.play(bag[0]) == []


def test_a_jump_in_a_loop_is_one_of_its_first_round(bag: Bag) -> None:
    """Later rounds start where the replay was told to start."""
    reader = BagReader(bag[0])
    dues = schedule(reader, loop=True, start_offset=9.0, first_ns=105 * SECOND)
    rounds: dict[int, list[float]] = {}
    for due in dues:
        if due.round == 2:
            break
        rounds.setdefault(due.round, []).append(due.message.stamp_ns / SECOND - 100.0)
    assert rounds[0][0] == 4.0 and rounds[0][1] == 5.0
    assert rounds[1] == [8.0, 9.0, 9.0, 9.5]
