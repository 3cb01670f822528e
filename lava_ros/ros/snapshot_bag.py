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


"""Snapshots of a simulation that no node ran, as a bag: what `lava report` and players read."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import yaml

from lava_ros.bag import BagWriter
from lava_ros.layer_files import load_layers
from lava_ros.ros import codec, outputs, qos
from lava_ros.scene import Scene, scene_to_dict, Terrain
from lava_ros.share import share_path
from lava_ros.simulation.snapshot import Snapshot

#: ROS time of simulated time 0 [ns]: 2001-09-09T01:46:40Z, a round number that is a real time.
START_NS = 1_000_000_000 * 10**9

_NS = 1e9

#: How layers become messages.
_LAYERS = 'msg_configs/default.yaml'


def write_snapshots(
    directory: Path,
    scene: Scene,
    snapshots: Iterable[Snapshot],
    *,
    custom_data: Mapping[str, str],
    terrains: Iterable[tuple[float, Terrain]] = (),
) -> None:
    """Write a bag; its ROS time is simulated time.

    Args:
        directory: The bag, which does not exist yet.
        scene: The scene.
        snapshots: The maps, by time.
        custom_data: What describes the recording beside the scene, by name.
        terrains: Later grounds, each with the simulated time of its beginning [s].

    Raises:
        LavaError: The bag exists or cannot be created.
        OSError: The bag cannot be written.
    """
    layers = [layer for layer in load_layers(share_path(_LAYERS)) if layer.enabled]
    data = {
        'scene': yaml.safe_dump(scene_to_dict(scene), sort_keys=False),
        'msg_config': share_path(_LAYERS).read_text(encoding='utf-8'),
        'frame_id': 'map',
        **custom_data,
    }
    with BagWriter(directory, custom_data=data) as writer:

        def write(topic: str, message_type: str, message: Any, stamp_ns: int) -> None:
            profile = qos.bag_profile(qos.LATCHED)
            writer.write(
                f'/{topic}', message_type, codec.serialise(message), stamp_ns, qos=profile
            )

        def ground(terrain: Terrain, stamp_ns: int) -> None:
            image, info = outputs.terrain_messages(terrain, frame_id='map', stamp_ns=stamp_ns)
            write('terrain', 'sensor_msgs/msg/Image', image, stamp_ns)
            write('terrain_info', 'nav_msgs/msg/MapMetaData', info, stamp_ns)

        ground(scene.terrain, START_NS)
        later = list(terrains)
        rows: Any = None
        for snapshot in snapshots:
            stamp = START_NS + round(snapshot.time * _NS)
            while later and later[0][0] <= snapshot.time:
                time, terrain = later.pop(0)
                ground(terrain, START_NS + round(time * _NS))
            now = outputs.vent_rows(scene.vents, snapshot.time)
            if now != rows:
                cloud = outputs.vents_message(now, scene.terrain, frame_id='map', stamp_ns=stamp)
                write('vents', 'sensor_msgs/msg/PointCloud2', cloud, stamp)
                rows = now
            for layer in layers:
                message = outputs.layer_message(layer, snapshot, frame_id='map', stamp_ns=stamp)
                profile = qos.bag_profile(layer.qos)
                body = codec.serialise(message)
                writer.write(f'/{layer.topic}', layer.message, body, stamp, qos=profile)
            told = _told(snapshot, stamp)
            write('diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', told, stamp)


def _told(snapshot: Snapshot, stamp_ns: int) -> DiagnosticArray:
    """What a node says about its newest maps."""
    budget, steps = snapshot.budget, snapshot.steps
    values = {
        'simulated_time_s': repr(snapshot.time),
        'frame_stamp_ns': str(stamp_ns),
        'volume_emitted_m3': repr(budget.emitted),
        'volume_held_m3': repr(budget.held),
        'volume_pending_m3': repr(budget.pending),
        'volume_late_m3': repr(budget.late),
        'volume_left_m3': repr(budget.left),
        'volume_frozen_m3': repr(budget.frozen),
        'volume_error': f'{budget.error:.3e}',
        'particles': str(snapshot.particle_count),
        'steps': str(steps.count),
        'step_s': f'{steps.length:.6g}',
        'step_limit': steps.limit,
    }
    status = DiagnosticStatus(
        name='lava: simulation',
        message='finished',
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    return DiagnosticArray(header=codec.header('', stamp_ns), status=[status])
