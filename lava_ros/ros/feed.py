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

"""A node that stands for the sensors: publishes a scene's terrain and vents as topics."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import MapMetaData
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2

from lava_ros.ros import outputs, qos
from lava_ros.scene import Scene


class SceneFeed(Node):
    """Publishes terrain once, latched, and the vents whenever they change or somebody joins.

    A discharge that changes with time follows the simulated time on ``/diagnostics``, which also
    say what the node has refused: whoever runs the feed does not see the node's log.
    """

    def __init__(self, scene: Scene, *, frame_id: str = 'map') -> None:
        """Create the publishers, and publish the terrain.

        The feed does not send the lava's constants; these are parameters of the simulation.
        """
        super().__init__('lava_feed')
        self._scene = scene
        self._frame_id = frame_id
        self._time = 0.0
        self._sent: list[tuple[float, ...]] | None = None
        self._readers = 0
        self._refusal = ''
        latched = qos.ros_profile(qos.LATCHED)
        # a latched publisher has to stay
        self._terrain = {
            'terrain': self.create_publisher(Image, 'terrain', latched),
            'terrain_info': self.create_publisher(MapMetaData, 'terrain_info', latched),
        }
        # who comes late gets them when published again: the node does not ask for old ones
        self._vents = self.create_publisher(PointCloud2, 'vents', qos.ros_profile(qos.COMMANDS))
        self.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.ros_profile(qos.DIAGNOSTICS)
        )
        messages = outputs.terrain_messages(
            scene.terrain, frame_id=frame_id, stamp_ns=self._stamp_ns()
        )
        for topic, message in messages.items():
            self._terrain[topic].publish(message)
        self.create_timer(0.2, self._publish_vents)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            # Other namespaces have eruptions of their own.
            node, _, _ = status.name.rpartition(': ')
            if node.rpartition('/')[0] != self.get_namespace().strip('/'):
                continue
            if status.name.endswith(': inputs'):
                self._tell_refusal(status)
            for item in status.values:
                if item.key == 'simulated_time_s':
                    self._time = float(item.value)

    def _tell_refusal(self, status: DiagnosticStatus) -> None:
        refusal = status.message if status.level == DiagnosticStatus.ERROR else ''
        if refusal and refusal != self._refusal:
            self.get_logger().error(f'{status.name}: {refusal}')
        self._refusal = refusal

    def _publish_vents(self) -> None:
        rows = outputs.vent_rows(self._scene.vents, self._time)
        readers = self._vents.get_subscription_count()
        if rows != self._sent or readers > self._readers:
            self._vents.publish(
                outputs.vents_message(
                    rows, self._scene.terrain, frame_id=self._frame_id, stamp_ns=self._stamp_ns()
                )
            )
            self._sent = rows
        self._readers = readers

    def _stamp_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)
