# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Masks and hazard of a paused node and of a killed node."""

import signal

from nav_msgs.msg import OccupancyGrid
import numpy as np
import pytest
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from ros_domain import own_domain
from waiting import wait_until

CONFIG = """
layers:
  keepout_mask:
    {source: hazard, message: nav_msgs/OccupancyGrid, step: 1.0, heartbeat: 1.0, outside: 100}
  hazard: {source: hazard, message: nav_msgs/OccupancyGrid, heartbeat: 1.0}
"""


class Robot:
    """A subscriber that requests the deadline and the liveliness of the heartbeat."""

    def __init__(self):
        self.context = Context()
        self.context.init(domain_id=own_domain('graph'))
        self.node = Node('test_robot', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.received, self.missed, self.alive = {}, {}, {}
        for topic in ('keepout_mask', 'hazard'):
            self._subscribe(topic)

    def _subscribe(self, topic):
        self.received[topic], self.missed[topic], self.alive[topic] = [], 0, 0

        def miss(event):
            self.missed[topic] = event.total_count

        def change(event):
            self.alive[topic] = event.alive_count

        asked = QoSProfile(
            depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, deadline=Duration(seconds=2),
            liveliness_lease_duration=Duration(seconds=2),
        )
        events = SubscriptionEventCallbacks(deadline=miss, liveliness=change)
        self.node.create_subscription(
            OccupancyGrid, topic, self.received[topic].append, asked, event_callbacks=events
        )

    def wait(self, condition):
        def is_so():
            self.executor.spin_once(timeout_sec=0.1)
            return condition()

        wait_until(is_so, lambda: (self.missed, self.alive), pause=0.0)

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def robot():
    result = Robot()
    yield result
    result.close()


def test_killed_node_misses_its_deadline(graph, tmp_path, robot):
    """A paused node repeats its maps with their stamps."""
    terrain, config = tmp_path / 'slope.npz', tmp_path / 'layers.yaml'
    _, x = np.mgrid[0:30, 0:40]
    np.savez(terrain, elevation=(300.0 - x).astype(np.float32), resolution=10.0)
    config.write_text(CONFIG, encoding='utf-8')
    node = graph.node(
        device='cpu', terrain_file=str(terrain), msg_config=str(config), end_time=0.001
    )
    topics = robot.received
    robot.wait(lambda: all(len(received) > 3 for received in topics.values()))
    for received in topics.values():
        assert received[-1].header.stamp == received[-2].header.stamp
        assert received[-1].data == received[-2].data
    assert set(robot.alive.values()) == {1}
    node.end(signal.SIGKILL)
    before = dict(robot.missed)
    robot.wait(lambda: set(robot.alive.values()) == {0})
    robot.wait(lambda: all(robot.missed[topic] > before[topic] for topic in topics))
