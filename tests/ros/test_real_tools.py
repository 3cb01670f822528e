# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A node with the ROS tools and Nav2 costmaps, at the root and in a namespace.

The tools are those of the shell, or of the folder ROS_TOOLS after sourcing its env.sh.
"""

import json
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time

import pytest
import yaml

from lava_ros.layers.layer_files import load_layers
from ros.conftest import Graph

ROOT = Path(__file__).parents[2]
PATIENCE = 100.0

SCENE = """
terrain: {file: st_helens.npz}
vents: [{position: [4050.0, 3300.0], discharge: 60.0, radius: 30.0}]
"""

#: Parameters of a robot's costmaps in addition to the shipped file.
ROBOT = {
    'global_frame': 'map',
    'robot_base_frame': 'base_link',
    'resolution': 0.5,
    'robot_radius': 0.5,
    'track_unknown_space': True,
    'publish_frequency': 2.0,
    'update_frequency': 2.0,
    'always_send_full_costmap': True,
    'static_layer': {
        'plugin': 'nav2_costmap_2d::StaticLayer', 'map_topic': '/map',
        'map_subscribe_transient_local': True,
    },
    'inflation_layer': {'plugin': 'nav2_costmap_2d::InflationLayer', 'inflation_radius': 1.0},
}

#: A costmap that moves with the robot, of fewer cells than the mask has; sides in metres.
WINDOW = {'rolling_window': True, 'width': 120, 'height': 110}

#: Speed of a moving robot [m/s], and its small window; sides in metres.
SPEED = 1.0
SMALL_WINDOW = {
    'rolling_window': True, 'width': 3, 'height': 3, 'resolution': 0.05, 'update_frequency': 5.0,
    'publish_frequency': 10.0, 'robot_base_frame': 'moving_robot', 'plugins': ['inflation_layer'],
}


def _environment():
    """Return the environment of the tools, None without tools."""
    folder = os.environ.get('ROS_TOOLS')
    if folder is None:
        return dict(os.environ) if shutil.which('ros2') else None
    output = subprocess.run(
        ['bash', '-c', '. "$0/env.sh" && env -0', folder], capture_output=True, check=True
    )
    return dict(item.split('=', 1) for item in output.stdout.decode().split('\0') if item)


TOOLS = _environment()
pytestmark = pytest.mark.skipif(TOOLS is None, reason='ros2 is not there (PATH, ROS_TOOLS)')


class Tools:
    """The tools in the domain of a graph, with the checkout as a package."""

    def __init__(self, graph, namespace):
        self.graph, self.prefix = graph, f'/{namespace}' * bool(namespace)
        self.node = f'{self.prefix}/lava'
        own = graph.listener('hazard').environment
        share = graph.directory / 'prefix/share'
        (share / 'ament_index/resource_index/packages').mkdir(parents=True, exist_ok=True)
        (share / 'ament_index/resource_index/packages/lava_ros').touch()
        program = graph.directory / 'prefix/lib/lava_ros/lava_node'
        program.parent.mkdir(parents=True, exist_ok=True)
        if not program.exists():
            # ros2 launch searches the share directory without following links
            for name in ('launch', 'msg_configs', 'params', 'rviz'):
                shutil.copytree(ROOT / name, share / 'lava_ros' / name)
            kept = ('LD_LIBRARY_PATH', 'PYTHONPATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE')
            lines = [
                f"export {name}='{own[name]}'" if name in own else f'unset {name}' for name in kept
            ]
            lines.append(f'exec "{sys.executable}" -m lava_ros.ros.node "$@"')
            program.write_text('#!/bin/sh\n' + '\n'.join(lines) + '\n', encoding='utf-8')
            program.chmod(0o755)
        names = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')
        prefixes = [str(graph.directory / 'prefix'), TOOLS.get('AMENT_PREFIX_PATH', '')]
        self.environment = {
            **TOOLS,
            **{name: own[name] for name in names},
            'AMENT_PREFIX_PATH': os.pathsep.join(filter(None, prefixes)),
            'HOME': str(graph.directory),
            'ROS_LOG_DIR': str(graph.directory / 'log'),
        }
        self._started = []

    def start(self, *words):
        child = subprocess.Popen(
            ['ros2', *words], cwd=self.graph.directory, env=self.environment,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )
        self._started.append(child)
        return child

    def ros2(self, *words):
        """Return the output of a tool that exits with 0; one that discovers nodes is slow."""
        end = time.monotonic() + PATIENCE
        while True:
            ended = subprocess.run(
                ['ros2', *words], cwd=self.graph.directory, env=self.environment,
                capture_output=True, text=True, timeout=PATIENCE, check=False,
            )
            if 'Node not found' not in ended.stderr or time.monotonic() > end:
                break
        assert ended.returncode == 0, ended.stdout + ended.stderr
        return ended.stdout

    def python(self, *words):
        """Return the output of a script of the Python of ROS, whatever its exit status is."""
        folder = os.environ.get('ROS_TOOLS')
        program = f'{folder}/venv/bin/python' if folder else 'python3'
        ended = subprocess.run(
            [program, *map(str, words)], cwd=self.graph.directory, env=self.environment,
            capture_output=True, text=True, check=False,
        )
        assert ended.stdout, ended.stderr
        return ended.stdout

    def wait_for_ends(self, topic, publishers, subscriptions):
        words = (f'Publisher count: {publishers}', f'Subscription count: {subscriptions}')
        end = time.monotonic() + PATIENCE
        while not all(word in (output := self.ros2('topic', 'info', topic)) for word in words):
            assert time.monotonic() < end, output

    def kill_node(self):
        """Kill the launched node, and nothing else."""
        output = subprocess.run(
            ['ps', '-o', 'pid=,args=', '--ppid', str(self.launched.pid)],
            capture_output=True, text=True, check=True,
        )
        (line,) = [item for item in output.stdout.splitlines() if 'lava_ros.ros.node' in item]
        os.kill(int(line.split()[0]), signal.SIGKILL)

    def end(self, child, number=signal.SIGINT):
        os.killpg(child.pid, number)
        try:
            child.communicate(timeout=20.0)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.communicate()

    def close(self):
        for child in reversed(self._started):
            if child.poll() is None:
                self.end(child)
        self.ros2('daemon', 'stop')


@pytest.fixture(scope='module', params=['', 'etna'])
def tools(tmp_path_factory, request):
    graph = Graph(tmp_path_factory.mktemp('graph'))
    result = Tools(graph, request.param)
    (graph.directory / 'scene.yaml').write_text(SCENE, encoding='utf-8')
    result.has_nav2 = 'nav2_costmap_2d' in result.ros2('pkg', 'list')
    name = 'nav2_keepout.launch.py' if result.has_nav2 else 'lava.launch.py'
    words = ('scene:=scene.yaml', 'device:=cpu', 'time_scale:=60.0', 'preset:=draft')
    words += ('record:=true', 'checkpoint_period:=1.0')
    words += (f'namespace:={request.param}',) * bool(request.param)
    launched = result.launched = result.start('launch', 'lava_ros', name, *words)
    received = ('hazard', 'keepout_mask')
    result.listener = graph.listener(*(f'{result.prefix}/{name}' for name in received))
    hazard = f'{result.prefix}/hazard'
    result.listener.wait_for_topic(hazard, lambda grid: grid['wet'] > 3, PATIENCE)
    assert launched.poll() is None
    # the daemon of the tools needs time for discovery
    assert any(result.node in result.ros2('node', 'list').split() for _ in range(20))
    yield result
    result.close()
    graph.close()


def test_command_line_reads_and_sets_the_node(tools):
    assert 'active' in tools.ros2('lifecycle', 'get', tools.node)
    tools.ros2('param', 'set', tools.node, 'time_scale', '30.0')
    assert '30.0' in tools.ros2('param', 'get', tools.node, 'time_scale')
    (tools.graph.directory / 'dump.yaml').write_text(tools.ros2('param', 'dump', tools.node))
    loaded = tools.ros2('param', 'load', tools.node, 'dump.yaml').splitlines()
    assert 'Set parameter lava.ground_diffusivity successful' in loaded
    # read-only parameters are not a failure of the file
    failed = [line for line in loaded if 'failed' in line]
    assert all('read-only' in line for line in failed), failed
    grid = tools.ros2('topic', 'echo', '--once', f'{tools.prefix}/hazard', '--field', 'info')
    assert 'width: 260' in grid
    answer = tools.ros2('service', 'call', f'{tools.node}/save', 'std_srvs/srv/Trigger')
    assert 'success=True' in answer
    assert 'successful' in tools.ros2('lifecycle', 'set', tools.node, 'deactivate')
    assert 'successful' in tools.ros2('lifecycle', 'set', tools.node, 'activate')


def test_rosbag2_recording_can_be_played_and_plotted(tools):
    bag = f'bag{tools.prefix.replace("/", "_")}'
    recorder = tools.start('bag', 'record', '-a', '-s', 'mcap', '-o', bag)
    # two subscriptions of the node, and the recorder's
    tools.wait_for_ends(f'{tools.prefix}/terrain', publishers=1, subscriptions=3)
    # two maps received since it started
    since = tools.listener.hear()
    tools.listener.wait(
        lambda _: sum('hazard' in item['topic'] for item in tools.listener.seen[since:]) > 4
    )
    tools.end(recorder)
    assert f'Topic: {tools.prefix}/terrain |' in tools.ros2('bag', 'info', bag)
    tools.ros2('bag', 'play', bag, '--rate', '50', '--topics', f'{tools.prefix}/terrain')
    plot = tools.graph.process('-m', 'lava_ros.cli.main', 'map', bag, '-o', f'{bag}.png')
    assert plot.wait_for_end(PATIENCE) == 0, plot.log


def _costmap(name, **values):
    """Return the parameters of a shipped costmap, ``global_costmap`` or ``local_costmap``."""
    shipped = yaml.safe_load((ROOT / 'params/nav2_filters.yaml').read_text(encoding='utf-8'))
    result = {**shipped[name][name]['ros__parameters'], **ROBOT}
    known = [item for item in result.get('plugins', ['inflation_layer']) if item in ROBOT]
    return {**result, 'plugins': known, **values}


def _place(tools, x, y):
    """Move the robot to a place."""
    words = ('--x', x, '--y', y, '--frame-id', 'map', '--child-frame-id', 'base_link')
    return tools.start('run', 'tf2_ros', 'static_transform_publisher', *words)


def _start_costmaps(tools, **costmaps):
    """Start and activate costmaps with these parameters by name, and return their topics."""
    for name, values in costmaps.items():
        path = tools.graph.directory / f'{name}.yaml'
        path.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}), encoding='utf-8')
        remaps = ('-r', f'__ns:={tools.prefix}/{name}', '-r', f'__node:={name}')
        words = ('nav2_costmap_2d', 'nav2_costmap_2d', '--ros-args', *remaps)
        tools.start('run', *words, '--params-file', str(path))
    managed = [f'{tools.prefix}/{name}/{name}' for name in costmaps]
    tools.start(
        'run', 'nav2_lifecycle_manager', 'lifecycle_manager', '--ros-args',
        '-r', f'__node:={"_".join(costmaps)}_manager',
        '-p', 'autostart:=true', '-p', 'bond_timeout:=0.0', '-p', f'node_names:={managed}',
    )
    return [f'{tools.prefix}/{name}/costmap' for name in costmaps]


def _wait_for_agreement(comparison, *, after=0):
    """Wait until each costmap has all of a mask newer than ``after``, and the robot's wall.

    Only the local costmap has no wall. Returns the number of the last compared mask.
    """
    numbers = []
    for name in ('static', 'rolling', 'local'):

        def is_whole(line, name=name):
            (walls, wall), (cells, lava) = line['wall'], line['lava']
            is_wall = walls == wall > 0 or name == 'local'
            is_named = line['topic'].endswith(f'/{name}/costmap') and line['mask'] > after
            return is_named and is_wall and cells == lava > 1000 and line['elsewhere'] == 0

        numbers.append(comparison.wait(is_whole, PATIENCE)['mask'])
    return max(numbers)


def test_nav2_costmaps_have_the_mask_and_the_wall(tools):
    if not tools.has_nav2:
        pytest.skip('Nav2 is not there')
    limit = tools.start('topic', 'echo', '--once', '/speed_limit', 'nav2_msgs/msg/SpeedLimit')
    assert any('/speed_limit' in tools.ros2('topic', 'list').split() for _ in range(20))
    away = _place(tools, '100', '100')
    topics = _start_costmaps(
        tools,
        static=_costmap('global_costmap', rolling_window=False),
        rolling=_costmap('global_costmap', **WINDOW),
        local=_costmap('local_costmap', **WINDOW),
    )
    comparison = tools.graph.comparison(f'{tools.prefix}/keepout_mask', *topics)
    # the limit is published once per change: both ends must exist before the robot is near lava
    tools.wait_for_ends('/speed_limit', publishers=2, subscriptions=1)
    tools.end(away)
    there = _place(tools, '4040', '3290')
    output = limit.communicate(timeout=PATIENCE)[0]
    assert 'percentage: true' in output, output
    speed = next(line for line in output.splitlines() if line.startswith('speed_limit:'))
    assert 10.0 <= float(speed.split()[1]) <= 50.0
    number = 0
    for _ in range(3):
        number = _wait_for_agreement(comparison, after=number)
    tools.end(there)
    _place(tools, '4090', '3310')
    tools.ros2('service', 'call', f'{tools.node}/pause', 'std_srvs/srv/SetBool', '{data: true}')
    comparison.hear()
    _wait_for_agreement(comparison)


def test_window_has_the_mask_under_a_moving_robot(tools):
    """The mask under the robot is lethal in every costmap, as late as its heartbeat may be.

    The robot does not move on before the costmap and the mask have arrived.
    """
    if not tools.has_nav2:
        pytest.skip('Nav2 is not there')
    tools.ros2('service', 'call', f'{tools.node}/pause', 'std_srvs/srv/SetBool', '{data: true}')
    (topic,) = _start_costmaps(tools, small=_costmap('local_costmap', **SMALL_WINDOW))
    (mask,) = [
        layer for layer in load_layers(ROOT / 'msg_configs/nav2_speed.yaml')
        if layer.name == 'keepout_mask'
    ]
    words = ('--speed', SPEED, '--heartbeat', mask.heartbeat)
    words += ('--steps', f'{tools.prefix}/{mask.topic}', topic)
    driven = tools.python(ROOT / 'docs/benchmarks/rolling_window.py', *words)
    counts = json.loads(driven)
    assert 0 < counts['whole'] == counts['costmaps'], driven


def test_paused_node_repeats_its_mask(tools):
    mask = f'{tools.prefix}/keepout_mask'
    tools.ros2('service', 'call', f'{tools.node}/pause', 'std_srvs/srv/SetBool', '{data: true}')
    output = tools.ros2('topic', 'info', '-v', mask)
    assert 'Deadline: 1000000000 nanoseconds' in output
    assert 'Liveliness lease duration: 1000000000 nanoseconds' in output
    tools.listener.hear()
    received = []
    for _ in range(3):
        received.append(tools.listener.wait_for_topic(mask, timeout=PATIENCE))
    assert received[-1] == received[-2]


def test_launch_restarts_a_killed_node_that_resumes(tools):
    tools.ros2('service', 'call', f'{tools.node}/pause', 'std_srvs/srv/SetBool', '{data: false}')
    node, since_ns, checkpoint = tools.node.strip('/'), 0, 0.0

    def wait_for_status(task, condition):
        return tools.listener.wait_for_status(task, condition, PATIENCE, node, since_ns)

    for _ in range(3):
        before = checkpoint + 60.0
        recorder = wait_for_status(
            'recorder',
            lambda item, before=before: float(item.get('checkpoint_time_s', 0.0)) > before,
        )
        checkpoint = float(recorder['checkpoint_time_s'])
        tools.kill_node()
        since_ns = time.time_ns()
        hazard = tools.listener.wait_for_topic(
            f'{tools.prefix}/hazard', lambda item, since_ns=since_ns: item['stamp_ns'] > since_ns,
            PATIENCE,
        )
        assert hazard['wet'] > 3
        status = wait_for_status('simulation', lambda item: 'simulated_time_s' in item)
        assert float(status['simulated_time_s']) >= checkpoint
        emitted = 60.0 * float(status['simulated_time_s'])
        assert float(status['volume_emitted_m3']) == pytest.approx(emitted, rel=1e-6)
    assert tools.launched.poll() is None
