# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Input of a simulation: terrain, lava, vents and their uncertainty."""

from lava_ros.scene.lava import Lava
from lava_ros.scene.plausibility import KELVIN
from lava_ros.scene.scene import (
    check_plausible,
    constants_of,
    date_text,
    ENVIRONMENT,
    MAX_VENT_VISCOSITY,
    Scene,
    scene_from_dict,
    scene_to_dict,
    suspicious_temperatures,
)
from lava_ros.scene.source import scene_from_yaml, SceneSource, SourcedScene
from lava_ros.scene.terrain import (
    Georeference,
    MAX_COORDINATE,
    MAX_ELEVATION,
    MAX_SIDE_CELLS,
    RESOLUTION_RANGE,
    Terrain,
)
from lava_ros.scene.vent_keys import MAX_DISCHARGE, VENT_TEMPERATURE_RANGE
from lava_ros.scene.vents import check_vents, Vent, vents_from_list

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
    'Georeference',
    'Lava',
    'Scene',
    'SceneSource',
    'SourcedScene',
    'Terrain',
    'Vent',
    'check_plausible',
    'check_vents',
    'constants_of',
    'date_text',
    'scene_from_dict',
    'scene_from_yaml',
    'scene_to_dict',
    'suspicious_temperatures',
    'vents_from_list',
]
