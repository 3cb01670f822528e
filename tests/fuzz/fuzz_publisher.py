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

"""A process that sends a node messages nobody means well with, and waits for an answer after each.

Arguments: seed, number of messages. Prints one JSON line: how many of each kind were sent, how
many of each topic can only be refused, and the longest time an answer took.
"""

from collections import Counter
from functools import partial
import itertools
import json
from pathlib import Path
import sys
import time

sys.path.insert(0, str(Path(__file__).parents[1]))

from rcl_interfaces.srv import GetParameters
import rclpy

from fuzz.messages import messages, TOPICS
from lava_ros.errors import LavaError
from lava_ros.ros import inputs
from lava_ros.ros.codec import decode
from lava_ros.ros.parameters import Settings
from ros import graph_publisher

RULES = Settings()

#: Time the node has for an answer [s].
PATIENCE = 60.0

CHECKS = {
    'terrain': inputs.check_image,
    'terrain_info': inputs.check_info,
    'terrain_cloud': inputs.terrain_from_cloud,
    'vents': inputs.vents_from_cloud,
    'clicked_point': partial(inputs.vent_from_point, name='click'),
}


def is_bad(item):
    """Whether a message is wrong by itself, whatever terrain there is."""
    # The middleware fills messages up to a multiple of four bytes.
    data = item.data + bytes(-len(item.data) % 4)
    try:
        message = decode(data, TOPICS[item.topic], item.topic, max_bytes=10**9)
        CHECKS[item.topic](message, RULES)
    except LavaError:
        return True
    return False


def main():
    """Send them all."""
    seed, count = int(sys.argv[1]), int(sys.argv[2])
    rclpy.init()
    node = rclpy.create_node('fuzz_publisher')
    publishers = {
        topic: node.create_publisher(kind, topic, graph_publisher.TYPES[topic][1])
        for topic, kind in TOPICS.items()
    }
    client = node.create_client(GetParameters, '/lava/get_parameters')
    assert client.wait_for_service(timeout_sec=PATIENCE)
    while any(item.get_subscription_count() == 0 for item in publishers.values()):
        rclpy.spin_once(node, timeout_sec=0.02)
    kinds, bad, longest = Counter(), Counter(), 0.0
    for item in itertools.islice(messages(seed), count):
        publishers[item.topic].publish(item.data)
        start = time.monotonic()
        future = client.call_async(GetParameters.Request(names=['time_scale']))
        rclpy.spin_until_future_complete(node, future, timeout_sec=PATIENCE)
        if not future.done():
            print(json.dumps({'silent_after': [item.topic, item.kind, item.data.hex()]}))
            sys.exit(1)
        longest = max(longest, time.monotonic() - start)
        kinds[item.kind] += 1
        bad[item.topic] += is_bad(item)
    print(json.dumps({'kinds': kinds, 'bad': bad, 'longest_answer': longest}), flush=True)
    # What was sent last is still on its way.
    time.sleep(1.0)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
