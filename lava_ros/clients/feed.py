# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A feed of the topics of terrain and vents, in place of sensors."""

from dataclasses import replace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import MapMetaData
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.executor import now_ns
from lava_ros.scene import Scene


class SceneFeed(Node):
    """Publishes terrain and vents, latched, when they change.

    Effusion rates and terrain events follow the simulated time on ``/diagnostics``. Inputs that
    the node refuses are logged here too, for a user of the feed who does not see the node's log.
    The constants of the lava are parameters of the node and are not published.
    """

    def __init__(
        self, scene: Scene, *, frame_id: str = 'map', has_vents: bool = True
    ) -> None:
        """Create the publishers, and publish the terrain; ``has_vents`` adds the vents."""
        super().__init__('lava_feed')
        self._scene = scene
        self._frame_id = frame_id
        self._time = 0.0
        self._sent: list[tuple[float, ...]] | None = None
        self._refusal = ''
        latched = qos.ros_profile(qos.LATCHED)
        # a latched publisher has to stay
        self._terrain = {
            'terrain': self.create_publisher(Image, 'terrain', latched),
            'terrain_info': self.create_publisher(MapMetaData, 'terrain_info', latched),
        }
        self.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.ros_profile(qos.DIAGNOSTICS)
        )
        self._publish_terrain()
        self.create_timer(0.2, self._follow_events)
        if has_vents:
            self._vents = self.create_publisher(PointCloud2, 'vents', latched)
            self.create_timer(0.2, self._publish_vents)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            # a node in another namespace simulates another eruption
            node, _, task = status.name.rpartition(': ')
            if node.rpartition('/')[0] != self.get_namespace().strip('/'):
                continue
            if task == 'inputs':
                refusal = status.message if status.level == DiagnosticStatus.ERROR else ''
                if refusal and refusal != self._refusal:
                    self.get_logger().error(f'{status.name}: {refusal}')
                self._refusal = refusal
            for item in status.values:
                if item.key == 'simulated_time_s':
                    self._time = float(item.value)

    def _header(self) -> Header:
        return codec.header(self._frame_id, now_ns(self))

    def _publish_terrain(self) -> None:
        messages = outputs.terrain_messages(self._scene.terrain, self._header())
        for topic, message in messages.items():
            self._terrain[topic].publish(message)

    def _follow_events(self) -> None:
        while self._scene.events and self._scene.events[0].time <= self._time:
            event, *later = self._scene.events
            ground = event.ground(self._scene.terrain)
            self._scene = replace(self._scene, terrain=ground, events=tuple(later))
            self.get_logger().info(f'at {self._time:.0f} s: {event.text}')
            self._publish_terrain()

    def _publish_vents(self) -> None:
        terrain, rows = self._scene.terrain, outputs.vent_rows(self._scene.vents, self._time)
        if rows != self._sent:
            self._vents.publish(outputs.vents_message(rows, terrain, self._header()))
            self._sent = rows
