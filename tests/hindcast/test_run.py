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

"""Runs of a case: maps, resumption, changes of the ground."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eruption import VENT, write_case
from lava_ros.errors import LavaError
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.coarse import coarsened, refined
from lava_ros.hindcast.page import comparison, FALSE_ALARM, HIT, MISS, NEITHER, UNKNOWN
from lava_ros.hindcast.run import Run, Settings, simulate
from lava_ros.hindcast.score import covered_by, judge
from lava_ros.scene import Terrain
from lava_ros.simulation.accuracy import expected_thickness, mature_thickness
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import resolution_of
from lava_ros.simulation.snapshot import Snapshot, StepReport

SETTINGS = Settings('draft', spacing=16.0, device='cpu', maps=4)

LAVA = 'lava: {viscosity: 2.0e+4, yield_strength: 200}\n'


@pytest.fixture(scope='module')
def valley(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A valley down which lava flows for an hour."""
    return load_case(write_case(tmp_path_factory.mktemp('run') / 'valley', hours=1, yaml=LAVA))


def _finished(run: Run) -> Run:
    for _ in run.snapshots():
        pass
    return run


def test_lava_comes_down_the_valley(valley: Case) -> None:
    """It covers a part of what was mapped, its volume is what came out, and time is told."""
    run = Run(valley, SETTINGS)
    told = list(run.snapshots())
    shares, maps = [share for share, _ in told], [item for _, item in told if item is not None]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    assert [round(item.time) for item in maps] == [900, 1800, 2700, 3600]
    result = run.result()
    judged = judge(valley, result.snapshot.thickness, covered_by(result.snapshot))
    assert judged.jaccard > 0.3
    budget = result.snapshot.budget
    assert budget.emitted == pytest.approx(valley.volume)
    assert budget.error < 1e-5
    np.testing.assert_array_equal(
        result.peak, np.max([np.nan_to_num(item.thickness) for item in maps], axis=0)
    )
    vent = valley.scene.terrain.cell_at(*valley.scene.vents[0].position)
    assert vent is not None
    arrived = result.snapshot.arrived
    assert arrived is not None and 0.0 < arrived[vent] < 900.0
    assert 900.0 < np.nanmax(arrived) <= 3600.0
    assert 'inertia' not in result.effects
    assert {'arrhenius', 'cover'} <= set(result.effects)
    assert result.most_particles > 10


def test_run_that_is_cut_off_goes_on(valley: Case, tmp_path: Path) -> None:
    """Maps, peak and arrival are those of a run that was not cut off, to the bit."""
    whole = _finished(Run(valley, SETTINGS, folder=tmp_path / 'whole'))
    first = Run(valley, SETTINGS, folder=tmp_path / 'parts')
    maps = (snapshot for _, snapshot in first.snapshots() if snapshot is not None)
    for _ in range(2):
        next(maps)
    second = Run(valley, SETTINGS, folder=tmp_path / 'parts')
    assert second.is_resumed and not first.is_resumed
    one, other = whole.result(), _finished(second).result()
    np.testing.assert_array_equal(one.snapshot.thickness, other.snapshot.thickness)
    np.testing.assert_array_equal(one.peak, other.peak)
    np.testing.assert_array_equal(one.snapshot.arrived, other.snapshot.arrived)
    kept = second.kept()
    assert len(kept) == SETTINGS.maps
    for a, b in zip(whole.kept(), kept, strict=True):
        np.testing.assert_array_equal(a.thickness, b.thickness)
        assert a.budget == b.budget


def test_finished_run_is_not_run_again(valley: Case, tmp_path: Path) -> None:
    """It gives its result at once; another case, other settings and a damaged run are refused."""
    settings, folder = replace(SETTINGS, maps=1), tmp_path / 'kept'
    whole = _finished(Run(valley, settings, folder=folder))
    again = Run(valley, settings, folder=folder)
    assert list(again.snapshots()) == []
    np.testing.assert_array_equal(
        again.result().snapshot.thickness, whole.result().snapshot.thickness
    )
    for case, other in (
        (valley.with_lava({'emissivity': 0.8}), settings),
        (valley, replace(settings, spacing=15.0)),
    ):
        with pytest.raises(LavaError, match='--fresh'):
            Run(case, other, folder=folder)
    # what a power cut left behind is told from a run
    path = folder / 'checkpoint_0001'
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(LavaError, match='checkpoint'):
        Run(valley, settings, folder=folder)


def test_barrier_in_mid_eruption_holds_lava_back(valley: Case, tmp_path: Path) -> None:
    """Lava that comes after a barrier was built does not get as far as without it."""
    x, y = VENT
    barrier = (
        f'events:\n- time: 300\n  barrier: {{line: [[{x - 250}, {y - 250}], '
        f'[{x + 250}, {y - 250}]], height: 30, width: 20}}\n'
    )
    dammed = load_case(write_case(tmp_path / 'dammed', hours=1, yaml=LAVA + barrier))
    below = np.arange(valley.scene.terrain.shape[0]) * 20.0 < 740.0
    free, got = (
        np.nansum(simulate(case, SETTINGS).snapshot.thickness[below]) for case in (valley, dammed)
    )
    assert free > 30.0 and got < 0.1 * free


def test_a_case_has_the_spacing_of_its_flow(valley: Case) -> None:
    """It is that of any scene for the duration of the case; cells are no finer than particles."""
    for preset in ('draft', 'standard', 'fine'):
        found = resolution_of(valley.scene, PRESETS[preset].accuracy, horizon=valley.duration)
        accuracy = Settings(preset).accuracy(valley)
        assert (accuracy.spacing, accuracy.thickness) == (found.spacing, found.thickness)
    assert Settings('draft').accuracy(valley).courant_number == 1.0
    assert Settings('reference').accuracy(valley).courant_number == 0.25
    assert Settings('fine', spacing=15.0).coarseness(valley) == 1
    assert Settings('fine', spacing=45.0).coarseness(valley) == 2


def test_flows_are_as_thick_as_lava_on_its_way(valley: Case) -> None:
    """At the geometric mean of the viscosities at vent and solidus; at the vent without one."""
    scene = valley.scene
    lava, hot = scene.lava, scene.vents[0].temperature
    half_way = 0.5 * (hot + lava.solidus)
    ratio = lava.viscosity_at(half_way) / lava.viscosity_at(hot)
    assert mature_thickness(scene) == pytest.approx(expected_thickness(scene) * ratio**0.25)
    liquid = replace(scene, lava=replace(lava, solidus=0.0, latent_heat=0.0))
    assert mature_thickness(liquid) == expected_thickness(liquid)
    assert Settings('standard').accuracy(valley).thickness == mature_thickness(scene)


def test_with_lava_changes_what_it_says(valley: Case) -> None:
    """Constants, temperature and discharge are replaced, and nothing else."""
    other = valley.with_lava({'emissivity': 0.9}, temperature=1340.0, discharge=2.0)
    assert other.scene.lava == replace(valley.scene.lava, emissivity=0.9)
    assert other.scene.vents[0].temperature == 1340.0
    assert other.volume == pytest.approx(2.0 * valley.volume)
    assert other.scene.vents[0].series[0] == (0.0, 40.0)
    assert other.scene.terrain is valley.scene.terrain


def test_comparison_says_what_each_cell_is(valley: Case) -> None:
    """Hit, miss, false alarm, neither, and nothing where nobody can know."""
    never, ground = np.nan, np.array([[0.0, 0.0, 0.0], [0.0, np.nan, np.nan]])
    snapshot = replace(
        simulate(valley, SETTINGS).snapshot,
        terrain=Terrain(ground, 10.0),
        arrived=np.array([[5.0, never, 7.0], [never, never, never]]),
    )
    footprint = np.array([[True, True, False], [False, False, True]])
    codes = comparison(snapshot, footprint)
    assert codes.tolist() == [[HIT, MISS, FALSE_ALARM], [NEITHER, UNKNOWN, MISS]]


def test_larger_cells_are_means_of_what_is_known() -> None:
    """They reach over all borders alike, share cells by area, and leave out those without data."""
    elevation = np.arange(35.0).reshape(5, 7)
    elevation[0, 0] = np.nan
    elevation[3:, 5:] = np.nan
    ground = Terrain(elevation, 10.0, origin=(3.0, 4.0), epsg=32633, offset=(5e5, 4e6))
    coarse = coarsened(ground, 2)
    assert coarse.shape == (3, 4)
    assert (coarse.resolution, coarse.origin, coarse.offset) == (20.0, (-2.0, -1.0), (5e5, 4e6))
    # cells 1 and 7 by halves, 8 by a quarter
    assert coarse.elevation[0, 0] == pytest.approx((0.5 * 1 + 0.5 * 7 + 0.25 * 8) / 1.25)
    weights = np.outer([0.5, 1.0, 0.5], [0.5, 1.0, 0.5])
    mean = np.average(elevation[1:4, 1:4], weights=weights)
    assert coarse.elevation[1, 1] == pytest.approx(mean)
    assert np.isnan(coarse.elevation[2, 3])
    assert coarsened(ground, 1) is ground


def test_larger_cells_turn_with_the_ground() -> None:
    """A terrain that is turned by a quarter, or mirrored, has the same larger cells."""
    elevation = np.random.default_rng(3).normal(size=(19, 14))
    elevation[3, 4] = np.nan
    ground = Terrain(elevation, 10.0)
    for factor in (2, 3, 4):
        coarse = coarsened(ground, factor).elevation
        for change in (np.rot90, np.flipud, np.fliplr):
            other = coarsened(replace(ground, elevation=change(elevation)), factor)
            np.testing.assert_allclose(other.elevation, change(coarse), rtol=0.0, atol=1e-14)


def test_maps_come_back_on_the_finer_cells() -> None:
    """Each cell has the value of its block, the volume stays, holes stay holes."""
    elevation = np.zeros((6, 4))
    elevation[5, 3] = np.nan
    ground = Terrain(elevation, 10.0)
    coarse = coarsened(ground, 2)
    thickness = np.arange(6.0, dtype=np.float32).reshape(3, 2)
    snapshot = Snapshot(
        1.0, coarse, thickness, np.full((3, 2), np.nan, np.float32),
        VolumeBudget(1.0, 1.0, 0.0, 0.0), 1, StepReport(1, 1, 1, 1.0, 'longest'), thickness,
    )
    fine = refined(snapshot, ground, 2)
    assert fine.terrain is ground
    assert fine.frozen is not None
    for values in (fine.thickness, fine.frozen):
        np.testing.assert_array_equal(values[:2, :2], 0.0)
        np.testing.assert_array_equal(values[4, :], [4, 4, 5, 5])
        assert np.isnan(values[5, 3])
    assert np.nansum(fine.thickness) * 100.0 == thickness.sum() * 400.0 - 500.0
    assert refined(snapshot, coarse, 1) is snapshot
