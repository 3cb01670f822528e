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

"""A process that prints, as JSON, what a node publishes and subscribes to: types and QoS."""

import json
import sys
import time

import rclpy


def endpoints_of(looking, name):
    """Type, reliability and durability by kind and topic, as they are known now."""
    found = {'publishers': {}, 'subscriptions': {}}
    for topic, _ in looking.get_topic_names_and_types():
        for kind, infos in (
            ('publishers', looking.get_publishers_info_by_topic(topic)),
            ('subscriptions', looking.get_subscriptions_info_by_topic(topic)),
        ):
            for info in infos:
                if info.node_name == name:
                    found[kind][topic] = {
                        'type': info.topic_type,
                        'reliability': info.qos_profile.reliability.name,
                        'durability': info.qos_profile.durability.name,
                    }
    return found


def main():
    """Wait for the node, and until what it has has stopped changing."""
    rclpy.init()
    looking = rclpy.create_node('test_looking_at_endpoints')
    name, end = sys.argv[1], time.monotonic() + 60.0
    seen = []
    while len(seen) < 3 or not seen[-1]['publishers'] or seen[-1] != seen[-3]:
        assert time.monotonic() < end, f'nothing steady of {name}: {seen[-1:]}'
        time.sleep(0.5)
        seen.append(endpoints_of(looking, name))
    print(json.dumps(seen[-1]), flush=True)
    looking.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
