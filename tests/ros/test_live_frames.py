# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The maps of a node become frames as they are heard, in a real graph."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip('rclpy')
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from lava_ros.errors import LavaError
from lava_ros.maps.layers import IMAGE, PROBABILITY
from lava_ros.ros import codec, live_frames, outputs, qos
from lava_ros.ros.live_frames import LiveFrames
from lava_ros.ros.outputs import vent_markers
from lava_ros.ros.spinning import Watcher
from lava_ros.watch.frames import Level, watched_layers
from recording import diagnostics_of, growing, SECOND, snapshot_at, START, TERRAIN, VENT
from ros.graph_publisher import wait_until
from ros_domain import own_domain

LAYERS = {item.source: item for item in watched_layers()}


class Speaker(Watcher):
    """Says what a node in /etna would."""

    def __init__(self) -> None:
        super().__init__('speaker', own_domain(), 'etna')
        self._publishers: dict[str, Any] = {}

    def say(self, topic: str, message: Any) -> None:
        """Publish a message, latched but for diagnostics, once somebody hears it."""
        if topic not in self._publishers:
            profile = qos.DIAGNOSTICS if topic == '/diagnostics' else qos.LATCHED
            self._publishers[topic] = self._node.create_publisher(
                type(message), topic, qos.ros_profile(profile)
            )
        until(lambda: self._publishers[topic].get_subscription_count() > 0)
        self._publishers[topic].publish(message)

    def ground(self) -> None:
        """Tell of the terrain and a vent."""
        image, info = outputs.terrain_messages(TERRAIN, frame_id='map', stamp_ns=START).values()
        self.say('terrain', image)
        self.say('terrain_info', info)
        markers = vent_markers((VENT,), 0.0, TERRAIN, frame_id='map', stamp_ns=START)
        self.say('vents_markers', markers)

    def frame(self, second: int, *sources: str) -> None:
        """Publish maps of 100 s a second."""
        time_s, stamp = 100.0 * second, START + second * SECOND
        snapshot = snapshot_at(time_s, growing(time_s), TERRAIN)
        for source in sources:
            layer = LAYERS[source]
            message = outputs.layer_message(layer, snapshot, frame_id='map', stamp_ns=stamp)
            self.say(layer.topic, message)

    def status(self, second: float, simulated: float, name: str = 'etna/lava') -> None:
        """Tell which simulated time the frame of a second has."""
        snapshot = snapshot_at(simulated, growing(simulated), TERRAIN)
        message = diagnostics_of(snapshot, START + int(second * SECOND))
        message.status[0].name = f'{name}: simulation'
        message.status[0].message = 'running'
        self.say('/diagnostics', message)


def until(condition: Callable[[], bool], poll: Callable[[], None] = lambda: None) -> None:
    """Poll until something holds."""
    wait_until(lambda: poll() or condition())


@pytest.fixture
def live() -> Iterator[LiveFrames]:
    """What listens in /etna."""
    frames = LiveFrames('/etna', own_domain())
    yield frames
    frames.close()


@pytest.fixture
def speaker(live: LiveFrames) -> Iterator[Speaker]:
    """Who speaks there."""
    result = Speaker()
    yield result
    result.close()


def test_maps_become_frames_of_their_time(live: LiveFrames, speaker: Speaker) -> None:
    """Maps of one stamp are a frame; one that came without diagnostics is between two that did."""
    speaker.ground()
    speaker.frame(2, 'thickness', 'hazard')
    until(lambda: len(live._waiting.get(START + 2 * SECOND, ())) == 2, live.poll)
    speaker.status(2, 200.0)
    until(lambda: live.times == [200.0], live.poll)
    for second in (3, 4):
        speaker.frame(second, 'thickness')
        until(lambda stamp=START + second * SECOND: stamp in live._waiting, live.poll)
    speaker.status(4, 400.0)
    until(lambda: len(live.times) == 3, live.poll)
    assert live.times == [200.0, 300.0, 400.0]
    until(lambda: len(live.frame(0).vents) == 1, live.poll)
    assert live.status == (Level.WELL, 'etna/lava: running')
    for index, time_s in enumerate(live.times):
        frame = live.frame(index)
        thickness = growing(time_s)
        expected = np.where(thickness > 0.0, thickness, np.nan)
        np.testing.assert_array_equal(frame.layers['thickness'].values, expected)
        # the last one there was
        assert np.isfinite(frame.layers['hazard'].values).sum() == 20
    assert (frame.time, frame.resolution, frame.origin) == (400.0, 5.0, (-50.0, 20.0))
    np.testing.assert_allclose(frame.vents, [VENT.position])
    np.testing.assert_array_equal(frame.elevation, TERRAIN.elevation.astype(np.float32))
    # a reset: the run before is not of this one
    speaker.status(5, 0.0)
    until(lambda: live.times == [], live.poll)


def test_probabilities_belong_to_the_frames_from_then_on(
    live: LiveFrames, speaker: Speaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A forecast is of an earlier moment; long runs keep every second frame."""
    monkeypatch.setattr(live_frames, 'MOST_FRAMES', 4)
    speaker.ground()
    for second in range(1, 6):
        if second == 3:
            cells = np.full(TERRAIN.shape, 40, dtype=np.int8)
            cells[0] = -1
            info = codec.map_metadata(TERRAIN, START)
            grid = codec.occupancy_grid(cells, info, codec.header('map', START))
            speaker.say(LAYERS[PROBABILITY].topic, grid)
            until(lambda: bool(live._forecasts), live.poll)
        speaker.frame(second, 'thickness')
        until(lambda stamp=START + second * SECOND: stamp in live._waiting, live.poll)
        speaker.status(second, 100.0 * second)
        until(lambda now=100.0 * second: now in live.times, live.poll)
    assert live.times == [100.0, 300.0, 500.0]
    assert PROBABILITY not in live.frame(0).layers
    values = live.frame(1).layers[PROBABILITY].values
    assert np.isnan(values[0]).all()
    assert (values[1:] == 40.0).all()


def test_what_is_wrong_is_said(
    live: LiveFrames, speaker: Speaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody, somebody elsewhere, a broken map, silence: each has its sentence."""
    assert live.status.level is Level.WAITING
    speaker.status(1, 100.0, name='other/lava')
    until(lambda: bool(live._others), live.poll)
    monkeypatch.setattr(live_frames, 'PATIENCE', -1.0)
    level, words = live.status
    assert level is Level.BAD
    assert 'no node answers in namespace /etna of ROS domain' in words
    assert '(heard from other/lava)' in words
    monkeypatch.setattr(live_frames, 'PATIENCE', 1e6)
    speaker.status(1, 100.0)
    until(lambda: live.status.level is Level.WELL, live.poll)
    with pytest.raises(LavaError, match='terrain'):
        live.frame(0)
    image = codec.float_image(TERRAIN.elevation, codec.header('map', START))
    image.step = 1
    speaker.say(LAYERS['thickness'].topic, image)
    until(lambda: live.status.level is Level.BAD, live.poll)
    assert live.status.words.startswith('height_raw: height_raw.step is 1')
    speaker.frame(2, 'thickness')
    speaker.status(2, 200.0)
    until(lambda: live.status.level is not Level.BAD, live.poll)
    monkeypatch.setattr(live_frames, 'PATIENCE', -1.0)
    assert 'the node has been silent for' in live.status.words
    error = DiagnosticArray(status=[DiagnosticStatus(name='etna/lava: simulation', level=b'\2')])
    monkeypatch.setattr(live_frames, 'PATIENCE', 1e6)
    speaker.say('/diagnostics', error)
    until(lambda: live.status == (Level.BAD, 'etna/lava: '), live.poll)


def test_the_watched_layers_are_subscribed_to_as_they_are_published(live: LiveFrames) -> None:
    """Topics and types are those of the node's layers, in the namespace."""
    heard = dict(live._node.get_topic_names_and_types())
    for layer in LAYERS.values():
        assert heard[f'/etna/{layer.topic}'] == [layer.message]
    assert LAYERS['arrived'].message == IMAGE
