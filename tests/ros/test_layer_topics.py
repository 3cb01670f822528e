# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A layer has a topic of its own among all topics of its node, also after remapping."""

import json
from pathlib import Path

import pytest

from lava_ros.layers.layer_files import load_layers

ROOT = Path(__file__).parents[2]

THICKNESS = {'source': 'thickness', 'message': 'sensor_msgs/Image'}

#: Parameters with which a node has all its topics.
WHOLE = {
    'use_sim_time': True, 'forecast_horizon': 1.0, 'ensemble_members': 4,
    'places': [str(ROOT / 'examples' / 'places.csv')],
}

#: Topics that rclpy or rcl makes for each node.
OF_ROS = {'clock', 'parameter_events', 'rosout', 'lava/transition_event'}


def layer_file(directory, **layers):
    path = directory / 'layers.yaml'
    path.write_text(json.dumps({'layers': layers}))
    return str(path)


def refused(node):
    """Return the reason why a node is not configured."""
    assert not node.change('configure')
    reason = node.log.splitlines()[-1]
    assert reason.startswith('[ERROR]') and 'Traceback' not in reason, node.log
    return reason.partition('cannot configure: ')[2]


def test_layer_with_a_topic_of_the_node_is_refused(local, tmp_path):
    node = local(**WHOLE, msg_config=layer_file(tmp_path, test_layer=THICKNESS))
    assert node.change('configure'), node.log
    forecasts = {layer.topic for layer in load_layers(ROOT / 'msg_configs/forecast.yaml')}
    made = {
        item.topic_name.removeprefix('/')
        for item in (*node.node.publishers, *node.node.subscriptions)
    }
    taken = made - forecasts - {'test_layer'} | OF_ROS
    # terrain, vents, clicks, outlines, the scene, particles, places and diagnostics
    assert len(taken) >= len(OF_ROS) + 11
    assert node.change('cleanup'), node.log
    for topic in sorted(taken):
        layer_file(tmp_path, mine={**THICKNESS, 'topic': topic})
        assert refused(node).startswith(f"layers.mine.topic is '/{topic}', expected a ")
    for topic in sorted(forecasts):
        layer_file(tmp_path, **{topic: THICKNESS})
        expected = f"layers.{topic}.topic is '/{topic}', expected a different topic"
        assert refused(node).startswith(expected)
    # the node continues with a valid file
    layer_file(tmp_path, thickness=THICKNESS)
    assert node.change('configure') and node.change('activate'), node.log


@pytest.mark.parametrize(('rules', 'field', 'other'), [
    (['first:=/map', 'second:=/map'], 'layers.second.topic', 'first'),
    (['first:=/second'], 'layers.second.topic', 'first'),
    (['first:=relief'], 'layers.first.topic', 'relief'),
    (['relief:=/map', 'first:=/map'], 'layers.first.topic', 'relief'),
    (['second:=/diagnostics'], 'layers.second.topic', 'diagnostics'),
    (['vents:=second'], 'layers.second.topic', 'vents'),
    (['__ns:=/etna', 'observed_outline:=/etna/first'], 'layers.first.topic', 'observed_outline'),
    # without a layer
    (['relief:=/map', 'vents_markers:=/map'], 'vents_markers', 'relief'),
    (['terrain_cloud:=vents'], 'vents', 'terrain_cloud'),
])
def test_remapping_may_not_join_two_topics(local, tmp_path, rules, field, other):
    path = layer_file(tmp_path, first=THICKNESS, second=THICKNESS)
    node = local(**WHOLE, msg_config=path, remap=rules)
    space = '/etna/lava' if '__ns:=/etna' in rules else '/lava'
    assert not node.change('configure', space)
    reason = node.log.splitlines()[-1].partition('cannot configure: ')[2]
    assert reason.startswith(f'{field} is '), node.log
    assert reason.endswith(
        f'expected a different topic; {other} has the same one after remapping'
    )
