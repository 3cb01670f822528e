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

"""What is sent of a snapshot: maps with each frame, masks when a cell of them has changed."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from lava_ros.maps.layer_files import load_layers
from lava_ros.ros.layer_publishers import LayerPublishers
from lava_ros.ros.recorder import Recorder
from lava_ros.scene import Terrain
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.snapshot import Snapshot, StepReport

CONFIGS = Path(__file__).parents[2] / 'msg_configs'


def test_masks_are_sent_when_they_change():
    """Nav2 works its costmaps out anew for each: hazard comes with each frame, masks do not."""
    sent = []

    def publisher(message_class, topic, profile):
        return SimpleNamespace(publish=lambda data: sent.append(topic), topic_name=f'/{topic}')

    publishers = LayerPublishers(
        SimpleNamespace(publisher=publisher),
        load_layers(CONFIGS / 'nav2_speed.yaml'),
        Recorder(),
        frame_id='map',
    )
    thickness = np.zeros((20, 30), dtype=np.float32)
    thickness[10, 10] = 1.0
    first = Snapshot(
        time=1.0,
        terrain=Terrain(np.zeros((20, 30)), 10.0),
        thickness=thickness,
        temperature=np.full((20, 30), 1300.0, dtype=np.float32),
        budget=VolumeBudget(1.0, 1.0, 0.0, 0.0),
        particle_count=1,
        steps=StepReport(1, 1, 1, 1.0, 'diffusion'),
    )

    def topics(snapshot, *, repeat=False):
        sent.clear()
        publishers.publish(snapshot, 10**9, also_not_due=True, repeat=repeat)
        return set(sent)

    both = {'keepout_mask', 'speed_mask'}
    assert topics(first) == both | {'hazard'}
    assert topics(replace(first, time=2.0)) == {'hazard'}
    further = thickness.copy()
    further[10, 11] = 1.0
    second = replace(first, time=3.0, thickness=further)
    assert topics(second) == both | {'hazard'}
    # a bag that begins now, or who activates the node, has all of them
    assert topics(second, repeat=True) == both | {'hazard'}
    elsewhere = Terrain(np.zeros((20, 30)), 10.0, (5.0, 5.0))
    assert topics(replace(second, time=4.0, terrain=elsewhere)) == both | {'hazard'}
