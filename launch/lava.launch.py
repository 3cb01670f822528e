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
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare

# Parameters of the node: name, type, description. One that is not given is as the file of
# parameters or, without one there, the node has it; one that is given wins.
PARAMETERS = (
    ('scene', str, 'Scene file (YAML) to start with; empty: terrain and vents from topics'),
    ('terrain_file', str, 'Terrain to start with (GeoTIFF, ESRI ASCII grid, npz)'),
    ('resume', str, 'Bag to go on from its newest checkpoint, in place of a scene'),
    ('msg_config', str, 'How layers become messages: a path, or a name'),
    ('preset', str, 'Accuracy: draft, standard, fine or reference'),
    ('device', str, 'cpu, cuda:0, ...; empty: the first GPU, else the CPU'),
    ('time_scale', float, 'Simulated seconds per second of the clock'),
    ('end_time', float, 'Simulated time to stop at [s]; 0.0: never'),
    ('record', bool, 'Record from the first terrain on'),
    ('bag_directory', str, 'Bag to record to, a new folder; empty: bags/<date and time>'),
    ('bag_max_size', int, 'Size [bytes] at which the bag goes on in a new file; 0: never'),
    ('bag_max_duration', float, 'Time [s] at which it goes on in a new file; 0.0: never'),
    ('forecast_horizon', float, 'How far ahead forecasts look [h]; 0.0: none'),
    ('forecast_config', str, 'How forecasts become messages'),
    ('forecast_max_age', float, 'Age at which they are withdrawn [s]; 0.0: half of that'),
    ('forecast_share', float, 'Largest share of the device that they take'),
    ('ensemble_members', int, 'Members of ensembles beside forecasts; 0: none'),
    ('deadline', float, 'Time in which a forecast and its ensemble come [s]; 0.0: any'),
    ('use_sim_time', bool, 'Follow /clock'),
)


def _share(*words):
    return PathJoinSubstitution([FindPackageShare('lava_ros'), *words])


# Everything else: name, default, description.
ARGUMENTS = (
    ('namespace', '', 'Namespace of the node, or of the replay, and of RViz'),
    (
        'params_file',
        _share('params', 'lava.yaml'),
        'Parameters of the node (YAML); arguments that are given win over what stands there',
    ),
    ('replay', '', 'Bag to publish in place of the simulation; empty: none'),
    ('replay_rate', '1.0', 'Speed of the replay'),
    ('rviz', 'false', 'Start RViz as well'),
    ('rviz_config', _share('rviz', 'lava.rviz'), 'What RViz shows'),
)


def _start(context):
    """List what the arguments ask for."""
    values = {name: LaunchConfiguration(name) for name, *_ in PARAMETERS}
    given = {
        name: ParameterValue(values[name], value_type=kind)
        for name, kind, _ in PARAMETERS
        if values[name].perform(context)
    }
    replay = LaunchConfiguration('replay').perform(context)
    namespace = LaunchConfiguration('namespace')
    player = Node(
        package='lava_ros',
        executable='lava',
        namespace=namespace,
        output='screen',
        arguments=['replay', replay, '--rate', LaunchConfiguration('replay_rate')],
    )
    node = Node(
        package='lava_ros',
        executable='lava_node',
        name='lava',
        namespace=namespace,
        output='screen',
        parameters=[ParameterFile(LaunchConfiguration('params_file')), given],
    )
    # Both would publish the same topics.
    started = [player if replay else node]
    if LaunchConfiguration('rviz').perform(context).lower() in ('true', '1'):
        # Without RViz nothing shall start: launch would leave the node behind.
        ExecutableInPackage(executable='rviz2', package='rviz2').perform(context)
        started.append(
            Node(
                package='rviz2',
                executable='rviz2',
                namespace=namespace,
                arguments=['-d', LaunchConfiguration('rviz_config')],
                parameters=[{name: given[name] for name in ('use_sim_time',) if name in given}],
            )
        )
    return started


def generate_launch_description():
    """Describe the arguments and what is started with them."""
    arguments = [*ARGUMENTS, *((name, '', description) for name, _, description in PARAMETERS)]
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, default, description in arguments
            ),
            OpaqueFunction(function=_start),
        ]
    )
