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

"""ROS's own tools and Nav2's own costmaps on a node, at the root and in a namespace.

They are taken from the shell, or from the folder ROS_TOOLS whose env.sh sets it up. What the tools
are told by is tested without them in test_contract.py, test_layers.py and launch_files/.
"""

import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PATIENCE = 100.0

SCENE = """
terrain: {file: st_helens.npz}
vents: [{position: [4050.0, 3300.0], discharge: 60.0, radius: 30.0}]
"""

#: Costmaps with a static layer and both filters, and with the keepout filter alone.
COSTMAPS = ('static_costmap', 'filter_costmap')

#: What a costmap has to be told beside the file, here of the terrain's size.
COSTMAP = {
    'global_frame': 'map',
    'robot_base_frame': 'base_link',
    'width': 7800,
    'height': 7800,
    'resolution': 30.0,
    'robot_radius': 1.0,
    'publish_frequency': 2.0,
    'update_frequency': 2.0,
    'always_send_full_costmap': True,
    'trinary_costmap': False,
}


def _environment():
    """The environment of the tools, None where there are none."""
    folder = os.environ.get('ROS_TOOLS')
    if folder is None:
        return dict(os.environ) if shutil.which('ros2') else None
    said = subprocess.run(
        ['bash', '-c', '. "$0/env.sh" && env -0', folder], capture_output=True, check=True
    )
    return dict(item.split('=', 1) for item in said.stdout.decode().split('\0') if item)


TOOLS = _environment()
pytestmark = pytest.mark.skipif(TOOLS is None, reason='ros2 is not there (PATH, ROS_TOOLS)')


class Tools:
    """The tools in the domain of a graph, with the checkout as a package; what they started."""

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
            # ros2 launch looks in every folder of the share but follows no link
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
        """Start a tool that goes on."""
        child = subprocess.Popen(
            ['ros2', *words],
            cwd=self.graph.directory,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self._started.append(child)
        return child

    def say(self, *words):
        """What a tool says that ends with 0; one that looks for the node takes its time."""
        end = time.monotonic() + PATIENCE
        while True:
            ended = subprocess.run(
                ['ros2', *words],
                cwd=self.graph.directory,
                env=self.environment,
                capture_output=True,
                text=True,
                timeout=PATIENCE,
                check=False,
            )
            if 'Node not found' not in ended.stderr or time.monotonic() > end:
                break
        assert ended.returncode == 0, ended.stdout + ended.stderr
        return ended.stdout

    def wait_for_ends(self, topic, publishers, subscriptions):
        """Wait until a topic has so many of each."""
        words = (f'Publisher count: {publishers}', f'Subscription count: {subscriptions}')
        end = time.monotonic() + PATIENCE
        while not all(word in (said := self.say('topic', 'info', topic)) for word in words):
            assert time.monotonic() < end, said

    def end(self, child, number=signal.SIGINT):
        """End a tool and all that it started."""
        os.killpg(child.pid, number)
        try:
            child.communicate(timeout=20.0)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.communicate()

    def close(self):
        """End what still runs."""
        for child in reversed(self._started):
            if child.poll() is None:
                self.end(child)
        self.say('daemon', 'stop')


@pytest.fixture(scope='module', params=['', 'etna'])
def tools(graph, request):
    """A launched node of a namespace, with Nav2's filter servers where Nav2 is."""
    result = Tools(graph, request.param)
    (graph.directory / 'scene.yaml').write_text(SCENE, encoding='utf-8')
    result.has_nav2 = 'nav2_costmap_2d' in result.say('pkg', 'list')
    name = 'nav2_keepout.launch.py' if result.has_nav2 else 'lava.launch.py'
    words = ('scene:=scene.yaml', 'device:=cpu', 'time_scale:=60.0', 'preset:=draft')
    words += (f'namespace:={request.param}',) * bool(request.param)
    launched = result.start('launch', 'lava_ros', name, *words)
    heard = ('hazard', 'keepout_mask', *(f'{name}/costmap' for name in COSTMAPS))
    result.listener = graph.listener(*(f'{result.prefix}/{name}' for name in heard))
    hazard = f'{result.prefix}/hazard'
    result.listener.wait_for_topic(hazard, lambda grid: grid['wet'] > 3, PATIENCE)
    assert launched.poll() is None
    # the daemon of the tools knows nobody for a moment
    assert any(result.node in result.say('node', 'list').split() for _ in range(20))
    yield result
    result.close()


def test_the_node_is_told_and_asked(tools):
    """Parameters, lifecycle, topics and services, by the command line."""
    assert 'active' in tools.say('lifecycle', 'get', tools.node)
    tools.say('param', 'set', tools.node, 'time_scale', '30.0')
    assert '30.0' in tools.say('param', 'get', tools.node, 'time_scale')
    (tools.graph.directory / 'dump.yaml').write_text(tools.say('param', 'dump', tools.node))
    loaded = tools.say('param', 'load', tools.node, 'dump.yaml').splitlines()
    assert 'Set parameter lava.ground_diffusivity successful' in loaded
    # those that are read when the node is configured are no failure of the file
    failed = [line for line in loaded if 'failed' in line]
    assert all('read-only' in line for line in failed), failed
    grid = tools.say('topic', 'echo', '--once', f'{tools.prefix}/hazard', '--field', 'info')
    assert 'width: 260' in grid
    answer = tools.say('service', 'call', f'{tools.node}/save', 'std_srvs/srv/Trigger')
    assert 'success=True' in answer
    assert 'successful' in tools.say('lifecycle', 'set', tools.node, 'deactivate')
    assert 'successful' in tools.say('lifecycle', 'set', tools.node, 'activate')


def test_a_recording_of_all_topics_can_be_used(tools):
    """By rosbag2, which plays it, and by the commands of this package."""
    bag = f'bag{tools.prefix.replace("/", "_")}'
    recorder = tools.start('bag', 'record', '-a', '-s', 'mcap', '-o', bag)
    # the node itself, and the recorder
    tools.wait_for_ends(f'{tools.prefix}/terrain', publishers=1, subscriptions=2)
    # two maps that came while it has been there
    since = tools.listener.hear()
    tools.listener.wait(
        lambda _: sum('hazard' in item['topic'] for item in tools.listener.seen[since:]) > 4
    )
    tools.end(recorder)
    assert f'Topic: {tools.prefix}/terrain |' in tools.say('bag', 'info', bag)
    tools.say('bag', 'play', bag, '--rate', '50', '--topics', f'{tools.prefix}/terrain')
    plot = tools.graph.process('-m', 'lava_ros.cli.main', 'plot', bag, '-o', f'{bag}.png')
    assert plot.wait_for_end(PATIENCE) == 0, plot.log


def _parameters(tools):
    """The second part of the shipped file, as its comment says for a namespace."""
    text = (ROOT / 'params/nav2_filters.yaml').read_text(encoding='utf-8')
    text = text.replace('map_topic: /keepout_mask', f'map_topic: {tools.prefix}/keepout_mask')
    shipped = yaml.safe_load(text)
    whole = shipped['global_costmap']['global_costmap']['ros__parameters']
    local = shipped['local_costmap']['local_costmap']['ros__parameters']
    return {
        'static_costmap': {**whole, **COSTMAP, 'plugins': ['lava_layer']},
        'filter_costmap': {**local, **COSTMAP, 'plugins': ['unused'], 'unused': {
            'plugin': 'nav2_costmap_2d::InflationLayer', 'enabled': False}},
    }


def _place(tools, x, y):
    """Put the robot to a place."""
    words = ('--x', x, '--y', y, '--frame-id', 'map', '--child-frame-id', 'base_link')
    return tools.start('run', 'tf2_ros', 'static_transform_publisher', *words)


def test_masks_reach_the_costmaps_of_nav2(tools):
    """By the keepout filter alone, and by layer and filters: lethal where the mask is, no more."""
    if not tools.has_nav2:
        pytest.skip('Nav2 is not there')
    limit = tools.start('topic', 'echo', '--once', '/speed_limit', 'nav2_msgs/msg/SpeedLimit')
    assert any('/speed_limit' in tools.say('topic', 'list').split() for _ in range(20))
    away = _place(tools, '100', '100')
    names = _parameters(tools)
    for name, values in names.items():
        path = tools.graph.directory / f'{name}.yaml'
        path.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}), encoding='utf-8')
        remaps = ('-r', f'__ns:={tools.prefix}/{name}', '-r', f'__node:={name}')
        words = ('nav2_costmap_2d', 'nav2_costmap_2d', '--ros-args', *remaps)
        tools.start('run', *words, '--params-file', str(path))
    managed = [f'{tools.prefix}/{name}/{name}' for name in names]
    tools.start(
        'run', 'nav2_lifecycle_manager', 'lifecycle_manager', '--ros-args', '-r', '__node:=costs',
        '-p', 'autostart:=true', '-p', 'bond_timeout:=0.0', '-p', f'node_names:={managed}',
    )
    # told once, when it changes: both ends have to be there before the robot comes to lava
    tools.wait_for_ends('/speed_limit', publishers=1, subscriptions=1)
    tools.end(away)
    _place(tools, '4050', '3300')
    said = limit.communicate(timeout=PATIENCE)[0]
    assert 'percentage: true' in said, said
    speed = next(line for line in said.splitlines() if line.startswith('speed_limit:'))
    assert 10.0 <= float(speed.split()[1]) <= 50.0
    # a moving mask is some way ahead of the costmap: let it stand still
    tools.say('service', 'call', f'{tools.node}/pause', 'std_srvs/srv/SetBool', '{data: true}')
    for name in names:
        topic = f'{tools.prefix}/{name}/costmap'
        mask = f'{tools.prefix}/keepout_mask'

        def agrees(grid, topic=topic, mask=mask):
            seen = [item for item in tools.listener.seen if item['topic'] == mask]
            return grid['topic'] == topic and seen and grid['cells'] == seen[-1]['cells']

        assert tools.listener.wait(agrees, PATIENCE)['max'] == 100
