# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checkpoints in the bag of a live simulation."""

from concurrent.futures import Future
from unittest.mock import Mock

import numpy as np
import pytest

from lava_ros.bag import QosProfile
from lava_ros.bag.checkpoints import checkpoints_of
from lava_ros.errors import LavaError
from lava_ros.live.checkpoint_recording import CheckpointRecording, PATIENCE
from lava_ros.live.recorder import Recorder
from small_checkpoint import small_checkpoint

PERIOD = 60.0


def state(time, particles=10):
    return small_checkpoint(time, particles).to_bytes()


class Session:
    """Returns checkpoints of its time, immediately or on request."""

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
    """Return a recorder with an open bag, a session, and the recording of its checkpoints."""
    recorder = Recorder()
    recorder.arm(tmp_path / 'bag')
    recorder.describe({})
    session = Session()
    checkpoints = CheckpointRecording(recorder, session.take, clock=lambda: session.time)
    yield recorder, session, checkpoints
    recorder.stop()


def run(recorder, session, checkpoints, seconds, bytes_a_second=0):
    """Poll twice a second, and write a message of a size each second."""
    random = np.random.default_rng(0)
    for _ in range(2 * seconds):
        session.time += 0.5
        if bytes_a_second and session.time % 1.0 == 0.0:
            data = bytes(4) + random.bytes(bytes_a_second)
            stamp = int(session.time * 1e9)
            recorder.write('/words', 'std_msgs/msg/String', data, stamp, qos=QosProfile())
            recorder.flush()
        assert checkpoints.poll(PERIOD, int(session.time * 1e9)) == ''


def test_checkpoints_are_written_at_the_start_each_period_and_at_the_end(tmp_path, recording):
    recorder, _session, checkpoints = recording
    run(*recording, 150, bytes_a_second=1000)
    assert checkpoints.finish(PERIOD, 150 * 10**9, timeout=1.0) == ''
    recorder.stop()
    stored = checkpoints_of(tmp_path / 'bag')
    assert [item.time for item in stored] == [0.5, 60.5, 120.5, 150.0]
    assert stored[-1].log_time_ns == 150 * 10**9
    assert (checkpoints.last.time, checkpoints.count) == (150.0, 4)
    assert checkpoints.last.size == stored[-1].size
    assert checkpoints.poll(PERIOD, 0) == ''
    assert checkpoints.last is None


def test_checkpoint_follows_a_change_within_a_tenth_of_the_period(tmp_path, recording):
    recorder, session, checkpoints = recording
    run(*recording, 20, bytes_a_second=1000)
    for changes in (1, 1, 2):
        for _ in range(20):
            session.time += 0.5
            assert checkpoints.poll(PERIOD, int(session.time * 1e9), changes=changes) == ''
    # many changes in a row: one checkpoint in each tenth
    for changes in range(3, 30):
        session.time += 0.5
        assert checkpoints.poll(PERIOD, int(session.time * 1e9), changes=changes) == ''
    recorder.stop()
    stored = checkpoints_of(tmp_path / 'bag')
    assert [item.time for item in stored] == [0.5, 20.5, 40.5, 50.5, 56.5, 62.5]


def test_no_checkpoint_without_a_period_or_a_bag(tmp_path, recording):
    recorder, session, checkpoints = recording
    assert checkpoints.poll(0.0, 1) == checkpoints.finish(0.0, 1, timeout=1.0) == ''
    recorder.stop()
    assert checkpoints.poll(PERIOD, 1) == checkpoints.finish(PERIOD, 1, timeout=1.0) == ''
    assert session.asked == []
    assert checkpoints_of(tmp_path / 'bag') == []


def test_identical_checkpoint_is_written_once(tmp_path, recording):
    recorder, _session, checkpoints = recording
    checkpoints.take = lambda: Mock(**{'result.return_value': state(7.0)})
    run(*recording, 300, bytes_a_second=1000)
    checkpoints.finish(PERIOD, 1, timeout=1.0)
    recorder.stop()
    assert [item.time for item in checkpoints_of(tmp_path / 'bag')] == [7.0]


def test_slow_simulation_has_one_pending_request(recording):
    _recorder, session, checkpoints = recording
    session.is_slow = True
    run(*recording, 200)
    assert len(session.asked) == 1
    assert checkpoints.last is None
    session.answer()
    run(*recording, 1)
    assert checkpoints.last.time == 200.0
    assert checkpoints.finish(PERIOD, 1, timeout=0.01) == 'no checkpoint within 0.01 s'


def test_large_checkpoints_wait_for_the_bag_to_grow(tmp_path, recording):
    recorder, session, _checkpoints = recording
    session.particles = 10_000
    size = len(state(0.0, 10_000))
    assert size > 100_000
    run(*recording, 1800, bytes_a_second=size // 100)
    recorder.stop()
    stored = checkpoints_of(tmp_path / 'bag')
    waits = np.diff([item.time for item in stored])
    # records and indexes add to the hundredth; the second checkpoint waits for two
    assert waits[1:].min() > 80.0 and waits.max() < 202.0
    bag = sum(item.stat().st_size for item in (tmp_path / 'bag').glob('*.mcap'))
    assert sum(item.size for item in stored) <= 0.52 * bag
    session.time = 0.0
    recorder.arm(tmp_path / 'next')
    recorder.describe({})
    run(*recording, 1500)
    recorder.stop()
    waits = np.diff([item.time for item in checkpoints_of(tmp_path / 'next')])
    assert waits.tolist() == [PATIENCE * PERIOD] * 2


def test_failed_checkpoint_is_reported_and_repeated(recording):
    _recorder, session, checkpoints = recording
    for failure in (LavaError('checkpoint', 'no simulation', 'one'), RuntimeError('no memory')):
        checkpoints.take = Mock(**{'return_value.result.side_effect': failure})
        assert checkpoints.finish(PERIOD, 1, timeout=1.0) == str(failure)
    checkpoints.take = session.take
    run(*recording, 1)
    assert checkpoints.count == 1


def test_new_bag_starts_with_a_checkpoint(tmp_path, recording):
    recorder, _session, checkpoints = recording
    run(*recording, 10)
    recorder.stop()
    recorder.arm(tmp_path / 'second')
    recorder.describe({})
    run(*recording, 2)
    assert checkpoints.last.time == 10.5
    recorder.stop()
    assert [item.time for item in checkpoints_of(tmp_path / 'second')] == [10.5]
