# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Masks and hazard of a paused node and of a killed node."""

import signal

from nav_msgs.msg import OccupancyGrid
import numpy as np
import pytest
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile

CONFIG = """
layers:
  keepout_mask:
    {source: hazard, message: nav_msgs/OccupancyGrid, step: 1.0, heartbeat: 1.0, outside: 100}
  hazard: {source: hazard, message: nav_msgs/OccupancyGrid, heartbeat: 1.0}
"""


@pytest.mark.nightly
def test_killed_node_misses_its_deadline(graph, tmp_path):
    """A paused node repeats its maps with their stamps."""
    terrain, config = tmp_path / 'slope.npz', tmp_path / 'layers.yaml'
    _, x = np.mgrid[0:30, 0:40]
    np.savez(terrain, elevation=(300.0 - x).astype(np.float32), resolution=10.0)
    config.write_text(CONFIG, encoding='utf-8')
    node = graph.node(
        device='cpu', terrain_file=str(terrain), msg_config=str(config), end_time=0.001
    )
    robot, topics = graph.publisher(), ('keepout_mask', 'hazard')
    received = {topic: [] for topic in topics}
    missed, alive = dict.fromkeys(topics, 0), {}
    asked = QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, deadline=Duration(seconds=2),
        liveliness_lease_duration=Duration(seconds=2),
    )
    for topic in topics:
        events = SubscriptionEventCallbacks(
            deadline=lambda event, topic=topic: missed.update({topic: event.total_count}),
            liveliness=lambda event, topic=topic: alive.update({topic: event.alive_count}),
        )
        robot.node.create_subscription(
            OccupancyGrid, topic, received[topic].append, asked, event_callbacks=events
        )
    robot.spin_until(lambda: all(len(maps) > 3 for maps in received.values()))
    for maps in received.values():
        assert maps[-1].header.stamp == maps[-2].header.stamp
        assert maps[-1].data == maps[-2].data
    assert set(alive.values()) == {1}
    node.end(signal.SIGKILL)
    before = dict(missed)
    robot.spin_until(lambda: set(alive.values()) == {0})
    robot.spin_until(lambda: all(missed[topic] > before[topic] for topic in topics))
