# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Keep a Nav2 robot out of lava: the lava node with masks, and the servers of their filters.

ros2 launch lava_ros nav2_keepout.launch.py scene:=etna.yaml time_scale:=60.0 mask_margin:=25.0

This file includes lava.launch.py with all its arguments. The node publishes the keepout masks and
the speed mask, and a costmap_filter_info_server of Nav2 is started for each mask of msg_config.
Start Nav2 itself as usual, with the second part of params/nav2_filters.yaml in its parameters.
"""

from pathlib import Path
import runpy

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare
from launch_ros.utilities import make_namespace_absolute, prefix_namespace
import yaml

# The launch file of the node.
LAVA = runpy.run_path(str(Path(__file__).with_name('lava.launch.py')))

# Servers, and the layers of their masks.
SERVERS = {
    'keepout_filter_info_server': 'keepout_mask',
    'padded_keepout_filter_info_server': 'padded_keepout_mask',
    'speed_filter_info_server': 'speed_mask',
}

# Packages and executables of Nav2.
SERVER = {'package': 'nav2_map_server', 'executable': 'costmap_filter_info_server'}
MANAGER = {'package': 'nav2_lifecycle_manager', 'executable': 'lifecycle_manager'}


def _share(*words):
    return PathJoinSubstitution([FindPackageShare('lava_ros'), *words])


# name, default, description
ARGUMENTS = (
    ('msg_config', 'nav2_speed.yaml', 'Layers of the node; the servers announce its masks'),
    ('filters_file', _share('params', 'nav2_filters.yaml'), 'Parameters of the servers (YAML)'),
    ('namespace', '', 'Namespace of the node, of the servers and of RViz'),
    ('layers_on', '[""]', 'Layers of msg_config to publish even if disabled there'),
    ('layers_off', '[""]', 'Layers of msg_config not to publish even if enabled there'),
)


def _topics(context):
    """Return the topics of the layers that the node publishes, by layer."""
    name = LaunchConfiguration('msg_config').perform(context)
    # same search order as in the node
    shared = Path(_share('msg_configs', name).perform(context))
    path = Path(name) if Path(name).is_file() else shared
    on, off = (
        yaml.safe_load(LaunchConfiguration(field).perform(context)) or ()
        for field in ('layers_on', 'layers_off')
    )
    try:
        layers = yaml.safe_load(path.read_text(encoding='utf-8'))['layers']
        return {
            name: layer.get('topic', name)
            for name, layer in layers.items()
            if name in on or (layer.get('enabled', True) and name not in off)
        }
    except (OSError, yaml.YAMLError, AttributeError, KeyError, TypeError) as error:
        expected = 'a file of layers, or the name of one in msg_configs/'
        raise RuntimeError(f'msg_config is {name!r}, expected {expected} ({error!r})') from error


def _absolute(context, topic):
    """Return the absolute name of a topic of the node; Nav2 does not resolve names."""
    pushed = context.launch_configurations.get('ros_namespace')
    namespace = LaunchConfiguration('namespace').perform(context)
    return f'{make_namespace_absolute(prefix_namespace(pushed, namespace)).rstrip("/")}/{topic}'


def _start(context):
    """Return the node, a server for each mask and their manager, if all are installed."""
    # check first: an error after the node has started would leave it running
    for executable in (SERVER, MANAGER):
        ExecutableInPackage(**executable).perform(context)
    given = LAVA['given_parameters'](context)
    topics = _topics(context)
    masks = {server: topics[layer] for server, layer in SERVERS.items() if layer in topics}
    if not masks:
        name = LaunchConfiguration('msg_config').perform(context)
        expected = f'a file with one of the layers {", ".join(SERVERS.values())}'
        raise RuntimeError(f'msg_config is {name!r}, expected {expected}')
    common = {
        'namespace': LaunchConfiguration('namespace'),
        'output': 'screen',
        'arguments': ['--ros-args', '--log-level', LaunchConfiguration('log_level')],
    }
    parameters = [
        ParameterFile(LAVA['existing_file'](context, 'filters_file')),
        {name: given[name] for name in ('use_sim_time',) if name in given},
    ]
    return [
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(_share('launch', 'lava.launch.py')),
            launch_arguments=[
                (name, LaunchConfiguration(name))
                for name in ('msg_config', 'layers_on', 'layers_off', 'namespace')
            ],
        ),
        *(
            Node(
                **SERVER,
                **common,
                name=server,
                parameters=[*parameters, {'mask_topic': _absolute(context, topic)}],
            )
            for server, topic in masks.items()
        ),
        Node(
            **MANAGER,
            **common,
            name='lifecycle_manager_lava_filters',
            parameters=[*parameters, {'node_names': list(masks)}],
        ),
    ]


def generate_launch_description():
    """Return the launch description."""
    own = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, default, description in ARGUMENTS
    ]
    names = [name for name, *_ in ARGUMENTS]
    others = [item for item in LAVA['declare_arguments']() if item.name not in names]
    declared = [*own, *others]

    def check(context):
        return LAVA['reject_unknown_arguments'](context, __file__, declared)

    return LaunchDescription(
        [*declared, OpaqueFunction(function=check), OpaqueFunction(function=_start)]
    )
