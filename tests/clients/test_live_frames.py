# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Maps of a node become frames, in a real graph."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip('rclpy')
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PointStamped
from std_srvs.srv import SetBool

from lava_ros.clients import live_frames
from lava_ros.clients.live_frames import LiveFrames
from lava_ros.clients.watcher import Watcher
from lava_ros.errors import LavaError
from lava_ros.maps.layers import IMAGE, PROBABILITY
from lava_ros.maps.plot import barriers_of
from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.outputs import vent_markers
from lava_ros.watch.frames import Level, watched_layers
from recording import diagnostics_of, growing, SECOND, snapshot_at, START, TERRAIN, VENT
from ros_domain import own_domain
from waiting import wait_until

#: Crest of a barrier on the terrain, easting and northing [m].
BARRIER = [(500_020.0, 4_180_050.0), (500_060.0, 4_180_070.0)]

LAYERS = {item.source: item for item in watched_layers()}


class FakeNode(Watcher):
    """Publishes the messages of a node in /etna."""

    def __init__(self) -> None:
        super().__init__('fake_node', own_domain(), 'etna')
        self._publishers: dict[str, Any] = {}

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message once a subscriber exists; all but diagnostics are latched."""
        if topic not in self._publishers:
            profile = qos.DIAGNOSTICS if topic == '/diagnostics' else qos.LATCHED
            self._publishers[topic] = self._node.create_publisher(
                type(message), topic, qos.ros_profile(profile)
            )
        until(lambda: self._publishers[topic].get_subscription_count() > 0)
        self._publishers[topic].publish(message)

    def publish_ground(self, live: LiveFrames) -> None:
        """Publish terrain and vents, and wait until all of it has arrived."""
        image, info = outputs.terrain_messages(TERRAIN, frame_id='map', stamp_ns=START).values()
        self.publish('terrain', image)
        self.publish('terrain_info', info)
        ground = replace(TERRAIN, barriers=[BARRIER])
        markers = vent_markers((VENT,), 0.0, ground, frame_id='map', stamp_ns=START)
        self.publish('vents_markers', markers)
        until(
            lambda: live._elevation is not None and live._info is not None and live._scene,
            live.poll,
        )

    def frame(self, second: int, *sources: str) -> None:
        """Publish maps of a frame; each second is 100 s of simulated time."""
        time_s, stamp = 100.0 * second, START + second * SECOND
        snapshot = snapshot_at(time_s, growing(time_s), TERRAIN)
        for source in sources:
            layer = LAYERS[source]
            message = outputs.layer_message(layer, snapshot, frame_id='map', stamp_ns=stamp)
            self.publish(layer.topic, message)

    def status(self, second: float, simulated: float, name: str = 'etna/lava') -> None:
        """Publish diagnostics with the simulated time of the frame of a second."""
        snapshot = snapshot_at(simulated, growing(simulated), TERRAIN)
        message = diagnostics_of(snapshot, START + int(second * SECOND))
        message.status[0].name = f'{name}: simulation'
        message.status[0].message = 'running'
        self.publish('/diagnostics', message)


def until(condition: Callable[[], bool], poll: Callable[[], None] = lambda: None) -> None:
    wait_until(lambda: poll() or condition())


@pytest.fixture
def live() -> Iterator[LiveFrames]:
    frames = LiveFrames('/etna', own_domain())
    yield frames
    frames.close()


@pytest.fixture
def node(live: LiveFrames) -> Iterator[FakeNode]:
    result = FakeNode()
    yield result
    result.close()


def test_maps_become_frames_of_their_time(live: LiveFrames, node: FakeNode) -> None:
    """A map without diagnostics has a time between those of its neighbours."""
    node.publish_ground(live)
    node.frame(2, 'thickness', 'hazard')
    until(lambda: len(live._waiting.get(START + 2 * SECOND, ())) == 2, live.poll)
    node.status(2, 200.0)
    until(lambda: live.times == [200.0], live.poll)
    for second in (3, 4):
        node.frame(second, 'thickness')
        until(lambda stamp=START + second * SECOND: stamp in live._waiting, live.poll)
    node.status(4, 400.0)
    until(lambda: len(live.times) == 3, live.poll)
    assert live.times == [200.0, 300.0, 400.0]
    assert len(live.frame(0).vents) == 1
    assert live.status == (Level.OK, 'etna/lava: running')
    for index, time_s in enumerate(live.times):
        frame = live.frame(index)
        thickness = growing(time_s)
        expected = np.where(thickness > 0.0, thickness, np.nan)
        np.testing.assert_array_equal(frame.layers['thickness'].values, expected)
        # the last received one
        assert np.isfinite(frame.layers['hazard'].values).sum() == 20
    assert (frame.time, frame.resolution, frame.origin) == (400.0, 5.0, (-50.0, 20.0))
    np.testing.assert_allclose(frame.vents, [VENT.position])
    (crest,) = barriers_of(frame)
    np.testing.assert_allclose(crest, np.subtract(BARRIER, TERRAIN.offset))
    np.testing.assert_array_equal(frame.elevation, TERRAIN.elevation.astype(np.float32))
    # a reset: frames of the previous run are dropped
    node.status(5, 0.0)
    until(lambda: live.times == [], live.poll)


def test_probabilities_belong_to_later_frames(
    live: LiveFrames, node: FakeNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_frames, 'MAX_FRAMES', 4)
    node.publish_ground(live)
    for second in range(1, 6):
        if second == 3:
            cells = np.full(TERRAIN.shape, 40, dtype=np.int8)
            cells[0] = -1
            info = codec.map_metadata(TERRAIN, START)
            grid = codec.occupancy_grid(cells, info, codec.header('map', START))
            node.publish(LAYERS[PROBABILITY].topic, grid)
            until(lambda: bool(live._forecasts), live.poll)
        node.frame(second, 'thickness')
        until(lambda stamp=START + second * SECOND: stamp in live._waiting, live.poll)
        node.status(second, 100.0 * second)
        until(lambda now=100.0 * second: now in live.times, live.poll)
    assert live.times == [100.0, 300.0, 500.0]
    assert PROBABILITY not in live.frame(0).layers
    values = live.frame(1).layers[PROBABILITY].values
    assert np.isnan(values[0]).all()
    assert (values[1:] == 40.0).all()


def test_status_reports_each_fault(
    live: LiveFrames, node: FakeNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert live.status.level is Level.WARN
    node.status(1, 100.0, name='other/lava')
    until(lambda: bool(live._others), live.poll)
    monkeypatch.setattr(live_frames, 'PATIENCE', -1.0)
    level, words = live.status
    assert level is Level.ERROR
    assert 'no node answers in namespace /etna of ROS domain' in words
    assert '(heard from other/lava)' in words
    monkeypatch.setattr(live_frames, 'PATIENCE', 1e6)
    node.status(1, 100.0)
    until(lambda: live.status.level is Level.OK, live.poll)
    with pytest.raises(LavaError, match='terrain'):
        live.frame(0)
    image = codec.float_image(TERRAIN.elevation, codec.header('map', START))
    image.step = 1
    node.publish(LAYERS['thickness'].topic, image)
    until(lambda: live.status.level is Level.ERROR, live.poll)
    assert live.status.words.startswith('height_raw: height_raw.step is 1')
    node.frame(2, 'thickness')
    node.status(2, 200.0)
    until(lambda: live.status.level is not Level.ERROR, live.poll)
    monkeypatch.setattr(live_frames, 'PATIENCE', -1.0)
    assert 'the node has been silent for' in live.status.words
    error = DiagnosticArray(status=[DiagnosticStatus(name='etna/lava: simulation', level=b'\2')])
    monkeypatch.setattr(live_frames, 'PATIENCE', 1e6)
    node.publish('/diagnostics', error)
    until(lambda: live.status == (Level.ERROR, 'etna/lava: '), live.poll)


def test_places_and_vents_have_names(live: LiveFrames, node: Any) -> None:
    node.publish_ground(live)
    values = [KeyValue(key='x_m', value='20.0'), KeyValue(key='y_m', value='95.0')]
    statuses = [DiagnosticStatus(name='hut', values=values), DiagnosticStatus(name='unplaced')]
    node.publish('place_arrivals', DiagnosticArray(status=statuses))
    until(lambda: live.places == {'hut': (20.0, 95.0)}, live.poll)
    (vent,) = live._scene['vents']
    assert vent['name'].startswith('open: 10 m3/s')
    np.testing.assert_allclose(vent['position'], VENT.position)


def test_commands_reach_the_node(live: LiveFrames, node: Any) -> None:
    live.command('reset')
    assert live.answer == 'reset: no node answers'
    heard: list[Any] = []

    def pause(request: Any, response: Any) -> Any:
        heard.append(request.data)
        response.message = 'pausing'
        return response

    node._node.create_service(SetBool, 'lava/pause', pause)
    node._node.create_subscription(PointStamped, 'clicked_point', heard.append, 10)
    node.status(1, 100.0)

    def poll() -> None:
        live.poll()
        node.listen(0.0)

    until(lambda: live.facts(0) == {'simulation': 'running'}, poll)

    def asked() -> bool:
        if live.answer != 'pause: asked':
            live.command('pause')
        return bool(heard)

    until(asked, poll)
    assert heard == [True]
    until(lambda: live.answer == 'pause: pausing', poll)
    live.command('resume')
    until(lambda: heard == [True, False], poll)
    until(lambda: live._node.count_subscribers('/etna/clicked_point') > 0, poll)

    def clicked() -> bool:
        live.open_vent(10.0, 20.0)
        return len(heard) > 2

    until(clicked, poll)
    assert (heard[2].header.frame_id, heard[2].point.x, heard[2].point.y) == ('map', 10.0, 20.0)


def test_subscriptions_have_the_types_of_the_layers(live: LiveFrames) -> None:
    types = dict(live._node.get_topic_names_and_types())
    for layer in LAYERS.values():
        assert types[f'/etna/{layer.topic}'] == [layer.message]
    assert LAYERS['arrived'].message == IMAGE
