# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Start the lava node or a replay of a bag, and RViz.

ros2 launch lava_ros lava.launch.py scene:=etna.yaml time_scale:=60.0 rviz:=true
ros2 launch lava_ros lava.launch.py scene:=etna.yaml forecast_horizon:=6.0 ensemble_members:=32
ros2 launch lava_ros lava.launch.py scene:=etna.yaml record:=true
ros2 launch lava_ros lava.launch.py resume:=bags/etna record:=true
ros2 launch lava_ros lava.launch.py replay:=bags/demo rviz:=true
ros2 launch lava_ros lava.launch.py --show-args

Every parameter of the node is an argument. A node that records is restarted if it is killed, and
resumes from its bag. If the node ends by itself, the whole launch ends.
"""

from difflib import get_close_matches
import os
from pathlib import Path
import sys
from uuid import uuid4

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode, Node
from launch_ros.parameter_descriptions import ParameterFile, ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare
import yaml

# Default and description of each parameter of the node, by name. The default determines the type.
# An argument that is not given leaves the value to the parameter file and to the node.
PARAMETERS = yaml.safe_load(Path(__file__).with_name('lava_parameters.yaml').read_text('utf-8'))
PARAMETERS['use_sim_time'] = {'default': False, 'description': 'Follow /clock'}

# Descriptions of the values of each type.
EXPECTED = {
    bool: 'true or false',
    int: 'a whole number',
    float: 'a number',
    str: 'a text',
    list: 'a list, such as [one, two]',
}

# Arguments that launch itself reads.
OF_LAUNCH = ('emulate_tty', 'ros_namespace', 'sigkill_timeout', 'sigterm_timeout')

# Arguments that a replay cannot have.
OF_SIMULATION = ('scene', 'terrain_file', 'resume', 'record')

# Time between the end of a killed node and its restart [s].
RESPAWN_DELAY = 1.0


def _share(*words):
    return PathJoinSubstitution([FindPackageShare('lava_ros'), *words])


# Other arguments: name, default, description, choices.
ARGUMENTS = (
    ('namespace', '', 'Namespace of the node, or of the replay, and of RViz', None),
    (
        'params_file',
        _share('params', 'lava.yaml'),
        'Parameters of the node (YAML); arguments take precedence over this file',
        None,
    ),
    (
        'log_level',
        'info',
        'Minimum level of the messages that the node logs',
        ['debug', 'info', 'warn', 'error', 'fatal'],
    ),
    (
        'respawn',
        '',
        'Restart the node when it is killed, and resume from the bag that it recorded; without '
        'a bag the eruption starts again at time 0; empty: true with record:=true, else false',
        ['', 'true', 'false', 'True', 'False'],
    ),
    ('replay', '', 'Bag to publish in place of the simulation; empty: none', None),
    ('replay_rate', '1.0', 'Speed of the replay', None),
    ('rviz', 'false', 'Start RViz as well', ['true', 'false', '1', '0', 'True', 'False']),
    ('rviz_config', _share('rviz', 'lava.rviz'), 'Configuration of RViz', None),
)


def declare_arguments():
    """Declare all arguments of this file."""
    described = [
        (name, '', f'{about["description"]} (the default of the node: {about["default"]!r})', None)
        for name, about in PARAMETERS.items()
    ]
    return [
        DeclareLaunchArgument(name, default_value=default, description=text, choices=choices)
        for name, default, text, choices in (*ARGUMENTS, *described)
    ]


def reject_unknown_arguments(context, file, declared):
    """Raise an error for unknown arguments on the command line; launch would ignore them."""
    if Path(file).name not in [Path(word).name for word in sys.argv]:
        # another launch file includes this one, and the arguments are for that file
        return
    known = [argument.name for argument in declared]
    for word in context.argv:
        name, sign, _ = word.partition(':=')
        if sign and name not in (*known, *OF_LAUNCH):
            close = get_close_matches(name, known, 3) or ['none']
            text = f'{name}: unknown argument; similar: {", ".join(close)} (--show-args lists all)'
            raise RuntimeError(text)


def existing_file(context, name):
    """Return the path in an argument if the file exists; launch would ignore a missing one."""
    path = LaunchConfiguration(name).perform(context)
    if not os.path.isfile(path):
        raise RuntimeError(f'{name} is {path!r}, expected a file of parameters')
    return path


def given_parameters(context):
    """Return the given parameters by name, checked and converted to their types."""
    result = {}
    for name, about in PARAMETERS.items():
        text = LaunchConfiguration(name).perform(context)
        if not text:
            continue
        kind = type(about['default'])
        if not _is_of(kind, text):
            raise RuntimeError(f'{name} is {text!r}, expected {EXPECTED[kind]}')
        value_type = list[str] if kind is list else kind
        result[name] = ParameterValue(LaunchConfiguration(name), value_type=value_type)
    return result


def _is_of(kind, text):
    if kind is str:
        return True
    try:
        value = float(text) if kind is float else yaml.safe_load(text)
    except (ValueError, yaml.YAMLError):
        return False
    return type(value) is kind and (kind is not list or all(isinstance(x, str) for x in value))


def _is_true(context, name):
    return LaunchConfiguration(name).perform(context).lower() in ('true', '1')


def _start(context):
    """Return the actions for the arguments."""
    given = given_parameters(context)
    params_file = existing_file(context, 'params_file')
    replay = LaunchConfiguration('replay').perform(context)
    unused = [name for name in OF_SIMULATION if replay and name in given]
    if unused:
        text = 'a replay has no simulation; leave out one or the other'
        raise RuntimeError(f'replay excludes {", ".join(unused)}: {text}')
    namespace = LaunchConfiguration('namespace')
    player = Node(
        package='lava_ros',
        executable='lava',
        namespace=namespace,
        output='screen',
        arguments=['ros', 'replay', replay, '--rate', LaunchConfiguration('replay_rate')],
    )
    is_default = not LaunchConfiguration('respawn').perform(context)
    respawns = _is_true(context, 'record' if is_default else 'respawn')
    # Every start of the node in this launch is the same run; another launch is another run.
    restart = {'restart_token': f'launch-{uuid4().hex}'} if respawns else {}

    def end(event, context):
        """Shut down if the node ended by itself: a restart would end in the same way."""
        if context.is_shutdown or (event.returncode < 0 and respawns):
            return None
        return Shutdown(reason=f'the lava node ended with status {event.returncode}')

    node = LifecycleNode(
        package='lava_ros',
        executable='lava_node',
        name='lava',
        namespace=namespace,
        output='screen',
        parameters=[ParameterFile(params_file), {**restart, **given}],
        arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
        respawn=respawns,
        respawn_delay=RESPAWN_DELAY,
        on_exit=end,
    )
    # Both would publish the same topics.
    started = [player if replay else node]
    if _is_true(context, 'rviz'):
        # Raises if RViz is missing, before launch starts a node and leaves it running.
        ExecutableInPackage(executable='rviz2', package='rviz2').perform(context)
        started.append(
            Node(
                package='rviz2',
                executable='rviz2',
                namespace=namespace,
                # the shipped configuration has the default frame
                arguments=[
                    '-d', LaunchConfiguration('rviz_config'),
                    *(['-f', LaunchConfiguration('frame_id')] if 'frame_id' in given else []),
                ],
                parameters=[{name: given[name] for name in ('use_sim_time',) if name in given}],
            )
        )
    return started


def generate_launch_description():
    """Return the launch description."""
    declared = declare_arguments()
    check = OpaqueFunction(
        function=lambda context: reject_unknown_arguments(context, __file__, declared)
    )
    return LaunchDescription([*declared, check, OpaqueFunction(function=_start)])
