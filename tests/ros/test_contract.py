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

"""docs/ROS.md is what a running node shows of itself, no more and no less.

A publisher's depth is not told over the wire: that of layers is compared with their file.
"""

import importlib.util
import json
from pathlib import Path

import pytest

from lava_ros.maps.layer_files import load_layers
from lava_ros.ros import grid_map

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent
PAGE = ROOT / 'docs' / 'ROS.md'

#: What is there only with grid_map_msgs.
GRID_MAP_TOPICS = {'terrain_grid', 'lava_grid_map'}
HAS_GRID_MAPS = grid_map.installed_classes() is not None

#: Every layer that is off by default.
OPTIONAL = [
    layer.name
    for layer in load_layers(ROOT / 'msg_configs' / 'default.yaml')
    if not layer.enabled and (HAS_GRID_MAPS or layer.topic not in GRID_MAP_TOPICS)
]

#: What the node of this test is told.
GIVEN = {
    'device': 'cpu',
    'use_sim_time': True,
    'layers_on': OPTIONAL,
    'forecast_horizon': 1.0,
    'ensemble_members': 4,
}

#: Parameters that every node has, which no table here describes.
OF_EVERY_NODE = {'use_sim_time', 'start_type_description_service'}

TYPES = {'bool': bool, 'integer': int, 'double': float, 'string': str, 'string_array': list}


def rows(heading):
    """The rows of the table under a heading, without the marks of code."""
    text = PAGE.read_text(encoding='utf-8').partition(f'\n## {heading}\n')[2].partition('\n## ')[0]
    lines = [line for line in text.splitlines() if line.startswith('|')]
    table = [[cell.strip().strip('`') for cell in line.split('|')[1:-1]] for line in lines]
    assert len({len(row) for row in table}) == 1, heading
    return table[2:]


def full_name(name):
    """A name as the graph has it."""
    return f'/lava{name[1:]}' if name.startswith('~') else '/' + name.lstrip('/')


@pytest.fixture(scope='module')
def shown(graph):
    """What a node with every optional layer shows."""
    node = graph.node(**GIVEN)
    looking = graph.process(str(HERE / 'graph_contract.py'), 'lava')
    found = json.loads(looking.line(90.0))
    assert node.end() == 0
    return found


@pytest.mark.parametrize(('kind', 'way'), [('publishers', 'out'), ('subscriptions', 'in')])
def test_topics(shown, kind, way):
    """Names, types and QoS are those of the table, both ways."""
    expected = {}
    for name, direction, kind_of_message, qos, _, meaning in rows('Topics'):
        assert direction in ('in', 'out'), name
        assert meaning, name
        if name in GRID_MAP_TOPICS:
            assert 'where grid_map_msgs is installed' in meaning
            if not HAS_GRID_MAPS:
                continue
        reliability, durability, _ = qos.upper().split(', ')
        if direction == way:
            expected[full_name(name)] = {
                'type': kind_of_message,
                'reliability': reliability,
                'durability': durability,
            }
    assert shown[kind] == expected


@pytest.mark.parametrize('name', ['default.yaml', 'forecast.yaml'])
def test_layers_of_the_files_are_in_the_table(name):
    """Each is there with the type, depth and state that its file gives it."""
    table = {row[0]: row for row in rows('Topics')}
    for layer in load_layers(ROOT / 'msg_configs' / name):
        _, way, message, qos, _, meaning = table[layer.topic]
        assert (way, message) == ('out', layer.message)
        assert qos == f'{layer.qos.reliability}, {layer.qos.durability}, {layer.qos.depth}'
        assert ('off unless in `layers_on' in meaning) is not layer.enabled
        assert ('with `forecast_horizon' in meaning) is layer.is_forecast
        assert layer.rate == 1.0


def test_services(shown):
    """Names and types are those of the table, both ways."""
    table = rows('Services')
    assert all(meaning for _, _, meaning in table)
    assert shown['services'] == {full_name(name): [kind] for name, kind, _ in table}


def test_parameters(shown):
    """Names, types, defaults, ranges, meanings and what may change are those of the table."""
    table = {row[0]: row for row in rows('Parameters')}
    found = {name: item for name, item in shown['parameters'].items() if name not in OF_EVERY_NODE}
    assert set(found) == set(table)
    assert {name for name in shown['parameters'] if name not in found} == OF_EVERY_NODE
    for name, (_, kind, default, limits, unit, changes, meaning) in table.items():
        item = found[name]
        assert item['type'] == kind, name
        value = json.loads(default)
        assert type(value) is TYPES[kind], name
        assert item['value'] == GIVEN.get(name, value), name
        assert item['read_only'] is (changes == 'no'), name
        assert changes in ('yes', 'no', 'at a reset'), name
        assert item['description'] == meaning.replace('\\', ''), name
        assert unit in item['description'], name
        # a number of things has no unit, and neither have parts of a whole
        assert unit or kind != 'double' or name.startswith('lava.'), name
        expected = [float(limit) for limit in limits.split(' to ')] if limits else None
        assert item['range'] == (expected and pytest.approx(expected)), name


def test_the_table_of_parameters_is_the_one_that_is_made():
    """docs/parameters.py would write the page as it is."""
    spec = importlib.util.spec_from_file_location('parameters', PAGE.with_name('parameters.py'))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = PAGE.read_text(encoding='utf-8')
    assert module.page(text) == text, 'run python docs/parameters.py'


def test_transitions(shown):
    """The transitions of the graph are those of the table, with what a refusal leads to."""
    found = {tuple(item) for item in shown['transitions']}
    # what nobody expected, and what comes of it
    error = 'errorprocessing'
    expected = {
        ('transition_error', error, 'finalized'),
        ('transition_failure', error, 'finalized'),
        ('transition_success', error, 'unconfigured'),
    }
    for label, start, goal, refused, _ in rows('Lifecycle'):
        (between,) = [item[2] for item in found if item[:2] == (label, start)]
        expected |= {
            (label, start, between),
            ('transition_success', between, goal),
            ('transition_failure', between, refused),
            ('transition_error', between, error),
        }
    assert found == expected
