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

"""Ensembles of a node in a real graph: probabilities, what was seen, withdrawals, the bag."""

import numpy as np
import pytest

from lava_ros.bag import BagReader

#: Simulated seconds in a second.
SCALE = 5.0

HORIZON = 400.0

#: Wall time after which members have lava to be told apart by [s].
FLOWN = 10.0

MEMBERS = 5

SCENE = """
terrain: {file: slope.npz}
vents: [{position: [60.0, 155.0], discharge: 20.0, radius: 12.0}]
lava: {viscosity: 1.0e4}
uncertainty:
  discharge: {distribution: loguniform, low: 0.2, high: 5.0}
  position: {radius: 20.0}
"""

TOPICS = (
    'inundation_probability',
    'arrival_time_p10',
    'arrival_time_p50',
    'arrival_time_p90',
    'expected_thickness',
)


@pytest.fixture(scope='module')
def node(graph):
    """A node that makes ensembles and records them."""
    y, x = np.mgrid[0:30, 0:40]
    ground = (500.0 - x + 0.05 * (y - 15) ** 2).astype(np.float32)
    np.savez(graph.directory / 'slope.npz', elevation=ground, resolution=10.0)
    (graph.directory / 'scene.yaml').write_text(SCENE, encoding='utf-8')
    return graph.node(
        device='cpu',
        preset='draft',
        scene='scene.yaml',
        time_scale=SCALE,
        forecast_horizon=HORIZON / 3600.0,
        # where kernels are compiled first, beside other tests, members take a while
        forecast_max_age=10.0 * HORIZON,
        ensemble_members=MEMBERS,
        record=True,
        bag_directory='recorded',
    )


def test_ensembles_in_the_graph(graph, node):
    """They come with their start as the stamp, are weighed by what is seen, and withdrawn."""
    words = [
        name if name == 'inundation_probability' else f'{name}:image' for name in TOPICS
    ]
    listener, publisher = graph.listener(*words), graph.publisher()
    first = listener.wait_for_topic('inundation_probability', timeout=120.0)
    assert first['shape'] == [30, 40]
    status = listener.wait_for_status(
        'ensemble', lambda item: int(item.get('members', 0)) == MEMBERS, timeout=120.0
    )
    assert status['level'] == 0 and status['message'] == f'{MEMBERS} of {MEMBERS} members'
    assert status['is_stale'] == 'false' and int(status['frame_stamp_ns']) >= first['stamp_ns']
    assert float(status['horizon_s']) == HORIZON and float(status['duration_s']) > 0.0
    assert float(status['members_effective']) == MEMBERS
    whole = listener.wait_for_topic(
        'inundation_probability',
        lambda item: item['min'] == 0 and item['max'] == 100,
        timeout=120.0,
    )
    for name in TOPICS[1:]:
        image = listener.wait_for_topic(name, timeout=60.0)
        assert image['encoding'] == '32FC1' and image['shape'] == [30, 40]

    # members that have other lava than was seen count less, in the ensemble of now and the next
    listener.wait_for_status(
        'ensemble',
        lambda item: int(item['frame_stamp_ns']) > first['stamp_ns'] + FLOWN * 1e9,
        timeout=120.0,
    )
    publisher.publish('outline')
    sharper = listener.wait_for_status(
        'ensemble', lambda item: item['outlines'] == '1', timeout=120.0
    )
    assert 0.0 < float(sharper['jaccard_mean']) < 1.0
    weighed = listener.wait_for_status(
        'ensemble',
        lambda item: float(item['members_effective']) < MEMBERS - 0.5,
        timeout=120.0,
    )
    later = listener.wait_for_status(
        'ensemble',
        lambda item: int(item['frame_stamp_ns']) > int(weighed['frame_stamp_ns']),
        timeout=120.0,
    )
    assert later['outlines'] == '1' and float(later['members_effective']) < MEMBERS - 0.5

    # what cannot be used is named
    for name, field in (
        ('outline_wrong_frame', 'observed_outline.header.frame_id'),
        ('outline_wrong_size', 'observed_outline.data'),
        ('outline_no_resolution', 'observed_outline.info.resolution'),
        ('outline_too_early', 'before the first forecast of this scene'),
        ('outline_of_tomorrow', 'observed_outline.header.stamp'),
        ('outline_without_lava', 'observed.lava'),
    ):
        publisher.publish(name)
        node.wait_for_log(field)
    assert node.log.count('observed_outline refused') == 6

    publisher.publish('no_vents')
    left = set(TOPICS[:1])
    while left:
        gone = listener.wait(
            lambda item: item['topic'] in left and item['max'] == -1, timeout=60.0
        )
        left.remove(gone['topic'])
    node.wait_for_log('ensemble withdrawn: the scene or the effects have changed')
    assert whole['stamp_ns'] < gone['stamp_ns']
    assert node.end() == 0


def test_the_bag_has_the_ensembles(graph, node):
    """And what was seen."""
    assert node.child.poll() is not None, 'the test before ends the node'
    bag = BagReader(graph.directory / 'recorded')
    assert {f'/{topic}' for topic in TOPICS} | {'/observed_outline'} <= set(bag.topics)
