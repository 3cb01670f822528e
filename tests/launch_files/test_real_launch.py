# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Launch files with launch itself, where it is installed; a script stands in for the node."""

import os
from pathlib import Path
import shutil
import subprocess

import pytest
import yaml

from ros_domain import own_domain

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(shutil.which('ros2') is None, reason='ros2 is not installed')

#: Records its arguments, and the files of parameters, which launch removes.
NODE = """#!/bin/sh
cd "$(dirname "$0")"
echo "$0" >> starts
for word in "$@"; do
  echo "$word" >> words
  test -f "$word" && cp "$word" "$(grep -c . words).yaml"
done
eval "$(cat then 2>/dev/null)"
exit 0
"""

#: Programs of Nav2, which wait until they are killed.
PROGRAMS = (
    'nav2_map_server/costmap_filter_info_server', 'nav2_lifecycle_manager/lifecycle_manager',
)


@pytest.fixture
def launched(tmp_path, monkeypatch):
    """Return a function that performs a launch file: output, words and files of the node."""
    index = tmp_path / 'share/ament_index/resource_index/packages'
    index.mkdir(parents=True)
    (index / 'lava_ros').touch()
    (tmp_path / 'share/lava_ros').symlink_to(ROOT)
    libexec = tmp_path / 'lib/lava_ros'
    for name in (*PROGRAMS, 'lava_ros/lava_node'):
        (index / name.split('/')[0]).touch()
        program = tmp_path / 'lib' / name
        program.parent.mkdir(parents=True)
        program.write_text(NODE if name.endswith('node') else '#!/bin/sh\nexec sleep 1000\n')
        program.chmod(0o755)
    prefixes = [str(tmp_path), *filter(None, [os.environ.get('AMENT_PREFIX_PATH')])]
    monkeypatch.setenv('AMENT_PREFIX_PATH', os.pathsep.join(prefixes))
    monkeypatch.setenv('ROS_DOMAIN_ID', str(own_domain()))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'log'))

    def perform(name, *arguments, then=''):
        (libexec / 'then').write_text(then)
        ended = subprocess.run(
            ['ros2', 'launch', ROOT / 'launch' / name, *arguments], stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, timeout=100.0, check=False,
        )
        record = libexec / 'words'
        files = sorted(libexec.glob('*.yaml'), key=lambda path: int(path.stem))
        given = [yaml.safe_load(path.read_text()) for path in files]
        return ended.stdout, record.read_text().split() if record.exists() else None, given

    return perform


def test_arguments_override_the_parameter_file(launched, tmp_path):
    (tmp_path / 'my.yaml').write_text('/**: {ros__parameters: {preset: draft, horizon: 9.0}}')
    words = ('preset:=fine', 'time_scale:=60.0', 'record:=true', 'namespace:=etna')
    text, received, files = launched('lava.launch.py', f'params_file:={tmp_path}/my.yaml', *words)
    assert received is not None, text
    assert '__ns:=/etna' in received
    file, given = files
    assert file['/**']['ros__parameters'] == {'preset': 'draft', 'horizon': 9.0}
    assert given['/etna/lava']['ros__parameters'].pop('restart_token').startswith('launch-')
    expected = {'preset': 'fine', 'time_scale': 60.0, 'record': True}
    assert given['/etna/lava']['ros__parameters'] == expected


@pytest.mark.parametrize('then', ['exit 1', 'kill -9 $$', 'exit 0'])
def test_the_filter_servers_end_with_the_node(launched, then):
    text, received, _ = launched('nav2_keepout.launch.py', then=then)
    assert received is not None, text
    assert 'process[lava_node-1] was required' in text
    assert text.count('process started') == 5
    assert text.count('process has died') + text.count('process has finished cleanly') == 5


#: Kills the node by a signal at its first two starts.
KILL = 'test "$(grep -c . starts)" -lt 3 && kill -9 $$'


@pytest.mark.parametrize(('words', 'then', 'starts', 'token'), [
    (['record:=true'], KILL, 3, 'launch-'),
    (['respawn:=true'], KILL, 3, 'launch-'),
    (['record:=false', 'respawn:=True', 'restart_token:=mission'], KILL, 3, 'mission'),
    (['record:=false'], KILL, 1, None),
    (['record:=true', 'respawn:=false'], KILL, 1, None),
    # a node that fails by itself would fail again
    (['record:=true'], 'exit 1', 1, 'launch-'),
])
def test_killed_node_is_restarted_with_respawn(launched, tmp_path, words, then, starts, token):
    text, received, files = launched('lava.launch.py', *words, then=then)
    assert received is not None, text
    assert (tmp_path / 'lib/lava_ros/starts').read_text().count('lava_node') == starts
    given = [file['/lava']['ros__parameters'] for file in files if '/lava' in file]
    assert len(given) == starts
    (known,) = {values.get('restart_token') for values in given}
    assert known is None if token is None else known.startswith(token)


def test_each_launch_has_another_restart_token(launched):
    for _ in range(2):
        *_, files = launched('lava.launch.py', 'respawn:=true')
    tokens = {file['/lava']['ros__parameters']['restart_token'] for file in files
              if '/lava' in file}
    assert len(tokens) == 2
