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

"""A node that has its terrain from a file shows it, latched, and does not take it for news."""

import numpy as np
import pytest

SCENE = """
terrain: {file: slope.npz}
vents: [{position: [60.0, 155.0], discharge: 20.0, radius: 12.0}]
lava: {viscosity: 1.0e4}
"""


@pytest.fixture
def node(graph):
    """A node on a scene with a hole; a terrain image would be refused for it, and be scaled."""
    y, x = np.mgrid[0:30, 0:40]
    ground = (500.0 - x + 0.05 * (y - 15) ** 2).astype(np.float32)
    ground[29, 39] = np.nan
    np.savez(graph.directory / 'slope.npz', elevation=ground, resolution=10.0)
    (graph.directory / 'scene.yaml').write_text(SCENE, encoding='utf-8')
    return graph.node(device='cpu', time_scale=20.0, scene='scene.yaml', terrain_scale=2.0)


def test_the_terrain_is_there_for_who_comes_late(graph, node):
    """One that comes by the topics takes its place, and then it alone is there."""
    first = graph.listener('terrain:image', 'relief', 'height')
    seen = first.wait_for_topic('terrain', timeout=90.0)
    assert (seen['shape'], seen['encoding']) == ([30, 40], '32FC1')
    assert seen['max'] == pytest.approx(511.25)
    relief = first.wait_for_topic('relief', timeout=90.0)
    assert relief['shape'] == [30, 40]
    # by the hole there is no slope; elsewhere light and shade
    assert relief['min'] == -1 and 0 < relief['max'] <= 100
    # it has come back to the node by now
    first.wait_for_topic('height', lambda grid: grid['wet'] > 0, timeout=90.0)
    inputs = first.wait_for_status('inputs')
    assert (inputs['accepted'], inputs['rejected']) == ('1', '0'), inputs
    assert 'refused' not in node.log
    graph.publisher().publish('terrain_info', 'terrain')
    first.wait_for_status('inputs', lambda status: int(status['accepted']) >= 3)
    first.wait_for_topic('height')
    second = graph.listener('terrain:image', 'relief', 'height')
    second.wait_for_topic('height', timeout=60.0)
    shown = [item for item in second.seen if item['topic'] == 'terrain']
    assert [item['sha256'] for item in shown] != [seen['sha256']]
    assert seen['sha256'] not in [item['sha256'] for item in shown]
    # what is heard has a relief as well
    heard = [item for item in second.seen if item['topic'] == 'relief']
    assert heard and heard[-1]['cells'] != relief['cells']
