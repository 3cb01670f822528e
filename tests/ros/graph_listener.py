# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A process that subscribes to the node's topics and prints a JSON line for each message.

Arguments: topic names, with the suffix ``:image``, ``:cloud``, ``:markers`` or ``:georeference``
for other types.
"""

import hashlib
import json
import sys

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import OccupancyGrid
import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

#: Types of message by suffix of a topic's name.
KINDS = {
    '': OccupancyGrid, 'image': Image, 'cloud': PointCloud2, 'markers': MarkerArray,
    'georeference': TransformStamped,
}


def line_of(topic, kind, data):
    message = deserialize_message(data, kind)
    # the first marker clears the earlier ones
    header = message.markers[0].header if kind is MarkerArray else message.header
    stamp = header.stamp
    line = {
        'topic': topic, 'stamp_ns': stamp.sec * 10**9 + stamp.nanosec, 'frame_id': header.frame_id,
    }
    if kind is OccupancyGrid:
        values = np.frombuffer(message.data, np.int8)
        line['shape'] = [message.info.height, message.info.width]
        line['resolution'] = message.info.resolution
        line['origin'] = [message.info.origin.position.x, message.info.origin.position.y]
        line['min'], line['max'] = int(values.min()), int(values.max())
        line['wet'] = int((values > 0).sum())
        # not of all bytes: the padding between fields is arbitrary
        line['cells'] = hashlib.sha256(message.data).hexdigest()
    elif kind is Image:
        values = np.frombuffer(message.data, np.float32)
        line['shape'], line['encoding'] = [message.height, message.width], message.encoding
        line['max'] = float(np.fmax.reduce(values))
    elif kind is PointCloud2:
        names = [field.name for field in message.fields]
        values = np.frombuffer(message.data, np.float32).reshape(-1, len(names))
        line['points'] = message.width
        line['mean'] = {
            name: float(values[:, index].mean()) if message.width else 0.0
            for index, name in enumerate(names)
        }
    elif kind is TransformStamped:
        place = message.transform.translation
        line['system'], line['offset'] = message.header.frame_id, [place.x, place.y]
    elif kind is MarkerArray:
        line['markers'] = [
            {'action': item.action, 'text': item.text, 'z': item.pose.position.z}
            for item in message.markers
        ]
    else:
        line['status'] = {
            item.name: {
                'level': item.level[0],
                'message': item.message,
                **{pair.key: pair.value for pair in item.values},
            }
            for item in message.status
        }
    return line


def main():
    """Print messages until the process is terminated."""
    rclpy.init()
    node = rclpy.create_node('test_listener')
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

    def show(topic, kind):
        def take(data):
            print(json.dumps(line_of(topic, kind, data)), flush=True)

        return take

    for word in sys.argv[1:]:
        topic, _, kind = word.partition(':')
        kind = KINDS[kind]
        node.create_subscription(kind, topic, show(topic, kind), latched, raw=True)
    node.create_subscription(
        DiagnosticArray, '/diagnostics', show('diagnostics', DiagnosticArray), 10, raw=True
    )
    rclpy.spin(node)


if __name__ == '__main__':
    try:
        main()
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        sys.exit(0)
