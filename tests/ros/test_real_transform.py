# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Georeference and static transform of ``lava ros feed`` and of a node, read by tools of ROS."""

import os
import re
import signal
import subprocess
import sys
import time

import pytest
import yaml

from geodata import write_raster
from ros.graph_publisher import elevation
from ros.test_real_tools import PATIENCE, ROOT, TOOLS
from ros_domain import own_domain

pytestmark = [
    pytest.mark.skipif(TOOLS is None, reason='ros2 is not there (PATH, ROS_TOOLS)'),
    pytest.mark.nightly,
]

#: Upper left corner [m] and side of a cell [m] of the raster.
CORNER, CELL = (499_123.25, 4_181_234.5), 12.5

#: Map origin [m], which is the lower left corner.
ORIGIN = (CORNER[0], CORNER[1] - CELL * elevation().shape[0])


class Programs:
    """Programs in one graph, which all find tf2_msgs."""

    def __init__(self, folder):
        paths = [str(ROOT), TOOLS.get('PYTHONPATH', '')]
        self.folder = folder
        self.environment = {
            **TOOLS, 'ROS_DOMAIN_ID': str(own_domain()), 'HOME': str(folder),
            'PYTHONPATH': os.pathsep.join(filter(None, paths)),
        }
        self._started = []

    def start(self, *words):
        child = subprocess.Popen(
            words, cwd=self.folder, env=self.environment, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )
        self._started.append(child)
        return child

    def python(self, module, *words):
        return self.start(sys.executable, '-m', module, *words)

    def echo(self, topic, kind):
        """Return the first message of a latched topic."""
        words = ('--qos-durability', 'transient_local', '--qos-reliability', 'reliable')
        child = self.start('ros2', 'topic', 'echo', '--once', *words, topic, kind)
        output = child.communicate(timeout=PATIENCE)[0]
        assert child.returncode == 0, output
        return yaml.safe_load(output.partition('\n---')[0])

    def close(self):
        for child in reversed(self._started):
            if child.poll() is None:
                os.killpg(child.pid, signal.SIGKILL)
                child.communicate()


@pytest.fixture
def programs(tmp_path):
    result = Programs(tmp_path)
    yield result
    result.close()


@pytest.mark.parametrize('source', ['feed', 'node'])
@pytest.mark.parametrize(('epsg', 'parent'), [(32633, 'utm'), (25833, 'earth')])
def test_tools_receive_the_georeference_and_the_transform(
    programs, tmp_path, source, epsg, parent
):
    place = {'crs': f'EPSG:{epsg}', 'cell': CELL, 'north_west': CORNER}
    path = str(write_raster(tmp_path / 'x.tif', elevation()[::-1], **place))
    if source == 'feed':
        programs.python('lava_ros.cli.main', 'ros', 'feed', '--terrain', path, '--frame', 'lava')
    else:
        words = ('-p', f'terrain_file:={path}', '-p', 'frame_id:=lava', '-p', 'device:=cpu')
        programs.python('lava_ros.ros.node', '--ros-args', *words)
    message = programs.echo('/terrain_georeference', 'geometry_msgs/msg/TransformStamped')
    offset = message['transform']['translation']
    assert (message['header']['frame_id'], message['child_frame_id']) == (f'EPSG:{epsg}', 'lava')
    assert (offset['x'], offset['y'], offset['z']) == (*ORIGIN, 0.0)
    (transform,) = programs.echo('/tf_static', 'tf2_msgs/msg/TFMessage')['transforms']
    assert (transform['header']['frame_id'], transform['child_frame_id']) == (parent, 'lava')
    if parent == 'utm':
        assert transform['transform'] == message['transform']
    echo = programs.start('ros2', 'run', 'tf2_ros', 'tf2_echo', parent, 'lava')
    place, end = transform['transform']['translation'], time.monotonic() + PATIENCE
    for line in echo.stdout:
        assert time.monotonic() < end
        if found := re.search(r'Translation: \[(.*)\]', line):
            numbers = [float(number) for number in found[1].split(', ')]
            assert numbers == pytest.approx([place[axis] for axis in 'xyz'], abs=1e-3)
            return
    raise AssertionError('tf2_echo has ended')
