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

"""A process that prints, as JSON, the names a node has in the graph: topics and services."""

import json
import sys
import time

import rclpy

KINDS = ('publisher', 'subscriber', 'service', 'client')


def names_of(looking, name):
    """Names by kind, as they are known now."""
    return {
        kind: sorted(
            topic
            for topic, _ in getattr(looking, f'get_{kind}_names_and_types_by_node')(name, '/')
        )
        for kind in KINDS
    }


def main():
    """Wait for the node, and until its names have stopped changing."""
    rclpy.init()
    looking = rclpy.create_node('test_looking')
    name, end = sys.argv[1], time.monotonic() + 30.0
    while name not in looking.get_node_names():
        assert time.monotonic() < end, f'no node {name}'
        time.sleep(0.1)
    seen = [None, None, None]
    while seen[0] is None or seen[0] != seen[-1]:
        time.sleep(1.0)
        seen = [*seen[1:], names_of(looking, name)]
        assert time.monotonic() < end, f'names keep changing: {seen}'
    print(json.dumps(seen[-1]), flush=True)
    looking.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
