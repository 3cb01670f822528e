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

"""Keep a Nav2 robot out of the lava: the lava node with masks, and what tells Nav2 about them.

ros2 launch lava_ros nav2_keepout.launch.py scene:=etna.yaml time_scale:=60.0

It starts the node (lava.launch.py, all of whose arguments it takes) with the keepout and the speed
mask, and Nav2's costmap_filter_info_server for each of them. Nav2 itself is started as ever, with
the second part of params/nav2_filters.yaml among its parameters.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

# The servers, and the masks they speak of.
SERVERS = {
    'keepout_filter_info_server': 'keepout_mask',
    'speed_filter_info_server': 'speed_mask',
}

# Packages and executables of Nav2.
SERVER = {'package': 'nav2_map_server', 'executable': 'costmap_filter_info_server'}
MANAGER = {'package': 'nav2_lifecycle_manager', 'executable': 'lifecycle_manager'}


def _share(*words):
    return PathJoinSubstitution([FindPackageShare('lava_ros'), *words])


# name, default, description
ARGUMENTS = (
    ('msg_config', 'nav2_speed.yaml', 'Layers of the node; the servers speak of its masks'),
    ('filters_file', _share('params', 'nav2_filters.yaml'), 'Parameters of the servers (YAML)'),
    ('namespace', '', 'Namespace of the node, of the servers and of RViz'),
    ('use_sim_time', 'false', 'Follow /clock'),
)


def _check(context):
    """Fail before anything starts: launch would leave the node behind."""
    for executable in (SERVER, MANAGER):
        ExecutableInPackage(**executable).perform(context)


def generate_launch_description():
    """Describe the arguments and what is started with them."""
    use_sim_time = ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)
    namespace = LaunchConfiguration('namespace')
    parameters = [
        ParameterFile(LaunchConfiguration('filters_file')),
        {'use_sim_time': use_sim_time},
    ]
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, default, description in ARGUMENTS
            ),
            OpaqueFunction(function=_check),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(_share('launch', 'lava.launch.py')),
                launch_arguments=[
                    (name, LaunchConfiguration(name))
                    for name in ('msg_config', 'namespace', 'use_sim_time')
                ],
            ),
            *(
                Node(
                    **SERVER,
                    name=name,
                    namespace=namespace,
                    output='screen',
                    # Nav2 takes the name as it is, wherever its costmaps are.
                    parameters=[
                        *parameters,
                        {'mask_topic': PathJoinSubstitution(['/', namespace, mask])},
                    ],
                )
                for name, mask in SERVERS.items()
            ),
            Node(
                **MANAGER,
                namespace=namespace,
                name='lifecycle_manager_lava_filters',
                output='screen',
                parameters=parameters,
            ),
        ]
    )
