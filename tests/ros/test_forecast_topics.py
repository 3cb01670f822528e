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

"""Forecasts of a node in a real graph: maps, stamps, withdrawals, services, the bag."""

from dataclasses import replace
import json
from pathlib import Path

import numpy as np
import pytest

from lava_ros.bag import BagReader
from lava_ros.bag.decoding import Decoder
from lava_ros.errors import LavaError
from lava_ros.ros.layer_publishers import published_layers
from lava_ros.ros.parameters import Settings

CONFIGS = Path(__file__).parents[2] / 'msg_configs'

#: Simulated seconds in a second.
SCALE = 10.0

HORIZON = 300.0

SCENE = """
terrain: {file: slope.npz}
vents: [{position: [60.0, 155.0], discharge: 20.0, radius: 12.0}]
lava: {viscosity: 1.0e4}
"""

TOPICS = ('arrival_time', 'arrival', 'arrival_class', 'peak_height', 'peak_temperature')


@pytest.fixture(scope='module')
def node(graph):
    """A node that makes forecasts and records them."""
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
        record=True,
        bag_directory='recorded',
    )


def test_forecasts_in_the_graph(graph, node):
    """They come with their start as the stamp, are withdrawn with the scene, and come again."""
    listener = graph.listener('arrival', 'arrival_time:image', 'peak_height', 'peak_temperature')
    publisher, client = graph.publisher(), graph.client()
    first = listener.wait_for_topic('arrival', timeout=120.0)
    assert first['shape'] == [30, 40]
    assert first['min'] == 0 and first['wet'] > 3
    seconds = listener.wait_for_topic('arrival_time', timeout=60.0)
    assert 0.5 * HORIZON < seconds['max'] <= HORIZON
    assert seconds['encoding'] == '32FC1'
    for topic in ('peak_height', 'peak_temperature'):
        assert listener.wait_for_topic(topic)['max'] > 0
    later = listener.wait_for_topic(
        'arrival',
        lambda item: item['stamp_ns'] > first['stamp_ns'] and item['max'] == 100,
        timeout=60.0,
    )
    status = listener.wait_for_status(
        'forecast', lambda item: int(item.get('frame_stamp_ns', 0)) >= later['stamp_ns']
    )
    assert status['level'] == 0 and status['message'] == 'up to date'
    assert status['is_stale'] == 'false'
    assert float(status['horizon_s']) == HORIZON
    assert float(status['start_time_s']) > 0.0 and float(status['duration_s']) > 0.0
    assert 0.0 <= float(status['age_s']) <= 0.5 * HORIZON
    assert publisher.map('arrival')['shape'] == [30, 40]

    # what was said of one scene is taken back when there is another
    publisher.publish('no_vents')
    topics = {'arrival_time', 'arrival', 'peak_height', 'peak_temperature'}
    while topics:
        gone = listener.wait(
            lambda item: item['topic'] in topics and item['max'] == -1, timeout=60.0
        )
        topics.remove(gone['topic'])
    node.wait_for_log('forecast withdrawn: the scene or the effects have changed')
    back = listener.wait_for_topic('arrival', lambda item: item['max'] == 100, timeout=60.0)
    assert back['stamp_ns'] >= gone['stamp_ns'] - 2e9

    # paused: time stands still, and a forecast stays as good as it was
    assert client.call('pause', True)['success']
    still = listener.wait_for_status(
        'forecast', lambda item: item['progress'] == '' and item['age_s'] == '0', timeout=60.0
    )
    assert still['is_stale'] == 'false'
    assert node.end() == 0


def test_the_bag_has_the_forecasts(graph, node):
    """With the file that says how to read them; other readers pass over them."""
    assert node.child.poll() is not None, 'the test before ends the node'
    bag = BagReader(graph.directory / 'recorded')
    names = {f'/{topic}' for topic in TOPICS}
    assert names <= set(bag.topics)
    assert 'source: arrival' in bag.custom_data['forecast_config']
    decoder = Decoder(bag)
    stamps, logged = [], []
    for message in bag.messages({'/arrival'}):
        stamp = decoder.decode(message).header.stamp
        stamps.append(stamp.sec * 10**9 + stamp.nanosec)
        logged.append(message.publish_ns)
    assert len(stamps) >= 3
    assert logged == sorted(logged)
    # made some time after the moment they start from
    assert all(stamp <= when for stamp, when in zip(stamps, logged, strict=True))
    assert any(stamp < when for stamp, when in zip(stamps, logged, strict=True))


def _refusal(settings, msg_config='default.yaml', forecast_config='forecast.yaml'):
    with pytest.raises(LavaError) as caught:
        published_layers(
            CONFIGS / msg_config, CONFIGS / forecast_config, replace(Settings(), **settings)
        )
    return str(caught.value)


def test_files_that_do_not_fit_are_refused(graph, tmp_path):
    """Each source has its file, each topic one layer; the node says why and ends."""
    assert "layers.height.source is 'thickness'" in _refusal({}, forecast_config='default.yaml')
    assert "layers.arrival_time.source is 'arrival'" in _refusal({}, msg_config='forecast.yaml')
    assert 'layers_off' in _refusal({'layers_off': ('arrivals',)})
    layers = published_layers(
        CONFIGS / 'default.yaml', CONFIGS / 'forecast.yaml', Settings(layers_off=('arrival',))
    )
    assert {layer.topic for layer in layers if layer.is_forecast} == {*TOPICS} - {'arrival'}
    arrival = {'source': 'arrival', 'message': 'sensor_msgs/Image'}
    path = tmp_path / 'forecast.yaml'
    path.write_text(json.dumps({'layers': {'height': {**arrival, 'threshold': 0.01}}}))
    refusal = _refusal({}, forecast_config=path)
    assert "layers.height.topic is 'height', expected a topic" in refusal
    two = {'a': {**arrival, 'threshold': 0.01}, 'b': {**arrival, 'threshold': 0.5}}
    path.write_text(json.dumps({'layers': two}))
    node = graph.node(device='cpu', forecast_horizon=1.0, forecast_config=str(path))
    node.child.wait(60.0)
    assert node.child.returncode == 1
    assert 'forecast_config is [0.01, 0.5], expected one threshold' in node.log
