# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Terrain, vents, description and checkpoints of a bag."""

from concurrent.futures import Future
import json
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import yaml

from lava_ros.bag import BagReader, LATCHED, QosProfile
from lava_ros.bag.checkpoints import checkpoints_of
from lava_ros.cli.main import main
from lava_ros.errors import LavaError
from lava_ros.live.session import Origin
from lava_ros.ros.recorder import Recorder
from lava_ros.ros.recording import CheckpointRecording, PATIENCE, SceneRecording
from lava_ros.scene import Lava, Scene, Terrain, Vent
from recording import snapshot_at
from small_checkpoint import small_checkpoint

TERRAIN = Terrain(np.zeros((4, 5)), 10.0)
STEEP = {'steep': 'on: slope = 0.5 > 0.12', 'inertia': 'off: number = 0.01 <= 0.1'}
FAST = {'steep': 'on: slope = 0.5 > 0.12', 'inertia': 'on: number = 0.2 > 0.1'}


class FrameRecording:
    """A recording of frames."""

    def __init__(self, directory, terrain=TERRAIN):
        self.directory = directory
        self.scene = Scene(terrain, (Vent((25.0, 15.0), 2.0),), lava=Lava())
        self.schedule = self.scene.vents
        self.origin = None
        self.parameters = {}
        self.recorder = Recorder()
        self.recording = SceneRecording(
            SimpleNamespace(resolve_topic_name='/{}'.format, get_namespace=lambda: '/'),
            self.recorder, frame_id='map', configs={}, parameters=lambda: self.parameters,
        )

    def write(self, time, effects):
        terrain = self.scene.terrain
        snapshot = snapshot_at(time, np.zeros(terrain.shape, np.float32), terrain)
        session = SimpleNamespace(
            scene=self.scene, effects=effects, schedule=self.schedule, origin=self.origin,
            device='cpu',
        )
        self.recording.write(session, snapshot, int(time * 1e9))
        self.recorder.flush()

    def effects(self, name):
        return json.loads(BagReader(self.directory / name).custom_data['effects'])


@pytest.fixture
def frames(tmp_path):
    result = FrameRecording(tmp_path)
    result.recorder.arm(tmp_path / 'one')
    result.write(1.0, STEEP)
    return result


def test_bag_has_each_change_of_effects(frames):
    frames.write(2.0, {**STEEP, 'steep': 'on: slope = 0.6 > 0.12'})
    frames.write(3.0, FAST)
    # also in a truncated recording
    assert [entry['time'] for entry in frames.effects('one')] == [1.0, 3.0]
    frames.scene = Scene(TERRAIN, lava=Lava())
    frames.write(4.0, FAST)
    frames.write(5.0, STEEP)
    frames.write(6.0, FAST)
    frames.recorder.stop()
    entries = frames.effects('one')
    assert [entry['time'] for entry in entries] == [1.0, 3.0, 5.0, 6.0]
    assert entries[1]['effects'] == entries[3]['effects'] == {'inertia': FAST['inertia']}
    assert entries[2]['effects'] == {'inertia': STEEP['inertia']}
    frames.recorder.arm(frames.directory / 'two')
    frames.write(7.0, FAST)
    frames.recorder.stop()
    assert frames.effects('two') == [{'stamp_ns': 7 * 10**9, 'time': 7.0, 'effects': FAST}]


def test_bag_has_origin_and_onset_of_its_start(frames):
    frames.origin = Origin('bags/first', 120.0, 7)
    frames.parameters = {'onset': '2006-07-14T22:00Z'}
    frames.write(2.0, STEEP)
    frames.recorder.stop()
    frames.recorder.arm(frames.directory / 'two')
    frames.write(3.0, STEEP)
    frames.origin = None
    frames.write(0.0, FAST)
    frames.recorder.stop()
    first, second = (BagReader(frames.directory / name).custom_data for name in ('one', 'two'))
    assert not {'resumed_from', 'onset'} & set(first)
    origin = {'bag': 'bags/first', 'time': 120.0, 'stamp_ns': 7}
    assert json.loads(second['resumed_from']) == origin
    assert second['onset'] == '2006-07-14T22:00Z'


def test_bag_has_the_schedule_of_closed_vents(frames):
    frames.schedule = (Vent((25.0, 15.0), ((0.0, 2.0), (3.0, 5.0), (4.0, 0.0)), 1423.0),)
    frames.scene = Scene(TERRAIN, lava=Lava())
    frames.write(4.0, STEEP)
    frames.recorder.stop()
    scene = yaml.safe_load(BagReader(frames.directory / 'one').custom_data['scene'])
    assert scene['vents'][0]['discharge'] == [[0.0, 2.0], [3.0, 5.0], [4.0, 0.0]]
    assert main(['info', str(frames.directory / 'one')]) == 0


def test_terrain_and_vents_are_repeated_as_the_bag_grows(tmp_path):
    """They are repeated once a minute if the bag has grown by their size."""
    random = np.random.default_rng(0)
    frames = FrameRecording(tmp_path, Terrain(random.random((50, 60)), 1.0))
    frames.recorder.arm(tmp_path / 'one')
    for second in range(1, 186):
        frames.recorder.write(
            '/noise', 'std_msgs/msg/Empty', random.bytes(1000), second * 10**9, qos=LATCHED
        )
        frames.write(float(second), STEEP)
    for second in range(1000, 2000, 100):
        frames.write(float(second), STEEP)
    frames.recorder.stop()
    seen = {}
    for item in BagReader(tmp_path / 'one').messages():
        seen.setdefault(item.topic, []).append(item.stamp_ns // 10**9)
    # nothing else is written after that
    assert seen['/terrain'] == [1, 61, 121, 181]
    scene = ('/terrain', '/terrain_info', '/relief', '/vents', '/vents_markers')
    assert all(seen[topic] == seen['/terrain'] for topic in scene)


PERIOD = 60.0


def state(time, particles=10):
    return small_checkpoint(time, particles).to_bytes()


class SimulationSession:
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
    """Return a recorder with an open bag, an session, and the recording of its checkpoints."""
    recorder = Recorder()
    recorder.arm(tmp_path / 'bag')
    recorder.begin({})
    session = SimulationSession()
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
    assert (checkpoints.last.time, checkpoints.last.count) == (150.0, 4)
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
    run(*recording, 3600, bytes_a_second=size // 100)
    recorder.stop()
    stored = checkpoints_of(tmp_path / 'bag')
    waits = np.diff([item.time for item in stored])
    # records and indexes add to the hundredth; the second checkpoint waits for two
    assert waits[1:].min() > 80.0 and waits.max() < 202.0
    bag = sum(item.stat().st_size for item in (tmp_path / 'bag').glob('*.mcap'))
    assert sum(item.size for item in stored) <= 0.52 * bag
    session.time = 0.0
    recorder.arm(tmp_path / 'next')
    recorder.begin({})
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
    assert checkpoints.last.count == 1


def test_new_bag_starts_with_a_checkpoint(tmp_path, recording):
    recorder, _session, checkpoints = recording
    run(*recording, 10)
    recorder.stop()
    recorder.arm(tmp_path / 'second')
    recorder.begin({})
    run(*recording, 2)
    assert checkpoints.last.time == 10.5
    recorder.stop()
    assert [item.time for item in checkpoints_of(tmp_path / 'second')] == [10.5]
