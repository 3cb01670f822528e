# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys of scene files and of ``case.yaml``: they are checked, in the schemas and in the docs."""

from dataclasses import fields
from functools import partial

from lava_ros import validation
from lava_ros.files.keys import any_of, DATE, FLAG, Key, Keys, list_of, number, Schema
from lava_ros.scene.composition import MOLAR_MASSES, OXIDE_CHECK
from lava_ros.scene.effusion_rates import RATE_KEYS, TABLE_KEYS
from lava_ros.scene.emplaced import FLOW_KEYS
from lava_ros.scene.events import CASE_EVENT_KEYS, SCENE_EVENT_KEYS
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import materials
from lava_ros.scene.scene import ENVIRONMENT, Scene
from lava_ros.scene.terrain_files import TERRAIN_KEYS, TERRAIN_OPTIONS
from lava_ros.scene.uncertainty import UNCERTAINTY_KEYS
from lava_ros.scene.vent_keys import RATE_SCHEMAS, VENT_KEYS

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
        None,
        'Accept numbers that cannot be, such as an effusion rate above any known, with a warning',
        schema=FLAG,
    ),
    'material': Key(None, 'Deprecated: use lava: {material: NAME}', schema=_old_material),
}

_VENT = Keys({
    **VENT_KEYS.keys,
    'effusion_rate': Key(
        None, VENT_KEYS.keys['effusion_rate'].text,
        schema=any_of(*RATE_SCHEMAS, TABLE_KEYS.as_schema()),
    ),
}, VENT_KEYS.conditions)

#: Keys of a scene file.
SCENE_KEYS = Keys({
    'terrain': Key(
        None, 'Elevation file and how to read it', schema=TERRAIN_KEYS.as_schema
    ),
    'vents': Key(
        None, 'Points and lines at which lava is emitted', schema=list_of(_VENT.as_schema())
    ),
    'emplaced_flows': Key(
        None, 'Flows emplaced before the start', schema=list_of(FLOW_KEYS.as_schema())
    ),
    'events': Key(
        None, 'Changes of the ground during the eruption',
        schema=list_of(SCENE_EVENT_KEYS.as_schema()),
    ),
    'onset': Key(
        None, 'Date and time of the start of the simulation: 2021-09-19T14:10:00Z', schema=DATE
    ),
    **_SHARED,
})

#: Keys of an outline in ``case.yaml``.
OUTLINE_KEYS = Keys({
    'time': Key(
        None, 'Time of the map [s], or its date', True, schema={'type': ['number', 'string']}
    ),
    'file': Key(
        partial(validation.text, expected='the name of a file'),
        'Mapped outline, like footprint.asc', True,
    ),
})

#: Keys of ``case.yaml``.
CASE_KEYS = Keys({
    'title': Key(None, 'Title, for people', schema={}),
    'source': Key(None, 'Where the data are from', schema={}),
    'vent_temperature': Key(
        VENT_KEYS.keys['temperature'].check, 'Temperature of the erupting lava [K]'
    ),
    'vent_radius': Key(
        VENT_KEYS.keys['radius'].check, 'Radius of vents without their own [m]'
    ),
    'start': Key(None, 'Start of the simulation [s]', schema=number()),
    'end': Key(None, 'End of the simulation [s]', schema=number()),
    **{name: TERRAIN_OPTIONS[name] for name in CASE_TERRAIN},
    'low_pass': Key(
        None, 'Standard deviation of a Gaussian filter of the ground [m]; 0: none',
        schema=number(at_least=0.0),
    ),
    'events': Key(
        None, 'Changes of the ground during the eruption',
        schema=list_of(CASE_EVENT_KEYS.as_schema()),
    ),
    'effusion_rate': Key(
        None, 'Options for reading effusion_rate.csv', schema=RATE_KEYS.as_schema
    ),
    'outlines': Key(
        None, 'Flow fields mapped at several times, in place of a footprint',
        schema=list_of(OUTLINE_KEYS.as_schema(), 1),
    ),
    **_SHARED,
})
