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

"""The launch files, performed with stand-ins, beside the node's and Nav2's parameters."""

from pathlib import Path
import re

import pytest
import yaml

from launch_files.stand_in import start
from lava_ros.maps.layer_files import load_layers
from lava_ros.ros.parameters import constant_parameters, LIFECYCLE, PARAMETERS, SOURCES
from lava_ros.scene import constants_of

ROOT = Path(__file__).parents[2]
LAVA = ROOT / 'launch/lava.launch.py'
KEEPOUT = ROOT / 'launch/nav2_keepout.launch.py'
SPECS = {spec.name: spec for spec in SOURCES + PARAMETERS}
FILTERS = yaml.safe_load((ROOT / 'params/nav2_filters.yaml').read_text(encoding='utf-8'))


@pytest.mark.parametrize('path', sorted((ROOT / 'launch').glob('*.launch.py')))
def test_every_argument_is_documented(path, monkeypatch):
    """Each has a description and a default, so that --show-args tells the whole story."""
    _, declared = start(monkeypatch, path)
    assert declared
    for argument in declared.values():
        assert argument.description and argument.default_value != (), argument.name


def test_the_node_gets_parameters_it_has(monkeypatch):
    """By name and type, and none that was not given: a file of parameters has those."""
    (node,), declared = start(monkeypatch, LAVA)
    assert node.command == ['lava_ros:lava_node']
    assert node.name == 'lava'
    assert node.parameters == {}
    given = {name: str(SPECS[name].default).lower() for name in declared if name in SPECS}
    given = {name: word for name, word in given.items() if word}
    (whole,), _ = start(monkeypatch, LAVA, **given)
    assert set(whole.parameters) == set(given)
    for name, value in whole.parameters.items():
        assert type(value) is type(SPECS[name].default), name
        assert value == SPECS[name].default, name
    (file,) = node.files
    assert Path(file) == ROOT / 'params/lava.yaml'


def test_arguments_reach_the_node(monkeypatch):
    """Words on the command line become values of the right type."""
    (node,), _ = start(monkeypatch, LAVA, scene='etna.yaml', namespace='etna')
    assert (node.namespace, node.parameters) == ('etna', {'scene': 'etna.yaml'})
    values = {
        'time_scale': 60.0, 'record': True, 'preset': 'fine', 'use_sim_time': True,
        'resume': 'bags/etna', 'bag_max_size': 10**9, 'bag_max_duration': 3600.0,
        'forecast_horizon': 6.0, 'ensemble_members': 32, 'deadline': 60.0, 'forecast_share': 0.5,
    }
    words = {name: str(value).lower() for name, value in values.items()}
    (node,), _ = start(monkeypatch, LAVA, **words)
    assert node.parameters == values
    assert all(type(node.parameters[name]) is type(value) for name, value in values.items())


def test_every_parameter_of_forecasts_is_an_argument(monkeypatch):
    """Also of the launch file that starts Nav2's masks."""
    names = {name for name in SPECS if name.startswith(('forecast_', 'ensemble_'))}
    assert len(names) >= 5
    for path in (LAVA, KEEPOUT):
        _, declared = start(monkeypatch, path)
        assert names | {'deadline'} <= set(declared)


def test_a_replay_takes_the_place_of_the_node(monkeypatch):
    """Both would publish the same topics; RViz comes with either."""
    processes, _ = start(monkeypatch, LAVA, replay='bags/demo', replay_rate='10', rviz='true')
    assert [process.command for process in processes] == [
        ['lava_ros:lava', 'replay', 'bags/demo', '--rate', '10'],
        ['rviz2:rviz2', '-d', str(ROOT / 'rviz/lava.rviz')],
    ]
    assert processes[1].parameters == {}
    assert [process.namespace for process in processes] == ['', '']
    processes, _ = start(monkeypatch, LAVA, replay='bags/demo', rviz='true', namespace='etna')
    assert [process.namespace for process in processes] == ['etna', 'etna']
    (_, viewer), _ = start(monkeypatch, LAVA, rviz='true', use_sim_time='true')
    assert viewer.parameters == {'use_sim_time': True}


@pytest.mark.parametrize(
    ('path', 'words', 'missing'),
    [
        (LAVA, {'rviz': 'true'}, 'rviz2'),
        (KEEPOUT, {'rviz': 'true'}, 'rviz2'),
        (KEEPOUT, {}, 'nav2_map_server'),
        (KEEPOUT, {}, 'nav2_lifecycle_manager'),
    ],
)
def test_nothing_starts_where_something_is_missing(monkeypatch, path, words, missing):
    """Launch would end and leave behind what runs already."""
    started = []
    with pytest.raises(LookupError, match=missing):
        start(monkeypatch, path, processes=started, missing=missing, **words)
    assert started == []


@pytest.mark.parametrize('namespace', ['', 'etna', '/etna'])
def test_masks_are_named_where_they_are(monkeypatch, namespace):
    """The servers are in the namespace of the node, and speak of masks there."""
    processes, _ = start(monkeypatch, KEEPOUT, namespace=namespace)
    assert {process.namespace for process in processes} == {namespace}
    space = f'/{namespace}'.replace('//', '/').rstrip('/')
    by_name = {process.name: process for process in processes}
    for word in ('keepout', 'speed'):
        topic = by_name[f'{word}_filter_info_server'].parameters['mask_topic']
        assert topic == f'{space}/{word}_mask'


def test_the_replay_command_takes_its_arguments(monkeypatch):
    """The words after the executable parse as `lava` parses them."""
    from lava_ros.cli.manual import parsed

    (replay,), _ = start(monkeypatch, LAVA, replay='bags/demo')
    args = parsed(replay.command[1:])
    assert (args.command, args.bag, args.rate) == ('replay', 'bags/demo', 1.0)


def test_keepout_starts_the_masks_and_those_who_speak_of_them(monkeypatch):
    """The node with both masks, two info servers and their manager, all with real files."""
    processes, declared = start(monkeypatch, KEEPOUT, scene='etna.yaml')
    by_name = {process.name: process for process in processes}
    assert by_name['lava'].parameters['msg_config'] == 'nav2_speed.yaml'
    assert by_name['lava'].parameters['scene'] == 'etna.yaml'
    assert {'time_scale', 'rviz', 'replay'} <= set(declared)
    servers = [name for name in by_name if name.endswith('_info_server')]
    manager = by_name['lifecycle_manager_lava_filters']
    assert manager.command == ['nav2_lifecycle_manager:lifecycle_manager']
    managed = FILTERS['/**/lifecycle_manager_lava_filters']['ros__parameters']['node_names']
    assert servers == managed
    for process in processes[1:]:
        assert [Path(file) for file in process.files] == [ROOT / 'params/nav2_filters.yaml']
        assert f'/**/{process.name}' in FILTERS


@pytest.mark.parametrize('word', ['keepout', 'speed'])
def test_filters_hear_of_masks_that_are_published(word):
    """Info server, filter and layer agree on topics; the values are those of the masks."""
    info = FILTERS[f'/**/{word}_filter_info_server']['ros__parameters']
    assert set(info) == {'type', 'filter_info_topic', 'mask_topic', 'base', 'multiplier'}
    assert info['type'] == {'keepout': 0, 'speed': 1}[word]
    assert (info['base'], info['multiplier']) == (0.0, 1.0)
    published = {
        f'/{layer.topic}': layer for layer in load_layers(ROOT / 'msg_configs/nav2_speed.yaml')
    }
    layer = published[info['mask_topic']]
    assert (layer.qos.reliability, layer.qos.durability) == ('reliable', 'transient_local')
    costmaps = [FILTERS[f'{name}_costmap'][f'{name}_costmap']['ros__parameters']
                for name in ('global', 'local')]
    users = [costmap for costmap in costmaps if f'{word}_filter' in costmap['filters']]
    assert users
    for costmap in users:
        filter_ = costmap[f'{word}_filter']
        assert filter_['plugin'] == f'nav2_costmap_2d::{word.capitalize()}Filter'
        assert filter_['filter_info_topic'] == info['filter_info_topic']
    assert costmaps[0]['lava_layer']['map_topic'] in published
    assert 'lava_layer' in costmaps[0]['plugins']
    assert costmaps[0]['trinary_costmap'] is False


def test_the_parameter_file_is_one_for_the_node(tmp_path):
    """ROS reads every parameter of the node from it, with its default; a comment may be removed.

    The constants of the lava are comments: set there, they would replace those of a scene.
    """
    from rclpy.parameter import parameter_dict_from_yaml_file

    path = ROOT / 'params/lava.yaml'
    constants = constant_parameters(constants_of(None))
    own = {spec.name: spec.default for spec in LIFECYCLE + SOURCES + PARAMETERS}
    read = parameter_dict_from_yaml_file(str(path), use_wildcard=True)
    assert set(read) == set(own)
    complete = tmp_path / 'complete.yaml'
    text = path.read_text(encoding='utf-8')
    complete.write_text(re.sub(r'^    # ([\w.]+: \S+)$', r'    \1', text, flags=re.MULTILINE))
    read = parameter_dict_from_yaml_file(str(complete), use_wildcard=True)
    expected = own | {spec.name: spec.default for spec in constants}
    values = yaml.safe_load(complete.read_text(encoding='utf-8'))['/**']['ros__parameters']
    assert set(read) == set(values) == set(expected)
    for name, value in values.items():
        assert (type(value), value) == (type(expected[name]), expected[name]), name
