# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Maps of a node become frames, and commands reach the node."""

from dataclasses import replace

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
from lava_ros.layers.layer import PROBABILITY
from lava_ros.products.plot import barriers_of
from lava_ros.ros import codec, outputs, qos
from lava_ros.watch.frames import Level, watched_layers
from recording import diagnostics_of, growing, SECOND, snapshot_at, START, TERRAIN, VENT
from ros_domain import own_domain
from ros_messages import float_image, vent_markers
from waiting import wait_until

#: Crest of a barrier on the terrain, easting and northing [m].
BARRIER = [(500_020.0, 4_180_050.0), (500_060.0, 4_180_070.0)]

LAYERS = {item.source: item for item in watched_layers()}


class Received(LiveFrames):
    """Frames of a node in /etna whose messages a test delivers."""

    def __init__(self):
        super().__init__('/etna', own_domain())

    def deliver(self, topic, message):
        name = topic if topic.startswith('/') else f'/etna/{topic}'
        takers = [item for item in self._node.subscriptions if item.topic_name == name]
        assert takers
        for taker in takers:
            assert isinstance(message, taker.msg_type)
            taker.callback(message)

    def deliver_ground(self):
        messages = outputs.terrain_messages(TERRAIN, codec.header('map', START))
        ground = replace(TERRAIN, barriers=[BARRIER])
        markers = vent_markers((VENT,), 0.0, ground, codec.header('map', START))
        for topic, message in {**messages, 'vents_markers': markers}.items():
            self.deliver(topic, message)

    def deliver_maps(self, second, *sources):
        """Deliver maps of a second; each second is 100 s of simulated time."""
        time_s, stamp = 100.0 * second, START + second * SECOND
        snapshot = snapshot_at(time_s, growing(time_s), TERRAIN)
        for source in sources:
            layer = LAYERS[source]
            message = outputs.layer_message(layer, snapshot, codec.header('map', stamp))
            self.deliver(layer.topic, message)

    def deliver_status(self, second, simulated, name='etna/lava'):
        self.deliver('/diagnostics', status_message(second, simulated, name))


def status_message(second, simulated, name='etna/lava'):
    """Return diagnostics with the simulated time of the frame of a second."""
    snapshot = snapshot_at(simulated, growing(simulated), TERRAIN)
    message = diagnostics_of(snapshot, START + int(second * SECOND))
    message.status[0].name = f'{name}: simulation'
    message.status[0].message = 'running'
    return message


@pytest.fixture
def live():
    frames = Received()
    yield frames
    frames.close()


def test_maps_become_frames_of_their_time(live):
    """A map without diagnostics has a time between those of its neighbours."""
    live.deliver_ground()
    live.deliver_maps(2, 'thickness', 'hazard')
    live.deliver_status(2, 200.0)
    assert live.times == [200.0]
    for second in (3, 4):
        live.deliver_maps(second, 'thickness')
    live.deliver_status(4, 400.0)
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
    (vent,) = frame.scene['vents']
    assert vent['name'].startswith('open: 10 m3/s')
    np.testing.assert_allclose(vent['position'], VENT.position)
    assert (frame.terrain.epsg, frame.terrain.offset) == (TERRAIN.epsg, TERRAIN.offset)
    (crest,) = barriers_of(frame)
    np.testing.assert_allclose(crest, np.subtract(BARRIER, TERRAIN.offset))
    np.testing.assert_array_equal(frame.elevation, TERRAIN.elevation.astype(np.float32))
    values = [KeyValue(key='x_m', value='20.0'), KeyValue(key='y_m', value='95.0')]
    statuses = [DiagnosticStatus(name='hut', values=values), DiagnosticStatus(name='unplaced')]
    live.deliver('place_arrivals', DiagnosticArray(status=statuses))
    assert live.places == {'hut': (20.0, 95.0)}
    # a reset: frames of the previous run are dropped
    live.deliver_status(5, 0.0)
    assert live.times == []


def test_maps_from_before_a_jump_of_the_clock_are_not_shown_later(live):
    """A looping clock passes the stamp of a map that waited at the jump again."""
    live.deliver_ground()
    for second, simulated in ((5, 500.0), (1, 700.0), (2, 800.0), (7, 1300.0)):
        live.deliver_maps(second, 'thickness')
        live.deliver_status(second, simulated)
        if second == 5:
            live.deliver_maps(6, 'thickness')
    assert live.times == [500.0, 700.0, 800.0, 1300.0]


def test_receives_particles_only_while_they_are_shown(live, monkeypatch):
    live.deliver_ground()
    for second in (1, 2):
        live.deliver_maps(second, 'thickness')
        live.deliver_status(second, 100.0 * second)
    assert not len(live.particles(1).values)
    columns = {'x': [10.0, 20.0], 'y': [90.0, 95.0], 'temperature': [900.0, 950.0]}
    version = live.version
    live.deliver('lava_particles', codec.point_cloud(columns, codec.header('map', START)))
    assert live.version > version
    # only the newest ones are kept
    assert not len(live.particles(0).values)
    assert live.particles(1).values.tolist() == [[10.0, 90.0, 900.0], [20.0, 95.0, 950.0]]
    live.poll()
    topic = '/etna/lava_particles'
    assert topic in {item.topic_name for item in live._node.subscriptions}
    monkeypatch.setattr(live_frames, 'PATIENCE', -1.0)
    live.poll()
    assert topic not in {item.topic_name for item in live._node.subscriptions}
    live.deliver_status(3, 0.0)
    assert not len(live._particles.values)


def test_probabilities_belong_to_later_frames(live, monkeypatch):
    monkeypatch.setattr(live_frames, 'MAX_FRAMES', 4)
    live.deliver_ground()
    for second in range(1, 6):
        if second == 3:
            cells = np.full(TERRAIN.shape, 40, dtype=np.int8)
            cells[0] = -1
            grid = codec.occupancy_grid(cells, TERRAIN, codec.header('map', START))
            live.deliver(LAYERS[PROBABILITY].topic, grid)
        live.deliver_maps(second, 'thickness')
        live.deliver_status(second, 100.0 * second)
    assert live.times == [100.0, 300.0, 500.0]
    assert PROBABILITY not in live.frame(0).layers
    values = live.frame(1).layers[PROBABILITY].values
    assert np.isnan(values[0]).all()
    assert (values[1:] == 40.0).all()


def test_status_reports_each_fault(live, monkeypatch):
    assert live.status.level is Level.WARN
    live.deliver_status(1, 100.0, name='other/lava')
    monkeypatch.setattr(live_frames, 'PATIENCE', -1.0)
    level, words = live.status
    assert level is Level.ERROR
    assert 'no node answers in namespace /etna of ROS domain' in words
    assert '(heard from other/lava)' in words
    monkeypatch.setattr(live_frames, 'PATIENCE', 1e6)
    live.deliver_status(1, 100.0)
    assert live.status.level is Level.OK
    with pytest.raises(LavaError, match='terrain'):
        live.frame(0)
    image = float_image(TERRAIN.elevation, codec.header('map', START))
    image.step = 1
    live.deliver(LAYERS['thickness'].topic, image)
    assert live.status.level is Level.ERROR
    assert live.status.words.startswith('height_raw: height_raw.step is 1')
    live.deliver_maps(2, 'thickness')
    live.deliver_status(2, 200.0)
    assert live.status.level is not Level.ERROR
    monkeypatch.setattr(live_frames, 'PATIENCE', -1.0)
    assert 'no message from the node for' in live.status.words
    # the node is back
    monkeypatch.setattr(live_frames, 'PATIENCE', 1e6)
    live.deliver_status(3, 0.0)
    assert live.status == (Level.OK, 'etna/lava: running')
    error = DiagnosticArray(status=[DiagnosticStatus(name='etna/lava: simulation', level=b'\2')])
    live.deliver('/diagnostics', error)
    assert live.status == (Level.ERROR, 'etna/lava: ')


class FakeNode(Watcher):
    """A node in /etna with the service pause, clicks and diagnostics."""

    def __init__(self):
        super().__init__('fake_node', own_domain(), 'etna')
        self.received = []
        self._node.create_service(SetBool, 'lava/pause', self._pause)
        self._node.create_subscription(PointStamped, 'clicked_point', self.received.append, 10)
        self.diagnostics = self._node.create_publisher(
            DiagnosticArray, '/diagnostics', qos.ros_profile(qos.DIAGNOSTICS)
        )

    def _pause(self, request, response):
        self.received.append(request.data)
        response.message = 'paused'
        return response


@pytest.mark.parametrize('durability', ['transient_local', 'volatile'])
def test_terrain_is_received_from_latched_and_volatile_publishers(live, durability):
    node = FakeNode()
    profile = qos.ros_profile(replace(qos.LATCHED, durability=durability))
    ground = outputs.terrain_messages(TERRAIN, codec.header('map', START))
    for topic, message in ground.items():
        publisher = node._node.create_publisher(type(message), topic, profile)
        wait_until(publisher.get_subscription_count)
        publisher.publish(message)
    wait_until(lambda: live.poll() or (live._info is not None and live._elevation is not None))
    np.testing.assert_array_equal(live._elevation, TERRAIN.elevation.astype(np.float32))
    node.close()


def test_commands_reach_the_node_over_the_middleware(live):
    live.command('reset')
    assert live.answer == 'reset: no node answers'
    node = FakeNode()

    def wait(condition):
        wait_until(lambda: live.poll() or node.listen(0.0) or condition())

    wait(lambda: node.diagnostics.get_subscription_count() > 0)
    node.diagnostics.publish(status_message(1, 100.0))
    wait(lambda: live.facts(0) == {'simulation': 'running'})

    def is_asked():
        if live.answer != 'pause: asked':
            live.command('pause')
        return bool(node.received)

    wait(is_asked)
    wait(lambda: live.answer == 'pause: paused')
    live.command('resume')
    wait(lambda: node.received == [True, False])

    def is_clicked():
        live.open_vent(10.0, 20.0)
        return len(node.received) > 2

    wait(is_clicked)
    click = node.received[2]
    assert (click.header.frame_id, click.point.x, click.point.y) == ('map', 10.0, 20.0)
    node.close()
