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
