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

"""What a user describes: terrain, lava, vents, and what is uncertain about them."""

from lava_ros.scene.lava import Lava
from lava_ros.scene.scene import (
    constants_of,
    ENVIRONMENT,
    KELVIN,
    MAX_VENT_VISCOSITY,
    read_scene,
    Scene,
    scene_from_dict,
    scene_from_yaml,
    scene_to_dict,
    temperature_doubts,
    warn_of_celsius,
)
from lava_ros.scene.terrain import (
    MAX_COORDINATE,
    MAX_ELEVATION,
    MAX_SIDE_CELLS,
    RESOLUTION_RANGE,
    Terrain,
)
from lava_ros.scene.vents import (
    check_vents,
    MAX_DISCHARGE,
    Vent,
    VENT_TEMPERATURE_RANGE,
    vents_from_list,
)

__all__ = [
    'ENVIRONMENT',
    'KELVIN',
    'MAX_COORDINATE',
    'MAX_DISCHARGE',
    'MAX_ELEVATION',
    'MAX_SIDE_CELLS',
    'MAX_VENT_VISCOSITY',
    'RESOLUTION_RANGE',
    'VENT_TEMPERATURE_RANGE',
    'Lava',
    'Scene',
    'Terrain',
    'Vent',
    'check_vents',
    'constants_of',
    'read_scene',
    'scene_from_dict',
    'scene_from_yaml',
    'scene_to_dict',
    'temperature_doubts',
    'vents_from_list',
    'warn_of_celsius',
]
