# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write the JSON Schemas of our files into schemas/: `python docs/schemas.py`.

Names, limits and choices are those of the parsers. Limits that depend on other values of a file,
such as a solidus below the liquidus, are not in the schemas.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, fields
from functools import partial
import json
from pathlib import Path
from typing import Any

from lava_ros import validation
from lava_ros.hindcast import case
from lava_ros.layers import layer_files
from lava_ros.layers.layer import HazardLimits, Layer
from lava_ros.ros import parameters
from lava_ros.runs.store import FINISHED, RUNNING, VERSION
from lava_ros.scene import (
    constants_of,
    distributions,
    effusion_rates,
    emplaced,
    events,
    Lava,
    measurements,
    reshaping,
    Scene,
    uncertainty,
    Vent,
)
from lava_ros.scene.composition import MOLAR_MASSES, OXIDE_CHECK
from lava_ros.scene.materials import materials
from lava_ros.scene.scene import ENVIRONMENT, SCENE_KEYS
from lava_ros.scene.terrain import MIN_EPSG, SEA_LEVEL_CHECK
from lava_ros.scene.terrain_files import RESOLUTION_CHECK, TERRAIN_OPTIONS
from lava_ros.scene.vents import RATE_CHECK, VENT_CHECKS
from lava_ros.simulation.output.budget import VolumeBudget

FOLDER = Path(__file__).parents[1] / 'schemas'

Schema = dict[str, Any]

TEXT: Schema = {'type': 'string'}
FLAG: Schema = {'type': 'boolean'}
DATE: Schema = {'type': 'string', 'pattern': r'^\s*\d{4}'}

#: Descriptions of keys in editors, for keys without a description in the code.
MEANINGS = {
    'terrain': 'Elevation file and how to read it',
    'file': 'File, relative to this one',
    'epsg': 'EPSG code of the coordinates; replaces the one in the file',
    'resolution': 'Side of the cells to make [m]',
    'offset': 'Easting and northing of the origin of the map frame [m]',
    'window': 'Part to keep: smallest easting and northing, largest easting and northing [m]',
    'fill_holes': 'Fill cells without data that data surround',
    'nodata': 'Value of cells without data that the file does not declare; none: all have data',
    'onset': 'Date and time of the start of the simulation: 2021-09-19T14:10:00Z',
    'sea_level': 'Elevation at or below which the ground is sea [m], where lava leaves the map',
    'insist': 'Accept numbers that cannot be, such as an effusion rate above any known, with a '
    'warning',
    'vents': 'Points and lines at which lava is emitted',
    'name': 'Name in logs, messages and tables',
    'position': 'Position [x, y] in the map frame [m]',
    'projected': 'Position [easting, northing] in the coordinate system of the terrain [m]',
    'end': 'The other end of a fissure [x, y] in the map frame [m]',
    'projected_end': 'The other end of a fissure [easting, northing] [m]',
    'discharge': 'Effusion rate [m3/s]: a number, or a series of [time [s], rate] pairs',
    'effusion_rate': 'Effusion rate [m3/s]: a number, [time [s], rate] pairs, or a table',
    'temperature': 'Temperature of the erupting lava [K]',
    'radius': 'Radius of the disc, or half the width of the fissure [m]',
    'velocity': 'Velocity [vx, vy] of the emitted lava [m/s]',
    'lava': 'Material, and constants in place of its own',
    'uncertainty': 'Quantities that differ between the members of an ensemble',
    'vent_temperature': 'Temperature of the erupting lava [K]',
    'vent_radius': 'Radius of vents without their own [m]',
    'low_pass': 'Standard deviation of a Gaussian filter of the ground [m]; 0: none',
    'emplaced_flows': 'Flows emplaced before the start',
    'events': 'Changes of the ground during the eruption',
}

#: Descriptions of the keys of a layer; msg_configs/default.yaml has them in full.
LAYER_MEANINGS = {
    'topic': 'Relative topic name; the name of the layer if left out',
    'source': 'Quantity that the layer shows',
    'message': 'Type of the messages',
    'range': 'Values [low, high] that map to the ends of scale, in the unit of the source',
    'scale': 'Grid values [first, last] at the ends of range; [0, 100] if left out',
    'step': 'Value of the source at or above which a cell is 100; below it, 0',
    'classes': 'Values of the source at which one class ends and the next begins',
    'margin': 'Clearance around cells with lava [m]; 0 if left out',
    'threshold': 'Thickness below which a cell is dry [m]; 0.1 if left out',
    'outside': 'Grid value of cells without terrain; -1 if left out',
    'min_cells': 'Minimum number of columns and of rows; 0 if left out',
    'enabled': 'Publish the layer; true if left out',
    'rate': 'Maximum rate of the messages [Hz]; 1 if left out',
    'heartbeat': 'Wall time after which an unchanged map is sent again [s]; 0: never',
    'record': 'Write the layer to the bag; true if left out',
    'qos': 'Quality of service of the publisher',
    'hazard': 'Limits between which heat and burial grow from harmless to lethal',
}

#: Keyword of JSON Schema for each limit of ``validation.number`` and ``validation.whole``.
LIMITS = {'above': 'exclusiveMinimum', 'at_least': 'minimum', 'at_most': 'maximum'}


def of_check(check: Callable[..., Any]) -> Schema:
    """Return the schema of the values that a check of ``validation`` accepts."""
    options = check.keywords if isinstance(check, partial) else {}
    function = check.func if isinstance(check, partial) else check
    if function is validation.flag:
        return FLAG
    if function is validation.choice:
        return {'enum': list(options['allowed'])}
    if function is validation.pair:
        most = options.get('most')
        return list_of(number(at_least=None if most is None else -most, at_most=most), 2, 2)
    kind = {validation.number: 'number', validation.whole: 'integer'}[function]
    limits = {LIMITS[name]: value for name, value in options.items() if name in LIMITS}
    return {'type': kind} | {name: value for name, value in limits.items() if value is not None}


def number(**limits: float | None) -> Schema:
    """Return the schema of a number within the limits of ``validation.number``."""
    return of_check(partial(validation.number, **limits))


def list_of(item: Schema, least: int = 0, most: int | None = None) -> Schema:
    """Return the schema of a list."""
    limits = {'minItems': least} if most is None else {'minItems': least, 'maxItems': most}
    return {'type': 'array', 'items': item, **limits}


def mapping(
    properties: Mapping[str, Schema], required: Iterable[str] = (), **more: Any
) -> Schema:
    """Return the schema of a mapping that has no other keys."""
    known = {
        name: {'description': MEANINGS[name], **item} if name in MEANINGS else item
        for name, item in properties.items()
    }
    result = {'type': 'object', 'additionalProperties': False, 'properties': known, **more}
    return {**result, 'required': list(required)} if list(required) else result


def either(*names: str, optional: bool = False) -> Schema:
    """Return a condition on a mapping: exactly one of some keys, or at most one if optional."""
    options: list[Schema] = [{'required': [name]} for name in names]
    if optional:
        options.append({'not': {'anyOf': list(options)}})
    return {'oneOf': options}


def of_field(item: Field[Any]) -> Schema:
    """Return the schema of a field declared by ``effect.number``, ``choice`` or ``flag``."""
    about = item.metadata
    unit = f' [{about["unit"]}]' if about.get('unit') else ''
    text = {'description': about['text'] + unit}
    if 'limits' in about:
        return text | number(at_least=about['limits'][0], at_most=about['limits'][1])
    return text | ({'enum': list(about['choices'])} if 'choices' in about else FLAG)


def lava() -> Schema:
    """Return the schema of a lava."""
    names = {
        'description': 'A name of `lava materials`, whose constants are the defaults',
        'enum': list(materials()),
    }
    oxides = mapping(dict.fromkeys(MOLAR_MASSES, of_check(OXIDE_CHECK)), ['SiO2'])
    oxides['description'] = 'Composition of the melt [wt%]; gives vft_a, vft_b and vft_c'
    constants = {item.name: of_field(item) for item in fields(Lava)}
    return mapping({'material': names, 'composition': oxides, **constants})


def deprecated_material() -> Schema:
    """Return the schema of ``material`` outside ``lava``."""
    text = 'Deprecated: use lava: {material: NAME}'
    return {
        'description': text, 'deprecated': True, 'deprecationMessage': text,
        'enum': list(materials()),
    }


def surroundings() -> dict[str, Schema]:
    """Return the schemas of the constants of the surroundings, by name."""
    return {item.name: of_field(item) for item in fields(Scene) if item.name in ENVIRONMENT}


def terrain_options() -> dict[str, Schema]:
    """Return the schemas of the options for reading an elevation file, by name."""
    known = {
        'epsg': {'type': 'integer', 'minimum': MIN_EPSG},
        'resolution': of_check(RESOLUTION_CHECK),
        'offset': list_of(number(), 2, 2),
        'window': list_of(number(), 4, 4),
        'fill_holes': FLAG,
        'nodata': {'anyOf': [number(), {'const': 'none'}]},
        'sea_level': of_check(SEA_LEVEL_CHECK),
    }
    return {name: known[name] for name in TERRAIN_OPTIONS}


def rate_options() -> dict[str, Schema]:
    """Return the schemas of the options for reading a table of effusion rates, by name."""
    known = {
        'start': {
            'description': 'Start of the eruption (ISO 8601), which is time 0',
            **DATE,
        },
        'gaps': {
            'description': 'Effusion rate in a time without data',
            'enum': list(effusion_rates.GAPS),
        },
        'measured': {
            'description': 'Method of measurement, for the error of rates without errors',
            'enum': list(measurements.RATE_ERRORS),
        },
        'porosity': {
            'description': 'Fraction of bubbles: rates are dense-rock equivalents',
            'type': 'number', 'minimum': 0.0, 'exclusiveMaximum': 1.0,
        },
    }
    return {item.name: known[item.name] for item in fields(effusion_rates.Options)}


def vent() -> Schema:
    """Return the schema of a vent."""
    pair = {'type': 'array', 'items': [number(), of_check(RATE_CHECK)], 'minItems': 2}
    series = list_of({**pair, 'maxItems': 2}, 1)
    constant_or_series = [of_check(RATE_CHECK), series]
    table = mapping({'file': TEXT, **rate_options()}, ['file'])
    known = {
        **{name: of_check(check) for name, check in VENT_CHECKS.items()},
        'name': TEXT,
        'discharge': {'anyOf': constant_or_series},
    }
    own = {item.name: known[item.name] for item in fields(Vent)}
    place = list_of(number(), 2, 2)
    others = {
        'projected': place, 'projected_end': place,
        'effusion_rate': {'anyOf': [*constant_or_series, table]},
    }
    conditions = [
        either('discharge', 'effusion_rate'),
        either('position', 'projected'),
        either('end', 'projected_end', optional=True),
    ]
    return mapping({**own, **others}, allOf=conditions)


def distribution() -> Schema:
    """Return the schema of a distribution."""
    kinds = []
    words = {
        'source': TEXT | {'description': 'Reference, for people'},
        'follows': {'$ref': '#/definitions/leader'},
    }
    for kind, names in distributions.KINDS.items():
        numbers = {name: of_check(distributions.check_of(kind, name)) for name in names}
        limits: dict[str, Schema] = {}
        if kind in distributions.WITH_LIMITS:
            limits['limits'] = of_check(partial(validation.pair, most=1e9))
        known = {'distribution': {'const': kind}, **numbers, **limits, **words}
        kinds.append(mapping(known, ['distribution', *names]))
    return {'anyOf': kinds}


def definitions() -> dict[str, Schema]:
    """Return the schemas to which others refer."""
    names = [sign + name for sign in ('', '-') for name in uncertainty.QUANTITIES]
    meaning = 'Quantity with the same, or after a minus sign the opposite, rank'
    return {
        'distribution': distribution(), 'leader': {'description': meaning, 'enum': ['', *names]}
    }


def uncertainties() -> Schema:
    """Return the schema of uncertain quantities."""
    one = {'$ref': '#/definitions/distribution'}
    roughness = {
        name: of_check(distributions.ROUGHNESS_CHECK) for name in ('deviation', 'correlation')
    }
    displacement = {
        item.name: of_field(item)
        for item in fields(distributions.Displacement) if item.metadata
    }
    probability = of_check(uncertainty.PROBABILITY_CHECK)
    classes = mapping(
        {'probability': probability, 'duration': one, 'volume': one, 'name': TEXT},
        ['probability', 'duration', 'volume'],
    )
    source = {'source': TEXT | {'description': 'Reference, for people'}}
    measured = {'measured': {'enum': list(measurements.RATE_ERRORS)}}
    survey = {'survey': {'enum': list(measurements.SURVEYS)}}
    quantities = {'enum': list(uncertainty.QUANTITIES)}
    known = {
        'discharge': {'anyOf': [one, mapping(measured, measured)]},
        'effusion_rate': {'anyOf': [one, mapping(measured, measured)]},
        'exact': {'anyOf': [{'const': uncertainty.ALL}, list_of(quantities)]},
        'material': {'enum': list(materials())},
        'position': mapping(displacement | source),
        'terrain': {
            'anyOf': [mapping(roughness | source, roughness), mapping(survey, survey)]
        },
        'constants': mapping(dict.fromkeys(uncertainty.CONSTANTS, one)),
        'eruption': list_of(classes),
    }
    names = [item.name for item in fields(uncertainty.Uncertainty)]
    texts = {
        'discharge': 'Factor on all effusion rates',
        'effusion_rate': 'Factor on all effusion rates',
        'temperature': 'Offset of the temperature of all vents [K]',
        'position': 'Displacement of all vents', 'terrain': 'Errors of the terrain',
        'exact': 'Quantities that are not drawn',
        'material': 'Material whose published ranges are drawn; that of the lava if left out',
    }
    schemas = {
        name: {'description': texts[name], 'allOf': [known.get(name, one)]}
        if name in texts else known.get(name, one)
        for name in [*names, 'effusion_rate']
    }
    return mapping(schemas, **either('discharge', 'effusion_rate', optional=True))


def emplaced_flow() -> Schema:
    """Return the schema of a flow emplaced before the start."""
    known = {
        'file': TEXT | {
            'description': 'Raster of thickness [m], or outlines; relative to this file'
        },
        'as': {
            'description': 'Lava that can flow, or part of the ground; lava if left out',
            'enum': list(emplaced.KINDS),
        },
        'thickness': of_check(emplaced.THICKNESS_CHECK) | {
            'description': 'Thickness of outlines [m]'
        },
        'temperature': of_check(emplaced.TEMPERATURE_CHECK) | {
            'description': 'Temperature of the lava [K]; the eruption temperature if left out'
        },
    }
    return mapping({name: known[name] for name in emplaced.FLOW_KEYS}, ['file'])


def event(time: Schema) -> Schema:
    """Return the schema of a change of the ground at a time."""
    sides = {
        name: number(at_least=least, at_most=most)
        for name, (least, most, _) in reshaping.LIMITS.items()
    }
    place = of_check(partial(validation.pair, most=reshaping.MAX_COORDINATE))
    barrier = mapping(
        {'line': list_of(place, 2), **sides, 'name': TEXT}, ['line', 'height', 'width']
    )
    known = {
        'terrain': TEXT | {'description': 'File of the new elevation; relative to this file'},
        'barrier': barrier,
        'barriers': TEXT | {'description': 'Vector file of lines with height and width [m]'},
    }
    return mapping(
        {'time': time, **{name: known[name] for name in events.CHANGES}}, ['time'],
        **either(*events.CHANGES),
    )


def scene() -> Schema:
    """Return the schema of a scene file."""
    known = {
        'terrain': mapping({'file': TEXT, **terrain_options()}, ['file']),
        'vents': list_of(vent()),
        'lava': lava(),
        'uncertainty': uncertainties(),
        'emplaced_flows': list_of(emplaced_flow()),
        'events': list_of(event(of_check(partial(validation.number, at_least=0.0)))),
        'onset': DATE,
        'insist': FLAG,
        **surroundings(),
    }
    known = {name: known[name] for name in SCENE_KEYS}
    return mapping(
        {**known, 'material': deprecated_material()}, definitions=definitions()
    )


def case_file() -> Schema:
    """Return the schema of the ``case.yaml`` of a case."""
    options = terrain_options()
    known = {
        'title': {'description': 'Title, for people'},
        'source': {'description': 'Where the data are from'},
        'lava': lava(),
        'vent_temperature': of_check(VENT_CHECKS['temperature']),
        'vent_radius': of_check(VENT_CHECKS['radius']),
        **surroundings(),
        'start': number() | {'description': 'Start of the simulation [s]'},
        'end': number() | {'description': 'End of the simulation [s]'},
        **{name: options[name] for name in ('epsg', 'nodata', 'fill_holes', 'sea_level')},
        'low_pass': number(at_least=0.0),
        'events': list_of(event(number())),
        'uncertainty': uncertainties(),
        'effusion_rate': mapping(rate_options()) | {
            'description': 'Options for reading effusion_rate.csv'
        },
        'outlines': list_of(mapping({
            'time': {
                'description': 'Time of the map [s], or its date', 'type': ['number', 'string']
            },
            'file': {'description': 'Mapped outline, like footprint.asc', 'type': 'string'},
        }, ['time', 'file']), 1),
        'insist': FLAG,
    }
    known = {name: known[name] for name in case.KEYS}
    return mapping(
        {**known, 'material': deprecated_material()}, definitions=definitions()
    )


def layers() -> Schema:
    """Return the schema of a layer configuration."""
    checks = {name: of_check(check) for name, check in layer_files.CHECKS.items()}
    bound, classes = of_check(layer_files.RANGE_CHECK), layer_files.MAX_CLASSES - 1
    known = {
        **checks,
        'topic': {'type': 'string', 'pattern': f'^{layer_files.TOPIC.pattern}$'},
        'range': list_of(bound, 2, 2),
        'scale': list_of(of_check(layer_files.SCALE_CHECK), 2, 2),
        'step': number(),
        'classes': list_of(number(above=0.0), 1, classes),
        'heartbeat': {
            'anyOf': [
                {'const': 0},
                number(at_least=layer_files.MIN_HEARTBEAT, at_most=layer_files.MAX_HEARTBEAT),
            ]
        },
        'qos': mapping({name: checks[name] for name in layer_files.QOS_KEYS}),
        'hazard': mapping({item.name: checks[item.name] for item in fields(HazardLimits)}),
    }
    names = [item.name for item in fields(Layer) if item.name != 'name']
    layer = mapping(
        {name: {'description': LAYER_MEANINGS[name], **known[name]} for name in names},
        ['source', 'message'],
    )
    named = {'type': 'object', 'minProperties': 1, 'additionalProperties': layer}
    return mapping({'layers': named}, ['layers'])


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
    """Return the schema of the ``run.json`` of a run; results are absent until it is finished."""
    number, count, group = {'type': 'number'}, {'type': 'integer'}, {'type': 'object'}
    meanings: dict[str, tuple[Schema, str]] = {
        'version': ({'const': VERSION}, 'Version of this format'),
        'status': ({'enum': [RUNNING, FINISHED]}, 'running also if the run was interrupted'),
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
        'resolution': (group, 'Spacing [m], width of the flow [m], particles across'),
        'flow_kind': ({'type': ['string', 'null']}, 'Kind of the flow, with its numbers'),
        'numerical_error': ({'type': ['object', 'null']}, 'Fractions of the areas; null: unknown'),
        'numerical_error_text': (TEXT, 'The numerical error in words'),
        'simulated_time_s': (number, 'Simulated time of the results'),
        'inundation_threshold_m': (number, 'Thickness at or above which lava has arrived'),
        'inundated_area_m2': (number, 'Area inundated so far'),
        'standing_area_m2': (number, 'Area with lava at the end'),
        **dict.fromkeys(
            VolumeBudget(0.0, 0.0, 0.0, 0.0).texts(),
            (number, 'Volume of lava [m3], as in the diagnostics'),
        ),
        'particles': (count, 'Number of particles'),
        'steps': (count, 'Number of time steps'),
        'warnings': (list_of(TEXT), 'What a reader of the maps must know'),
    }
    properties = {
        name: {'description': text, **kind} for name, (kind, text) in meanings.items()
    }
    properties['volume_error']['description'] = 'Fraction of the volume that is unaccounted for'
    names = list(meanings)
    required = [*names[: names.index('preset')], 'maps', 'node', 'topics']
    return mapping(properties, required)


#: Title and function of the schema of each kind of file.
KINDS: Mapping[str, tuple[str, Callable[[], Schema]]] = {
    'scene': ('Scene of lava_ros: terrain, vents, lava', scene),
    'case': ('case.yaml of a mapped eruption', case_file),
    'layers': ('Published layers of the node', layers),
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
