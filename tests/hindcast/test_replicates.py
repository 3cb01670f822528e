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


"""Several runs: each is what it would be alone, and together they are steadier."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eruption import write_case
from lava_ros.errors import LavaError
from lava_ros.hindcast.case import Case, Event, load_case
from lava_ros.hindcast.replicates import agreement, Direction, directions, run_replicates
from lava_ros.hindcast.run import Run, Settings, simulate

SETTINGS = Settings('draft', spacing=16.0, device='cpu', maps=2)


@pytest.fixture(scope='module')
def valley(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A valley down which lava flows for an hour."""
    text = 'lava: {viscosity: 2.0e+4, yield_strength: 200}\n'
    return load_case(write_case(tmp_path_factory.mktemp('several') / 'valley', hours=1, yaml=text))


def test_directions_are_all_different(valley: Case) -> None:
    """Eight of them are all turns and mirror images; more move the vents by a little, up to 64."""
    for runs in (1, 65):
        with pytest.raises(LavaError, match='--runs'):
            run_replicates(valley, SETTINGS, runs)
    first = directions(8)
    assert {(item.quarters, item.mirror) for item in first} == {
        (quarters, mirror) for quarters in range(4) for mirror in (False, True)
    }
    assert {item.moved for item in first} == {0.0}
    assert len(set(directions(24))) == 24
    assert directions(24)[:8] == first


def test_each_run_is_what_it_would_be_alone(valley: Case) -> None:
    """Each run has the bits that it has alone, put back on the cells of the case."""
    settings = replace(SETTINGS, maps=1)
    told: list[float] = []
    results = run_replicates(valley, settings, 5, progress=told.append)
    assert told == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])
    for direction, result in zip(directions(5), results, strict=True):
        alone = simulate(direction.turn(valley), settings)
        thickness = result.snapshot.thickness
        np.testing.assert_array_equal(thickness, direction.restore(alone.snapshot.thickness))
        np.testing.assert_array_equal(np.isnan(thickness), ~valley.scene.terrain.has_data)
        assert result.snapshot.terrain is valley.scene.terrain
        assert result.peak.shape == valley.footprint.shape
        arrived = alone.snapshot.arrived
        assert arrived is not None
        np.testing.assert_array_equal(result.snapshot.arrived, direction.restore(arrived))
        assert result.snapshot.budget.emitted == pytest.approx(valley.volume)
        assert result.snapshot.budget.error < 1e-5
        assert result.effects == alone.effects
        assert result.accuracy == alone.accuracy


@pytest.mark.parametrize(('quarters', 'mirror'), [(1, False), (2, False), (3, True)])
def test_a_turned_case_has_the_same_runs(
    valley: Case, device: str, quarters: int, mirror: bool
) -> None:
    """In another order, to the bit: what half of them cover does not depend on the direction."""
    settings = replace(SETTINGS, device=device, maps=1)
    (vent,) = valley.scene.vents
    x, y = vent.position
    # no multiple of anything
    vent = replace(vent, position=(x + 1e-3 / 3.0, y - 1e-3 / 7.0))
    case = replace(valley, scene=replace(valley.scene, vents=(vent,)))
    direction = Direction(quarters, mirror)
    found, other = (
        agreement(one, [item.snapshot for item in run_replicates(one, settings, 16)])
        for one in (case, direction.turn(case))
    )
    one, another = (sorted(item.jaccard for item in of.scores) for of in (found, other))
    assert one == another
    assert found.majority.jaccard == other.majority.jaccard
    np.testing.assert_array_equal(direction.restore(other.share), found.share)


def test_changes_of_the_ground_reach_each_run(valley: Case) -> None:
    """A hill that rises in mid-eruption stands in the way of all of them, where it should."""
    ground = valley.scene.terrain
    elevation = ground.elevation.copy()
    elevation[35, :] += 60.0
    event = Event(valley.start + 60.0, replace(ground, elevation=elevation), 'a wall')
    free, stopped = (
        [np.nansum(run.snapshot.thickness[:32]) for run in run_replicates(case, SETTINGS, 2)]
        for case in (valley, replace(valley, events=(event,)))
    )
    assert min(free) > 30.0 and (np.array(stopped) < 0.1 * np.array(free)).all()


def test_agreement_is_what_half_of_the_runs_cover(valley: Case) -> None:
    """Shares and the majority are of the runs' own maps; holes count for nothing."""
    maps = np.zeros((3, *valley.footprint.shape))
    maps[0, 10:20, 10:20] = 3.0
    maps[1, 10:20, 10:16] = 1.0
    maps[2, 10:14, 10:16] = 0.1
    end = simulate(valley, SETTINGS).snapshot
    snapshots = [
        replace(end, thickness=item, arrived=np.where(item > 0.0, 60.0, np.nan)) for item in maps
    ]
    found = agreement(valley, snapshots)
    assert found.share[10, 10] == 1.0
    assert found.share[15, 10] == pytest.approx(2.0 / 3.0)
    np.testing.assert_array_equal(found.thickness > 0.0, maps[1] > 0.0)
    numbers = found.as_dict()
    assert numbers['count'] == 3
    assert numbers['lowest'] <= numbers['mean'] <= numbers['highest']
    assert numbers['standard_deviation'] == pytest.approx(np.std(numbers['jaccard'], ddof=1))
    assert found.majority.area == 60 * valley.scene.terrain.resolution**2


class CutOffError(Exception):
    """What ends runs before their time."""


def test_runs_that_are_cut_off_go_on(valley: Case, tmp_path: Path) -> None:
    """They end with the same bits, with more of them as well; other settings are refused."""

    def cut_off(share: float) -> None:
        if share > 0.6:
            raise CutOffError

    whole = run_replicates(valley, SETTINGS, 3)
    with pytest.raises(CutOffError):
        run_replicates(valley, SETTINGS, 2, folder=tmp_path, progress=cut_off)
    kept = tmp_path / 'run_01'
    assert Run(directions(2)[1].turn(valley), SETTINGS, folder=kept).is_resumed
    told: list[float] = []
    again = run_replicates(valley, SETTINGS, 3, folder=tmp_path, progress=told.append)
    assert len(told) == SETTINGS.maps * 3 - 3
    for one, other in zip(whole, again, strict=True):
        np.testing.assert_array_equal(one.snapshot.thickness, other.snapshot.thickness)
        np.testing.assert_array_equal(one.snapshot.arrived, other.snapshot.arrived)
    with pytest.raises(LavaError, match='--fresh'):
        run_replicates(valley, replace(SETTINGS, spacing=20.0), 3, folder=tmp_path)


@pytest.mark.parametrize('mirror', [False, True])
def test_turned_and_mirrored_places_are_on_the_same_ground(valley: Case, mirror: bool) -> None:
    """A vent keeps its ground in all eight directions, and maps come back as they were."""
    (vent,) = valley.scene.vents
    before = valley.scene.terrain
    here = before.cell_at(*vent.position)
    for quarters in range(4):
        direction = Direction(quarters, mirror)
        case = direction.turn(valley)
        ground, (moved,) = case.scene.terrain, case.scene.vents
        cell = ground.cell_at(*moved.position)
        assert cell is not None
        assert ground.elevation[cell] == before.elevation[here]
        assert case.footprint[cell] == valley.footprint[here]
        np.testing.assert_array_equal(direction.restore(ground.elevation), before.elevation)
        np.testing.assert_array_equal(direction.restore(case.footprint), valley.footprint)


def test_turns_are_counterclockwise_after_the_mirror(valley: Case) -> None:
    """A valley that falls to the south falls to the east; four turns are none."""
    (vent,) = valley.scene.vents
    once = Direction(1).turn(valley)
    assert np.median(np.diff(once.scene.terrain.elevation, axis=1)) < 0.0
    again = Direction(3).turn(once)
    np.testing.assert_array_equal(again.scene.terrain.elevation, valley.scene.terrain.elevation)
    assert again.scene.vents[0].position == pytest.approx(vent.position)
    mirrored = Direction(0, mirror=True).turn(valley)
    x0, _, x1, _ = valley.scene.terrain.extent
    assert mirrored.scene.vents[0].position[0] - x0 == pytest.approx(x1 - vent.position[0])
