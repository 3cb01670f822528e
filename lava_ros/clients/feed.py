# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A node that publishes terrain and vents in place of sensors."""

from dataclasses import replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from lava_ros.bag.georeference import TOPIC
from lava_ros.layers.messages import vent_rows
from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.executor import now_ns
from lava_ros.ros.georeference import georeference_message, static_transform, TF_STATIC
from lava_ros.scene import Scene


class SceneFeed(Node):
    """Publishes terrain and vents, latched, when they change.

    Effusion rates and terrain events follow the simulated time on ``/diagnostics``, also where it
    goes back: at a reset, and at the restart of a killed node. Inputs that
    the node refuses are logged here too, for a user of the feed who does not see the node's log.
    The constants of the lava are parameters of the node and are not published.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        frame_id: str = 'map',
        has_vents: bool = True,
        publish_tf: bool = True,
    ) -> None:
        """Create the publishers, and publish the terrain.

        ``has_vents`` adds the vents, ``publish_tf`` the static transform to ``frame_id``.
        """
        super().__init__('lava_feed')
        self._given = self._scene = scene
        self._frame_id = frame_id
        self._time = self._shown = 0.0
        self._sent: list[tuple[float, ...]] | None = None
        self._refusal = ''
        latched = qos.ros_profile(qos.LATCHED)
        self._transform = static_transform(is_wanted=publish_tf)
        # a latched publisher has to remain alive
        self._terrain: dict[str, Publisher] = {}
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
            values = {item.key: item.value for item in status.values}
            if 'simulated_time_s' in values:
                keys = ('simulated_time_s', 'age_s', 'max_age_s')
                self._note_time(*(float(values.get(key, 0.0)) for key in keys))

    def _note_time(self, shown: float, age: float, max_age: float) -> None:
        """Follow the simulated time of the maps, and that of the clock unless they are stale [s].

        A change ends the current step at the time of the clock.
        """
        if shown < self._shown:
            self._time = shown
        self._shown, ahead = shown, age if age <= max_age else 0.0
        self._time = max(self._time, shown + ahead)

    def _header(self) -> Header:
        return codec.header(self._frame_id, now_ns(self))

    def _publish_terrain(self) -> None:
        terrain, header = self._scene.terrain, self._header()
        messages: dict[str, Any] = {TOPIC: georeference_message(terrain.georeference, header)}
        messages |= outputs.terrain_messages(terrain, header)
        if self._transform and (transforms := self._transform.update(terrain, header)):
            messages[TF_STATIC] = transforms
        if self._transform and self._transform.problem:
            self.get_logger().warning(self._transform.problem)
        for topic, message in messages.items():
            if topic not in self._terrain:
                latched = qos.ros_profile(qos.LATCHED)
                self._terrain[topic] = self.create_publisher(type(message), topic, latched)
            self._terrain[topic].publish(message)

    def _follow_events(self) -> None:
        passed = self._given.events[: len(self._given.events) - len(self._scene.events)]
        if passed and self._time < passed[-1].time:
            self._scene = self._given
            self.get_logger().info(f'simulated time is {self._time:.0f} s again: first terrain')
            self._publish_terrain()
        while self._scene.events and self._scene.events[0].time <= self._time:
            event, *later = self._scene.events
            ground = event.ground(self._scene.terrain)
            self._scene = replace(self._scene, terrain=ground, events=tuple(later))
            self.get_logger().info(f'at {self._time:.0f} s: {event.text}')
            self._publish_terrain()

    def _publish_vents(self) -> None:
        terrain, rows = self._scene.terrain, vent_rows(self._scene.vents, self._time)
        if rows != self._sent:
            self._vents.publish(outputs.vents_message(rows, terrain, self._header()))
            self._sent = rows
