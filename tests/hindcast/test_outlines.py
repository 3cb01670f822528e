# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cases with outlines of several dates: reading, scores, references and forecasts."""

from dataclasses import replace
import json
from pathlib import Path
import shutil

import numpy as np
import pytest

from command_line import done, refused
from disc_flow import disc_fields, disc_plan, HORIZON
from eruption import footprint, LAVA, write_case, write_grid
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Outline as Observed
from lava_ros.forecast.probability import EnsembleAccumulator, footprint_of
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.probabilistic_score import probability_at, score_dates
from lava_ros.hindcast.run import Result, Settings, simulate
from lava_ros.hindcast.score import count_visits, descend, PATHS, refer, score_outlines
from lava_ros.scene.events import TerrainEvent

#: Times of two outlines [s], and options of a run that takes a second.
FIRST, SECOND = 900.0, 1800.0
QUICK = Settings('draft', 40.0, 'cpu')


def dated(folder: Path, outlines: str, *, start: str = '') -> Path:
    """Write a case of half an hour without a footprint, with outlines as in ``case.yaml``."""
    rates = f'effusion_rate: {{start: {start}}}\n' if start else ''
    case = write_case(folder, hours=0.5, yaml=f'{LAVA}{rates}outlines: {outlines}\n')
    (case / 'footprint.asc').unlink()
    write_grid(case / 'early.asc', footprint())
    return case


@pytest.fixture(scope='module')
def mapped(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """Return a case whose outlines are those of a simulation of it, and that simulation."""
    folder = tmp_path_factory.mktemp('outlines') / 'valley'
    items = f'[{{time: {FIRST}, file: early.asc}}, {{time: {SECOND}, file: late.asc}}]'
    dated(folder, items)
    write_grid(folder / 'late.asc', footprint())
    result = simulate(load_case(folder), QUICK)
    assert result.snapshot.half_inundated is not None
    for name, time in (('early', FIRST), ('late', SECOND)):
        write_grid(folder / f'{name}.asc', (result.snapshot.half_inundated <= time).astype(float))
    return folder, result


def test_outlines_of_a_simulation_agree_with_it_at_each_time(mapped):
    folder, result = mapped
    case = load_case(folder)
    assert [item.time for item in case.outlines] == [FIRST, SECOND] and case.end == SECOND
    assert np.array_equal(case.footprint, case.outlines[-1].footprint)
    early, late = (item.footprint for item in case.outlines)
    assert 0 < early.sum() < late.sum()
    for score in score_outlines(case, [result.snapshot]):
        assert score.jaccard == score.recall == score.precision == 1.0
        assert score.footprint_area_error == score.length_error == 0.0
    first, second = refer(case, dict.fromkeys(['900 s', '1800 s'], 0.0)).values()
    assert first.persistence is None and second.persistence == early.sum() / late.sum()
    # down the middle of the valley, but not as wide as lava
    assert 0.0 < first.descent < second.descent < 0.9
    (only,) = refer(case, {'1800 s': 0.0}, late).values()
    assert only.persistence == 1.0 and only.descent == second.descent


def test_outlines_rotate_with_their_case(mapped):
    from lava_ros.hindcast.replicates import directions

    case = load_case(mapped[0])
    for way in directions(8):
        turned = way.rotate(case)
        assert np.array_equal(turned.footprint, turned.outlines[-1].footprint)
        for item, original in zip(turned.outlines, case.outlines, strict=True):
            assert np.array_equal(way.rotate_back(item.footprint), original.footprint)


def test_majority_of_runs_counts_at_each_time(mapped):
    folder, result = mapped
    case, snapshot = load_case(folder), result.snapshot
    nothing = replace(snapshot, half_inundated=np.full_like(snapshot.arrived, np.nan))
    assert score_outlines(case, [snapshot, snapshot, nothing])[0].jaccard == 1.0
    assert score_outlines(case, [snapshot, nothing])[0].jaccard == 1.0
    assert score_outlines(case, [snapshot, nothing, nothing])[1].jaccard == 0.0


def test_outline_of_the_vent_alone_has_no_length(mapped):
    case = load_case(mapped[0])
    alone = np.zeros_like(case.footprint)
    alone[case.vent_cells[0]] = True
    case = replace(case, outlines=(replace(case.outlines[0], footprint=alone),))
    (score,) = score_outlines(case, [mapped[1].snapshot])
    assert np.isnan(score.length_error) and score.recall == 1.0


@pytest.mark.parametrize(('outlines', 'start', 'field', 'valid'), [
    ('3', '', 'outlines', 'a list of outlines'),
    ('[]', '', 'outlines', 'at least one'),
    ('[{time: 900}]', '', 'outlines[0].file', 'required'),
    ('[{time: 900, file: early.asc, date: 3}]', '', 'outlines[0].date', 'time'),
    ('[{time: -1, file: early.asc}]', '', 'outlines[0].time', 'after the start'),
    ('[{time: .nan, file: early.asc}]', '', 'outlines[0].time', 'finite'),
    ('[{time: 900, file: none.asc}]', '', 'outlines[0].file', 'a file in'),
    ('[{time: 900, file: 7}]', '', 'outlines[0].file', 'the name of a file'),
    ('[{time: 900, file: early.asc}, {time: 900, file: early.asc}]', '', 'outlines[1].time',
     'after the outline before'),
    ('[{time: "2021-09-24T12:00Z", file: early.asc}]', '', 'outlines[0].time',
     'effusion_rate: {start'),
    ('[{time: "24 September", file: early.asc}]', '2021-09-24T11:50Z', 'outlines[0].time',
     'a date such as'),
    ('[{time: "2021-09-24T11:00Z", file: early.asc}]', '2021-09-24T11:50Z', 'outlines[0].time',
     'after the start'),
    ('[{time: 9000, file: early.asc}]\nend: 1800', '', 'outlines[0].time', 'before the end'),
])
def test_refuses_unusable_outlines(outlines, start, field, valid, tmp_path):
    case = dated(tmp_path / 'valley', outlines, start=start)
    with pytest.raises(LavaError) as caught:
        load_case(case)
    assert f'case.{field}' in str(caught.value) and valid in str(caught.value)


def test_times_of_outlines_may_be_dates(tmp_path):
    items = '[{time: "2021-09-24T12:00Z", file: early.asc}]'
    case = load_case(dated(tmp_path / 'valley', items, start='"2021-09-24T11:50:00Z"'))
    assert [(item.time, item.text) for item in case.outlines] == [(600.0, '2021-09-24T12:00:00Z')]


def test_volume_until_the_end_is_compared_with_the_outline(tmp_path):
    # all of the table's volume would be 240 m thick on this outline
    case = write_case(tmp_path / 'valley', hours=400.0, yaml=f'{LAVA}end: 3600\n')
    assert load_case(case).volume == pytest.approx(20.0 * 3600.0)


def test_steepest_descent_fills_pits_on_its_way_to_the_border():
    elevation = np.full((7, 5), 9.0)
    # a pit at 1 behind a sill at 4, then down to the border
    low = {(5, 2): 6.0, (4, 2): 1.0, (3, 3): 4.0, (2, 2): 3.0, (1, 2): 2.0, (0, 2): 0.0}
    for place, height in low.items():
        elevation[place] = height
    path = descend(elevation, [(5, 2)])
    assert {tuple(cell) for cell in np.argwhere(path).tolist()} == set(low)
    elevation[1, 1] = np.nan
    assert not descend(elevation, [(5, 2)])[1, 2]


def test_paths_of_steepest_descent_spread_by_the_noise_of_the_ground():
    y, x = np.indices((40, 41)).astype(float)
    visits = count_visits(10.0 * y, [(38, 20)])
    assert visits[38, 20] == PATHS and visits.max() == PATHS
    across = np.abs(x - 20.0)
    near, far = ((visits * across)[row].sum() / visits[row].sum() for row in (34, 4))
    assert 0.2 < near < far < 10.0


def test_calibration_forecasts_later_outlines(mapped, tmp_path):
    words = ['calibrate', mapped[0], '--device', 'cpu', '--spacing', '40', '--runs', '4']
    words += ['--unknown', 'viscosity=1e4:4e4', '-o', tmp_path / 'out']
    text = done(*words, '--fit-until', '1000')
    assert 'forecast of valley 1800 s: Jaccard' in text
    result = json.loads((tmp_path / 'out/calibration.json').read_text())
    assert result['fitted'] == ['valley 900 s']
    (forecast,) = result['forecasts']
    best = result['best']['numbers']
    assert forecast['outline'] == 'valley 1800 s'
    assert forecast['jaccard'] == best['valley 1800 s']['jaccard']
    # the outlines are those of the usual constants
    usual = result['usual']['numbers']
    assert [item['jaccard'] for item in usual.values()] == [1.0, 1.0]
    assert [item['fitted'] for item in usual.values()] == [1.0, 0.0]
    assert [item['footprint_area_error'] for item in usual.values()] == [0.0, 0.0]
    table = (tmp_path / 'out/posterior.csv').read_text().splitlines()
    assert table[0] == 'name,unit,low,high,usual,best,p05,p50,p95'
    (unknown,) = result['unknowns']
    low, middle, high = (float(value) for value in table[1].split(',')[-3:])
    assert 1e4 < low < middle < high < 4e4
    assert unknown['quantiles'] == pytest.approx([low, middle, high], rel=1e-5)
    assert 1.0 <= result['effective_sets'] <= 4.0 and 'given the fit' in text
    case = load_case(mapped[0])
    early, late = (item.footprint for item in case.outlines)
    assert forecast['persistence'] == pytest.approx(early.sum() / late.sum())
    assert '--fit-until' in refused(*words, '--fit-until', '2000')
    assert 'after the first outline' in refused(*words, '--fit-until', '10', '--fresh')


def test_fit_until_needs_outlines(tmp_path):
    case = write_case(tmp_path / 'valley', hours=0.5, yaml=LAVA)
    text = refused('calibrate', case, '--fit-until', '900', '-o', tmp_path / 'out')
    assert '--fit-until does not apply to cases without dated outlines' in text
    assert not (tmp_path / 'out').exists()


def test_hindcast_reports_each_outline(mapped, tmp_path):
    words = ['run', mapped[0], '--preset', 'draft', '--spacing', '40', '--device', 'cpu']
    text = done(*words, '-o', tmp_path / 'out', '--maps', '1')
    assert 'Jaccard on 900 s' in text and 'Jaccard on 1800 s' in text
    record = json.loads((tmp_path / 'out/run.json').read_text())
    scores, last = record['outlines'], record['score']
    assert [item['jaccard'] for item in scores] == [1.0, 1.0]
    # the last outline is that of the end; only its cells are whole
    assert [item['footprint_area_error'] for item in (*scores, last)] == [0.0, 0.0, 0.0]
    assert last['area_error'] == last['inundated_area_m2'] / last['mapped_area_m2'] - 1.0 != 0.0
    assert not any('area_error' in item for item in scores)
    assert 'Jaccard on 1800 s' in (tmp_path / 'out/hindcast.html').read_text()


def test_ensemble_is_scored_at_each_outline_and_narrowed_by_the_first(mapped, tmp_path):
    case = Path(shutil.copytree(mapped[0], tmp_path / 'valley'))
    with (case / 'case.yaml').open('a') as file:
        file.write('uncertainty: {discharge: {distribution: uniform, low: 0.2, high: 2.0}}\n')
    words = ['run', case, '-o', tmp_path / 'out', '--members', '12', '--spacing', '15']
    words += ['--device', 'cpu', '--workers', '1', '--json', tmp_path / 'report.json']
    assert '--observed' in refused(*words, '--posterior', '12')
    text = done(*words)
    dates = json.loads((tmp_path / 'report.json').read_text())['dates']
    assert [item['date'] for item in dates['dates']] == ['900 s', '1800 s']
    assert dates['dates'][0]['brier_skill_persistence'] is None
    assert sum(item['count'] for item in dates['reliability']) == 2 * footprint().size
    assert f'{dates["brier_score"]:.3f}' in text and 'all dates' in text
    seen = ['--observed', case / 'early.asc', '--observed-at', '900s', '--posterior', '12']
    text = done(*words, *seen)
    report = json.loads((tmp_path / 'report.json').read_text())
    new = report['posterior']
    # the observed outline is not a forecast
    assert [item['date'] for item in new['dates']['dates']] == ['1800 s']
    assert report['resumed'] == 12 and new['members'] == 12
    assert new['effective_parents'] == pytest.approx(report['effective_members'])
    assert new['jaccard_mean'] > report['observed']['jaccard_mean']
    assert '12 members drawn near' in text
    for folder in ('.', 'weighted', 'posterior_900s'):
        assert (tmp_path / 'out' / folder / 'reliability.png').stat().st_size > 5000
    # new members near others, or after another outline, are refused before any member runs
    record = (tmp_path / 'out/run.json').read_text()
    words[words.index('12')] = '13'
    for observed in ('early.asc', 'late.asc'):
        seen[1] = case / observed
        error = refused(*words, *seen)
        assert f'The members in {tmp_path / "out/posterior_900s"} were drawn near other' in error
        words[words.index('--members') + 1] = '12'
    assert len(list((tmp_path / 'out/members').iterdir())) == 12
    assert (tmp_path / 'out/run.json').read_text() == record


def cells(*values: int) -> np.ndarray:
    return np.array([values], dtype=bool)


def test_dates_are_scored_together_against_persistence():
    known = cells(1, 1, 1, 1, 0)
    outlines = {
        'one': Observed(1.0, cells(1, 0, 0, 0, 0), known),
        'two': Observed(2.0, cells(1, 1, 0, 0, 0), known),
    }
    likely = np.array([[[100.0, 50.0, 0.0, 0.0, np.nan]], [[100.0, 50.0, 50.0, 0.0, np.nan]]])
    found = score_dates(likely, outlines)
    # over the cells with lava in a member or in an outline: two and three
    assert found['brier_score'] == pytest.approx(0.75 / 5)
    assert found['brier_persistence'] == pytest.approx(1 / 3)
    assert found['brier_skill_persistence'] == pytest.approx(0.5)
    assert [item['count'] for item in found['reliability']] == [3, 3, 2]
    assert [item['observed'] for item in found['reliability']] == pytest.approx([0, 1 / 3, 1])
    first, second = found['dates']
    assert first['brier_persistence'] is None and 'reliability' not in first
    assert second['brier_skill_persistence'] == pytest.approx(0.5)
    found = score_dates(likely, outlines, before=cells(1, 1, 0, 0, 0))
    assert found['brier_persistence'] == pytest.approx(1 / 5)
    assert found['brier_skill_persistence'] == pytest.approx(0.25)
    # perfect persistence has no error that a forecast could reduce
    assert found['dates'][1]['brier_skill_persistence'] is None


def test_probability_at_a_time_counts_the_weights_of_members():
    plan, members = disc_plan(), [disc_fields(0, 0.5), disc_fields(1, 2.0)]
    footprints = [footprint_of(item, plan) for item in members]
    early, late = probability_at([600.0, HORIZON], footprints, plan, [1.0, 3.0])
    assert set(np.unique(late)) == {0.0, 75.0, 100.0}
    assert (early <= late).all() and 0 < (early == 100.0).sum() < (late == 100.0).sum()
    tally = EnsembleAccumulator(plan)
    for member in footprints:
        tally.add(member)
    (even,) = probability_at([HORIZON], footprints, plan)
    np.testing.assert_array_equal(even, tally.maps().probability)


def test_probability_at_a_time_is_on_the_ground_of_that_time():
    plan = disc_plan()
    before, after = (np.array(plan.scene.terrain.elevation) for _ in range(2))
    before[0, 0] = after[-1, -1] = np.nan
    terrain = replace(plan.scene.terrain, elevation=before)
    event = TerrainEvent(900.0, 'new ground', replace(terrain, elevation=after))
    plan = replace(plan, scene=replace(plan.scene, terrain=terrain, events=(event,)))
    found = probability_at([900.0, HORIZON], [footprint_of(disc_fields(0, 0.5), plan)], plan)
    np.testing.assert_array_equal(np.isnan(found), np.isnan([before, after]))


def test_case_without_outlines_has_none(valley):
    assert valley.outlines == () and score_outlines(valley, []) == []
