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

"""What RViz and Foxglove are told to show: topics of a running node, asked for as offered."""

import json
from pathlib import Path
import re
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
import pytest
import yaml

from lava_ros.bag.qos import QosProfile
from lava_ros.ros import diagnostics
from lava_ros.ros.worker_status import WorkerState, WorkerStatus
from maps.test_masks import SNAPSHOT

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent

#: Types of message that the displays of RViz show.
DISPLAYED = {
    'rviz_default_plugins/Map': 'nav_msgs/msg/OccupancyGrid',
    'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
}


@pytest.fixture(scope='module')
def node(graph) -> dict[str, Any]:
    """Publishers and subscriptions of a node with its default layers."""
    graph.node(device='cpu')
    looking = graph.process(str(HERE / 'graph_endpoints.py'), 'lava')
    return json.loads(looking.line(90.0))


@pytest.fixture(scope='module')
def rviz() -> dict[str, Any]:
    """What RViz reads."""
    text = (ROOT / 'rviz/lava.rviz').read_text(encoding='utf-8')
    return yaml.safe_load(text)['Visualization Manager']


@pytest.fixture(scope='module')
def foxglove() -> dict[str, Any]:
    """What Foxglove imports."""
    return json.loads((ROOT / 'foxglove/lava.json').read_text(encoding='utf-8'))


def _policy(words: str) -> str:
    return words.upper().replace(' ', '_')


def test_rviz_shows_topics_of_the_node(rviz, node):
    """Each display's topic is published, of a type it shows, and asked for as it is offered."""
    displays = [display for display in rviz['Displays'] if 'Topic' in display]
    assert {'hazard', 'height', 'vents_markers'} <= {item['Topic']['Value'] for item in displays}
    for display in displays:
        asked = display['Topic']
        offered = node['publishers'][f'/{asked["Value"]}']
        assert offered == {
            'type': DISPLAYED[display['Class']],
            'reliability': _policy(asked['Reliability Policy']),
            'durability': _policy(asked['Durability Policy']),
        }
        # A map that was published before RViz came is there at once.
        assert offered['durability'] == 'TRANSIENT_LOCAL'


def test_rviz_stands_in_the_frame_of_the_node(rviz):
    """The fixed frame is the node's, and hazard on the ground is what one sees first."""
    assert rviz['Global Options']['Fixed Frame'] == 'map'
    maps = [item for item in rviz['Displays'] if item['Class'] == 'rviz_default_plugins/Map']
    shown = [item['Topic']['Value'] for item in maps if item['Enabled'] and item['Value']]
    assert shown == ['relief', 'hazard']
    assert [item['Draw Behind'] for item in maps] == [True, False, False, False]


def test_rviz_clicks_go_where_the_node_listens(rviz, node):
    """Publish Point sends to the topic that opens vents, as reliably as the node asks."""
    (tool,) = [item for item in rviz['Tools'] if item['Class'].endswith('/PublishPoint')]
    asked = node['subscriptions'][f'/{tool["Topic"]["Value"]}']
    assert asked['type'] == 'geometry_msgs/msg/PointStamped'
    assert asked['reliability'] == _policy(tool['Topic']['Reliability Policy'])
    assert asked['durability'] == _policy(tool['Topic']['Durability Policy']) == 'VOLATILE'


def _panels(node: Any) -> set[str]:
    return {node} if isinstance(node, str) else _panels(node['first']) | _panels(node['second'])


def test_every_foxglove_panel_is_laid_out(foxglove):
    """The panels of the layout and those that are configured are the same."""
    assert _panels(foxglove['layout']) == set(foxglove['configById'])
    kinds = {name.split('!')[0] for name in foxglove['configById']}
    assert {'3D', 'Plot', 'RawMessages'} <= kinds


def test_foxglove_shows_topics_of_the_node(foxglove, node):
    """Topics of the 3D panel and of every path are published; clicks go where it listens."""
    panels = foxglove['configById']
    topics = set(panels['3D!lava']['topics'])
    for panel in panels.values():
        paths = [path['value'] for path in panel.get('paths', ())]
        paths += [panel[key] for key in ('topicPath', 'topicToRender') if key in panel]
        topics |= {path.split('.')[0] for path in paths}
    assert {'/hazard', '/height', '/diagnostics'} <= topics <= set(node['publishers'])
    assert panels['3D!lava']['publish']['pointTopic'] in node['subscriptions']


def test_foxglove_plots_what_the_diagnostics_say(foxglove):
    """The keys in the paths are keys of the simulation's status, and numbers."""
    status = diagnostics.simulation_status(
        WorkerStatus(WorkerState.RUNNING, '', 1.0, 1.0, False, 'cpu'),
        SNAPSHOT,
        is_active=True,
        wet_cells=1,
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


def test_the_bag_has_what_foxglove_shows(foxglove):
    """Topics of the layout that a layer publishes are recorded, latched."""
    from lava_ros.maps.layer_files import load_layers

    layers = {f'/{item.topic}': item for item in load_layers(ROOT / 'msg_configs/default.yaml')}
    shown = set(foxglove['configById']['3D!lava']['topics']) & set(layers)
    assert shown == {'/hazard', '/height', '/temperature'}
    for topic in shown:
        assert layers[topic].record
        assert layers[topic].qos == QosProfile(depth=1, durability='transient_local')
