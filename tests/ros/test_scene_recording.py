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

"""What a bag tells of the scene and its effects."""

import json

import numpy as np
import pytest

from lava_ros.bag import BagReader, LATCHED
from lava_ros.ros.eruption import Origin
from lava_ros.ros.recorder import Recorder
from lava_ros.ros.scene_recording import SceneRecording
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation.snapshot import Snapshot, StepReport, VolumeBudget

TERRAIN = Terrain(np.zeros((4, 5)), 10.0)
STEEP = {'steep': 'on: slope = 0.5 > 0.12', 'inertia': 'off: number = 0.01 <= 0.1'}
FAST = {'steep': 'on: slope = 0.5 > 0.12', 'inertia': 'on: number = 0.2 > 0.1'}


class Names:
    """What a recording asks of a node."""

    @staticmethod
    def resolve_topic_name(name):
        return f'/{name}'


class Taped:
    """A recording that is told of one frame after the other."""

    def __init__(self, directory, terrain=TERRAIN):
        self.directory = directory
        self.scene = Scene(terrain, (Vent((25.0, 15.0), 2.0),))
        self.origin = None
        self.recorder = Recorder()
        self.recording = SceneRecording(
            Names(), self.recorder, frame_id='map', msg_config='', parameters=dict
        )

    def write(self, time, effects):
        terrain = self.scene.terrain
        empty = np.zeros(terrain.shape, np.float32)
        budget, steps = VolumeBudget(0.0, 0.0, 0.0, 0.0), StepReport(1, 1, 1, 1.0, 'longest')
        snapshot = Snapshot(time, terrain, empty, empty, budget, 0, steps)
        stamp_ns = int(time * 1e9)
        self.recording.write(
            self.scene, snapshot, stamp_ns, effects=effects, origin=self.origin, device='cpu'
        )
        self.recorder.flush()

    def effects(self, name):
        return json.loads(BagReader(self.directory / name).custom_data['effects'])


@pytest.fixture
def taped(tmp_path):
    """A recording that has begun with one effect on."""
    result = Taped(tmp_path)
    result.recorder.arm(tmp_path / 'one')
    result.write(1.0, STEEP)
    return result


def test_the_bag_begins_with_the_whole_table(taped):
    """The first entry has every effect, with its reason."""
    taped.recorder.stop()
    assert taped.effects('one') == [{'stamp_ns': 10**9, 'time': 1.0, 'effects': STEEP}]


def test_changes_of_effects_are_kept(taped):
    """Each time that some went on or off is an entry; a new number alone is none."""
    taped.write(2.0, {**STEEP, 'steep': 'on: slope = 0.6 > 0.12'})
    taped.write(3.0, FAST)
    taped.scene = Scene(TERRAIN)
    taped.write(4.0, FAST)
    taped.write(5.0, STEEP)
    taped.recorder.stop()
    entries = taped.effects('one')
    assert [entry['time'] for entry in entries] == [1.0, 3.0, 5.0]
    assert entries[1]['effects'] == {'inertia': FAST['inertia']}
    assert entries[2]['effects'] == {'inertia': STEEP['inertia']}


def test_a_recording_that_was_cut_off_has_the_changes(taped):
    """The list is in the file as soon as the frame is."""
    taped.write(3.0, FAST)
    assert [entry['time'] for entry in taped.effects('one')] == [1.0, 3.0]
    taped.recorder.stop()


def test_the_next_bag_begins_anew(taped):
    """A second recording has the whole table again, as it is then."""
    taped.write(3.0, FAST)
    taped.recorder.stop()
    taped.recorder.arm(taped.directory / 'two')
    taped.write(6.0, FAST)
    taped.recorder.stop()
    assert taped.effects('two') == [{'stamp_ns': 6 * 10**9, 'time': 6.0, 'effects': FAST}]


def test_a_bag_names_the_checkpoint_it_begins_after(taped):
    """Only a bag that was begun then, and it goes on to after the simulation starts anew."""
    taped.origin = Origin('bags/first', 120.0, 7)
    taped.write(2.0, STEEP)
    taped.recorder.stop()
    taped.recorder.arm(taped.directory / 'two')
    taped.write(3.0, STEEP)
    taped.origin = None
    taped.write(0.0, FAST)
    taped.recorder.stop()
    data = [BagReader(taped.directory / name).custom_data for name in ('one', 'two')]
    assert 'resumed_from' not in data[0]
    assert json.loads(data[1]['resumed_from']) == {
        'bag': 'bags/first', 'time': 120.0, 'stamp_ns': 7
    }


def test_terrain_and_vents_come_again(tmp_path):
    """Once a minute, when the bag has grown by as much as they are."""
    random = np.random.default_rng(0)
    taped = Taped(tmp_path, Terrain(random.random((50, 60)), 1.0))
    taped.recorder.arm(tmp_path / 'one')
    for second in range(1, 186):
        taped.recorder.write(
            '/noise', 'std_msgs/msg/Empty', random.bytes(1000), second * 10**9, qos=LATCHED
        )
        taped.write(float(second), STEEP)
    for second in range(1000, 2000, 100):
        taped.write(float(second), STEEP)
    taped.recorder.stop()
    seen = {}
    for item in BagReader(tmp_path / 'one').messages():
        seen.setdefault(item.topic, []).append(item.stamp_ns // 10**9)
    # after that there is nothing beside them
    assert seen['/terrain'] == [1, 61, 121, 181]
    assert seen['/terrain'] == seen['/terrain_info'] == seen['/vents']
