# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Mapped eruptions that start from an outline, and emplaced flows with a volume."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import rasterio

from command_line import done
from lava_ros.cli.ensemble_report import score_against_case
from lava_ros.errors import LavaError
from lava_ros.forecast.members import MemberFields, run_members
from lava_ros.forecast.probability import EnsembleAccumulator, Footprint, footprint_of, NEVER
from lava_ros.forecast.sampling import Member
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.page import FALSE_ALARM, HIT, MISS
from lava_ros.hindcast.probabilistic_score import plan_of, start_on
from lava_ros.hindcast.replicates import directions
from lava_ros.hindcast.run import (
    outlined_part,
    Settings,
    shown_on,
    simulate,
    simulated_scene,
)
from lava_ros.hindcast.score import refer, score_outlines
from lava_ros.scene.emplaced import profile_of
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.output.inundation import TOUCHED

CELL, ROWS, COLUMNS = 10.0, 40, 80


def _write_grid(path: Path, values: np.ndarray) -> None:
    """Write a grid whose first row is the northern one."""
    head = f'ncols {COLUMNS}\nnrows {ROWS}\nxllcorner 0\nyllcorner 0\ncellsize {CELL:g}\n'
    rows = '\n'.join(' '.join(f'{value:g}' for value in row) for row in values)
    path.write_text(f'{head}{rows}\n')


@pytest.fixture
def folder(tmp_path):
    """Return a case on a plane of 10 %, with outlines after 2,000, 4,000 and 6,000 s."""
    columns = np.arange(COLUMNS)
    _write_grid(tmp_path / 'elevation.asc', np.tile(200.0 - columns, (ROWS, 1)))
    (tmp_path / 'vent.csv').write_text('x,y\n105,200\n')
    (tmp_path / 'effusion_rate.csv').write_text(
        'start_s,end_s,effusion_rate_m3_per_s\n0,1000,30\n1000,6000,10\n'
    )
    for name, end in (('a', 30), ('b', 40), ('c', 50)):
        covered = np.zeros((ROWS, COLUMNS))
        covered[15:25, 8:end] = 1.0
        _write_grid(tmp_path / f'{name}.asc', covered)
    listed = ''.join(
        f'- {{time: {time}, file: {name}.asc}}\n'
        for time, name in ((2000, 'a'), (4000, 'b'), (6000, 'c'))
    )
    (tmp_path / 'case.yaml').write_text(f'outlines:\n{listed}')
    return tmp_path


def test_plastic_flow_thins_towards_its_margin():
    covered = np.zeros((9, 9), dtype=bool)
    covered[1:8, 1:8] = True
    thickness = profile_of(covered, 700.0, 2.0)
    assert 4.0 * thickness.sum() == pytest.approx(700.0)
    assert not thickness[~covered].any()
    assert thickness[4, 4] / thickness[1, 4] == pytest.approx(math.sqrt(3.5 / 0.5))


@pytest.mark.parametrize('solidified', [0.0, 0.25])
def test_case_starts_from_an_outline(folder, solidified):
    whole = load_case(folder)
    case = load_case(folder, from_outline=2000, solidified=solidified)
    flow, = case.scene.emplaced_flows
    erupted = 30.0 * 1000.0 + 10.0 * 1000.0
    assert flow.volume == pytest.approx((1.0 - solidified) * erupted)
    raised = case.scene.terrain.elevation - whole.scene.terrain.elevation
    assert raised.sum() * CELL**2 == pytest.approx(solidified * erupted, abs=20.0)
    assert (case.start, case.duration) == (2000.0, 4000.0)
    assert [item.time for item in case.outlines] == [2000.0, 4000.0]
    assert case.scene.vents[0].volume_between(0.0, 4000.0) == pytest.approx(40000.0)
    assert (case.initial == whole.outlines[0].footprint).all()
    # the volume of the whole eruption that is not solid
    assert case.volume == pytest.approx(whole.volume - solidified * erupted)
    # the outline of the start persists
    scores = refer(case, {item.text: 0.0 for item in case.outlines})
    assert scores['4000 s'].persistence == pytest.approx(220.0 / 320.0)


def test_flow_continues_from_its_outline(folder):
    """The area is never less than the outline, for a rotated case too, and then grows."""
    case = load_case(folder, from_outline=2000)
    settings = Settings('draft', spacing=10.0, device='cpu', maps=1)
    result = simulate(case, settings)
    first, last = score_outlines(case, [result.snapshot])
    outlines = [item.footprint.sum() for item in case.outlines]
    areas = [
        (1.0 + item.footprint_area_error) * cells
        for item, cells in zip((first, last), outlines, strict=True)
    ]
    assert case.initial.sum() <= areas[0] < areas[1]
    assert first.recall >= case.initial.sum() / outlines[0]
    turned = directions(2)[1].rotate(case)
    assert turned.scene.emplaced_flows[0].thickness.shape == (COLUMNS, ROWS)
    assert (turned.initial == (turned.scene.emplaced_flows[0].thickness > 0.0)).all()


@pytest.mark.parametrize(('changes', 'message'), [
    ({'from_outline': 3000}, 'from_outline.* is 3000, expected the time of an outline: 2000'),
    ({'from_outline': 6000}, 'one after that of the start'),
    ({'from_outline': '2021-09-24T12:00:00Z'}, 'a date also needs the date of time 0'),
    ({'solidified': 0.5}, 'no effect without'),
    ({'from_outline': 2000, 'solidified': 1.0}, 'at most 0.99'),
])
def test_unusable_outline_of_the_start_is_refused(folder, changes, message):
    with pytest.raises(LavaError, match=message):
        load_case(folder, **changes)


def test_case_file_and_option_start_alike(folder, tmp_path):
    text = (folder / 'case.yaml').read_text()
    (folder / 'case.yaml').write_text(f'{text}from_outline: {{time: 4000, solidified: 0.1}}\n')
    case = load_case(folder)
    assert case.start == 4000.0
    done(
        'run', folder, '--from-outline', '4000', '--solidified', '0.1', '--preset', 'draft',
        '--spacing', '20', '--device', 'cpu', '-o', tmp_path / 'out',
    )
    data = json.loads((tmp_path / 'out' / 'run.json').read_text())
    assert [item['outline'] for item in data['outlines']] == ['6000 s']
    other = load_case(folder, from_outline=2000)
    assert other.start == 2000.0 and other.scene.terrain.elevation[20, 20] == 180.0


def test_ensemble_that_starts_from_an_outline_is_compared_with_its_persistence(folder, tmp_path):
    case = load_case(folder, from_outline=4000)
    plan = plan_of(case, Settings('draft', spacing=10.0, device='cpu'))
    lava = case.outlines[-1].footprint
    member = Footprint(
        0, (0, 0), *(np.where(lava, 0, NEVER).astype(np.uint16) for _ in range(2)),
        np.where(lava, round(1.0 / TOUCHED), 0).astype(np.uint8),
        np.where(lava, 1000, 0).astype(np.uint32),
    )
    (date,) = score_against_case(case, plan, [member], tmp_path)['dates']['dates']
    # the outline of 4000 s lacks 100 of the 420 cells of 6000 s
    assert date['brier_persistence'] == pytest.approx(100.0 / 420.0)
    assert date['brier_skill_persistence'] == 1.0


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('spacing', [10.0, 20.0])
def test_members_count_the_outline_of_the_start_as_their_hindcast_does(folder, method, spacing):
    # most of the lava in the outline is solid, and the rest is thinner than the threshold
    case = load_case(folder, from_outline=2000, solidified=0.98)
    settings = Settings('draft', spacing=spacing, device='cpu', maps=1, method=method)
    snapshot, plan = simulate(case, settings).snapshot, plan_of(case, settings)
    (member,) = run_members(plan, [Member(1)], device='cpu')
    start, (arrival, inundated) = start_on(case, plan), member.on(plan.scene.terrain.shape)
    assert start.sum() * plan.scene.terrain.resolution**2 == 220 * CELL**2
    assert not arrival[start].any() and (inundated[start] >= 0.5).all()
    area = inundated.sum() * plan.scene.terrain.resolution**2
    assert area == pytest.approx(snapshot.area(snapshot.inundated), rel=0.02)
    tally = EnsembleAccumulator(plan)
    tally.add(footprint_of(member, plan))
    maps = tally.maps()
    assert (maps.probability[start] == 100.0).all()
    assert maps.areas(plan.scene.terrain.resolution)[0.5] == pytest.approx(area, rel=0.01)


@pytest.mark.parametrize('factor', [1, 2, 3])
@pytest.mark.parametrize('solidified', [0.0, 0.98])
def test_maps_of_a_hindcast_and_of_a_member_have_one_area_of_the_same_flow(
    folder, solidified, factor,
):
    case = load_case(folder, from_outline=2000, solidified=solidified)
    simulation = Simulation(
        simulated_scene(case, factor), accuracy=Accuracy(spacing=10.0 * factor), device='cpu'
    )
    simulation.advance(300.0)
    flow = simulation.snapshot()
    shown = shown_on(case, flow)
    member = MemberFields(
        0, flow.arrived, flow.half_inundated, flow.inundated, flow.thickness
    ).with_covered(outlined_part(case, factor))
    # an area counts parts of a cell, to which the fraction outside the outline is rounded
    area = shown.area(shown.inundated)
    assert area == pytest.approx(member.inundated.sum() * (CELL * factor) ** 2, rel=1e-3)
    # the area is at least that of the outline, and at least that of the flow
    assert area >= max(case.initial.sum() * CELL**2, flow.area(flow.inundated)) * (1.0 - 1e-3)
    assert (np.isfinite(shown.half_inundated) == shown.footprint).all()


@pytest.mark.parametrize('words', [[], ['--from-outline', '2000'],
                                   ['--from-outline', '2000', '--solidified', '0.3']])
def test_areas_and_cells_of_a_hindcast_agree_in_all_files(folder, tmp_path_factory, words):
    with (folder / 'case.yaml').open('a') as file:
        file.write('effusion_rate: {start: 2021-09-19T14:10:00Z}\n')
    out, maps = (tmp_path_factory.mktemp(name) for name in ('out', 'maps'))
    more = ['--preset', 'draft', '--spacing', '20', '--device', 'cpu', '--maps', '1']
    done('run', folder, *words, *more, '-o', out)
    record = json.loads((out / 'run.json').read_text())
    score = record['score']
    for name in ('inundated_area_m2', 'standing_area_m2'):
        assert record[name] == pytest.approx(score[name], rel=1e-9)
    with rasterio.open(out / 'comparison.tif') as file:
        codes = file.read(1)
    counts = {name: (codes == code).sum()
              for name, code in (('hits', HIT), ('misses', MISS), ('false_alarms', FALSE_ALARM))}
    assert counts == {name: score[name] for name in counts}
    done('export', out, '-o', maps, '--maps', 'inundated', 'thickness')
    for path in (*maps.glob('*.tif'), *(out / item.name for item in maps.glob('*.tif'))):
        with rasterio.open(path) as file:
            tags = file.tags()
        assert tags['date_utc'] == '2021-09-19T15:50:00Z'
        if path.stem == 'inundated':
            assert float(tags['inundated_area_m2']) == score['inundated_area_m2']
