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


"""Runs side by side: each is what it would be alone, and together they are steadier."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eruption import write_case
from lava_ros.errors import LavaError
from lava_ros.hindcast.case import Case, Event, load_case
from lava_ros.hindcast.run import Settings, simulate
from lava_ros.hindcast.score import THRESHOLD
from lava_ros.hindcast.several import agreement, directions, Several
from lava_ros.hindcast.turned import restored, turned

SETTINGS = Settings('draft', spacing=16.0, device='cpu', maps=2)


@pytest.fixture(scope='module')
def valley(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A valley down which lava flows for an hour."""
    text = 'lava: {viscosity: 2.0e+4, yield_strength: 200}\n'
    return load_case(write_case(tmp_path_factory.mktemp('several') / 'valley', hours=1, yaml=text))


def _last(several: Several) -> list[np.ndarray]:
    found = [maps for _, maps in several.maps() if maps is not None]
    assert len(found) == SETTINGS.maps
    return found[-1]


def test_directions_are_all_different() -> None:
    """Eight of them are all turns and mirror images; more move the vents by a little."""
    first = directions(8)
    assert {(item.quarters, item.mirror) for item in first} == {
        (quarters, mirror) for quarters in range(4) for mirror in (False, True)
    }
    assert {item.moved for item in first} == {0.0}
    assert len(set(directions(24))) == 24
    assert directions(24)[:8] == first


def test_each_run_is_what_it_would_be_alone(valley: Case) -> None:
    """Runs side by side cover what a run alone covers, and none is in another's way."""
    several = Several(valley, SETTINGS, 4)
    for direction, thickness in zip(several.directions, _last(several), strict=True):
        case = turned(valley, direction.quarters, mirror=direction.mirror)
        alone = simulate(case, SETTINGS)
        assert thickness.shape == valley.footprint.shape
        np.testing.assert_array_equal(np.isnan(thickness), ~valley.scene.terrain.has_data)
        own = restored(alone.snapshot.thickness, direction.quarters, mirror=direction.mirror)
        one, other = (np.nan_to_num(item) >= THRESHOLD for item in (thickness, own))
        assert (one & other).sum() / (one | other).sum() > 0.75
    budget = several.run.result().snapshot.budget
    assert budget.emitted == pytest.approx(4.0 * valley.volume)
    assert budget.error < 1e-5
    assert set(several.run.result().effects) == set(alone.effects)
    assert several.run.result().accuracy.spacing == alone.accuracy.spacing


def test_changes_of_the_ground_reach_each_run(valley: Case) -> None:
    """A hill that rises in mid-eruption stands in the way of all of them, where it should."""
    ground = valley.scene.terrain
    elevation = ground.elevation.copy()
    elevation[35, :] += 60.0
    event = Event(valley.start + 60.0, replace(ground, elevation=elevation), 'a wall')
    maps = _last(Several(replace(valley, events=(event,)), SETTINGS, 2))
    free = _last(Several(valley, SETTINGS, 2))
    for stopped, thickness in zip(maps, free, strict=True):
        assert np.nansum(thickness[:32]) > 30.0
        assert np.nansum(stopped[:32]) < 0.1 * np.nansum(thickness[:32])


def test_agreement_is_what_half_of_the_runs_cover(valley: Case) -> None:
    """Shares and the majority are of the runs' own maps; holes count for nothing."""
    maps = [np.zeros(valley.footprint.shape) for _ in range(3)]
    maps[0][10:20, 10:20] = 3.0
    maps[1][10:20, 10:16] = 1.0
    maps[2][10:14, 10:16] = THRESHOLD
    maps[2][0, 0] = np.nan
    found = agreement(valley, maps)
    assert found.share[10, 10] == 1.0
    assert found.share[15, 10] == pytest.approx(2.0 / 3.0)
    covered = found.thickness >= THRESHOLD
    expected = np.zeros_like(covered)
    expected[10:20, 10:16] = True
    np.testing.assert_array_equal(covered, expected)
    numbers = found.as_dict()
    assert numbers['count'] == 3
    assert numbers['lowest'] <= numbers['mean'] <= numbers['highest']
    assert numbers['standard_deviation'] == pytest.approx(np.std(numbers['jaccard'], ddof=1))
    assert found.majority.area == 60 * valley.scene.terrain.resolution**2


def test_runs_that_are_cut_off_go_on(valley: Case, tmp_path: Path) -> None:
    """They end with the same bits, and runs of another number are refused."""
    whole = _last(Several(valley, SETTINGS, 2))
    first = Several(valley, SETTINGS, 2, folder=tmp_path / 'kept')
    for _, maps in first.maps():
        if maps is not None:
            break
    second = Several(valley, SETTINGS, 2, folder=tmp_path / 'kept')
    assert second.run.is_resumed
    for _ in second.maps():
        pass
    for one, other in zip(whole, second._apart(second.run.result().snapshot), strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(LavaError, match='--fresh'):
        Several(valley, SETTINGS, 3, folder=tmp_path / 'kept')
    with pytest.raises(LavaError, match='--runs'):
        Several(valley, SETTINGS, 1)
