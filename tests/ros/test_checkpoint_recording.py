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

"""When checkpoints go into the bag, and how much of it they take."""

from concurrent.futures import Future

import numpy as np
import pytest

from lava_ros.bag import QosProfile
from lava_ros.bag.checkpoints import checkpoints_of
from lava_ros.errors import LavaError
from lava_ros.ros.checkpoint_recording import CheckpointRecording, PATIENCE
from lava_ros.ros.recorder import Recorder
from small_checkpoint import small_checkpoint

PERIOD = 60.0


def state(time, particles=10):
    """The bytes of a checkpoint at a time."""
    return small_checkpoint(time, particles).to_bytes()


class Eruption:
    """Gives checkpoints of its time; by itself or when it is told."""

    def __init__(self, particles=10):
        self.time = 0.0
        self.particles = particles
        self.asked = []
        self.is_slow = False

    def take(self):
        future = Future()
        self.asked.append(future)
        if not self.is_slow:
            self.answer()
        return future

    def answer(self):
        self.asked[-1].set_result(state(self.time, self.particles))


@pytest.fixture
def recording(tmp_path):
    """A recorder with an open bag, an eruption, and what puts its checkpoints into the bag."""
    recorder = Recorder()
    recorder.arm(tmp_path / 'bag')
    recorder.begin({})
    eruption = Eruption()
    checkpoints = CheckpointRecording(recorder, eruption.take, clock=lambda: eruption.time)
    yield recorder, eruption, checkpoints
    recorder.stop()


def run(recorder, eruption, checkpoints, seconds, bytes_a_second=0):
    """Poll twice a second; each second a message of a size goes into the bag."""
    random = np.random.default_rng(0)
    for _ in range(2 * seconds):
        eruption.time += 0.5
        if bytes_a_second and eruption.time % 1.0 == 0.0:
            data = bytes(4) + random.bytes(bytes_a_second)
            stamp = int(eruption.time * 1e9)
            recorder.write('/words', 'std_msgs/msg/String', data, stamp, qos=QosProfile())
            recorder.flush()
        assert checkpoints.poll(PERIOD, int(eruption.time * 1e9)) == ''


def test_one_at_the_start_and_one_each_period(tmp_path, recording):
    """And the last when the bag is closed, with what it holds by then."""
    recorder, _eruption, checkpoints = recording
    run(*recording, 150, bytes_a_second=1000)
    assert checkpoints.finish(PERIOD, 150 * 10**9, timeout=1.0) == ''
    recorder.stop()
    stored = checkpoints_of(tmp_path / 'bag')
    assert [item.time for item in stored] == [0.5, 60.5, 120.5, 150.0]
    assert stored[-1].log_time_ns == 150 * 10**9
    assert (checkpoints.last.time, checkpoints.last.count) == (150.0, 4)
    assert checkpoints.last.size == stored[-1].size
    assert checkpoints.poll(PERIOD, 0) == ''
    assert checkpoints.last is None


def test_none_when_they_are_off_or_nothing_is_recorded(tmp_path, recording):
    """A period of 0, and a recorder without a bag, ask for nothing."""
    recorder, eruption, checkpoints = recording
    assert checkpoints.poll(0.0, 1) == checkpoints.finish(0.0, 1, timeout=1.0) == ''
    recorder.stop()
    assert checkpoints.poll(PERIOD, 1) == checkpoints.finish(PERIOD, 1, timeout=1.0) == ''
    assert eruption.asked == []
    assert checkpoints_of(tmp_path / 'bag') == []


def test_the_same_is_not_written_twice(tmp_path, recording):
    """A simulation that stands still costs the bag one checkpoint."""
    recorder, _eruption, checkpoints = recording
    checkpoints._take = lambda: _done(state(7.0))
    run(*recording, 300, bytes_a_second=1000)
    checkpoints.finish(PERIOD, 1, timeout=1.0)
    recorder.stop()
    assert [item.time for item in checkpoints_of(tmp_path / 'bag')] == [7.0]


def test_nothing_waits_for_a_slow_simulation(recording):
    """While the simulation is busy there is one request, and it is written when it is done."""
    _recorder, eruption, checkpoints = recording
    eruption.is_slow = True
    run(*recording, 200)
    assert len(eruption.asked) == 1
    assert checkpoints.last is None
    eruption.answer()
    run(*recording, 1)
    assert checkpoints.last.time == 200.0
    assert checkpoints.finish(PERIOD, 1, timeout=0.01) == 'no checkpoint within 0.01 s'


def test_large_ones_wait_for_the_bag_to_grow(tmp_path, recording):
    """Checkpoints take no more than half of the bag, but one comes within ten periods."""
    recorder, eruption, _checkpoints = recording
    eruption.particles = 10_000
    size = len(state(0.0, 10_000))
    assert size > 100_000
    run(*recording, 3600, bytes_a_second=size // 100)
    recorder.stop()
    stored = checkpoints_of(tmp_path / 'bag')
    waits = np.diff([item.time for item in stored])
    # a message's record and its index add to the hundredth; the second waits for two of them
    assert waits[1:].min() > 80.0 and waits.max() < 202.0
    bag = sum(item.stat().st_size for item in (tmp_path / 'bag').glob('*.mcap'))
    assert sum(item.size for item in stored) <= 0.52 * bag
    eruption.time = 0.0
    recorder.arm(tmp_path / 'next')
    recorder.begin({})
    run(*recording, 1500)
    recorder.stop()
    waits = np.diff([item.time for item in checkpoints_of(tmp_path / 'next')])
    assert waits.tolist() == [PATIENCE * PERIOD] * 2


def test_what_goes_wrong_is_said_and_tried_again(recording):
    """An eruption that has not begun, has failed or has ended: a reason, and the next period."""
    _recorder, eruption, checkpoints = recording
    failures = [LavaError('checkpoint', 'no simulation', 'one'), RuntimeError('out of memory')]
    for failure in failures:
        future = Future()
        future.set_exception(failure)
        checkpoints._take = lambda future=future: future
        assert checkpoints.finish(PERIOD, 1, timeout=1.0) == str(failure)
    cancelled = Future()
    cancelled.cancel()
    checkpoints._take = lambda: cancelled
    assert 'ended' in checkpoints.finish(PERIOD, 1, timeout=1.0)
    checkpoints._take = eruption.take
    run(*recording, 1)
    assert checkpoints.last.count == 1


def test_a_new_bag_begins_with_a_checkpoint(tmp_path, recording):
    """A recording that starts in the middle of a period can be resumed from its start."""
    recorder, _eruption, checkpoints = recording
    run(*recording, 10)
    recorder.stop()
    recorder.arm(tmp_path / 'second')
    recorder.begin({})
    run(*recording, 2)
    assert checkpoints.last.time == 10.5
    recorder.stop()
    assert [item.time for item in checkpoints_of(tmp_path / 'second')] == [10.5]


def _done(data):
    future = Future()
    future.set_result(data)
    return future
