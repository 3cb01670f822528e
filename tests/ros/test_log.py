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

"""What people read in the log of a node that does what it should: one line for each thing."""

import re

import numpy as np

SCENE = """
terrain: {file: slope.npz}
vents: [{position: [60.0, 155.0], discharge: 20.0, radius: 12.0}]
lava: {viscosity: 1.0e4}
"""


def told(node):
    """The lines of the log, without severity, time and name."""
    return re.findall(r'^\[INFO\] \[[\d.]+\] \[lava\]: (.*)$', node.log, re.MULTILINE)


def test_a_node_tells_what_it_does(graph):
    """What it waits for, takes, chooses, records; paused is what somebody has paused."""
    node = graph.node(device='cpu', record=True, bag_directory='bag', checkpoint_period=0.0)
    node.wait_for_log('active')
    publisher = graph.publisher()
    node.wait_for_log('waiting for terrain on terrain, terrain_info, terrain_cloud')
    publisher.publish('vents', 'terrain_info', 'terrain')
    node.wait_for_log('recording to', timeout=90.0)
    for words in ({'preset': 'draft'}, {'lava__viscosity': 50.0}):
        assert publisher.set(**words)['success']
    assert publisher.call('reset')['success']
    publisher.call('pause', True)
    node.wait_for_log('simulation paused')
    assert node.end() == 0
    lines = told(node)
    # where there is no GPU Warp says so
    assert not [line for line in node.log.splitlines() if line.startswith('Warp ')]
    assert lines[0].startswith('waiting for terrain on ')
    assert lines[1:3] == ['configured', 'active']
    for expected in (
        'terrain: 40 x 30 cells of 10 m',
        'vents: 1, 20 m3/s',
        f'recording to {graph.directory / "bag"}',
        'preset: the new value is used from the next start or reset on',
        'lava.viscosity: the new value is used from the next start or reset on',
        'reset: starting again at time 0',
    ):
        assert lines.count(expected) == 1, (expected, lines)
    assert [line for line in lines if line.startswith('effects: ')], lines


def test_an_inactive_node_is_not_paused(graph):
    """Time stands still until it is active, and nobody has paused it."""
    y, x = np.mgrid[0:30, 0:40]
    ground = (500.0 - x + 0.05 * (y - 15) ** 2).astype(np.float32)
    np.savez(graph.directory / 'slope.npz', elevation=ground, resolution=10.0)
    (graph.directory / 'scene.yaml').write_text(SCENE, encoding='utf-8')
    node = graph.node(device='cpu', autostart=False, scene='scene.yaml')
    client = graph.client()
    assert client.change('configure'), node.log
    # in the diagnostics, which come after the log
    graph.listener().wait_for_status(
        'simulation', lambda status: status['state'] == 'paused', timeout=90.0
    )
    node.wait_for_log('terrain: ')
    assert client.change('activate'), node.log
    node.wait_for_log('simulation running', timeout=90.0)
    assert client.change('deactivate'), node.log
    assert node.end() == 0
    assert 'paused' not in node.log
    assert {'configured', 'active', 'inactive'} <= set(told(node))
