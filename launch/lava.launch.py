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

"""Start the lava node: ros2 launch lava_ros lava.launch.py scene:=scene.yaml time_scale:=60.0."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

# name, default, type, description
ARGUMENTS = (
    ('scene', '', str, 'Scene file (YAML) to start with'),
    ('terrain_file', '', str, 'Terrain file to start with'),
    ('msg_config', 'default.yaml', str, 'How layers become messages'),
    ('device', '', str, 'cpu, cuda:0, ...; empty: automatic'),
    ('time_scale', '1.0', float, 'Simulated seconds per second'),
    ('end_time', '0.0', float, 'Simulated time to stop at [s]; 0: never'),
    ('record', 'false', bool, 'Record from the first terrain on'),
    ('bag_directory', '', str, 'Bag to record to; empty: bags/<date and time>'),
    ('use_sim_time', 'false', bool, 'Follow /clock'),
)


def generate_launch_description():
    """Describe the arguments and the node they are the parameters of."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('namespace', default_value='', description='Of the node'),
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, default, _, description in ARGUMENTS
            ),
            Node(
                package='lava_ros',
                executable='lava_node',
                name='lava',
                namespace=LaunchConfiguration('namespace'),
                output='screen',
                parameters=[
                    {
                        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
                        for name, _, kind, _ in ARGUMENTS
                    }
                ],
            ),
        ]
    )
