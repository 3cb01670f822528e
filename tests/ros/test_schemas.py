# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The schemas of the YAML files agree with the code."""

from copy import deepcopy
from dataclasses import asdict
from functools import cache
import math
from pathlib import Path
import re
from unittest.mock import patch

import fastjsonschema
import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter

from eruption import VENT, write_case
from lava_ros.errors import LavaError
from lava_ros.files.yaml import dump_yaml, parse_yaml, read_yaml
from lava_ros.hindcast.case import load_case
from lava_ros.layers.layer_files import layers_from_dict
from lava_ros.ros import node_parameters, parameters
from lava_ros.ros.executor import start_ros
from lava_ros.scene import constants_of, scene_from_yaml
from lava_ros.scene.composition import MOLAR_MASSES
from lava_ros.scene.materials import default_lava
from lava_ros.validation import TINY
from ros_domain import own_domain
from scripts import load_script

ROOT = Path(__file__).parents[2]

#: Replacements for each value: of another type, too small, or too large.
WRONG = ('wrong', True, 0.5, -1e300, 1e300, [], {'wrong': 1})

#: Files by the name of their schema.
FILES = {
    'scene': sorted((ROOT / 'examples').glob('*.yaml')),
    'layers': sorted((ROOT / 'msg_configs').glob('*.yaml')),
    'parameters': sorted((ROOT / 'params').glob('*.yaml')),
}

NORMAL = {'distribution': 'normal', 'mean': 0.0, 'deviation': 1.0, 'limits': [-5.0, 5.0]}
FACTOR = {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5, 'limits': [0.5, 2.0]}
UNIFORM = {'distribution': 'uniform', 'low': 0.5, 'high': 2.0}
TRIANGLE = {'distribution': 'triangular', 'low': 0.5, 'mode': 1.0, 'high': 2.0}
LOG_UNIFORM = {'distribution': 'loguniform', 'low': 10.0, 'high': 2000.0}
UNCERTAINTY = {
    'viscosity': FACTOR,
    'yield_strength': TRIANGLE,
    'temperature': NORMAL,
    'position': {'radius': 5.0, 'deviation': 0.0},
    'terrain': {'deviation': 1.0, 'correlation': 50.0, 'source': 'a survey'},
    'constants': {'density': {**LOG_UNIFORM, 'source': 'a paper', 'follows': 'viscosity'}},
    'eruption': [
        {'probability': 1.0, 'duration': LOG_UNIFORM, 'volume': LOG_UNIFORM, 'name': 'small'}
    ],
}

#: Keys that a case shares with a scene: it reads its rasters each time, so they are nightly.
SHARED = (('case', 'events'), ('case', 'uncertainty'))

#: Valid files of each kind, which together have every key.
VALID = {
    'scene': [
        {
            'terrain': {
                'file': 'ground.npz', 'epsg': 32633, 'resolution': 10.0, 'offset': [0.0, 0.0],
                'window': [0.0, 0.0, 300.0, 300.0], 'fill_holes': False, 'nodata': -9999,
                'sea_level': -50.0,
            },
            'lava': {
                'material': 'etna_basalt',
                'composition': {**dict.fromkeys(MOLAR_MASSES, 1.0), 'SiO2': 88.0},
                **asdict(default_lava()),
            },
            **{name: value for name, value in constants_of(None).items() if name != 'lava'},
        },
        {
            'terrain': {'file': 'ground.npz', 'nodata': 'none'},
            'vents': [
                {
                    'name': 'a', 'projected': [100.0, 100.0], 'projected_end': [120.0, 120.0],
                    'temperature': 1360.0, 'radius': 20.0, 'velocity': [0.0, 1.0],
                    'effusion_rate': {
                        'file': 'rates.csv', 'start': '2021-09-19T14:10:00Z', 'gaps': 'zero',
                        'porosity': 0.2, 'measured': 'satellite',
                    },
                },
                {'position': [100.0, 50.0], 'end': [90.0, 50.0], 'effusion_rate': 3.0},
                {'position': [100.0, 90.0], 'discharge': [[0.0, 3.0], [5.0, 0.0]]},
            ],
            'uncertainty': {
                **UNCERTAINTY, 'effusion_rate': UNIFORM, 'exact': ['conductivity'],
                'material': 'etna_basalt',
            },
            # the schema has no limits of credible values
            'onset': '2021-09-19T14:10:00Z',
            'insist': True,
        },
        {'terrain': {'file': 'ground.npz'}, 'uncertainty': {'discharge': UNIFORM}},
        {
            'terrain': {'file': 'ground.npz'},
            'uncertainty': {
                'effusion_rate': {'measured': 'field'}, 'terrain': {'survey': 'srtm'},
                'exact': 'all',
            },
        },
        {'terrain': {'file': 'ground.npz'}, 'uncertainty': {'terrain': {'contours': 20.0}}},
        {'terrain': {'file': 'ground.npz'}, 'material': 'etna_basalt'},
        {
            'terrain': {'file': 'ground.npz'},
            'emplaced_flows': [
                {'file': 'outline.csv', 'as': 'lava', 'thickness': 3.0, 'temperature': 1360.0},
                {'file': 'flow.asc', 'as': 'ground'},
                {'file': 'outline.csv', 'volume': 1e5, 'solidified': 0.25},
            ],
            'events': [
                {'time': 600.0, 'terrain': 'ground.npz'},
                {
                    'time': 900.0,
                    'barrier': {
                        'line': [[50.0, 50.0], [250.0, 50.0]], 'height': 12.0, 'width': 20.0,
                        'slope': 1.0, 'name': 'dam',
                    },
                },
                {'time': 950.0, 'barriers': 'dams.csv'},
            ],
        },
    ],
    'case': [
        {
            'title': 'A valley', 'source': 'made up', 'lava': {'material': 'etna_basalt'},
            'vent_temperature': 1360.0, 'vent_radius': 25.0,
            **{name: value for name, value in constants_of(None).items() if name != 'lava'},
            'start': 0.0, 'end': 9000.0, 'epsg': 32633, 'nodata': -9999, 'fill_holes': True,
            'sea_level': -50.0,
            'low_pass': 40.0, 'insist': True, 'uncertainty': {'effusion_rate': UNIFORM},
            'events': [
                {'time': 600.0, 'terrain': 'elevation.asc'},
                {
                    'time': 900.0,
                    'barrier': {
                        'line': [[VENT[0] + 50.0, VENT[1]], [VENT[0] + 50.0, VENT[1] + 90.0]],
                        'height': 12.0, 'width': 20.0, 'slope': 1.0, 'name': 'dam',
                    },
                },
                {'time': 950.0, 'barriers': 'dams_of_case.csv'},
            ],
            'effusion_rate': {'start': '2021-09-19T14:10:00Z', 'gaps': 'zero', 'porosity': 0.2},
            'outlines': [
                {'time': 600.0, 'file': 'footprint.asc'},
                {'time': '2021-09-19T15:10:00Z', 'file': 'footprint.asc'},
            ],
            'from_outline': {'time': 600.0, 'solidified': 0.2},
        },
        {'material': 'etna_basalt'},
    ],
    'layers': [
        {
            'layers': {
                'height': {
                    'topic': 'ground/height', 'source': 'thickness', 'range': [0.0, 10.0],
                    'message': 'nav_msgs/OccupancyGrid', 'scale': [0, 100], 'threshold': 0.1,
                    'outside': -1, 'margin': 5.0, 'min_cells': 64, 'enabled': True, 'rate': 1.0,
                    'heartbeat': 5.0, 'record': False,
                    'qos': {
                        'reliability': 'reliable', 'durability': 'transient_local', 'depth': 1,
                    },
                },
                'mask': {
                    'source': 'hazard', 'message': 'nav_msgs/OccupancyGrid', 'step': 1.0,
                    'hazard': {
                        'lethal_thickness': 0.5, 'safe_temperature': 50.0,
                        'lethal_temperature': 300.0,
                    },
                },
                'depth': {
                    'source': 'thickness', 'message': 'nav_msgs/msg/OccupancyGrid',
                    'classes': [0.5, 2.0],
                },
            }
        }
    ],
}

#: Values whose limits depend on other values, a file or a list of codes: no schema has them.
DEPENDENT = re.compile(
    r'scene\.terrain\.(file|epsg|resolution|sea_level|(window|offset)\[.\])'
    r'|scene\.vents\[.\]\.(position|end|projected|projected_end)\[.\]'
    r'|scene\.vents\[.\]\.(temperature|effusion_rate\.(file|porosity)|discharge\[.\]\[0\])'
    # only conduction transfers heat through an aging crust
    r'|scene\.lava\.(crust|liquidus|solidus|composition\.[\w-]+)'
    r'|scene\.uncertainty\.(temperature\.(mean|deviation)|position\.(deviation|radius))'
    r'|scene\.uncertainty\.(viscosity\.median|\w+\.limits\[.\])'
    r'|\w+\.uncertainty\..*\.(low|mode|high)'
    # the widest filter depends on the size of the grid
    r'|case\.(start|end|epsg|low_pass|sea_level|from_outline\.time)|\w+\.events\[.\]\.(time|terrain|barriers)'
    r'|scene\.emplaced_flows\[.\]\.(file|temperature|volume)'
    r'|case\.(vent_temperature|effusion_rate\.porosity|outlines\[.\]\.(time|file))'
    r'|layers\.layers\.(height\.(range|scale)\[.\]|depth\.classes\[.\])'
    r'|layers\.layers\.mask\.hazard\.(safe|lethal)_temperature'
)


@cache
def _generator():
    return load_script(ROOT / 'docs' / 'schemas.py')


@cache
def _validator(kind):
    return fastjsonschema.compile(_generator().schema(kind))


def _fits(kind, data):
    """Return True if a schema accepts a file."""
    try:
        _validator(kind)(deepcopy(data))
    except fastjsonschema.JsonSchemaValueException:
        return False
    return True


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A folder of a case, with the files that a scene names."""
    folder = write_case(tmp_path_factory.mktemp('schemas') / 'valley')
    rows = np.arange(30.0)[:, None] + np.zeros(30)
    np.savez(folder / 'ground.npz', elevation=rows, resolution=10.0)
    rates = 'start,end,effusion_rate\n2021-09-19T14:10:00Z,2021-09-20T14:10:00Z,5\n'
    (folder / 'rates.csv').write_text(rates)
    (folder / 'outline.csv').write_text('wkt\n"POLYGON ((50 50, 90 50, 90 90, 50 50))"\n')
    x, y = VENT
    lines = {'dams': '20 150, 250 150', 'dams_of_case': f'{x + 60} {y}, {x + 60} {y + 90}'}
    for name, line in lines.items():
        table = f'wkt,height,width\n"LINESTRING ({line})",5,20\n'
        (folder / f'{name}.csv').write_text(table)
    header = 'ncols 3\nnrows 2\nxllcorner 100\nyllcorner 100\ncellsize 10\n'
    (folder / 'flow.asc').write_text(f'{header}2 0 3\n1 4 0\n')
    for kind in ('case', 'scene'):
        (folder / f'{kind}.yaml').touch()
    return folder


def _parse(kind, data, folder):
    """Parse the data of a file; writing and reading it would take most of the time."""
    if kind == 'layers':
        layers_from_dict(data)
        return
    module = 'case_files' if kind == 'case' else 'scene_files'
    with patch(f'lava_ros.scene.{module}.read_yaml', return_value=deepcopy(data)):
        load_case(folder) if kind == 'case' else scene_from_yaml(folder / 'scene.yaml')


def _refusal(kind, data, folder):
    """Return the error of the program for a file, None if it accepts it."""
    try:
        _parse(kind, data, folder)
    except LavaError as error:
        return error
    return None


def _places(value, path=()):
    if not isinstance(value, (dict, list)):
        return
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*path, key)
        yield from _places(item, (*path, key))


def _with(data, path, value):
    data = deepcopy(data)
    *parents, last = path
    around = data
    for key in parents:
        around = around[key]
    around[last] = value
    return data


def _limits(schema, key=None):
    """Return the limits of numbers in a schema, or in its properties with a name."""
    for name, item in schema.items() if isinstance(schema, dict) else enumerate(schema):
        if key is None and name in ('minimum', 'exclusiveMinimum', 'maximum', 'exclusiveMaximum'):
            yield item
        elif name == 'properties' and key in item:
            yield from _limits(item[key])
        if isinstance(item, (dict, list)):
            yield from _limits(item, key)


def _wrong(kind, data, path):
    """Yield wrong values, and an unknown key, for a place in a file."""
    yield from WRONG
    for key in path:
        data = data[key]
    if isinstance(data, dict):
        yield {**data, 'wrong': 1}


def _wrong_and_limits(kind, data, path):
    """Yield also the limits of numbers at a place, and the numbers next to them."""
    yield from _wrong(kind, data, path)
    key = next(name for name in reversed(path) if isinstance(name, str))
    for limit in sorted(set(_limits(_generator().schema(kind), key))):
        # the schema does not say which numbers are too small to differ from 0
        step = 1 if isinstance(limit, int) else max(math.ulp(limit), TINY)
        yield from (limit - step, limit, limit + step)


@pytest.mark.parametrize('kind', [*FILES, 'case'])
def test_schema_files_are_up_to_date(kind):
    module = _generator()
    assert module.path(kind).read_text('utf-8') == module.text(kind), 'run python docs/schemas.py'


@pytest.mark.parametrize(
    ('kind', 'path'), [(kind, path) for kind, paths in FILES.items() for path in paths],
    ids=lambda item: getattr(item, 'name', item),
)
def test_shipped_file_fits_its_schema(kind, path):
    assert _fits(kind, read_yaml('file', path))
    if path.name == 'nav2_filters.yaml':
        return
    first = path.read_text('utf-8').partition('\n')[0]
    named = first.removeprefix('# yaml-language-server: $schema=')
    assert (path.parent / named).resolve() == _generator().path(kind)


def test_case_in_the_documentation_fits_its_schema():
    text = (ROOT / 'docs' / 'VALIDATION.md').read_text('utf-8')
    (block,) = re.findall(r'```yaml\n(title: .*?)```', text, re.DOTALL)
    assert _fits('case', parse_yaml('case', block))


@pytest.mark.parametrize(
    ('kind', 'data'), [(kind, data) for kind, files in VALID.items() for data in files]
)
def test_schema_and_program_accept_valid_files(kind, data, folder):
    path = folder / f'{kind}.yaml'
    path.write_text(dump_yaml(data))
    assert read_yaml(kind, path) == data
    assert _refusal(kind, data, folder) is None
    _validator(kind)(deepcopy(data))


def _keys(schema):
    """Yield names of all properties in a schema, except those of constants."""
    for name, item in schema.items() if isinstance(schema, dict) else ():
        if name == 'properties':
            yield from item
            for key, below in item.items():
                yield from _keys(below) if key != 'constants' else ()
        else:
            yield from _keys(item)
    for item in schema if isinstance(schema, list) else ():
        yield from _keys(item)


def test_valid_files_have_every_key():
    tried = {kind: set() for kind in VALID}
    for kind, files in VALID.items():
        for data in files:
            tried[kind].update(key for path in _places(data) for key in path)
    # both have the same constants and distributions
    tried['case'] |= tried['scene']
    for kind, keys in tried.items():
        assert set(_keys(_generator().schema(kind))) <= keys


@pytest.mark.parametrize(
    'values', [_wrong, pytest.param(_wrong_and_limits, marks=pytest.mark.nightly)]
)
@pytest.mark.parametrize(
    ('kind', 'number'), [(kind, number) for kind in VALID for number in range(len(VALID[kind]))]
)
def test_schema_and_parser_agree_on_wrong_values(kind, number, values, folder):
    valid = VALID[kind][number]
    for path in _places(valid):
        if values is _wrong and (kind, path[0]) in SHARED:
            continue
        place = kind + ''.join(f'[{key}]' if isinstance(key, int) else f'.{key}' for key in path)
        for value in values(kind, valid, path):
            data = _with(valid, path, value)
            refusal, fits = _refusal(kind, data, folder), _fits(kind, data)
            if not fits:
                # an editor has to accept every file that the program accepts
                assert refusal is not None, f'{place}: only the schema refuses {data}'
            elif not DEPENDENT.fullmatch(place):
                assert refusal is None, f'{place}: the schema accepts {data}'


#: Parameters are never mappings; in JSON an integer is also a valid double.
@pytest.mark.parametrize('value', ['wrong', True, 0.5, -1e300, 1e300, ['wrong'], -1, 2**62])
def test_schema_and_node_agree_on_wrong_parameters(value):
    context = rclpy.Context()
    start_ros(['--ros-args'], context=context, domain_id=own_domain('graph'))
    specs = (*parameters.LIFECYCLE, *parameters.SOURCES, *parameters.PARAMETERS)
    specs += parameters.constant_parameters(constants_of(None))
    given = [Parameter(spec.name, value=value) for spec in specs]
    node = rclpy.create_node('lava', context=context, parameter_overrides=given)
    try:
        for spec in specs:
            if type(value) is int and isinstance(spec.default, float):
                continue
            try:
                spec.setting(node_parameters.declare(node, (spec,))[spec.name])
                is_taken = True
            except LavaError:
                is_taken = False
            groups = [{spec.name: value}]
            if spec.name.startswith(parameters.LAVA):
                groups.append({'lava': {spec.name.removeprefix(parameters.LAVA): value}})
            for group in groups:
                fits = _fits('parameters', {'/**': {'ros__parameters': group}})
                assert fits is is_taken, (group, is_taken)
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
