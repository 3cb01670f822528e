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

"""The maps of an ensemble as a bag, with the names and types that a node publishes them with."""

from collections.abc import Mapping
from pathlib import Path
import shutil
from typing import Any

import yaml

import lava_ros
from lava_ros.bag import BagWriter, LATCHED
from lava_ros.errors import LavaError
from lava_ros.forecast.members import Plan
from lava_ros.forecast.probability import HazardMaps
from lava_ros.layers import IMAGE
from lava_ros.ros import codec, outputs
from lava_ros.ros.probability import probability_messages
from lava_ros.scene import scene_to_dict

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
