# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Publication of layers: when, with which stamp and with which QoS."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from nav_msgs.msg import OccupancyGrid
import numpy as np
import pytest
from rclpy.clock import ClockType
from rclpy.serialization import deserialize_message

from lava_ros.bag import BagReader
from lava_ros.errors import LavaError
from lava_ros.layers.layer_files import load_layers
from lava_ros.live.recorder import Recorder
from lava_ros.ros import codec, outputs
from lava_ros.ros.node_graph import NodeGraph
from lava_ros.ros.parameters import PARAMETERS, Settings
from lava_ros.ros.publishers import LayerPublishers, published_layers
from lava_ros.scene import Terrain
from recording import snapshot_at

CONFIGS = Path(__file__).parents[2] / 'msg_configs'


class _Timer:
    """A timer of ROS on the steady time of ``world`` [s]: late calls do not delay the next one."""

    def __init__(self, world, period, callback):
        self._world, self.period, self.call = world, period, callback
        self.reset()

    def reset(self):
        self.next = self._world.now + self.period


class _Published:
    """Publishers of the layers of a file, their QoS and messages, and a steady clock."""

    def __init__(self, file, recorder=None):
        self.sent, self.profiles, self.now, self.timers = [], {}, 100.0, []
        self.heartbeat_ns = 99 * 10**9
        graph = NodeGraph(None, 'map')
        graph.create, graph.recorder = self._create, recorder or graph.recorder
        self.layers = [layer for layer in load_layers(CONFIGS / file) if layer.enabled]
        self.publishers = LayerPublishers(graph, self.layers, lambda: self.heartbeat_ns)

    def _create(self, kind, *arguments, clock=None, field=''):
        if kind == 'timer':
            assert clock.clock_type is ClockType.STEADY_TIME
            self.timers.append(_Timer(self, *arguments))
            return self.timers[-1]
        _, topic, profile = arguments
        self.profiles[topic] = profile
        return SimpleNamespace(
            publish=lambda data: self.sent.append((topic, bytes(data))), topic_name=f'/{topic}'
        )

    def advance(self, seconds):
        """Advance the clock, and call the timers that are due; return the times of each topic."""
        end, times = self.now + seconds, {}
        while (timer := min(self.timers, key=lambda timer: timer.next)).next <= end + 1e-9:
            self.now = timer.next
            timer.next += timer.period
            count = len(self.sent)
            timer.call()
            for topic, _ in self.sent[count:]:
                times.setdefault(topic, []).append(self.now)
        self.now = end
        return times


def _small_flow():
    thickness = np.zeros((20, 30), dtype=np.float32)
    thickness[10, 10] = 1.0
    return snapshot_at(1.0, thickness, Terrain(np.zeros((20, 30)), 10.0)), thickness


def test_grid_is_padded_to_its_minimum_size():
    (layer,) = (
        item for item in load_layers(CONFIGS / 'nav2_keepout.yaml') if item.name == 'keepout_mask'
    )
    snapshot, _ = _small_flow()
    plain, wide, high = (
        outputs.layer_message(
            replace(layer, min_cells=count), snapshot, codec.header('map', 1)
        )
        for count in (0, 41, 25)
    )
    for message, shape, corner in ((wide, (41, 41), (5, 10)), (high, (25, 30), (0, 2))):
        info = message.info
        assert (info.height, info.width, info.resolution) == (*shape, 10.0)
        column, row = corner
        origin = info.origin.position
        assert (origin.x, origin.y) == (-10.0 * column, -10.0 * row)
        cells = np.array(message.data).reshape(shape)
        within = cells[row : row + 20, column : column + 30]
        np.testing.assert_array_equal(within.ravel(), plain.data)
        assert (cells == -1).sum() == cells.size - 600


def test_repeated_map_has_the_stamp_of_its_state(tmp_path):
    recorder = Recorder()
    recorder.arm(tmp_path / 'bag')
    recorder.describe({})
    world = _Published('nav2_speed.yaml', recorder)
    first, _ = _small_flow()

    def stamps(send):
        world.sent.clear()
        send()
        return {
            topic: deserialize_message(data, OccupancyGrid).header.stamp.sec
            for topic, data in world.sent
        }

    def publish(snapshot, second, *, repeat=False):
        world.publishers.publish(snapshot, second * 10**9, also_not_due=True, repeat=repeat)

    masks = {'keepout_mask', 'padded_keepout_mask', 'speed_mask'}
    topics = masks | {'hazard'}
    assert stamps(lambda: world.advance(20.0)) == {}
    assert stamps(lambda: publish(first, 1)) == dict.fromkeys(topics, 1)
    assert stamps(lambda: world.advance(4.0)) == {'keepout_mask': 1}
    # unchanged masks are not sent, but their heartbeat has the time of the newest map
    assert stamps(lambda: publish(replace(first, time=2.0), 2)) == {'hazard': 2}
    assert stamps(lambda: world.advance(1.0)) == dict.fromkeys(masks, 2)
    assert stamps(lambda: world.advance(4.0)) == {'hazard': 2, 'keepout_mask': 2}
    assert stamps(lambda: world.advance(1.0)) == dict.fromkeys(masks, 2)
    # so has a repeated map, unless the clock went back
    second = world.publishers.shown
    for now, stamp in ((9, 2), (1, 1), (3, 1)):
        repeated = stamps(lambda now=now: publish(second, now, repeat=True))
        assert repeated == dict.fromkeys(topics, stamp)
    recorder.stop()
    recorded = [message.topic for message in BagReader(tmp_path / 'bag').messages()]
    assert {topic: recorded.count(f'/{topic}') for topic in topics} == dict.fromkeys(topics, 5)


def test_heartbeat_after_the_clock_went_back_is_not_from_the_future():
    world = _Published('nav2_speed.yaml')
    snapshot, _ = _small_flow()
    world.publishers.publish(snapshot, 50 * 10**9, also_not_due=True, repeat=False)

    def stamps():
        return {
            (topic, deserialize_message(data, OccupancyGrid).header.stamp.sec)
            for topic, data in world.sent
        }

    topics = {layer.topic for layer in world.layers}
    assert stamps() == {(topic, 50) for topic in topics}
    # the maps of a paused simulation keep the stamp of the first heartbeat after the jump
    for now in (20, 30):
        world.sent.clear()
        world.heartbeat_ns = now * 10**9
        world.advance(6.0)
        assert stamps() == {(topic, 20) for topic in topics}
    assert world.publishers.shown_stamp_ns == 20 * 10**9


@pytest.mark.parametrize('is_at_rest', [True, False])
def test_maps_without_a_heartbeat_follow_the_clock_back_at_rest(is_at_rest):
    """A simulation that runs soon has a new map, and the same one twice would be in its bag."""
    world = _Published('nav2_speed.yaml')
    snapshot, _ = _small_flow()
    world.publishers.publish(snapshot, 50 * 10**9, also_not_due=True, repeat=False)
    world.sent.clear()
    for now in (20, 30):
        world.publishers.publish(snapshot, now * 10**9, also_not_due=is_at_rest, repeat=False)
    stamps = [
        (topic, deserialize_message(data, OccupancyGrid).header.stamp.sec)
        for topic, data in world.sent
    ]
    expected = [(layer.topic, 20) for layer in world.layers] if is_at_rest else []
    assert sorted(stamps) == sorted(expected)


@pytest.mark.parametrize('phase', [0.0, 0.3, 1.9])
def test_heartbeat_is_never_late(phase):
    """No gap is longer than the heartbeat, whenever the map was published before."""
    world = _Published('nav2_speed.yaml')
    snapshot, thickness = _small_flow()
    world.publishers.publish(snapshot, 10**9, also_not_due=True, repeat=False)
    start = world.now
    before = world.advance(phase)
    wider = thickness.copy()
    wider[10, 11] = 1.0
    changed = replace(snapshot, time=2.0, thickness=wider)
    world.publishers.publish(changed, 2 * 10**9, also_not_due=True, repeat=False)
    after = world.advance(20.0)
    for layer in world.layers:
        times = [start, *before.get(layer.topic, ()), start + phase, *after[layer.topic]]
        assert np.diff(times).max() <= layer.heartbeat + 1e-6, layer.topic
        assert np.diff(after[layer.topic]).min() >= layer.heartbeat - 1e-6, layer.topic
    # a node that is not active, or whose state is old, repeats nothing
    world.heartbeat_ns = None
    assert world.advance(20.0) == {}


def test_qos_has_twice_the_heartbeat_as_deadline_and_lease():
    for file in ('default.yaml', 'nav2_speed.yaml'):
        world = _Published(file)
        for layer in world.layers:
            profile, twice = world.profiles[layer.topic], round(2e9 * layer.heartbeat)
            promised = profile.deadline.nanoseconds, profile.liveliness_lease_duration.nanoseconds
            assert promised == (twice, twice), layer.name


def test_parameter_replaces_the_margin_of_keepout_masks():
    file = CONFIGS / 'nav2_speed.yaml'
    spec = next(spec for spec in PARAMETERS if spec.name == 'mask_margin')
    usual, none, wide = (
        {
            layer.name: layer.margin
            for layer in published_layers(file, settings=Settings(mask_margin=spec.setting(value)))
        }
        for value in (spec.default, 0.0, 55.0)
    )
    keepout = {'keepout_mask', 'padded_keepout_mask'}
    assert usual == {'hazard': 0.0, 'speed_mask': 100.0, **dict.fromkeys(keepout, 20.0)}
    assert none == {**usual, **dict.fromkeys(keepout, 0.0)}
    assert wide == {**usual, **dict.fromkeys(keepout, 55.0)}
    for margin in (0.0, 55.0):
        with pytest.raises(LavaError, match=f'mask_margin is {margin}, expected -1 unless'):
            published_layers(CONFIGS / 'default.yaml', settings=Settings(mask_margin=margin))


def test_masks_are_sent_only_when_they_change():
    world = _Published('nav2_speed.yaml')
    publishers, sent = world.publishers, world.sent
    first, thickness = _small_flow()

    def topics(snapshot, *, repeat=False):
        sent.clear()
        publishers.publish(snapshot, 10**9, also_not_due=True, repeat=repeat)
        return {topic for topic, _ in sent}

    masks = {'keepout_mask', 'padded_keepout_mask', 'speed_mask'}
    assert topics(first) == masks | {'hazard'}
    assert topics(replace(first, time=2.0)) == {'hazard'}
    further = thickness.copy()
    further[10, 11] = 1.0
    second = replace(first, time=3.0, thickness=further)
    assert topics(second) == masks | {'hazard'}
    # a new bag, or an activated node, gets all of them
    assert topics(second, repeat=True) == masks | {'hazard'}
    elsewhere = Terrain(np.zeros((20, 30)), 10.0, (5.0, 5.0))
    assert topics(replace(second, time=4.0, terrain=elsewhere)) == masks | {'hazard'}
