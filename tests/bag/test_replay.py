# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Timing of a replay with a fake clock."""

from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path

import pytest

from bag.conftest import Bag, GRID, SECOND, small_bag
from lava_ros.bag import BagReader, BagWriter, LATCHED
from lava_ros.bag.replay import LOOP_PAUSE, pace, schedule, Step
from lava_ros.errors import LavaError


class FakeClock:
    """A clock that ``wait`` advances by the requested time plus a delay."""

    def __init__(self, delay: float = 0.0, stop_at: float = float('inf')) -> None:
        """Start at an arbitrary time."""
        self.time = 1000.0
        self.delay = delay
        self.stop_at = 1000.0 + stop_at

    def now(self) -> float:
        """Return the time [s]."""
        return self.time

    def wait(self, seconds: float) -> bool:
        """Advance; return True at or after ``stop_at``."""
        if seconds > 0.0:
            self.time += seconds + self.delay
        return self.time >= self.stop_at


def steps(
    dues: Iterator[Step], clock: FakeClock, rate: float = 1.0, tick: float | None = None
) -> list[tuple[float, Step]]:
    """Return the steps, each with its wall time [s]."""
    taken = pace(dues, rate=rate, now=clock.now, wait=clock.wait, tick=tick)
    return [(clock.time - 1000.0, step) for step in taken]


@pytest.mark.parametrize('rate', [0.5, 1.0, 4.0])
def test_schedule_divides_times_by_the_rate(bag: Bag, rate: float) -> None:
    directory, written = bag
    dues = list(schedule(BagReader(directory), rate=rate))
    assert [(due.message.topic, due.message.data) for due in dues] == [
        (topic, data) for topic, _, data in written
    ]
    for due, (_, stamp, _) in zip(dues, written, strict=True):
        assert due.at == pytest.approx((stamp - 100 * SECOND) / SECOND / rate)
        assert due.clock_ns == stamp


def test_schedule_with_an_offset_begins_with_latched_messages(bag: Bag) -> None:
    directory, written = bag
    first, *rest = schedule(BagReader(directory), start_offset=3.25)
    assert (first.message.topic, first.message.stamp_ns) == ('/hazard', 103 * SECOND)
    assert (first.at, first.clock_ns) == (0.0, 103_250_000_000)
    expected = [(topic, stamp) for topic, stamp, _ in written if stamp >= 103_250_000_000]
    assert [(due.message.topic, due.message.stamp_ns) for due in rest] == expected
    assert rest[0].at == pytest.approx(0.25)
    # a map at the offset itself follows the previous map
    dues = list(islice(schedule(BagReader(directory), start_offset=3.0), 3))
    assert [due.message.stamp_ns for due in dues] == [102 * SECOND, 103 * SECOND, 103 * SECOND]


@pytest.mark.parametrize('topic', ['/tf_static', '/etna/tf_static'])
def test_schedule_with_an_offset_begins_with_all_static_transforms(
    tmp_path: Path, topic: str
) -> None:
    """A robot and a node publish transforms to different frames on one topic."""
    written = [(topic, 1), ('/hazard', 2), (topic, 3), ('/hazard', 4), (topic, 9)]
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        for name, second in written:
            writer.write(name, GRID, bytes(8), second * SECOND, qos=LATCHED)
    dues = [
        (due.message.topic, due.message.stamp_ns // SECOND, due.at)
        for due in schedule(BagReader(tmp_path / 'bag'), start_offset=5.0)
    ]
    assert dues == [(topic, 1, 0.0), (topic, 3, 0.0), ('/hazard', 4, 0.0), (topic, 9, 3.0)]


def test_loop_repeats_after_a_pause(bag: Bag, tmp_path: Path) -> None:
    dues = list(islice(schedule(BagReader(bag[0]), rate=2.0, loop=True, start_offset=9.0), 15))
    rounds = [[due for due in dues if due.round == index] for index in range(3)]
    assert [len(item) for item in rounds] == [4, 4, 4]
    period = 0.5 / 2.0 + LOOP_PAUSE
    for first, second in zip(rounds[0], rounds[1], strict=True):
        assert second.at == pytest.approx(first.at + period)
        assert second.message == first.message
    dues = islice(schedule(small_bag(tmp_path / 'one', (7, bytes(4))), loop=True), 3)
    assert [due.at for due in dues] == [0.0, LOOP_PAUSE, 2 * LOOP_PAUSE]


@pytest.mark.parametrize(('options', 'field'), [
    ({'rate': 0.0}, 'rate'),
    ({'rate': -1.0}, 'rate'),
    ({'rate': float('nan')}, 'rate'),
    ({'start_offset': -0.1}, 'start_offset'),
    ({'start_offset': 9.6}, 'start_offset'),
])
def test_schedule_raises_for_invalid_arguments(
    bag: Bag, options: dict[str, float], field: str, tmp_path: Path
) -> None:
    with pytest.raises(LavaError) as caught:
        schedule(BagReader(bag[0]), **options)
    assert caught.value.field == field
    with pytest.raises(LavaError, match='contains no messages'):
        schedule(small_bag(tmp_path / 'empty'))


@pytest.mark.parametrize('delay', [0.0, 0.003, 0.3])
@pytest.mark.parametrize('rate', [0.5, 8.0])
def test_the_clock_ticks_and_never_goes_back(bag: Bag, delay: float, rate: float) -> None:
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


def test_stop_ends_a_loop(bag: Bag) -> None:
    taken = steps(schedule(BagReader(bag[0]), loop=True), FakeClock(stop_at=30.2), tick=0.01)
    assert taken[-1][0] == pytest.approx(30.2, abs=0.02)
