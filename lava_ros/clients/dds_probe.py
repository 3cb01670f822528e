# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Round trip of a ROS message, run by ``lava check install`` in a separate process."""

import json
import os
import statistics
import sys
import time
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import get_rmw_implementation_identifier
from std_msgs.msg import String

from lava_ros.bag.qos import LATCHED
from lava_ros.ros.executor import start_ros
from lava_ros.ros.qos import ros_profile

#: Number of timed messages.
COUNT = 20

#: Maximum duration of the whole test [s].
PATIENCE = 20.0


def probe() -> dict[str, Any]:
    """Send latched messages between two nodes of this process.

    Returns:
        ``middleware``, time to the first message ``discovery_ms`` [ms], median time of a message
        ``trip_ms`` [ms] and number of other ``nodes`` in the graph; or only ``error``.
    """
    end = time.monotonic() + PATIENCE
    topic = f'lava_doctor_{os.getpid()}'
    executor = SingleThreadedExecutor()
    sender, receiver = (
        rclpy.create_node(f'{topic}_{part}', start_parameter_services=False)
        for part in ('sender', 'receiver')
    )
    received: list[str] = []
    for node in (sender, receiver):
        executor.add_node(node)

    def wait_for(text: str) -> bool:
        while text not in received and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        return text in received

    started = time.monotonic()
    publisher = sender.create_publisher(String, topic, ros_profile(LATCHED))
    # Publish before subscribing: a latched message must reach a late subscriber.
    publisher.publish(String(data='first'))
    receiver.create_subscription(
        String, topic, lambda message: received.append(message.data), ros_profile(LATCHED)
    )
    if not wait_for('first'):
        return {'error': f'a latched message did not arrive within {PATIENCE:g} s'}
    found = time.monotonic()
    trips = []
    for index in range(COUNT):
        sent = time.monotonic()
        publisher.publish(String(data=str(index)))
        if not wait_for(str(index)):
            return {'error': f'message {index} of {COUNT} did not arrive'}
        trips.append(time.monotonic() - sent)
    others = [name for name in sender.get_node_names() if not name.startswith(topic)]
    return {
        'middleware': get_rmw_implementation_identifier(),
        'discovery_ms': 1e3 * (found - started),
        'trip_ms': 1e3 * statistics.median(trips),
        'nodes': len(others),
    }


def main() -> int:
    """Print the results as one line of JSON."""
    start_ros()
    print(json.dumps(probe()), flush=True)
    rclpy.shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
