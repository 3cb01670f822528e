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


"""Turned cases: the grid's direction is not the flow's."""

import numpy as np
import pytest

from eruption import write_case
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.run import Settings, simulate
from lava_ros.hindcast.score import judge
from lava_ros.hindcast.turned import restored, turned


@pytest.fixture(scope='module')
def valley(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A valley down which lava flows for an hour."""
    text = 'lava: {viscosity: 2.0e+4, yield_strength: 200}\n'
    return load_case(write_case(tmp_path_factory.mktemp('turn') / 'valley', hours=1, yaml=text))


def test_turned_places_are_on_the_same_ground(valley: Case) -> None:
    """A vent keeps its elevation and its distance from the footprint; four turns are none."""
    (vent,) = valley.scene.vents
    height = valley.scene.terrain.elevation[valley.scene.terrain.cell_at(*vent.position)]
    for quarters in (1, 2, 3):
        case = turned(valley, quarters)
        ground, (moved,) = case.scene.terrain, case.scene.vents
        cell = ground.cell_at(*moved.position)
        assert cell is not None
        assert ground.elevation[cell] == height
        assert case.footprint[cell] == valley.footprint[
            valley.scene.terrain.cell_at(*vent.position)
        ]
    once = turned(valley, 1)
    # the valley falls to the south; a quarter turn counterclockwise has it fall to the east
    rise = np.diff(once.scene.terrain.elevation, axis=1)
    assert np.median(rise) < 0.0
    again = turned(once, 3)
    np.testing.assert_array_equal(again.scene.terrain.elevation, valley.scene.terrain.elevation)
    np.testing.assert_array_equal(again.footprint, valley.footprint)
    assert again.scene.vents[0].position == pytest.approx(vent.position)


def test_mirrored_and_turned_places_are_on_the_same_ground(valley: Case) -> None:
    """The vent keeps its ground in all eight directions, and maps come back as they were."""
    (vent,) = valley.scene.vents
    height = valley.scene.terrain.elevation[valley.scene.terrain.cell_at(*vent.position)]
    for quarters in range(4):
        case = turned(valley, quarters, mirror=True)
        ground, (moved,) = case.scene.terrain, case.scene.vents
        assert ground.elevation[ground.cell_at(*moved.position)] == height
        for mirror in (False, True):
            case = turned(valley, quarters, mirror=mirror)
            back = restored(case.scene.terrain.elevation, quarters, mirror=mirror)
            np.testing.assert_array_equal(back, valley.scene.terrain.elevation)
            back = restored(case.footprint, quarters, mirror=mirror)
            np.testing.assert_array_equal(back, valley.footprint)
    once = turned(valley, 0, mirror=True)
    x0, _, x1, _ = valley.scene.terrain.extent
    assert once.scene.vents[0].position[0] - x0 == pytest.approx(x1 - vent.position[0])


def test_score_does_not_depend_on_the_direction(valley: Case) -> None:
    """Jaccard of a turned case is the same: places where lava comes out turn with the ground."""
    settings = Settings('draft', spacing=8.0, device='cpu')
    scores = [
        judge(case, simulate(case, settings).snapshot.thickness)
        for case in (turned(valley, quarters) for quarters in range(4))
    ]
    found = [item.jaccard for item in scores]
    assert max(found) - min(found) < 0.01
    lengths = [item.length for item in scores]
    # a cell more or less
    assert max(lengths) - min(lengths) <= valley.scene.terrain.resolution
