# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of a case: maps, resume, changes of the terrain, and replicates."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from eruption import LAVA, VENT, write_case
from lava_ros.errors import LavaError
from lava_ros.forecast.members import run_members
from lava_ros.forecast.partner_runs import measure_run
from lava_ros.forecast.sampling import Member
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.coarse import coarsened, refined
from lava_ros.hindcast.page import (
    comparison,
    FALSE_ALARM,
    HIT,
    MISS,
    NEITHER,
    UNKNOWN,
    write_maps,
)
from lava_ros.hindcast.probabilistic_score import plan_of
from lava_ros.hindcast.replicates import agreement, directions, Orientation, run_replicates
from lava_ros.hindcast.run import request_of, Result, Run, Settings, simulate
from lava_ros.hindcast.score import score_snapshot
from lava_ros.layers.recording import Recording
from lava_ros.runs.scene_run import SceneRun
from lava_ros.runs.sinks import TimeSink
from lava_ros.scene import Terrain
from lava_ros.scene.events import TerrainEvent
from lava_ros.simulation.numerical_error import difference
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.snapshot import Snapshot, StepReport
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import resolution_of

SETTINGS = Settings('draft', spacing=16.0, device='cpu', maps=4)


def _snapshot(terrain: Terrain, thickness: np.ndarray, arrived: np.ndarray) -> Snapshot:
    return Snapshot(
        1.0, terrain, thickness.astype(np.float32), np.full(terrain.shape, np.nan, np.float32),
        VolumeBudget(1.0, 1.0), 1, StepReport(1, 1, 1, 1.0, 'longest'),
        arrived=arrived.astype(np.float32), half_inundated=arrived.astype(np.float32),
        inundated=np.isfinite(arrived).astype(np.float32),
    )


def _finished(run: Run) -> Run:
    for _ in run.parts():
        pass
    return run


def _thickness(frame: Any) -> np.ndarray:
    """Return the thickness in a frame [m], NaN without lava."""
    values: np.ndarray = frame.layers['thickness'].values
    return values


def _frames(folder: Path) -> list[Any]:
    """Return the frames in the bag of a run, which is closed."""
    return list(Recording(folder).frames())


@pytest.fixture(scope='module')
def whole(valley: Case, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """Return the result of a run with four maps, and its folder."""
    folder = tmp_path_factory.mktemp('whole') / 'run'
    with SceneRun(request_of(valley, SETTINGS, output=folder)) as made:
        made.run()
        made.finish()
    return Result.of_run(made), folder


def test_case_runs_on_cells_of_its_ground(valley, tmp_path):
    found = []
    for settings in (SETTINGS, replace(SETTINGS, method='cells', spacing=None)):
        request = request_of(valley, settings, output=tmp_path / settings.method)
        with SceneRun(request) as made:
            made.run()
            found.append((Result.of_run(made), measure_run(made)))
    (particles, other), (result, own) = found
    cell = valley.scene.terrain.resolution
    assert result.accuracy.method == 'cells'
    assert result.snapshot.terrain == valley.scene.terrain
    assert result.resolution.method == 'cells' and result.accuracy.spacing == cell
    assert 'cells of lava of' in own.text() and 'particles' in other.text()
    areas = (np.nan_to_num(one.snapshot.inundated) for one in (result, particles))
    stated = np.hypot(own.inundated.total, other.inundated.total)
    assert difference(*areas) < 2.0 * stated < 0.5


def test_lava_flows_down_the_valley(valley, whole):
    result, folder = whole
    maps = _frames(folder)
    # each map is at the end of the step in which it was due
    times = [item.time for item in maps]
    dues = (900, 1800, 2700, 3600)
    late = np.subtract(times, dues)
    assert late.min() >= 0.0 and late.max() <= SETTINGS.accuracy(valley).longest_step
    assert times[-1] == valley.duration
    judged = score_snapshot(valley, result.snapshot)
    assert judged.precision > 0.9 and judged.recall > 0.2
    budget = result.snapshot.budget
    assert budget.emitted == pytest.approx(valley.volume)
    vent = valley.scene.terrain.cell_at(*valley.scene.vents[0].position)
    assert vent is not None
    arrived = result.snapshot.arrived
    assert arrived is not None and 0.0 < arrived[vent] < 900.0
    assert 900.0 < np.nanmax(arrived) <= 3600.0
    assert 'inertia' not in result.effects
    assert {'arrhenius', 'cover'} <= set(result.effects)
    assert result.most_particles > 10


class CutOffError(Exception):
    """Interrupts runs."""


def test_interrupted_run_resumes(valley, whole, tmp_path, monkeypatch):
    """The state is stored at the second map, not at the first."""
    monkeypatch.setattr('lava_ros.runs.store.KEEP_EVERY', np.inf)
    folder = tmp_path / 'parts'
    request = request_of(valley, SETTINGS, output=folder)
    seen: list[float] = []

    def at_map(time: float) -> None:
        seen.append(time)
        if len(seen) == 2:
            first.keep()
        elif len(seen) == 3:
            raise CutOffError

    with pytest.raises(CutOffError), SceneRun(request) as first:
        first.run(TimeSink(SETTINGS.map_times(valley), at_map))
    with SceneRun(request) as second:
        assert second.is_resumed
        assert second.simulation.time == pytest.approx(seen[1])
        second.run()
        second.finish()
    one, other = whole[0], Result.of_run(second)
    np.testing.assert_array_equal(one.snapshot.thickness, other.snapshot.thickness)
    np.testing.assert_array_equal(one.snapshot.arrived, other.snapshot.arrived)
    assert one.most_particles == other.most_particles
    frames = _frames(folder)
    assert len(frames) == SETTINGS.maps
    for before, after in zip(_frames(whole[1]), frames, strict=True):
        assert before.time == after.time
        np.testing.assert_array_equal(*(_thickness(frame) for frame in (before, after)))


def test_finished_run_is_not_repeated(valley, whole, tmp_path):
    """The number of maps does not change its result."""
    settings, folder = replace(SETTINGS, maps=1), tmp_path / 'kept'
    first = _finished(Run(valley, settings, folder=folder))
    first.keep()
    first.close()
    again = Run(valley, settings, folder=folder)
    assert list(again.parts()) == []
    one, other = again.result().snapshot, whole[0].snapshot
    np.testing.assert_array_equal(one.thickness, other.thickness)
    np.testing.assert_array_equal(one.arrived, other.arrived)
    assert one.steps == other.steps
    again.close()
    for case, other in (
        (valley.with_lava({'emissivity': 0.8}), settings),
        (valley, replace(settings, spacing=15.0)),
    ):
        with pytest.raises(LavaError, match='--output'):
            Run(case, other, folder=folder)
    # a checkpoint truncated by a power failure
    path = folder / 'checkpoint'
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(LavaError, match='checkpoint'):
        Run(valley, settings, folder=folder)


def test_spacing_of_a_case_is_that_of_its_scene(valley):
    for preset in ('draft', 'standard', 'fine'):
        found = resolution_of(valley.scene, PRESETS[preset].accuracy, horizon=valley.duration)
        accuracy = Settings(preset).accuracy(valley)
        assert (accuracy.spacing, accuracy.thickness) == (found.spacing, found.thickness)
    for preset, steps in (('draft', (2.0, 'rkl1')), ('reference', (0.25, 'rkl2'))):
        accuracy = Settings(preset).accuracy(valley)
        assert (accuracy.courant_number, accuracy.integrator) == steps
    assert Settings('fine', spacing=15.0).coarseness(valley) == 1
    assert Settings('fine', spacing=45.0).coarseness(valley) == 2


def test_comparison_classifies_each_cell():
    """A cell without an elevation is unknown unless it is mapped."""
    never, ground = np.nan, np.array([[0.0, 0.0, 0.0], [0.0, np.nan, np.nan]])
    arrived = np.array([[5.0, never, 7.0], [never, never, never]])
    footprint = np.array([[True, True, False], [False, False, True]])
    codes = comparison(_snapshot(Terrain(ground, 10.0), ground, arrived), footprint)
    assert codes.tolist() == [[HIT, MISS, FALSE_ALARM], [NEITHER, UNKNOWN, MISS]]


@pytest.mark.parametrize('method', ['particles', 'cells'])
def test_maps_of_a_case_are_on_the_ground_of_their_time(valley, tmp_path, method):
    """The new ground has data where the old one has none, and the other way round."""
    before, after = (np.array(valley.scene.terrain.elevation) for _ in range(2))
    before[:4, -4:] = after[-4:, :4] = np.nan
    terrain = replace(valley.scene.terrain, elevation=before)
    # at the time of the second map, which is on the ground before
    event = TerrainEvent(1800.0, 'new ground', replace(terrain, elevation=after))
    case = replace(valley, scene=replace(valley.scene, terrain=terrain, events=(event,)))
    settings = Settings('draft', 45.0, device='cpu', maps=4, method=method)
    assert (settings.coarseness(case) > 1) == (method == 'particles')
    with SceneRun(request_of(case, settings, output=tmp_path / 'run')) as made:
        made.run()
        result = Result.of_run(made)
        made.finish()
    folder = tmp_path / 'run'
    for frame in _frames(folder):
        expected = before if frame.time <= 1800.0 else after
        np.testing.assert_array_equal(np.isnan(frame.elevation), np.isnan(expected))
    several = agreement(case, [result.snapshot])
    peak = np.nan_to_num(result.snapshot.thickness)
    files = write_maps(case, 'draft', result, peak, folder, several)
    whole = {'inundated', 'comparison', 'runs'}
    for path in files:
        with rasterio.open(path) as file:
            is_known = file.read_masks(1)[::-1] > 0
        assert not is_known[np.isnan(after)].any(), path
        if path.stem in whole:
            assert is_known[np.isfinite(after)].all(), path


def test_coarse_cells_are_area_weighted_means():
    elevation = np.arange(35.0).reshape(5, 7)
    elevation[0, 0] = np.nan
    elevation[3:, 5:] = np.nan
    ground = Terrain(elevation, 10.0, origin=(3.0, 4.0), epsg=32633, offset=(5e5, 4e6))
    coarse = coarsened(ground, 2)
    assert coarse.shape == (3, 4)
    assert (coarse.resolution, coarse.origin, coarse.offset) == (20.0, (-2.0, -1.0), (5e5, 4e6))
    # half of cells 1 and 7, a quarter of cell 8
    assert coarse.elevation[0, 0] == pytest.approx((0.5 * 1 + 0.5 * 7 + 0.25 * 8) / 1.25)
    weights = np.outer([0.5, 1.0, 0.5], [0.5, 1.0, 0.5])
    mean = np.average(elevation[1:4, 1:4], weights=weights)
    assert coarse.elevation[1, 1] == pytest.approx(mean)
    assert np.isnan(coarse.elevation[2, 3])
    assert coarsened(ground, 1) is ground


def test_refined_maps_keep_volume_and_cells_without_data():
    elevation = np.zeros((6, 4))
    elevation[5, 3] = np.nan
    ground = Terrain(elevation, 10.0)
    coarse = coarsened(ground, 2)
    thickness = np.arange(6.0, dtype=np.float32).reshape(3, 2)
    snapshot = replace(_snapshot(coarse, thickness, thickness), frozen=thickness, inundated=None)
    fine = refined(snapshot, ground)
    assert fine.terrain is ground
    assert fine.frozen is not None
    for values in (fine.thickness, fine.frozen):
        np.testing.assert_array_equal(values[:2, :2], 0.0)
        np.testing.assert_array_equal(values[4, :], [4, 4, 5, 5])
        assert np.isnan(values[5, 3])
    assert np.nansum(fine.thickness) * 100.0 == thickness.sum() * 400.0 - 500.0
    assert refined(snapshot, coarse) is snapshot


@pytest.mark.parametrize('shape', [(6, 8), (7, 9), (9, 6)])
def test_refined_lava_stands_on_reached_cells_and_keeps_volume_and_area(shape):
    ground = Terrain(np.zeros(shape), 10.0)
    coarse = coarsened(ground, 2)
    arrived = np.full(coarse.shape, np.nan, np.float32)
    arrived[1:3, 1:3] = 7.0
    thickness = np.where(np.isfinite(arrived), 3.0, 0.0).astype(np.float32)
    thickness[1, 1] = 1.0
    snapshot = replace(_snapshot(coarse, thickness, arrived), frozen=thickness / 2.0)
    snapshot.inundated[1, 1] = 0.04
    fine = refined(snapshot, ground)
    reached = np.isfinite(fine.arrived)
    assert not (fine.standing & ~reached).any() and fine.footprint.any()
    np.testing.assert_array_equal(fine.inundated > 0.0, reached)
    np.testing.assert_array_equal(np.isfinite(fine.half_inundated), fine.footprint)
    assert fine.area(fine.inundated) == pytest.approx(snapshot.area(snapshot.inundated))
    for name in ('thickness', 'frozen'):
        before, after = getattr(snapshot, name), getattr(fine, name)
        assert after.sum() * 100.0 == pytest.approx(before.sum() * 400.0, rel=1e-6)


#: Settings of replicates.
TWO_MAPS = replace(SETTINGS, maps=2)


def test_directions_are_all_different(valley):
    """The first eight are all rotations and mirror images; up to 64 also displace the vents."""
    for runs in (1, 65):
        with pytest.raises(LavaError, match='--runs'):
            run_replicates(valley, TWO_MAPS, runs)
    first = directions(8)
    assert {(item.quarters, item.mirror) for item in first} == {
        (quarters, mirror) for quarters in range(4) for mirror in (False, True)
    }
    assert {item.moved for item in first} == {0.0}
    assert len(set(directions(24))) == 24
    assert directions(24)[:8] == first


def test_replicates_equal_single_runs(valley):
    settings = replace(SETTINGS, maps=1)
    done: list[float] = []
    results = run_replicates(valley, settings, 3, progress=done.append)
    assert done == pytest.approx([1 / 3, 2 / 3, 1.0])
    for direction, result in zip(directions(3), results, strict=True):
        alone = simulate(direction.rotate(valley), settings)
        thickness = result.snapshot.thickness
        np.testing.assert_array_equal(thickness, direction.rotate_back(alone.snapshot.thickness))
        np.testing.assert_array_equal(np.isnan(thickness), ~valley.scene.terrain.has_data)
        assert result.snapshot.terrain is valley.scene.terrain
        arrived = alone.snapshot.arrived
        assert arrived is not None
        np.testing.assert_array_equal(result.snapshot.arrived, direction.rotate_back(arrived))
        assert result.snapshot.budget.emitted == pytest.approx(valley.volume)
        assert result.effects == alone.effects
        assert result.accuracy == alone.accuracy


@pytest.mark.parametrize(('quarters', 'mirror', 'runs'), [
    (1, False, 8),
    pytest.param(1, False, 16, marks=pytest.mark.nightly),
    pytest.param(2, False, 16, marks=pytest.mark.nightly),
    pytest.param(3, True, 16, marks=pytest.mark.nightly),
])
def test_a_rotated_case_has_the_same_replicates(valley, device, quarters, mirror, runs):
    """They are bitwise identical in another order, so their majority is the same."""
    settings = replace(SETTINGS, spacing=24.0, device=device, maps=1)
    (vent,) = valley.scene.vents
    x, y = vent.position
    # not a multiple of the step of positions
    vent = replace(vent, position=(x + 1e-3 / 3.0, y - 1e-3 / 7.0))
    case = replace(valley, scene=replace(valley.scene, vents=(vent,)))
    direction = Orientation(quarters, mirror)
    found, other = (
        agreement(one, [item.snapshot for item in run_replicates(one, settings, runs)])
        for one in (case, direction.rotate(case))
    )
    one, another = (sorted(item.jaccard for item in of.scores) for of in (found, other))
    assert one == another
    assert found.majority.jaccard == other.majority.jaccard
    np.testing.assert_array_equal(direction.rotate_back(other.share), found.share)


@pytest.fixture
def dammed(tmp_path):
    """Return the valley with a barrier that is built below the vent."""
    x, y = VENT
    barrier = (
        f'events:\n- time: 300\n  barrier: {{line: [[{x - 250}, {y - 250}], '
        f'[{x + 250}, {y - 250}]], height: 30, width: 20}}\n'
    )
    return load_case(write_case(tmp_path / 'dammed', hours=1, yaml=LAVA + barrier))


def test_barrier_in_mid_eruption_holds_lava_back(valley, dammed):
    free, stopped = (
        np.array([
            np.nansum(run.snapshot.thickness[:37]) for run in run_replicates(case, TWO_MAPS, 2)
        ])
        for case in (valley, dammed)
    )
    assert free.min() > 30.0 and (stopped < 0.1 * free).all()


def test_members_of_a_case_have_its_events(valley, dammed):
    plans = [plan_of(case, TWO_MAPS) for case in (valley, dammed)]
    members = [run_members(plan, [Member(1)], device='cpu')[0] for plan in plans]
    free, stopped = (
        member.on(plan.scene.terrain.shape)[1][:37].sum()
        for plan, member in zip(plans, members, strict=True)
    )
    assert free > 10.0 and stopped < 0.1 * free


def test_majority_is_the_area_that_half_of_the_runs_cover(valley):
    maps = np.zeros((3, *valley.footprint.shape))
    maps[0, 10:20, 10:20] = 3.0
    maps[1, 10:20, 10:16] = 1.0
    maps[2, 10:14, 10:16] = 0.1
    snapshots = [
        _snapshot(valley.scene.terrain, item, np.where(item > 0.0, 60.0, np.nan)) for item in maps
    ]
    found = agreement(valley, snapshots)
    assert found.share[10, 10] == 1.0
    assert found.share[15, 10] == pytest.approx(2.0 / 3.0)
    np.testing.assert_array_equal(found.thickness > 0.0, maps[1] > 0.0)
    numbers = found.as_dict()
    assert numbers['count'] == 3
    assert numbers['lowest'] <= numbers['mean'] <= numbers['highest']
    assert numbers['standard_deviation'] == pytest.approx(np.std(numbers['jaccard'], ddof=1))
    cell = valley.scene.terrain.resolution**2
    assert found.majority.area == 60 * cell
    # also if it is exactly half of them
    half = agreement(valley, snapshots[:2])
    assert half.majority.area == 100 * cell
    np.testing.assert_array_equal(half.thickness > 0.0, maps[0] > 0.0)


def test_interrupted_replicates_resume(valley, tmp_path, monkeypatch):
    """They are bitwise identical, also if their number has grown; other settings raise."""
    monkeypatch.setattr('lava_ros.runs.store.KEEP_EVERY', 0.0)

    def cut_off(done: float) -> None:
        if done > 0.6:
            raise CutOffError

    whole = run_replicates(valley, TWO_MAPS, 3)
    with pytest.raises(CutOffError):
        run_replicates(valley, TWO_MAPS, 2, folder=tmp_path, progress=cut_off)
    kept = tmp_path / 'run_01'
    turned = directions(2)[1].rotate(valley)
    resumed = Run(turned, TWO_MAPS, folder=kept)
    assert resumed.is_resumed
    resumed.close()
    done: list[float] = []
    again = run_replicates(valley, TWO_MAPS, 3, folder=tmp_path, progress=done.append)
    assert len(done) == TWO_MAPS.maps * 3 - 3
    for one, other in zip(whole, again, strict=True):
        np.testing.assert_array_equal(one.snapshot.thickness, other.snapshot.thickness)
        np.testing.assert_array_equal(one.snapshot.arrived, other.snapshot.arrived)
    with pytest.raises(LavaError, match='--output'):
        run_replicates(valley, replace(TWO_MAPS, spacing=20.0), 3, folder=tmp_path)


def test_rotated_and_mirrored_vents_are_on_the_same_ground(valley):
    """A valley that slopes south slopes east after a quarter turn."""
    (vent,) = valley.scene.vents
    before = valley.scene.terrain
    here = before.cell_at(*vent.position)
    for direction in directions(8):
        case = direction.rotate(valley)
        ground, (moved,) = case.scene.terrain, case.scene.vents
        cell = ground.cell_at(*moved.position)
        assert cell is not None
        assert ground.elevation[cell] == before.elevation[here]
        assert case.footprint[cell] == valley.footprint[here]
        np.testing.assert_array_equal(direction.rotate_back(ground.elevation), before.elevation)
        np.testing.assert_array_equal(direction.rotate_back(case.footprint), valley.footprint)
    quarter = Orientation(1).rotate(valley).scene.terrain.elevation
    assert np.median(np.diff(quarter, axis=1)) < 0.0


def test_numerical_error_of_a_run_is_measured_on_its_own_cells(valley, tmp_path):
    found = []
    for spacing in (40.0, 6.0):
        request = request_of(
            valley, replace(SETTINGS, spacing=spacing, maps=1), output=tmp_path / f'{spacing}'
        )
        with SceneRun(request) as made:
            made.run()
            error = measure_run(made)
        assert error is not None
        found.append(error)
    coarse, fine = found
    assert coarse.cell == 2.0 * valley.scene.terrain.resolution
    assert (coarse.spacing, coarse.time) == (40.0, valley.duration)
    assert 0.0 < fine.inundated.lava < coarse.inundated.lava < 1.0
    # larger cells lower a parabolic valley evenly
    assert fine.inundated.ground == fine.standing.ground == 0.0
