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

"""What a bag tells of the scene: terrain, vents and a description, ahead of the layers."""

from collections.abc import Callable, Mapping
import json
from typing import Any

from rclpy.node import Node
import yaml

import lava_ros
from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.effect_table import is_on
from lava_ros.ros.eruption import Origin
from lava_ros.ros.recorder import Recorder
from lava_ros.scene import Scene, scene_to_dict, Terrain
from lava_ros.simulation.snapshot import Snapshot

#: ROS time after which terrain and vents are written again [ns]: players that start in the middle
#: of a bag pass over what is latched from before.
REPEAT_PERIOD_NS = 60 * 10**9


class SceneRecording:
    """Opens an armed bag, and writes terrain and vents into it whenever they have changed.

    They are written again from time to time, though never so often that they are most of the bag.
    What describes the bag is replaced when the scene changes, all but the effects: their list has
    one entry for the start and one for each time that some went on or off, in JSON. A bag that
    begins in the middle of an eruption names the checkpoint it has gone on from, in JSON.
    """

    def __init__(
        self,
        node: Node,
        recorder: Recorder,
        *,
        frame_id: str,
        msg_config: str,
        parameters: Callable[[], Mapping[str, Any]],
        forecast_config: str = '',
    ) -> None:
        """Write nothing yet.

        Args:
            node: The node whose names the topics have.
            recorder: The bag.
            frame_id: Frame of the messages.
            msg_config: Text of the file that says how layers become messages.
            parameters: Gives the node's parameters by name.
            forecast_config: That for the layers of forecasts, empty without forecasts.
        """
        self._node = node
        self._recorder = recorder
        self._frame_id = frame_id
        self._configs = {'msg_config': msg_config}
        if forecast_config:
            self._configs['forecast_config'] = forecast_config
        self._parameters = parameters
        self._scene: Scene | None = None
        self._origin: Origin | None = None
        self._terrain: Terrain | None = None
        self._vents: list[tuple[float, ...]] | None = None
        self._told_ns = self._told_size = 0
        self._effects: dict[str, str] = {}
        self._history: list[dict[str, Any]] = []

    def write(
        self,
        scene: Scene,
        snapshot: Snapshot,
        stamp_ns: int,
        *,
        effects: Mapping[str, str],
        origin: Origin | None,
        device: str,
    ) -> None:
        """Write what has changed since the last time.

        Args:
            scene: The scene in use.
            snapshot: The snapshot about to be published.
            stamp_ns: Its ROS time [ns].
            effects: The table of effects (``effect_table``).
            origin: The checkpoint that the simulation has gone on from.
            device: Name of the simulation's device.
        """
        if not (self._recorder.is_armed or self._recorder.is_recording):
            return
        if self._recorder.is_armed:
            self._effects, self._history, self._origin = {}, [], origin
            self._note_effects(effects, snapshot, stamp_ns)
            self._recorder.begin(self._description(scene, device))
            self._scene = scene
            self._terrain = self._vents = None
        if self._note_effects(effects, snapshot, stamp_ns) or scene is not self._scene:
            self._recorder.describe(self._description(scene, device))
            self._scene = scene
        if self._is_to_repeat(snapshot.terrain, stamp_ns):
            self._terrain = self._vents = None
        if snapshot.terrain is not self._terrain:
            image, info = outputs.terrain_messages(
                snapshot.terrain, frame_id=self._frame_id, stamp_ns=stamp_ns
            )
            self._write('terrain', 'sensor_msgs/msg/Image', image, stamp_ns)
            self._write('terrain_info', 'nav_msgs/msg/MapMetaData', info, stamp_ns)
            self._terrain = snapshot.terrain
            self._told_ns, self._told_size = stamp_ns, self._recorder.size
        rows = outputs.vent_rows(scene.vents, snapshot.time)
        if rows != self._vents:
            cloud = outputs.vents_message(
                rows, scene.terrain, frame_id=self._frame_id, stamp_ns=stamp_ns
            )
            self._write('vents', 'sensor_msgs/msg/PointCloud2', cloud, stamp_ns)
            self._vents = rows

    def _is_to_repeat(self, terrain: Terrain, stamp_ns: int) -> bool:
        grown = self._recorder.size - self._told_size
        is_late = stamp_ns - self._told_ns >= REPEAT_PERIOD_NS
        # what it has grown by begins with the terrain itself
        return is_late and grown >= 2 * terrain.elevation.nbytes

    def _note_effects(
        self, effects: Mapping[str, str], snapshot: Snapshot, stamp_ns: int
    ) -> bool:
        """Add what has gone on or off to the list; the first entry has all of the table.

        Returns:
            Whether there was anything.
        """
        changed = {
            name: text
            for name, text in effects.items()
            if name not in self._effects or is_on(text) != is_on(self._effects[name])
        }
        self._effects.update(changed)
        if changed:
            entry = {'stamp_ns': stamp_ns, 'time': snapshot.time, 'effects': changed}
            self._history.append(entry)
        return bool(changed)

    def _write(self, topic: str, message_type: str, message: Any, stamp_ns: int) -> None:
        self._recorder.write(
            self._node.resolve_topic_name(topic),
            message_type,
            codec.serialise(message),
            stamp_ns,
            qos=qos.bag_profile(qos.LATCHED),
        )

    def _description(self, scene: Scene, device: str) -> dict[str, str]:
        resumed = {'resumed_from': json.dumps(self._origin._asdict())} if self._origin else {}
        return {
            'scene': yaml.safe_dump(scene_to_dict(scene), sort_keys=False),
            'parameters': yaml.safe_dump(dict(self._parameters()), sort_keys=False),
            'effects': json.dumps(self._history),
            **resumed,
            **self._configs,
            'version': lava_ros.__version__,
            'device': device,
        }
