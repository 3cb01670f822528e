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

"""What is drawn of the vents."""

import numpy as np
import pytest
from visualization_msgs.msg import Marker

from lava_ros.ros.markers import CLOSED, LABELS, OPEN, PLACES, vent_markers
from lava_ros.scene import Terrain, Vent

TERRAIN = Terrain(np.arange(600.0).reshape(20, 30), 10.0, origin=(100.0, 200.0))
VENTS = (
    Vent((105.0, 205.0), ((0.0, 4.0), (20.0, 0.0)), temperature=1373.15, radius=3.0, name='north'),
    Vent((125.0, 215.0), 6.0, end=(115.0, 205.0), radius=2.0),
)


def markers(time):
    """The markers of both vents at a time."""
    return vent_markers(VENTS, time, TERRAIN, frame_id='map', stamp_ns=3_000_000_004).markers


def test_old_markers_go_first():
    """A vent that is no more leaves no marker behind."""
    first, *others = markers(10.0)
    assert first.action == Marker.DELETEALL
    assert {item.action for item in others} == {Marker.ADD}
    assert len({(item.ns, item.id) for item in others}) == len(others) == 4
    assert {item.header.frame_id for item in others} == {'map'}
    (only,) = vent_markers((), 0.0, TERRAIN, frame_id='map', stamp_ns=0).markers
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
