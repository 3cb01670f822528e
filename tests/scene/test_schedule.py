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

"""What vents have emitted, after they were changed."""

from dataclasses import replace

from lava_ros.scene import Vent
from lava_ros.scene.schedule import schedule

VENT = Vent((10.0, 20.0), 5.0, name='first')


def test_changes_are_added():
    """Entries follow one another; what stays as it is adds none."""
    assert schedule((VENT,), (VENT,), 100.0) == (VENT,)
    one = schedule((VENT,), (replace(VENT, discharge=8.0, name='renamed'),), 100.0)
    assert [(vent.name, vent.discharge) for vent in one] == [
        ('renamed', ((0.0, 5.0), (100.0, 8.0)))
    ]
    two = schedule(one, (replace(VENT, discharge=((50.0, 1.0), (150.0, 2.0), (300.0, 3.0))),), 200)
    assert two[0].discharge == ((0.0, 5.0), (100.0, 8.0), (200.0, 2.0), (300.0, 3.0))
    # what was still to come has not come
    three = schedule(two, (VENT,), 250.0)
    assert three[0].discharge == ((0.0, 5.0), (100.0, 8.0), (200.0, 2.0), (250.0, 5.0))


def test_vents_close_and_open():
    """One that closes emits nothing from then on; a new one emits nothing before."""
    other = Vent((30.0, 20.0), 1.0)
    closed = schedule((VENT,), (other,), 60.0)
    assert [vent.discharge for vent in closed] == [((0.0, 5.0), (60.0, 0.0)), ((60.0, 1.0),)]
    assert [vent.volume_between(0.0, 100.0) for vent in closed] == [300.0, 40.0]
    again = schedule(closed, (VENT,), 80.0)
    assert [vent.volume_between(0.0, 100.0) for vent in again] == [20.0, 400.0]
    assert schedule((), (VENT,), 0.0) == (VENT,)


def test_what_is_remembered_is_bounded(monkeypatch):
    """A topic may change vents for ever."""
    monkeypatch.setattr('lava_ros.scene.schedule.LONGEST_SERIES', 50)
    monkeypatch.setattr('lava_ros.scene.schedule.MOST_CLOSED', 10)
    vents = ()
    for time in range(100):
        vents = schedule(vents, (replace(VENT, discharge=float(1 + time % 2)),), time)
    assert len(vents[0].discharge) == 50
    for time in range(20):
        place = Vent((float(time), 0.0), 1.0)
        vents = schedule(vents, (place,), 5000.0 + time)
    assert len(vents) == 10 + 1
