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

"""The launch files with launch itself, where it is installed; the node only says its words."""

import os
from pathlib import Path
import shutil
import subprocess

import pytest
import yaml

from ros_domain import own_domain

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.skipif(shutil.which('ros2') is None, reason='ros2 is not installed')

#: Writes down its arguments and the files of parameters, which launch removes.
NODE = """#!/bin/sh
cd "$(dirname "$0")"
for word in "$@"; do
  echo "$word" >> words
  test -f "$word" && cp "$word" "$(grep -c . words).yaml"
done
exit 0
"""


@pytest.fixture
def launched(tmp_path, monkeypatch):
    """Performs a launch file in an ament prefix of its own; what the node was told, and launch."""
    index = tmp_path / 'share/ament_index/resource_index/packages'
    index.mkdir(parents=True)
    (index / 'lava_ros').touch()
    (tmp_path / 'share/lava_ros').symlink_to(ROOT)
    libexec = tmp_path / 'lib/lava_ros'
    libexec.mkdir(parents=True)
    (libexec / 'lava_node').write_text(NODE)
    (libexec / 'lava_node').chmod(0o755)
    prefixes = [str(tmp_path), *filter(None, [os.environ.get('AMENT_PREFIX_PATH')])]
    monkeypatch.setenv('AMENT_PREFIX_PATH', os.pathsep.join(prefixes))
    monkeypatch.setenv('ROS_DOMAIN_ID', str(own_domain()))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'log'))

    def perform(name, *arguments):
        ended = subprocess.run(
            ['ros2', 'launch', ROOT / 'launch' / name, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=100.0,
            check=False,
        )
        said = libexec / 'words'
        files = sorted(libexec.glob('*.yaml'), key=lambda path: int(path.stem))
        given = [yaml.safe_load(path.read_text()) for path in files]
        return ended.stdout, said.read_text().split() if said.exists() else None, given

    return perform


def test_arguments_come_after_the_file(launched, tmp_path):
    """What is given wins over the file, what is not given is not said."""
    (tmp_path / 'my.yaml').write_text('/**: {ros__parameters: {preset: draft, deadline: 9.0}}')
    words = ('preset:=fine', 'time_scale:=60.0', 'record:=true', 'namespace:=etna')
    text, told, files = launched('lava.launch.py', f'params_file:={tmp_path}/my.yaml', *words)
    assert told is not None, text
    assert '__ns:=/etna' in told
    file, given = files
    assert file['/**']['ros__parameters'] == {'preset': 'draft', 'deadline': 9.0}
    expected = {'preset': 'fine', 'time_scale': 60.0, 'record': True}
    assert given['/etna/lava']['ros__parameters'] == expected


@pytest.mark.parametrize('name', ['lava.launch.py', 'nav2_keepout.launch.py'])
def test_nothing_starts_without_rviz(launched, name):
    """Launch ends with what is missing, and no node is left behind."""
    if shutil.which('rviz2') is not None:
        pytest.skip('RViz is installed')
    text, told, _ = launched(name, 'rviz:=true')
    assert 'not found' in text
    assert told is None
