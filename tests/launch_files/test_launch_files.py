# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Launch files performed with stand-ins, compared with the parameters of the node and Nav2."""

from pathlib import Path
import re
import runpy
import sys

import pytest
import yaml

from launch_files.stand_in import Context, start
from lava_ros.cli.parser import parse_command_line
from lava_ros.layers.layer_files import load_layers
from lava_ros.ros.parameters import constant_parameters, LIFECYCLE, PARAMETERS, SOURCES
from lava_ros.scene import constants_of
from scripts import load_script

ROOT = Path(__file__).parents[2]
LAVA = ROOT / 'launch/lava.launch.py'
KEEPOUT = ROOT / 'launch/nav2_keepout.launch.py'
BOTH, MASKS = (LAVA, KEEPOUT), (KEEPOUT,)
CONSTANTS = constant_parameters(constants_of(None))
SPECS = {spec.name: spec for spec in LIFECYCLE + SOURCES + PARAMETERS + CONSTANTS}
FILTERS = yaml.safe_load((ROOT / 'params/nav2_filters.yaml').read_text(encoding='utf-8'))


@pytest.mark.parametrize('path', sorted((ROOT / 'launch').glob('*.launch.py')))
def test_every_parameter_is_a_documented_argument(path, monkeypatch):
    _, declared = start(monkeypatch, path)
    assert set(SPECS) | {'log_level', 'respawn', 'params_file'} <= set(declared)
    for argument in declared.values():
        assert argument.description and argument.default_value != (), argument.name


def test_only_given_arguments_become_parameters(monkeypatch):
    (node,), _ = start(monkeypatch, LAVA)
    assert node.command == ['lava_ros:lava_node', '--ros-args', '--log-level', 'info']
    assert node.name == 'lava'
    assert node.parameters == {}
    given = {name: yaml.safe_dump(spec.default, default_flow_style=True).removesuffix('...\n')
             for name, spec in SPECS.items() if spec.default != ''}
    (whole,), _ = start(monkeypatch, LAVA, **given)
    assert set(whole.parameters) == set(given)
    for name, value in whole.parameters.items():
        assert type(value) is type(SPECS[name].default), name
        assert value == SPECS[name].default or f'{SPECS[name].default}\n' == value, name
    (file,) = node.files
    assert Path(file) == ROOT / 'params/lava.yaml'
    (node,), _ = start(monkeypatch, LAVA, scene='etna.yaml', namespace='etna')
    assert (node.namespace, node.parameters) == ('etna', {'scene': 'etna.yaml'})


def test_launch_arguments_are_up_to_date():
    module = load_script(ROOT / 'docs/parameters.py')
    text = (ROOT / 'launch/lava_parameters.yaml').read_text(encoding='utf-8')
    assert module.launch_arguments() == text, 'run python docs/parameters.py'


@pytest.mark.parametrize(('paths', 'arguments', 'words'), [
    (BOTH, {'scen': 'etna.yaml'}, 'scen: unknown argument; similar: scene'),
    (BOTH, {'xyz': '1'}, 'xyz: unknown argument'),
    (BOTH, {'time_scale': 'fast'}, "time_scale is 'fast', expected a number"),
    (BOTH, {'ensemble_members': '2.5'}, "ensemble_members is '2.5', expected a whole number"),
    (BOTH, {'record': 'maybe'}, "record is 'maybe', expected true or false"),
    (BOTH, {'layers_on': 'lava_points'}, "layers_on is 'lava_points', expected a list"),
    (BOTH, {'layers_on': '[1]'}, 'layers_on .* expected a list'),
    (BOTH, {'params_file': 'none.yaml'}, "params_file is 'none.yaml', expected a file"),
    (BOTH, {'replay': 'a', 'scene': 'b', 'record': 'true'}, 'replay excludes scene, record: a'),
    (MASKS, {'filters_file': 'none.yaml'}, "filters_file is 'none.yaml', expected a file"),
    (MASKS, {'msg_config': 'none.yaml'}, "msg_config is 'none.yaml', .* a file of layers"),
    (BOTH, {'rviz': 'true', 'missing': 'rviz2'}, 'rviz2'),
    (MASKS, {'missing': 'nav2_map_server'}, 'nav2_map_server'),
    (MASKS, {'missing': 'nav2_lifecycle_manager'}, 'nav2_lifecycle_manager'),
    # no mask would be published, although the servers announce it
    (MASKS, {'msg_config': 'default.yaml'}, 'one of the layers keepout_mask, padded_keep'),
])
def test_wrong_arguments_and_missing_packages_start_nothing(monkeypatch, paths, arguments, words):
    started = []
    for path in paths:
        with pytest.raises((RuntimeError, LookupError), match=words):
            start(monkeypatch, path, processes=started, **arguments)
    assert started == []


def test_accepts_further_arguments_of_an_including_file(monkeypatch):
    start(monkeypatch, LAVA, scene='etna.yaml')
    module = runpy.run_path(str(LAVA))
    monkeypatch.setattr(sys, 'argv', ['ros2', 'launch', 'robot.launch.py', 'robot:=r1'])
    context = Context({}, ['robot:=r1'])
    module['reject_unknown_arguments'](context, str(LAVA), module['declare_arguments']())


def test_replay_replaces_the_node(monkeypatch):
    processes, _ = start(monkeypatch, LAVA, replay='bags/demo', replay_rate='10', rviz='true')
    assert [process.command for process in processes] == [
        ['lava_ros:lava', 'ros', 'replay', 'bags/demo', '--rate', '10'],
        ['rviz2:rviz2', '-d', str(ROOT / 'rviz/lava.rviz')],
    ]
    assert processes[1].parameters == {}
    args = parse_command_line(processes[0].command[1:])
    assert (args.command, args.bag, args.rate) == ('ros replay', 'bags/demo', 10.0)
    assert [process.namespace for process in processes] == ['', '']
    processes, _ = start(monkeypatch, LAVA, replay='bags/demo', rviz='true', namespace='etna')
    assert [process.namespace for process in processes] == ['etna', 'etna']
    (_, viewer), _ = start(monkeypatch, LAVA, rviz='true', use_sim_time='true')
    assert viewer.parameters == {'use_sim_time': True}


def test_rviz_shows_the_frame_of_the_node(monkeypatch):
    (node, viewer), _ = start(monkeypatch, LAVA, rviz='true', frame_id='lava_map')
    assert node.parameters == {'frame_id': 'lava_map'}
    assert viewer.command[1:] == ['-d', str(ROOT / 'rviz/lava.rviz'), '-f', 'lava_map']


@pytest.mark.parametrize(('pushed', 'namespace', 'space'), [
    ('', '', ''),
    ('', 'etna', '/etna'),
    ('', '/etna', '/etna'),
    ('/robot1', '', '/robot1'),
    ('/robot1', 'etna', '/robot1/etna'),
])
def test_mask_topics_are_in_the_namespace_of_the_node(monkeypatch, pushed, namespace, space):
    given = {'ros_namespace': pushed} if pushed else {}
    processes, _ = start(monkeypatch, KEEPOUT, namespace=namespace, **given)
    assert {process.namespace for process in processes} == {namespace}
    by_name = {process.name: process for process in processes}
    for word in ('keepout', 'padded_keepout', 'speed'):
        topic = by_name[f'{word}_filter_info_server'].parameters['mask_topic']
        assert topic == f'{space}/{word}_mask'


def test_keepout_starts_node_info_servers_and_manager(monkeypatch):
    processes, declared = start(monkeypatch, KEEPOUT, scene='etna.yaml')
    by_name = {process.name: process for process in processes}
    # a parameter file may set all others, but must not switch off a mask that is announced
    layers = {'msg_config': 'nav2_speed.yaml', 'layers_on': [''], 'layers_off': ['']}
    assert by_name['lava'].parameters == {'scene': 'etna.yaml', **layers}
    assert {'rviz', 'replay', 'filters_file'} <= set(declared)
    servers = [name for name in by_name if name.endswith('_info_server')]
    manager = by_name['lifecycle_manager_lava_filters']
    assert manager.command[0] == 'nav2_lifecycle_manager:lifecycle_manager'
    managed = FILTERS['/**/lifecycle_manager_lava_filters']['ros__parameters']['node_names']
    assert servers == managed
    assert manager.parameters['node_names'] == managed
    for process in processes[1:]:
        assert [Path(file) for file in process.files] == [ROOT / 'params/nav2_filters.yaml']
        assert f'/**/{process.name}' in FILTERS
        assert 'use_sim_time' not in process.parameters
    processes, _ = start(monkeypatch, KEEPOUT, use_sim_time='true')
    assert all(process.parameters['use_sim_time'] is True for process in processes)


@pytest.mark.parametrize(('arguments', 'words'), [
    ({'msg_config': 'nav2_keepout.yaml'}, ['keepout', 'padded_keepout']),
    ({'layers_off': '[padded_keepout_mask]'}, ['keepout', 'speed']),
    ({'msg_config': '{}/some.yaml'}, ['keepout']),
    ({'msg_config': '{}/some.yaml', 'layers_on': '[speed_mask]'}, ['keepout', 'speed']),
])
def test_only_masks_that_are_published_are_announced(monkeypatch, tmp_path, arguments, words):
    some = {'keepout_mask': {}, 'speed_mask': {'enabled': False}}
    (tmp_path / 'some.yaml').write_text(yaml.safe_dump({'layers': some}))
    given = {name: value.format(tmp_path) for name, value in arguments.items()}
    processes, _ = start(monkeypatch, KEEPOUT, **given)
    _, *servers, manager = processes
    names = [server.name for server in servers]
    assert names == [f'{word}_filter_info_server' for word in words]
    assert manager.parameters['node_names'] == names


@pytest.mark.parametrize(('word', 'costmaps_with_it'), [
    ('keepout', ['local']), ('padded_keepout', ['global']), ('speed', ['global']),
])
def test_filters_use_masks_that_are_published(word, costmaps_with_it):
    info = FILTERS[f'/**/{word}_filter_info_server']['ros__parameters']
    assert set(info) == {'type', 'filter_info_topic', 'mask_topic', 'base', 'multiplier'}
    kind = word.removeprefix('padded_')
    assert info['type'] == {'keepout': 0, 'speed': 1}[kind]
    assert (info['base'], info['multiplier']) == (0.0, 1.0)
    published = {
        f'/{layer.topic}': layer for layer in load_layers(ROOT / 'msg_configs/nav2_speed.yaml')
    }
    layer = published[info['mask_topic']]
    assert (layer.qos.reliability, layer.qos.durability) == ('reliable', 'transient_local')
    costmaps = {
        name: FILTERS[f'{name}_costmap'][f'{name}_costmap']['ros__parameters']
        for name in ('global', 'local')
    }
    users = []
    for name, costmap in costmaps.items():
        for filter_ in (costmap[item] for item in costmap['filters']):
            if filter_['filter_info_topic'] == info['filter_info_topic']:
                assert filter_['plugin'] == f'nav2_costmap_2d::{kind.capitalize()}Filter'
                users.append(name)
    assert users == costmaps_with_it
    for costmap in costmaps.values():
        layers = [item for item in costmap.values() if isinstance(item, dict)]
        # a static layer would replace the robot's own map
        assert 'nav2_costmap_2d::StaticLayer' not in [item['plugin'] for item in layers]


def test_parameter_file_has_every_parameter_with_its_default(tmp_path):
    from rclpy.parameter import parameter_dict_from_yaml_file

    # constants of the lava are comments: set there, they would replace those of a scene
    path, complete = ROOT / 'params/lava.yaml', tmp_path / 'complete.yaml'
    read = parameter_dict_from_yaml_file(str(path), use_wildcard=True)
    assert set(read) == set(SPECS) - {spec.name for spec in CONSTANTS}
    text = path.read_text(encoding='utf-8')
    complete.write_text(re.sub(r'^    # ([\w.]+: \S+)$', r'    \1', text, flags=re.MULTILINE))
    values = yaml.safe_load(complete.read_text(encoding='utf-8'))['/**']['ros__parameters']
    assert set(values) == set(SPECS)
    for name, value in values.items():
        assert (type(value), value) == (type(SPECS[name].default), SPECS[name].default), name
