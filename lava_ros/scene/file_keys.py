# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys of scene files and of ``case.yaml``: they are checked, in the schemas and in the docs."""

from dataclasses import fields

from lava_ros.files.keys import (
    any_of,
    DATE,
    FILE_NAME,
    FLAG,
    Key,
    Keys,
    list_of,
    number,
    Schema,
)
from lava_ros.scene.composition import MOLAR_MASSES, OXIDE_CHECK
from lava_ros.scene.effusion_rates import RATE_KEYS, TABLE_KEYS
from lava_ros.scene.emplaced import FLOW_KEYS
from lava_ros.scene.events import CASE_EVENT_KEYS, SCENE_EVENT_KEYS
from lava_ros.scene.from_outline import FROM_OUTLINE_KEYS
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import materials
from lava_ros.scene.scene import ENVIRONMENT, Scene
from lava_ros.scene.terrain_files import TERRAIN_KEYS, TERRAIN_OPTIONS
from lava_ros.scene.uncertainty import UNCERTAINTY_KEYS
from lava_ros.scene.vent_keys import (
    RADIUS_CHECK,
    RATE_SCHEMAS,
    TEMPERATURE_CHECK,
    VENT_KEYS,
)

#: Options for reading the elevation of a case.
CASE_TERRAIN = ('epsg', 'nodata', 'fill_holes', 'sea_level')


def lava_schema() -> Schema:
    """Return the schema of the ``lava`` of a file, for which ``lava_from_dict`` reads it."""
    oxides = Keys({
        name: Key(OXIDE_CHECK, is_required=name == 'SiO2') for name in MOLAR_MASSES
    })
    return Keys({
        'material': Key(
            None, 'A name of `lava materials`, whose constants are the defaults',
            schema={'enum': list(materials())},
        ),
        'composition': Key(
            oxides, 'Composition of the melt [wt%]; gives vft_a, vft_b and vft_c'
        ),
        **{item.name: Key.of_field(item) for item in fields(Lava)},
    }).as_schema()


def _old_material() -> Schema:
    text = 'Deprecated: use lava: {material: NAME}'
    return {'deprecated': True, 'deprecationMessage': text, 'enum': list(materials())}


#: Keys that scenes and cases share.
_SHARED = {
    'lava': Key(None, 'Material, and constants in place of its own', schema=lava_schema),
    'uncertainty': Key(
        None, 'Quantities that differ between the members of an ensemble',
        schema=UNCERTAINTY_KEYS.as_schema,
    ),
    **{item.name: Key.of_field(item) for item in fields(Scene) if item.name in ENVIRONMENT},
    'insist': Key(
        FLAG,
        'Accept numbers that cannot be, such as an effusion rate above any known, with a warning',
    ),
    'material': Key(None, 'Deprecated: use lava: {material: NAME}', schema=_old_material),
}

_VENT = Keys({
    **VENT_KEYS.keys,
    'effusion_rate': Key(
        any_of(*RATE_SCHEMAS, TABLE_KEYS.as_schema()), VENT_KEYS.keys['effusion_rate'].text
    ),
}, VENT_KEYS.conditions)

_EVENTS = 'Changes of the ground during the eruption'

#: Keys of a scene file.
SCENE_KEYS = Keys({
    'terrain': Key(TERRAIN_KEYS.as_schema(), 'Elevation file and how to read it'),
    'vents': Key(list_of(_VENT.as_schema()), 'Points and lines at which lava is emitted'),
    'emplaced_flows': Key(list_of(FLOW_KEYS.as_schema()), 'Flows emplaced before the start'),
    'events': Key(list_of(SCENE_EVENT_KEYS.as_schema()), _EVENTS),
    'onset': Key(
        DATE, 'Date and time of the start of the simulation, in UTC unless it has a time zone: '
        '2021-09-19T14:10:00Z',
    ),
    **_SHARED,
})

#: Keys of an outline in ``case.yaml``.
OUTLINE_KEYS = Keys({
    'time': Key({'type': ['number', 'string']}, 'Time of the map [s], or its date', True),
    'file': Key(FILE_NAME, 'Mapped outline, like footprint.asc', True),
})

#: Keys of ``case.yaml``.
CASE_KEYS = Keys({
    'title': Key({}, 'Title, for people'),
    'source': Key({}, 'Where the data are from'),
    'vent_temperature': Key(TEMPERATURE_CHECK, 'Temperature of the erupting lava [K]'),
    'vent_radius': Key(RADIUS_CHECK, 'Radius of vents that state none [m]'),
    'start': Key(number(), 'Start of the simulation [s]'),
    'end': Key(number(), 'End of the simulation [s]'),
    **{name: TERRAIN_OPTIONS[name] for name in CASE_TERRAIN},
    'low_pass': Key(
        number(at_least=0.0), 'Standard deviation of a Gaussian filter of the ground [m]; 0: none'
    ),
    'events': Key(list_of(CASE_EVENT_KEYS.as_schema()), _EVENTS),
    'effusion_rate': Key(RATE_KEYS.as_schema(), 'Options for reading effusion_rate.csv'),
    'from_outline': Key(
        FROM_OUTLINE_KEYS.as_schema(),
        'Outline from which the simulation starts: lava that erupted before lies in it',
    ),
    'outlines': Key(
        list_of(OUTLINE_KEYS.as_schema(), 1),
        'Flow fields mapped at several times, in place of a footprint',
    ),
    **_SHARED,
})
