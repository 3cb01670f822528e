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

"""Messages out: layers as they are due, terrain, vents, their markers."""

from array import array
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from geometry_msgs.msg import Pose
import numpy as np
import pytest
from visualization_msgs.msg import Marker

from lava_ros.bag.decoding import cloud_columns, image_array
from lava_ros.maps.layer_files import layers_from_dict, load_layers
from lava_ros.ros import inputs, outputs
from lava_ros.ros.layer_publishers import LayerPublishers
from lava_ros.ros.parameters import Settings
from lava_ros.ros.recorder import Recorder
from lava_ros.ros.scene_publisher import CLOSED, LABELS, OPEN, PLACES, vent_markers
from lava_ros.scene import Terrain, Vent
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.snapshot import Snapshot, StepReport
from recording import snapshot_at

TERRAIN = Terrain(np.arange(6.0).reshape(2, 3), 10.0, origin=(100.0, 200.0))
SNAPSHOT = Snapshot(
    time=5.0,
    terrain=TERRAIN,
    thickness=np.array([[0.0, 1.0, 2.0], [3.0, np.nan, 0.05]], np.float32),
    temperature=np.full((2, 3), 1273.15, np.float32),
    budget=VolumeBudget(1.0, 1.0, 0.0, 0.0),
    particle_count=1,
    steps=StepReport(1, 1, 1, 1.0, 'diffusion'),
)


def _message(**layer):
    (made,) = layers_from_dict({'layers': {'one': {'source': 'thickness'} | layer}})
    return outputs.layer_message(made, SNAPSHOT, frame_id='map', stamp_ns=3_000_000_004)


def test_grid_message():
    """A grid has the terrain's place and size, and the layer's values."""
    grid = _message(message='nav_msgs/OccupancyGrid', range=[0.0, 100.0])
    assert isinstance(grid.data, array) and grid.data.typecode == 'b'
    assert list(grid.data) == [0, 1, 2, 3, -1, 0]
    stamp = grid.header.stamp
    assert (grid.header.frame_id, stamp.sec, stamp.nanosec) == ('map', 3, 4)
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (3, 2, 10.0)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (100.0, 200.0)
    assert grid.info.origin.orientation == Pose().orientation


def test_image_message():
    """An image has the raw values."""
    image = _message(message='sensor_msgs/Image', threshold=0.0)
    np.testing.assert_array_equal(image_array(image, 'height'), SNAPSHOT.thickness)


def test_points_message():
    """A cloud has a point for each wet cell, under the names that viewers show."""
    cloud = _message(source='lava', message='sensor_msgs/PointCloud2', threshold=0.05)
    assert [field.name for field in cloud.fields] == ['x', 'y', 'z', 'thickness', 'temperature']
    assert (cloud.header.frame_id, cloud.header.stamp.sec) == ('map', 3)
    assert (cloud.height, cloud.width, cloud.is_dense) == (1, 4, True)
    columns = cloud_columns(cloud, 'lava_points', [field.name for field in cloud.fields])
    assert columns['x'].tolist() == [115.0, 125.0, 105.0, 125.0]
    assert columns['y'].tolist() == [205.0, 205.0, 215.0, 215.0]
    assert columns['z'].tolist() == pytest.approx([2.0, 4.0, 6.0, 5.05])
    assert columns['thickness'].tolist() == pytest.approx([1.0, 2.0, 3.0, 0.05])
    assert columns['temperature'].tolist() == pytest.approx([1000.0] * 4)


def test_no_points_message():
    """Without lava there is a cloud without points: viewers take away what they showed."""
    cloud = _message(source='lava', message='sensor_msgs/PointCloud2', threshold=100.0)
    assert (cloud.width, len(cloud.data), len(cloud.fields)) == (0, 0, 5)


def test_vents_message_reads_back():
    """Vents survive the way out and in, at the discharge of the moment and the ground's height."""
    series = ((0.0, 4.0), (10.0, 8.0), (20.0, 0.0))
    vents = (
        Vent((105.0, 205.0), series, temperature=1300.0, radius=3.0),
        Vent((125.0, 215.0), 6.0, 1423.0, end=(115.0, 205.0)),
    )
    rows = outputs.vent_rows(vents, 15.0)
    assert [row[2] for row in rows] == [8.0, 3.0, 3.0]
    assert [row[2] for row in outputs.vent_rows(vents, -1.0)] == [0.0, 3.0, 3.0]
    cloud = outputs.vents_message(rows, TERRAIN, frame_id='map', stamp_ns=0)
    assert cloud_columns(cloud, 'vents', ('z',))['z'].tolist() == [0.0, 5.0, 1.0]
    again = inputs.vents_from_cloud(cloud, Settings())
    assert [vent.position for vent in again] == [(105.0, 205.0), (125.0, 215.0), (115.0, 205.0)]
    assert again[0].temperature == pytest.approx(1300.0, abs=1e-3)
    assert again[0].radius == 3.0


def test_no_vents_message():
    """No vents are a cloud without points."""
    cloud = outputs.vents_message([], TERRAIN, frame_id='map', stamp_ns=0)
    assert inputs.vents_from_cloud(cloud, Settings()) == ()


def test_the_relief_is_lit_from_the_north_west():
    """Slopes that face the light are bright, those that turn away dark; flat ground between."""
    y, x = np.mgrid[0:5, 0:5] * 10.0

    def shade(elevation):
        message = outputs.relief_message(Terrain(elevation, 10.0), frame_id='map', stamp_ns=1)
        return np.array(message.data).reshape(5, 5)

    facing, flat, away = shade(0.5 * (x - y)), shade(0.0 * x), shade(0.5 * (y - x))
    assert facing.max() < flat.min() == flat.max() == 29 < away.min()
    hole = 0.0 * x
    hole[0, 0] = np.nan
    assert shade(hole)[0, 0] == -1 and shade(hole)[4, 4] == 29


HILL = Terrain(np.arange(600.0).reshape(20, 30), 10.0, origin=(100.0, 200.0))
VENTS = (
    Vent((105.0, 205.0), ((0.0, 4.0), (20.0, 0.0)), temperature=1373.15, radius=3.0, name='north'),
    Vent((125.0, 215.0), 6.0, 1423.0, end=(115.0, 205.0), radius=2.0),
)


def markers(time):
    """The markers of both vents at a time."""
    return vent_markers(VENTS, time, HILL, frame_id='map', stamp_ns=3_000_000_004).markers


def test_old_markers_go_first():
    """A vent that is no more leaves no marker behind."""
    first, *others = markers(10.0)
    assert first.action == Marker.DELETEALL
    assert {item.action for item in others} == {Marker.ADD}
    assert len({(item.ns, item.id) for item in others}) == len(others) == 4
    assert {item.header.frame_id for item in others} == {'map'}
    (only,) = vent_markers((), 0.0, HILL, frame_id='map', stamp_ns=0).markers
    assert only.action == Marker.DELETEALL


def test_places_lie_on_the_ground():
    """A disc is as wide as its vent; a fissure is a line between its ends."""
    disc, fissure = (item for item in markers(10.0) if item.ns == PLACES)
    assert disc.type == Marker.CYLINDER
    at = disc.pose.position
    assert (at.x, at.y, at.z) == (105.0, 205.0, 0.0)
    assert (disc.scale.x, disc.scale.y) == (6.0, 6.0)
    assert fissure.type == Marker.LINE_STRIP
    assert [(end.x, end.y, end.z) for end in fissure.points] == [
        (125.0, 215.0, 32.0),
        (115.0, 205.0, 1.0),
    ]
    assert fissure.scale.x == 4.0
    assert disc.pose.orientation.w == fissure.pose.orientation.w == 1.0


@pytest.mark.parametrize(
    ('time', 'color', 'words'),
    [(10.0, OPEN, 'north: 4 m3/s, 1100 C'), (30.0, CLOSED, 'north: 0 m3/s, 1100 C')],
)
def test_discharge_of_the_moment(time, color, words):
    """What a vent gives now is written beside it and colours it."""
    shown = markers(time)
    disc = next(item for item in shown if item.ns == PLACES)
    assert (disc.color.r, disc.color.g, disc.color.b, disc.color.a) == pytest.approx(color)
    label = next(item for item in shown if item.ns == LABELS)
    assert label.text == words
    assert label.pose.position.z > 0.0
    assert label.scale.z > 0.0


def test_a_vent_without_a_name_has_its_number():
    """The second vent is called 2."""
    label = [item for item in markers(0.0) if item.ns == LABELS][1]
    assert label.text.startswith('2: 6 m3/s')


CONFIGS = Path(__file__).parents[2] / 'msg_configs'


def test_masks_are_sent_when_they_change():
    """Nav2 works its costmaps out anew for each: hazard comes with each frame, masks do not."""
    sent = []

    def create(kind, message_class, topic, profile):
        return SimpleNamespace(publish=lambda data: sent.append(topic), topic_name=f'/{topic}')

    publishers = LayerPublishers(
        SimpleNamespace(create=create),
        load_layers(CONFIGS / 'nav2_speed.yaml'),
        Recorder(),
        frame_id='map',
    )
    thickness = np.zeros((20, 30), dtype=np.float32)
    thickness[10, 10] = 1.0
    first = snapshot_at(1.0, thickness, Terrain(np.zeros((20, 30)), 10.0))

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
