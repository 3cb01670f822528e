# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write the JSON Schemas of our files into schemas/: `python docs/schemas.py`.

Keys of scenes, cases and layers are declared where they are checked (``lava_ros.files.keys``).
Limits that depend on other values of a file, such as a solidus below the liquidus, are not in the
schemas.
"""

from collections.abc import Callable, Mapping
import json
from pathlib import Path

from lava_ros.files.keys import list_of, Schema, TEXT
from lava_ros.layers.layer_files import FILE_KEYS
from lava_ros.ros import parameters
from lava_ros.runs.store import FINISHED, RUNNING, VERSION
from lava_ros.scene import constants_of
from lava_ros.scene.file_keys import CASE_KEYS, SCENE_KEYS
from lava_ros.scene.uncertainty import definitions
from lava_ros.simulation.carriers import count_key, COUNTED, max_count_key, METHODS
from lava_ros.simulation.output.budget import volume_key, VOLUMES

FOLDER = Path(__file__).parents[1] / 'schemas'


def of_parameter(spec: parameters.ParameterSpec) -> Schema:
    """Return the schema of a parameter."""
    text = {'description': spec.description}
    if spec.is_list:
        # ROS writes an empty list of strings as one empty string
        item = {'enum': ['', *spec.choices]} if spec.choices else TEXT
        return {**text, 'anyOf': [list_of(item), {'enum': ['', None]}]}
    if spec.choices:
        return {**text, 'enum': list(spec.choices)}
    kind = {bool: 'boolean', int: 'integer', float: 'number', str: 'string'}[type(spec.default)]
    limits = dict(zip(('minimum', 'maximum'), spec.limits or (), strict=False))
    return {**text, 'type': kind, **limits}


def parameter_file() -> Schema:
    """Return the schema of a parameter file.

    Unknown parameters and other nodes are valid: the node ignores them, with a warning.
    """
    specs = (*parameters.LIFECYCLE, *parameters.SOURCES, *parameters.PARAMETERS)
    specs += parameters.constant_parameters(constants_of(None))
    flat = {spec.name: of_parameter(spec) for spec in specs}
    prefix = parameters.LAVA
    nested = {name[len(prefix):]: item for name, item in flat.items() if name.startswith(prefix)}
    of_lava = {'type': 'object', 'properties': nested}
    own = {'type': 'object', 'properties': {**flat, prefix.rstrip('.'): of_lava}}
    node = {'type': 'object', 'properties': {'ros__parameters': {'$ref': '#/definitions/node'}}}
    names = ('/**', '/**/lava', '/lava', 'lava')
    return {
        'type': 'object',
        'properties': dict.fromkeys(names, node),
        'definitions': {'node': own},
    }


def run_file() -> Schema:
    """Return the schema of ``run.json``; results are absent until the run is finished.

    Mapped eruptions and ensembles have further keys, which json_run.schema.json lists.
    """
    number, count, group = {'type': 'number'}, {'type': 'integer'}, {'type': 'object'}
    meanings: dict[str, tuple[Schema, str]] = {
        'version': ({'const': VERSION}, 'Version of this format'),
        'status': ({'enum': [RUNNING, FINISHED]}, 'running also if the run was interrupted'),
        'kind': ({'enum': ['scene', 'case', 'ensemble']}, 'Kind; case: a mapped eruption'),
        'program': (group, 'Version of lava_ros, number of the model, commit of the checkout'),
        'identity': (TEXT, 'Digest of the scene and of the settings: the same for equal runs'),
        'begun': (TEXT, 'Date and time at which the run was begun'),
        'onset': ({'type': ['string', 'null']}, 'Date and time of simulated time 0'),
        'settings': (group, 'Choices of the user: times [s], preset, spacing [m], effects'),
        'inputs': (list_of(group), 'Path as given, size [bytes] and SHA-256 digest of each file'),
        'scene': (group, 'The scene, with all values resolved'),
        'erupting_lava': (group, 'Material, temperature [K] and viscosity [Pa s] at each vent'),
        'preset': (TEXT, 'Preset of the accuracy'),
        'accuracy': (group, 'The accuracy, without automatic values'),
        'device': (TEXT, 'Computing device'),
        'effects': (list_of(group), 'Effects at the start and later switches, with times [s]'),
        'node': (TEXT, 'Node whose topics the bag has'),
        'topics': (group, 'Topic of each layer in the bag'),
        'maps': (TEXT, 'Folder of the bag, in that of the run'),
        'wall_time_s': (number, 'Wall time of the run, with its earlier parts'),
        'resolution': (group, 'Spacing [m], width of the flow [m], carriers across'),
        'flow_kind': ({'type': ['string', 'null']}, 'Kind of the flow, with its numbers'),
        'numerical_error': ({'type': ['object', 'null']}, 'Fractions of the areas; null: unknown'),
        'numerical_error_text': (TEXT, 'The numerical error in words'),
        'simulated_time_s': (number, 'Simulated time of the results'),
        'inundation_threshold_m': (number, 'Thickness at or above which lava has arrived'),
        'inundated_area_m2': (number, 'Area inundated so far'),
        'standing_area_m2': (number, 'Area with lava at the end'),
        **{
            volume_key(name): (number, f'Volume {label} [m3]: {meaning}')
            for name, (label, meaning) in VOLUMES.items()
        },
        'volume_error': (number, 'Fraction of the emitted volume that is unaccounted for'),
        **{count_key(name): (count, f'Number of {COUNTED[name]}') for name in METHODS},
        **{
            max_count_key(name): (count, f'Largest number of {COUNTED[name]} in any map')
            for name in METHODS
        },
        'steps': (count, 'Number of time steps'),
        'warnings': (list_of(TEXT), 'What a reader of the maps must know'),
    }
    properties = {
        name: {'description': text, **kind} for name, (kind, text) in meanings.items()
    }
    names = list(meanings)
    required = [*names[: names.index('preset')], 'maps']
    return {'type': 'object', 'properties': properties, 'required': required}


#: Title and function of the schema of each kind of file.
KINDS: Mapping[str, tuple[str, Callable[[], Schema]]] = {
    'scene': (
        'Scene of lava_ros: terrain, vents, lava',
        lambda: SCENE_KEYS.as_schema(definitions=definitions()),
    ),
    'case': (
        'case.yaml of a mapped eruption', lambda: CASE_KEYS.as_schema(definitions=definitions()),
    ),
    'layers': ('Published layers of the node', FILE_KEYS.as_schema),
    'parameters': ('Parameters of the node', parameter_file),
    'run': ('run.json of a run', run_file),
}


def schema(kind: str) -> Schema:
    """Return the schema of a kind of file."""
    title, make = KINDS[kind]
    return {'$schema': 'http://json-schema.org/draft-07/schema#', 'title': title, **make()}


def path(kind: str) -> Path:
    """Return the path of a schema file."""
    return FOLDER / f'{kind}.schema.json'


def text(kind: str) -> str:
    """Return the text of a schema file."""
    return json.dumps(schema(kind), indent=1) + '\n'


if __name__ == '__main__':
    FOLDER.mkdir(exist_ok=True)
    for name in KINDS:
        path(name).write_text(text(name), encoding='utf-8')
