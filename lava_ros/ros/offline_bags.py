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

"""Maps of an ensemble, and snapshots, that no node published, as bags."""

from collections.abc import Iterable, Mapping
from pathlib import Path
import shutil
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np
import yaml

import lava_ros
from lava_ros.bag import BagWriter, LATCHED
from lava_ros.errors import LavaError
from lava_ros.files.resources import share_path
from lava_ros.forecast.members import Plan
from lava_ros.maps.forecast import HazardMaps, occupancy
from lava_ros.maps.layer_files import load_layers
from lava_ros.maps.layers import ARRIVED, IMAGE, OCCUPANCY_GRID
from lava_ros.ros import codec, outputs, qos
from lava_ros.scene import Scene, scene_to_dict, Terrain
from lava_ros.simulation.snapshot import Snapshot

#: Namespace of the topics.
NAMESPACE = '/lava'


def write_atlas_bag(
    directory: Path,
    maps: HazardMaps,
    plan: Plan,
    *,
    stamp_ns: int,
    custom_data: Mapping[str, str],
    frame_id: str = 'map',
) -> None:
    """Write terrain, vents and maps; a bag of this name that is there is replaced.

    Args:
        directory: The bag.
        maps: The maps.
        plan: What they are of.
        stamp_ns: Time of all messages [ns].
        custom_data: What describes the bag, beside its scene.
        frame_id: Frame of the messages.

    Raises:
        LavaError: The bag cannot be written.
    """
    description = {
        'scene': yaml.safe_dump(scene_to_dict(plan.scene), sort_keys=False),
        'version': lava_ros.__version__,
        **custom_data,
    }
    try:
        if directory.exists():
            shutil.rmtree(directory)
        with BagWriter(directory, custom_data=description) as bag:
            for name, (message_type, message) in _messages(maps, plan, frame_id, stamp_ns).items():
                data = codec.serialise(message)
                bag.write(f'{NAMESPACE}/{name}', message_type, data, stamp_ns, qos=LATCHED)
    except OSError as error:
        raise LavaError('bag', str(directory), f'a bag that can be written ({error})') from error


def _messages(
    maps: HazardMaps, plan: Plan, frame_id: str, stamp_ns: int
) -> dict[str, tuple[str, Any]]:
    """Messages and their types by topic."""
    terrain = plan.scene.terrain
    image, info = outputs.terrain_messages(terrain, frame_id=frame_id, stamp_ns=stamp_ns)
    vents = outputs.vents_message(
        outputs.vent_rows(plan.scene.vents, 0.0), terrain, frame_id=frame_id, stamp_ns=stamp_ns
    )
    return {
        'terrain': (IMAGE, image),
        'terrain_info': ('nav_msgs/msg/MapMetaData', info),
        'vents': ('sensor_msgs/msg/PointCloud2', vents),
        **probability_messages(maps, terrain, frame_id=frame_id, stamp_ns=stamp_ns),
    }


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
            profile = qos.LATCHED
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
                if layer.source == ARRIVED and snapshot.arrived is None:
                    continue
                message = outputs.layer_message(layer, snapshot, frame_id='map', stamp_ns=stamp)
                profile = layer.qos
                body = codec.serialise(message)
                writer.write(f'/{layer.topic}', layer.message, body, stamp, qos=profile)
            told = _told(snapshot, stamp)
            write('diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', told, stamp)


def _told(snapshot: Snapshot, stamp_ns: int) -> DiagnosticArray:
    """What a node says about its newest maps."""
    steps = snapshot.steps
    values = {
        'simulated_time_s': repr(snapshot.time),
        'frame_stamp_ns': str(stamp_ns),
        **snapshot.budget.texts(),
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


#: Arrival where nothing is known.
UNKNOWN = -1.0


def probability_messages(
    maps: HazardMaps, terrain: Terrain, *, frame_id: str, stamp_ns: int
) -> dict[str, tuple[str, Any]]:
    """Make the messages of an ensemble.

    Args:
        maps: The maps.
        terrain: The ground they belong to.
        frame_id: Frame of the messages.
        stamp_ns: Time from which on the maps look ahead [ns].

    Returns:
        Type and message by relative topic: ``inundation_probability`` as an occupancy grid, and as
        32FC1 images ``expected_thickness`` [m] and ``arrival_time_p10``, ``_p50``, ``_p90``: the
        time [s] by which so many per cent of the members had lava, NaN where fewer had any and -1
        where nothing is known, as in ``arrival_time``.
    """
    header, info = codec.header(frame_id, stamp_ns), codec.map_metadata(terrain, stamp_ns)
    grid = codec.occupancy_grid(occupancy(maps.probability), info, header)
    messages: dict[str, tuple[str, Any]] = {
        'inundation_probability': (OCCUPANCY_GRID, grid),
        'expected_thickness': (IMAGE, codec.float_image(maps.thickness, header)),
    }
    for share, values in maps.arrival.items():
        name = f'arrival_time_p{round(100 * share)}'
        times = np.where(terrain.has_data, values, np.float32(UNKNOWN))
        messages[name] = (IMAGE, codec.float_image(times, header))
    return messages
