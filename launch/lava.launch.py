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

"""Start the lava node, or a replay in its place, and RViz.

ros2 launch lava_ros lava.launch.py scene:=etna.yaml time_scale:=60.0 rviz:=true
ros2 launch lava_ros lava.launch.py scene:=etna.yaml forecast_horizon:=6.0 ensemble_members:=32
ros2 launch lava_ros lava.launch.py resume:=bags/etna record:=true
ros2 launch lava_ros lava.launch.py replay:=bags/demo rviz:=true
ros2 launch lava_ros lava.launch.py --show-args
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import (
    EqualsSubstitution,
    LaunchConfiguration,
    NotEqualsSubstitution,
    PathJoinSubstitution,
)
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

# Parameters of the node: name, default, type, description.
PARAMETERS = (
    ('scene', '', str, 'Scene file (YAML) to start with; empty: terrain and vents from topics'),
    ('terrain_file', '', str, 'Terrain to start with (GeoTIFF, ESRI ASCII grid, npz)'),
    ('resume', '', str, 'Bag to go on from its newest checkpoint, in place of a scene'),
    ('msg_config', 'default.yaml', str, 'How layers become messages: a path, or a name'),
    ('preset', 'standard', str, 'Accuracy: draft, standard, fine or reference'),
    ('device', '', str, 'cpu, cuda:0, ...; empty: the first GPU, else the CPU'),
    ('time_scale', '1.0', float, 'Simulated seconds per second of the clock'),
    ('end_time', '0.0', float, 'Simulated time to stop at [s]; 0.0: never'),
    ('record', 'false', bool, 'Record from the first terrain on'),
    ('bag_directory', '', str, 'Bag to record to, a new folder; empty: bags/<date and time>'),
    ('bag_max_size', '0', int, 'Size [bytes] at which the bag goes on in a new file; 0: never'),
    ('bag_max_duration', '0.0', float, 'Time [s] at which it goes on in a new file; 0.0: never'),
    ('forecast_horizon', '0.0', float, 'How far ahead forecasts look [h]; 0.0: none'),
    ('forecast_config', 'forecast.yaml', str, 'How forecasts become messages'),
    ('forecast_max_age', '0.0', float, 'Age at which they are withdrawn [s]; 0.0: half of that'),
    ('forecast_share', '1.0', float, 'Largest share of the device that they take'),
    ('ensemble_members', '0', int, 'Members of ensembles beside forecasts; 0: none'),
    ('deadline', '0.0', float, 'Time in which a forecast and its ensemble come [s]; 0.0: any'),
    ('use_sim_time', 'false', bool, 'Follow /clock'),
)


def _share(*words):
    return PathJoinSubstitution([FindPackageShare('lava_ros'), *words])


# Everything else: name, default, description.
ARGUMENTS = (
    ('namespace', '', 'Namespace of the node and of RViz'),
    (
        'params_file',
        _share('params', 'lava.yaml'),
        'Parameters of the node (YAML); what stands there wins over the arguments here',
    ),
    ('replay', '', 'Bag to publish in place of the simulation; empty: none'),
    ('replay_rate', '1.0', 'Speed of the replay'),
    ('rviz', 'false', 'Start RViz as well'),
    ('rviz_config', _share('rviz', 'lava.rviz'), 'What RViz shows'),
)


def generate_launch_description():
    """Describe the arguments and what is started with them."""
    replay = LaunchConfiguration('replay')
    values = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, _, kind, _ in PARAMETERS
    }
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, default, description in ARGUMENTS
            ),
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, default, _, description in PARAMETERS
            ),
            Node(
                package='lava_ros',
                executable='lava_node',
                name='lava',
                namespace=LaunchConfiguration('namespace'),
                output='screen',
                parameters=[values, ParameterFile(LaunchConfiguration('params_file'))],
                # Both would publish the same topics.
                condition=IfCondition(EqualsSubstitution(replay, '')),
            ),
            # A process and no Node: that would add arguments for ROS, which the command refuses.
            ExecuteProcess(
                cmd=[
                    ExecutableInPackage(executable='lava', package='lava_ros'),
                    'replay',
                    replay,
                    '--rate',
                    LaunchConfiguration('replay_rate'),
                ],
                output='screen',
                condition=IfCondition(NotEqualsSubstitution(replay, '')),
            ),
            Node(
                package='rviz2',
                executable='rviz2',
                namespace=LaunchConfiguration('namespace'),
                arguments=['-d', LaunchConfiguration('rviz_config')],
                parameters=[{'use_sim_time': values['use_sim_time']}],
                condition=IfCondition(LaunchConfiguration('rviz')),
            ),
        ]
    )
