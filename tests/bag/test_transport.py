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

"""A replay under keys, against a clock that the test turns."""

from pathlib import Path
import threading

import pytest

from lava_ros.bag import BagReader
from lava_ros.bag.replay import pace, schedule
from lava_ros.bag.transport import JUMP, SPEEDS, Transport

SECOND = 1_000_000_000

Bag = tuple[Path, list[tuple[str, int, bytes]]]


class Desk:
    """Somebody who presses keys at given times, and a clock that moves when waited for."""

    def __init__(self, **presses: float) -> None:
        """Take keys by name, with the wall time of each [s]; digits behind a name do not count."""
        self.time = 0.0
        self.presses = sorted((when, name.rstrip('0123456789')) for name, when in presses.items())
        self.changes: list[tuple[bool, float]] = []
        self.stop = threading.Event()
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


def test_without_keys_it_is_the_real_clock(bag: Bag) -> None:
    """Every message comes once, when it is due."""
    taken = Desk().play(bag[0])
    assert [place for _, _, place in taken] == [(stamp / 1e9) - 100.0 for _, stamp, _ in bag[1]]
    for moment, _, place in taken:
        assert moment == pytest.approx(place, abs=1e-3)


def test_space_holds_it_and_lets_it_go_on(bag: Bag) -> None:
    """Nothing comes while it is held, and what comes later is late by as much."""
    desk = Desk(space1=3.2, space2=20.2)
    taken = desk.play(bag[0])
    assert [place for _, _, place in taken] == [(stamp / 1e9) - 100.0 for _, stamp, _ in bag[1]]
    for moment, _, place in taken:
        assert moment == pytest.approx(place if place < 3.2 else place + 17.0, abs=1e-3)
    assert desk.changes == [(True, 1.0), (False, 1.0)]


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


def test_right_goes_ahead(bag: Bag) -> None:
    """The latched map from before is shown at once, and the messages between are left out."""
    taken = Desk(right=1.25).play(bag[0])
    place = 1.25 + JUMP
    after = [item for item in taken if item[2] > 1.25]
    assert after[0][1:] == ('/hazard', 6.0)
    assert after[0][0] == pytest.approx(1.25, abs=0.06)
    assert [item[2] for item in after[1:]] == [
        stamp / 1e9 - 100.0 for _, stamp, _ in bag[1] if stamp / 1e9 - 100.0 >= place
    ]


def test_left_goes_back(bag: Bag) -> None:
    """No further than to the start; what has been comes again."""
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


def test_q_ends_it_also_while_it_is_held(bag: Bag) -> None:
    """At once; a stop from elsewhere does as well."""
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
