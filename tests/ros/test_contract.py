# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The interfaces of a running node are those in docs/ROS.md and in the views.

A publisher's depth is not visible in the graph: that of layers is compared with their file.
"""

import importlib.util
import json
from pathlib import Path
import re
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import GetAvailableTransitions
import pytest
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import Marker
import yaml

from lava_ros.bag import BagReader, LATCHED
from lava_ros.layers.layer_files import load_layers
from lava_ros.live.worker_status import WorkerState, WorkerStatus
from lava_ros.ros import diagnostics
from lava_ros.ros.codec import message_class
from lava_ros.runs.map_bag import RunBag
from lava_ros.scene import Lava, Scene
from layers.test_layers import EASTWARD as SNAPSHOT
from recording import growing, snapshot_at, TERRAIN, VENT
from ros.local_node import COARSE
from scripts import load_script

ROOT = Path(__file__).parents[2]
PAGE = ROOT / 'docs' / 'ROS.md'
FILE = ROOT / 'params' / 'lava.yaml'

#: Packages of topics that exist only with them.
PACKAGES = {
    'terrain_grid': 'grid_map_msgs', 'lava_grid_map': 'grid_map_msgs', '/tf_static': 'tf2_msgs',
}
MISSING = {name for name in PACKAGES.values() if importlib.util.find_spec(name) is None}

#: Layers that are off by default.
OPTIONAL = [
    layer.name
    for layer in load_layers(ROOT / 'msg_configs' / 'default.yaml')
    if not layer.enabled and PACKAGES.get(layer.topic) not in MISSING
]

#: Parameters of the node, in addition to those of ``COARSE``.
GIVEN = {
    **COARSE, 'msg_config': 'default.yaml', 'use_sim_time': True, 'autostart': False,
    'layers_on': OPTIONAL, 'forecast_horizon': 1.0, 'ensemble_members': 4,
    'places': [str(ROOT / 'examples' / 'places.csv')],
}

#: Parameters of every node, which are not in the table.
OF_EVERY_NODE = {'use_sim_time', 'start_type_description_service'}

TYPES = {'bool': bool, 'integer': int, 'double': float, 'string': str, 'string_array': list}


def rows(heading):
    """Return the rows of the table under a heading, without code marks."""
    text = PAGE.read_text(encoding='utf-8').partition(f'\n## {heading}\n')[2].partition('\n## ')[0]
    lines = [line for line in text.splitlines() if line.startswith('|')]
    table = [[cell.strip().strip('`') for cell in line.split('|')[1:-1]] for line in lines]
    assert len({len(row) for row in table}) == 1, heading
    return table[2:]


def full_name(name):
    return f'/lava{name[1:]}' if name.startswith('~') else '/' + name.lstrip('/')


def endpoints(node, name):
    """Return type, reliability and durability of a node's endpoints on a topic of the graph.

    Two subscriptions to a topic have the durability ``TRANSIENT_LOCAL AND VOLATILE``.
    """
    found = {}
    for kind, infos in (
        ('publishers', node.get_publishers_info_by_topic(name)),
        ('subscriptions', node.get_subscriptions_info_by_topic(name)),
    ):
        own = [info for info in infos if info.node_name == 'lava']
        if own:
            (message,) = {info.topic_type for info in own}
            (reliability,) = {info.qos_profile.reliability.name for info in own}
            durability = ' AND '.join(sorted(info.qos_profile.durability.name for info in own))
            found[kind] = {
                'type': message, 'reliability': reliability, 'durability': durability,
            }
    return found


def parameters_of(node):
    """Return value and description of each parameter by name."""
    names = node.list_parameters([], 0).names
    found = {}
    for item, descriptor in zip(
        node.get_parameters(names), node.describe_parameters(names), strict=True
    ):
        limits = [*descriptor.floating_point_range, *descriptor.integer_range]
        found[item.name] = {
            'type': item.type_.name.lower(), 'value': item.value,
            'read_only': descriptor.read_only, 'description': descriptor.description,
            'range': [limits[0].from_value, limits[0].to_value] if limits else None,
        }
    return found


@pytest.fixture(scope='module')
def shown(module_local):
    """Return the interfaces of a node with every optional layer."""
    local = module_local(**GIVEN)
    assert local.change('configure'), local.log
    # discovery is complete
    local.names()
    found = {'publishers': {}, 'subscriptions': {}}
    for topic, _ in local.node.get_topic_names_and_types():
        for kind, endpoint in endpoints(local.node, topic).items():
            found[kind][topic] = endpoint
    answer = local.ask(GetAvailableTransitions, '/lava/get_transition_graph')
    return {
        **found,
        'services': dict(local.node.get_service_names_and_types_by_node('lava', '/')),
        'parameters': parameters_of(local.node),
        'transitions': {
            (item.transition.label, item.start_state.label, item.goal_state.label)
            for item in answer.available_transitions
        },
    }


@pytest.mark.parametrize(('kind', 'way'), [('publishers', 'out'), ('subscriptions', 'in')])
def test_topics_are_those_of_the_table(shown, kind, way):
    expected = {}
    for name, direction, kind_of_message, qos, _, meaning in rows('Topics'):
        assert direction in ('in', 'out'), name
        assert meaning, name
        if name in PACKAGES:
            assert f'where {PACKAGES[name]} is installed' in meaning
            if PACKAGES[name] in MISSING:
                continue
        reliability, durability, _ = qos.upper().split(', ')
        if direction == way:
            expected[full_name(name)] = {
                'type': kind_of_message, 'reliability': reliability, 'durability': durability,
            }
    assert shown[kind] == expected


@pytest.mark.parametrize('name', ['default.yaml', 'forecast.yaml'])
def test_layers_of_the_files_are_those_of_the_table(name):
    table = {row[0]: row for row in rows('Topics')}
    for layer in load_layers(ROOT / 'msg_configs' / name):
        _, way, message, qos, _, meaning = table[layer.topic]
        assert (way, message) == ('out', layer.message)
        assert qos == f'{layer.qos.reliability}, {layer.qos.durability}, {layer.qos.depth}'
        assert ('off unless in `layers_on' in meaning) is not layer.enabled
        assert ('with `forecast_horizon' in meaning) is layer.is_forecast
        assert layer.rate == 1.0


def test_services_are_those_of_the_table(shown):
    table = rows('Services')
    assert all(meaning for _, _, meaning in table)
    assert shown['services'] == {full_name(name): [kind] for name, kind, _ in table}


def test_parameters_are_those_of_the_table(shown):
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
        # counts and fractions have no unit
        assert unit or kind != 'double' or name.startswith('lava.'), name
        expected = [float(limit) for limit in limits.split(' to ')] if limits else None
        assert item['range'] == (expected and pytest.approx(expected)), name


def test_table_and_file_of_parameters_are_up_to_date():
    module = load_script(PAGE.with_name('parameters.py'))
    text = PAGE.read_text(encoding='utf-8')
    assert module.page(text) == text, 'run python docs/parameters.py'
    assert module.file() == FILE.read_text(encoding='utf-8'), 'run python docs/parameters.py'


def test_transitions_are_those_of_the_table(shown):
    found = shown['transitions']
    # transitions after an unexpected error
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


#: Types of message that the displays of RViz show.
DISPLAYED = {
    'rviz_default_plugins/Map': 'nav_msgs/msg/OccupancyGrid',
    'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
}


@pytest.fixture(scope='module')
def rviz() -> dict[str, Any]:
    text = (ROOT / 'rviz/lava.rviz').read_text(encoding='utf-8')
    return yaml.safe_load(text)['Visualization Manager']


@pytest.fixture(scope='module')
def foxglove() -> dict[str, Any]:
    return json.loads((ROOT / 'foxglove/lava.json').read_text(encoding='utf-8'))


def _policy(words: str) -> str:
    return words.upper().replace(' ', '_')


def test_rviz_shows_what_the_node_publishes(rviz, shown):
    displays = [display for display in rviz['Displays'] if 'Topic' in display]
    assert {'hazard', 'height', 'vents_markers'} <= {item['Topic']['Value'] for item in displays}
    for display in displays:
        asked = display['Topic']
        offered = shown['publishers'][f'/{asked["Value"]}']
        assert offered == {
            'type': DISPLAYED[display['Class']],
            'reliability': _policy(asked['Reliability Policy']),
            'durability': _policy(asked['Durability Policy']),
        }
        # late subscribers get the last map
        assert offered['durability'] == 'TRANSIENT_LOCAL'
    assert rviz['Global Options']['Fixed Frame'] == 'map'
    maps = [item for item in displays if item['Class'] == 'rviz_default_plugins/Map']
    seen = [item['Topic']['Value'] for item in maps if item['Enabled'] and item['Value']]
    assert seen == ['relief', 'hazard']
    # translucent maps of lava are drawn on the relief
    for item in maps:
        is_ground = item['Topic']['Value'] == 'relief'
        assert item['Draw Behind'] is is_ground
        assert item['Color Scheme'] == ('map' if is_ground else 'costmap')
        assert 0.4 <= item['Alpha'] < 1.0


def test_rviz_publishes_clicks_to_the_topic_of_the_node(rviz, shown):
    (tool,) = [item for item in rviz['Tools'] if item['Class'].endswith('/PublishPoint')]
    asked = shown['subscriptions'][f'/{tool["Topic"]["Value"]}']
    assert asked['type'] == 'geometry_msgs/msg/PointStamped'
    assert asked['reliability'] == _policy(tool['Topic']['Reliability Policy'])
    assert asked['durability'] == _policy(tool['Topic']['Durability Policy']) == 'VOLATILE'


def _panels(node: Any) -> set[str]:
    return {node} if isinstance(node, str) else _panels(node['first']) | _panels(node['second'])


def test_foxglove_shows_topics_of_the_node(foxglove, shown):
    panels = foxglove['configById']
    assert _panels(foxglove['layout']) == set(panels)
    assert {'3D', 'Plot', 'RawMessages'} <= {name.split('!')[0] for name in panels}
    drawn = set(panels['3D!lava']['topics'])
    topics = set(drawn)
    for panel in panels.values():
        paths = [path['value'] for path in panel.get('paths', ())]
        paths += [panel[key] for key in ('topicPath', 'topicToRender') if key in panel]
        topics |= {path.split('.')[0] for path in paths}
    assert {'/hazard', '/height', '/diagnostics'} <= topics <= set(shown['publishers'])
    assert panels['3D!lava']['publish']['pointTopic'] in shown['subscriptions']
    layers = {f'/{item.topic}': item for item in load_layers(ROOT / 'msg_configs/default.yaml')}
    assert drawn & set(layers) == {'/hazard', '/height', '/temperature'}
    for topic in drawn & set(layers):
        assert layers[topic].record
        assert layers[topic].qos == LATCHED
    topics = panels['3D!lava']['topics']
    modes = {name: item['colorMode'] for name, item in topics.items() if 'colorMode' in item}
    assert modes.pop('/relief') == 'map' and set(modes.values()) == {'costmap'}


def test_foxglove_plots_numbers_of_the_diagnostics(foxglove):
    status = diagnostics.simulation_status(
        WorkerStatus(WorkerState.RUNNING), SNAPSHOT, is_active=True,
        frame_stamp_ns=0,
    )
    diagnostics.sign(DiagnosticArray(status=[status]), '/lava', 'cpu')
    values = {item.key: item.value for item in status.values}
    plots = [panel for panel in foxglove['configById'].values() if 'paths' in panel]
    assert plots
    for path in (path['value'] for panel in plots for path in panel['paths']):
        name, key = re.findall(r'"([^"]+)"', path)
        assert name == status.name
        assert float(values[key]) >= 0.0


def write_run(directory):
    """Write a bag as `lava run` does; return it."""
    scene = Scene(TERRAIN, (VENT,), Lava.paper())
    snapshot = snapshot_at(600.0, growing(600.0), TERRAIN)
    with RunBag(directory, scene, {}) as bag:
        bag.put_snapshot(scene, snapshot, {})
    return directory


@pytest.mark.parametrize('write', [write_run, lambda _: ROOT / 'bags/sample'])
def test_bags_have_the_topics_of_the_views(write, rviz, foxglove, tmp_path):
    bag = BagReader(write(tmp_path / 'bag'))
    first = {}
    for item in bag.messages():
        kind = message_class(bag.topics[item.topic].message_type)
        first.setdefault(item.topic, (item.stamp_ns, deserialize_message(item.data, kind)))
    drawn = {f'/{item["Topic"]["Value"]}' for item in rviz['Displays'] if 'Topic' in item}
    for topic in drawn | set(foxglove['configById']['3D!lava']['topics']):
        assert topic in first and bag.topics[topic].qos == LATCHED, topic
    stamp_ns, hazard = first['/hazard']
    assert all(first[topic][0] <= stamp_ns for topic in ('/relief', '/vents_markers'))
    relief, markers = (first[topic][1] for topic in ('/relief', '/vents_markers'))
    for name in ('width', 'height', 'resolution', 'origin'):
        assert getattr(relief.info, name) == getattr(hazard.info, name)
    frames = {item.header.frame_id for item in markers.markers if item.action == Marker.ADD}
    assert frames == {relief.header.frame_id} == {'map'}
    assert any(item.text for item in markers.markers)
