# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava run --members`: maps from a scene file, resumed runs, barriers and errors."""

from argparse import Namespace
import json
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import rasterio
import yaml

from command_line import done, lava, refused
from eruption import footprint, write_case
from geodata import write_raster, write_scene
from lava_ros.bag import BagReader
from lava_ros.bag.decoding import Decoder, read_grid
from lava_ros.bag.recorded_node import described_node, RecordedNode
from lava_ros.cli.options import seconds_of
from lava_ros.cli.planned import target_of
from lava_ros.effects import EFFECTS
from lava_ros.errors import LavaError
from lava_ros.layers.forecast import occupancy
from lava_ros.layers.numbers import area_words, duration
from lava_ros.products.run_page import read_run
from lava_ros.scene.features import load_features
from lava_ros.simulation import Simulation

MAPS = (
    'inundation_probability', 'expected_peak_thickness', 'arrival_time_p10', 'arrival_time_p50',
    'arrival_time_p90',
)

CORNER = (500_000.0, 4_180_000.0)


@pytest.fixture
def scene(tmp_path):
    """Write a scene file: a slope of 24 x 30 cells of 20 m in UTM zone 33."""
    y, x = np.mgrid[0:30, 0:24] * 20.0
    return write_scene(tmp_path, 500.0 - 0.1 * y + 5.0 * np.sin(x / 60.0), 20.0, {
        'vents': [{'position': [240.0, 100.0], 'discharge': 10.0, 'radius': 30.0}],
        'lava': {'viscosity': 5e3},
        'uncertainty': {
            'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
            'position': {'deviation': 20.0},
        },
    }, epsg=32633, offset=CORNER)


@pytest.fixture
def lines(tmp_path):
    """Write two barriers, and a hut in a file of its own."""
    x, y = CORNER
    dams = [('upper', 12, 180, 300, 170), ('lower', 9, 150, 330, 200)]
    rows = [
        f'"LINESTRING ({x + west} {y + north}, {x + east} {y + north})",{name},{height},30'
        for name, height, west, east, north in dams
    ]
    (tmp_path / 'dams.csv').write_text('\n'.join(['wkt,name,barrier_height,width', *rows]) + '\n')
    (tmp_path / 'hut.csv').write_text(f'x,y,name\n{x + 240},{y + 190},hut\n')
    return tmp_path / 'dams.csv'


def raster(path: Path, values: np.ndarray) -> Path:
    """Write a GeoTIFF on the cells of the terrain, row 0 in the south."""
    north_west = (CORNER[0], CORNER[1] + 600.0)
    return write_raster(path, values[::-1].astype('float32'), cell=20.0, north_west=north_west)


def read(path: Path) -> np.ndarray:
    """Read a map, row 0 in the south."""
    with rasterio.open(path) as file:
        return file.read(1)[::-1]


def test_barriers_are_compared_with_the_same_members(scene, lines, tmp_path):
    out, report = tmp_path / 'out', tmp_path / 'report.json'
    words = ['run', scene, '-o', out, '--until', '12min', '--members', '2']
    words += ['--workers', '1', '--device', 'cpu', '--json', report, '--barriers', lines]
    words += ['--places', tmp_path / 'hut.csv', '--barriers-at', '2min']
    output = done(*words)
    earth = [line for line in output.splitlines() if line.startswith('barrier ')]
    assert [line.split()[1] for line in earth] == ['upper', 'lower']
    assert '120 m long, 12 m high, crest 30 m wide' in earth[0]
    compared = json.loads(report.read_text())['barriers']
    assert compared['built_s'] == 120.0
    assert [round(item['volume_m3']) for item in compared['barriers']] == [
        int(line.split(': ')[1].split()[0]) for line in earth
    ]
    without, dammed = (
        read(folder / 'inundation_probability.tif') for folder in (out, out / 'with_barriers')
    )
    change = read(out / 'comparison/probability_change.tif')
    changed = dammed - without
    np.testing.assert_array_equal(change, np.where(changed != 0.0, changed, -9999.0))
    assert changed.min() < 0.0
    for percent, areas in compared['area_m2'].items():
        tag = f'inundated_area_p{percent.split()[2]}_m2'
        for case, folder in (('without', out), ('with', out / 'with_barriers')):
            with rasterio.open(folder / 'inundation_probability.tif') as file:
                assert areas[case] == float(file.tags()[tag])
    assert compared['area_m2']['at least 10 %']['with'] < without.size * 400.0
    (hut,) = compared['places']
    assert hut['name'] == 'hut'
    assert hut['probability_percent_with'] <= hut['probability_percent_without']
    table = (out / 'comparison/places.csv').read_text().splitlines()
    assert table[0].startswith('name,kind,probability_percent_without,probability_percent_with')
    assert table[1].startswith('hut,point,')
    assert (out / 'comparison/barriers.png').stat().st_size > 10_000
    # the comparison keeps the two members
    status, _, warned = lava(*words[:7], '3', *words[8:12])
    assert status == 0
    assert f'the maps in {out / "with_barriers"} and {out / "comparison"} are of 2' in warned
    # other barriers are refused before the fourth member runs
    record = (out / 'run.json').read_text()
    status, _, error = lava(*words[:7], '4', *words[8:-1], '3min')
    assert status == 2
    assert 'scene.events[0].time is 180' in error
    assert f'the members in {out / "with_barriers"}' in error
    assert len(list((out / 'members').iterdir())) == 3
    assert (out / 'run.json').read_text() == record


@pytest.mark.parametrize(('words', 'named'), [
    (('-o', 'full'), "--output is 'full'"),
    (('-o', 'full/letter.txt/out'), "--output is 'full/letter.txt/out'"),
    (('--scheduler', 'nowhere'), "--scheduler is 'nowhere'"),
])
@pytest.mark.parametrize('target', [(), ('--within', '1min')], ids=['preset', 'within'])
def test_ensemble_is_refused_before_its_pilot_runs(
    tmp_path, monkeypatch, target, words, named
):
    monkeypatch.chdir(tmp_path)
    write_case(Path('valley'))
    Path('full').mkdir()
    Path('full/letter.txt').write_text('dear')
    advance = Mock(side_effect=AssertionError('a simulation has begun'))
    monkeypatch.setattr(Simulation, 'advancing', advance)
    workers = () if '--scheduler' in words else ('--workers', '1')
    error = refused(
        'run', 'valley', '--members', '4', '--device', 'cpu', *workers, *target, *words
    )
    assert named in error and not advance.called


@pytest.mark.parametrize('words', [(), ('--members', 1)], ids=['run', 'ensemble'])
def test_warns_of_what_comes_after_the_end(scene, lines, tmp_path, words):
    data = yaml.safe_load(scene.read_text())
    data['vents'].append(
        {'position': [300.0, 300.0], 'discharge': [[0, 0], [7200, 9]], 'name': 'upper vent'}
    )
    data['events'] = [{'time': 3600.0, 'barriers': 'dams.csv'}]
    scene.write_text(yaml.safe_dump(data))
    command = [
        'run', scene, '-o', tmp_path / 'out', '--until', '3min', '--method', 'cells', '--json',
        tmp_path / 'report.json', *words,
    ]
    status, _, warned = lava(*command)
    assert status == 0
    late = ('at 60 min comes after the end of the run, 3 min', 'upper vent begins at 2 h, after')
    assert all(text in warned for text in late)
    report = json.loads((tmp_path / 'report.json').read_text())
    assert all(any(text in item for item in report['warnings']) for text in late)
    page = ' '.join(read_run(tmp_path / 'out').warnings)
    assert all(text in page for text in late)
    command[3] = tmp_path / 'other'
    error = refused(*command, '--barriers', lines, '--barriers-at', '3min')
    assert "--barriers-at is '3min', expected a time before the end of the run, 3 min" in error


@pytest.mark.parametrize(('words', 'named'), [
    (('--barriers-at', '1h'), '--barriers-at'),
    (('--places', 'none.csv'), '--places'),
    (('--seed', '3', '--at', '1h'), '--at and --members exclude'),
    (('--barriers', 'hut.csv'), 'a line'),
    (('--emplaced-as', 'ground'), '--emplaced-as'),
    (('--emplaced-flow', 'hut.csv', '--emplaced-thickness', '3'), 'at least one area'),
    (('--terrain-at', '1h', 'none.tif'), 'none.tif'),
    (('--terrain-at', '-1h', 'ground.npz'), '--terrain-at'),
    (('--workers', '0'), '--workers'),
    (('--workers', '2', '--scheduler', 'tcp://localhost:1'), '--workers'),
    (('--observed', 'outline.tif'), '--observed-at'),
    (('--observed', 'none.tif', '--observed-at', '30h'), "--observed-at is '30h', expected"),
    (('--susceptibility', 'none.tif'), '--susceptibility'),
])
def test_refuses_unusable_options(scene, lines, tmp_path, monkeypatch, words, named):
    monkeypatch.chdir(tmp_path)
    error = refused('run', scene, '-o', 'out', '--members', '4', *words)
    assert error.startswith('lava run: ') and named in error
    assert not (tmp_path / 'out').exists()


def test_maps_bag_and_report_of_an_ensemble_agree(scene, tmp_path, undrawn):
    out, report = tmp_path / 'out', tmp_path / 'report.json'
    words = ['run', scene, '-o', out, '--until', '10min', '--workers', '1']
    words += ['--device', 'cpu', '--json', report]
    done(*words, '--members', '2', '--formats', 'gpkg', 'nc', 'shp')
    # of an area that the next maps do not have
    (out / 'arrival_time_p90.csv').write_text('old')
    first = json.loads(report.read_text())
    assert (first['members'], first['resumed'], first['workers']) == (2, 0, 1)
    output = done(*words, '--members', '4')
    second = json.loads(report.read_text())
    assert (second['members'], second['resumed']) == (4, 2)
    assert second['sampling_error_percent'] == pytest.approx(25.0)
    assert '2 members run' in output

    maps = {name: read(out / f'{name}.tif') for name in MAPS}
    probability = maps['inundation_probability']
    counts = np.zeros(probability.shape)
    for path in (out / 'members').glob('*.npz'):
        with np.load(path) as member:
            look, (row, column) = member['look'], member['corner']
            counts[row : row + look.shape[0], column : column + look.shape[1]] += look < 2**16 - 1
    # corrected for the spacing by the pair of the first member
    error = second['spacing_error']
    assert error['pairs'] == 1 and 0.0 < abs(error['delay']) < 1.0
    assert not probability[counts == 0].any() and probability[counts > 0].all()
    assert np.abs(probability - 25.0 * counts).mean() < 5.0
    assert probability.max() >= 75.0 and probability.min() == 0.0
    assert second['unseen_percent'] == 20.0 and 'a probability below 20 %' in output
    assert second['arrives_before_percent']['p10'] == 20.0
    assert 'error of the spacing: ' in output
    for name, area in second['area_m2'].items():
        assert f'{name:>13}: {area_words(area)}' in output
    assert second['area_m2']['in any member'] >= second['area_m2']['at least 10 %'] > 0.0
    earliest = read(out / 'arrival_time_earliest.tif')
    np.testing.assert_array_equal(earliest >= 0.0, counts > 0)
    late = maps['arrival_time_p10'] >= 0.0
    assert (earliest[late] <= maps['arrival_time_p10'][late]).all()
    largest = read(out / 'largest_peak_thickness.tif')
    assert (largest >= maps['expected_peak_thickness']).all()
    half = maps['arrival_time_p50'] >= 0.0
    np.testing.assert_array_equal(half, probability >= 50.0)
    assert (maps['arrival_time_p10'][half] <= maps['arrival_time_p50'][half]).all()
    assert ((maps['expected_peak_thickness'] > 0.0) >= (probability > 0.0)).all()
    with rasterio.open(out / 'arrival_time_p50.tif') as file:
        assert file.crs.to_epsg() == 32633 and file.units == ('s',)
        assert file.bounds[:2] == CORNER
        assert (file.tags()['members'], file.tags()['unseen_percent']) == ('4', '20')
    # the formats of the first command have all members, too
    with rasterio.open(f'netcdf:{out / "maps.nc"}:inundation_probability') as file:
        assert file.tags(1)['members'] == '4'
        np.testing.assert_array_equal(file.read(1)[::-1], probability)
    for path in (out / 'lava.gpkg', out / 'inundation_probability.shp'):
        # probability and area, of a Shapefile with names of 10 letters
        rows = [list(item.properties.values()) for item in load_features('--places', path)]
        assert [50.0, 0.1, (probability >= 50.0).sum() * 400.0] in rows
    assert (out / 'arrival_time_p90.csv').read_text() != 'old'

    bag = BagReader(out / 'atlas')
    assert yaml.safe_load(bag.custom_data['scene'])['uncertainty']['discharge']['factor'] == 1.5
    messages = {message.topic: message for message in bag.messages()}
    others = (
        'terrain', 'terrain_info', 'terrain_georeference', 'relief', 'vents', 'vents_markers',
        'probability_class',
    )
    assert {f'/lava/{name}' for name in (*MAPS, *others)} == set(messages)
    assert described_node(bag.custom_data) == RecordedNode(
        '/lava/lava', '/lava', {topic.removeprefix('/lava/'): topic for topic in messages}
    )
    grid = read_grid(Decoder(bag), messages['/lava/inundation_probability'])
    np.testing.assert_array_equal(grid.cells, occupancy(probability))

    outline = raster(tmp_path / 'outline.tif', maps['arrival_time_p10'] > 0.0)
    done(*words, '--members', '4', '--observed', outline, '--observed-at', '600s')
    third = json.loads(report.read_text())
    assert third['resumed'] == 4 and third['effective_members'] < 4.0
    assert 0.0 < third['observed']['jaccard_mean'] < third['observed']['jaccard_best'] <= 1.0
    assert read(out / 'weighted/inundation_probability.tif').sum() > probability.sum()
    # the maps without weights have not changed
    for name, values in maps.items():
        np.testing.assert_array_equal(read(out / f'{name}.tif'), values)
        for folder, observation in ((out, 'none'), (out / 'weighted', 'outline.tif, 600 s')):
            with rasterio.open(folder / f'{name}.tif') as file:
                assert file.tags()['observation'].startswith(observation)
            assert (folder / f'{name}.qml').exists()
    bags = [BagReader(folder) for folder in (out / 'atlas', out / 'weighted/atlas')]
    grids = [
        read_grid(Decoder(bag), next(bag.messages(['/lava/inundation_probability']))).cells
        for bag in bags
    ]
    np.testing.assert_array_equal(grids[0], occupancy(probability))
    assert not np.array_equal(*grids)
    page = tmp_path / 'page.json'
    words = ['map', out, out / 'weighted', '--layers', 'inundation_probability', '--json', page]
    done(*words, '-o', tmp_path / 'page.png')
    notes = json.loads(page.read_text())['notes']
    assert 'outline.tif, 600 s' in notes['weighted by']
    drawn = notes['uncertain'].split('; ')
    assert drawn[0] == 'effusion rate times 1 x/ 1.5 (lognormal), given by the scene'
    assert 'position +- 20 m in x and y (normal), given by the scene' in drawn
    assert any(text.startswith('viscosity times ') for text in drawn)


def test_effects_switched_on_by_the_flow_are_reported(scene, tmp_path):
    described = yaml.safe_load(scene.read_text())
    described['vents'][0]['discharge'] = [[0, 10], [300, 0]]
    described['lava'] |= {'yield_strength': 12.0, 'crust_strength': 0.0}
    described['uncertainty']['exact'] = 'all'
    scene.write_text(yaml.safe_dump(described))
    out, report = tmp_path / 'out', tmp_path / 'report.json'
    words = ['run', scene, '-o', out, '--until', '15min', '--workers', '1']
    words += ['--device', 'cpu', '--json', report, '--members', '1']
    status, output, warned = lava(*words)
    assert status == 0
    found = json.loads(report.read_text())
    (item,) = found['switched_on']
    assert (item['effect'], item['member']) == ('yielding', 0)
    assert item['number'] > item['threshold']
    time = duration(item['time_s'])
    reason = f'Bingham number = {item["number"]:.2g} > 0.01 in member 0 at {time}'
    assert f'yielding is switched on for all members from the start: {reason}' in warned
    assert f'yielding was switched on from the start: {reason}\n' in output
    (change,) = json.loads(BagReader(out / 'atlas').custom_data['effects'])
    assert change['effects']['yielding'] == f'on: {reason}' and change['time'] == 0.0
    on = [name for name, text in change['effects'].items() if text.startswith('on')]
    assert found['effects'] == [change]
    assert f'effects of all members: {", ".join(on)}\n' in output
    facts = read_run(out).facts
    assert facts['processes included'] == ', '.join(EFFECTS[name].title for name in on)
    assert facts['switched on'] == f'yield strength: {reason}'
    # a finished ensemble reports it again
    assert reason in done(*words) and json.loads(report.read_text())['resumed'] == 1


def test_interrupted_ensemble_explains_how_to_resume(scene, tmp_path, monkeypatch):
    def interrupted(*args: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr('lava_ros.cli.run_ensemble.run_ensemble', interrupted)
    words = ['--members', '4', '--workers', '1', '--device', 'cpu']
    status, _, output = lava('run', scene, '-o', tmp_path / 'out', *words)
    assert status == 130 and 'the same command' in output


def test_ensemble_without_a_folder_finds_its_own(scene, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ['run', scene, '--until', '20s', '--workers', '1', '--device', 'cpu']
    words += ['--spacing', '40', '--members']
    for members, seed, name in ((1, 0, 'scene_ensemble'), (1, 1, 'scene_ensemble_2'),
                                (2, 0, 'scene_ensemble')):
        done(*words, members, '--seed', seed)
        record = json.loads((tmp_path / 'runs' / name / 'run.json').read_text())
        assert (record['kind'], record['status']) == ('ensemble', 'finished')
        assert (record['members'], record['seed']) == (members, seed)
    assert record['resumed'] == 1
    assert {path.name for path in (tmp_path / 'runs').iterdir()} == {
        'scene_ensemble', 'scene_ensemble_2'
    }


def test_parses_times_with_and_without_units():
    known = {'6h': 21600.0, '90min': 5400.0, '1.5 d': 129600.0, '30': 30.0, '1e3s': 1000.0}
    assert {text: seconds_of('--until', text) for text in known} == known
    assert seconds_of('--at', '0', may_be_zero=True) == 0.0
    for text in ('', '6 hours', '0h', '-1h', 'nan', '1h30'):
        with pytest.raises(LavaError, match='--until'):
            seconds_of('--until', text)


@pytest.mark.parametrize(('name', 'text'), [
    ('within', '5min'), ('within', '1e1h'), ('within', ' 90 '), ('error', '1e1%'), ('error', '5'),
])
def test_errors_show_a_target_as_it_was_typed(name, text):
    found = target_of(Namespace(**{'within': None, 'error': None, name: text}))
    assert str(LavaError('it', found[name], 'more')) == f'it is {text.strip()}, expected more'


def test_ensemble_of_a_case_is_scored(tmp_path):
    case = write_case(tmp_path / 'valley', hours=1)
    words = ['run', case, '-o', tmp_path / 'out', '--members', '2']
    words += ['--device', 'cpu', '--workers', '1', '--spacing', '40']
    assert '--until does not apply to' in refused(*words, '--until', '1h')
    output = done(*words, '--json', tmp_path / 'report.json')
    report = json.loads((tmp_path / 'report.json').read_text())
    assert (report['case'], report['horizon_s']) == ('valley', 3600.0)
    assert set(report['uncertainty']['constants']) >= {'crust_cover', 'crust_temperature'}
    score = report['score']
    assert 0.0 < score['brier_score'] < 1.0
    assert score['brier_skill_of_terrain'] > score['brier_skill']
    # on cells of 40 m
    assert sum(item['count'] for item in score['reliability']) == footprint().size // 4
    assert f'skill {score["brier_skill"]:.2f}' in output


def test_susceptibility_map_places_the_vents(scene, tmp_path):
    likelihood = np.zeros((30, 24))
    likelihood[5:8, 3] = 1.0
    where = raster(tmp_path / 'where.tif', likelihood)
    (tmp_path / 'rates.csv').write_text('date,q\n2021-09-19T12:00Z,10\n2021-09-19T13:00Z,10\n')
    words = ['run', scene, '-o', tmp_path / 'out', '--until', '10min']
    words += ['--effusion-rate', tmp_path / 'rates.csv']
    words += ['--start', '2021-09-19T14:00:00+02:00']
    done(*words, '--members', '1', '--workers', '1', '--device', 'cpu', '--susceptibility', where)
    # maps have dates if the command states the start of the eruption
    with rasterio.open(tmp_path / 'out/inundation_probability.tif') as file:
        assert file.tags()['onset'] == '2021-09-19T14:00:00+02:00'
    wet = np.argwhere(read(tmp_path / 'out/inundation_probability.tif') > 0.0)
    assert len(wet) > 3
    assert np.hypot(*(wet - [6.0, 3.0]).T).max() < 10.0


@pytest.mark.parametrize('kind', ['scene', 'case'])
def test_position_is_not_drawn_with_a_susceptibility_map(scene, tmp_path, kind):
    target = scene
    if kind == 'case':
        target = write_case(tmp_path / 'valley', hours=0.2, yaml='epsg: 32633\n')
        where = target / 'footprint.asc'
    else:
        where = raster(tmp_path / 'where.tif', np.ones((30, 24)))
        described = yaml.safe_load(scene.read_text())
        described['uncertainty'].pop('position', None)
        scene.write_text(yaml.safe_dump(described))
    words = ['run', target, '-o', tmp_path / 'out', '--members', '1', '--spacing', '40']
    words += ['--until', '10min'] * (kind == 'scene')
    done(*words, '--workers', '1', '--device', 'cpu', '--susceptibility', where)
    quantities = json.loads((tmp_path / 'out/run.json').read_text())['quantities']
    assert 'position' in quantities['exact'] and 'position' not in quantities['drawn']


def test_ensemble_states_the_preset_of_its_plan_everywhere(scene, tmp_path, monkeypatch):
    plans = []

    def planned(*args, **options):
        plans.append(options)
        return Mock(preset='fine', spacing=30.0)

    monkeypatch.setattr('lava_ros.cli.ensemble_request.planned', planned)
    words = ['run', scene, '-o', tmp_path / 'out', '--until', '10min', '--workers', '1']
    words += ['--device', 'cpu', '--within', '60s', '--json', tmp_path / 'report.json']
    for members in (1, 2):
        done(*words, '--members', members)
        record = json.loads((tmp_path / 'out/run.json').read_text())
        report = json.loads((tmp_path / 'report.json').read_text())
        assert (record['preset'], report['preset']) == ('fine', 'fine')
        accuracy = record['plan']['accuracy']
        assert (accuracy['spacing'], accuracy['refinement']) == (30.0, 1.414)
        with rasterio.open(tmp_path / 'out/inundation_probability.tif') as file:
            assert file.tags()['preset'] == 'fine'
        assert 'preset fine' in read_run(tmp_path / 'out').facts['model']
    # further members have the spacing of the first ones
    assert len(plans) == 1
    error = refused(*words[:-4], '--preset', 'draft', '--members', '2')
    assert 'plan.accuracy.refinement is 0.707, expected 1.414, the value of the members' in error


def test_ensemble_says_what_it_has_drawn_and_what_decides(scene, tmp_path):
    described = yaml.safe_load(scene.read_text())
    crust = ['crust_strength', 'crust_cover', 'crust_cover_decay', 'crust_temperature']
    described['uncertainty']['exact'] = ['density', 'terrain', *crust]
    scene.write_text(yaml.safe_dump(described))
    out, report = tmp_path / 'out', tmp_path / 'report.json'
    words = ['run', scene, '-o', out, '--until', '10min', '--workers', '1']
    words += ['--device', 'cpu', '--json', report, '--members', '16', '--spacing', '30']
    output = done(*words)
    found = json.loads(report.read_text())
    drawn, exact = found['quantities']['drawn'], found['quantities']['exact']
    assert set(drawn) == {
        'effusion_rate', 'temperature', 'viscosity', 'yield_strength', 'position',
    }
    assert exact['density'] == exact['terrain'] == 'fixed by the user'
    assert 'taken as exact: terrain, density, crust strength, ' in output
    for name, item in drawn.items():
        assert item['distribution'] in output and item['source'] in output, name
    influence = found['influence']
    names = [row['quantity'] for row in influence['rows']]
    effects = [row['mismatch'] for row in influence['rows']]
    assert set(names) == set(drawn) - {'yield_strength'}
    assert effects == sorted(effects, reverse=True)
    table = output[output.index('what decides'):].splitlines()[1 : len(names) + 1]
    assert [line.split('  ')[0].split(' with ')[0].replace(' ', '_') for line in table] == names
    # the page shows it
    facts = read_run(out).facts
    assert facts['what decides (1 - J)'].startswith(names[0].replace('_', ' '))
    assert json.loads((out / 'run.json').read_text())['quantities'] == found['quantities']


def test_ensemble_with_too_coarse_particles_says_that_it_is_not_usable(scene, lines, tmp_path):
    out, report, table = (tmp_path / name for name in ('out', 'report.json', 'table.json'))
    words = ['run', scene, '-o', out, '--until', '10min', '--workers', '1', '--members']
    output = done(*words, '1', '--spacing', '40', '--device', 'cpu', '--json', report)
    error = json.loads(report.read_text())['spacing_error']
    assert error['spacing_m'] == 40.0 and not error['is_usable']
    said = f'a spacing of {error["usable_spacing_m"]:g} m would do'
    assert 'the probabilities are not usable' in output and said in output
    found = read_run(out)
    assert found.title.endswith(', not usable') and said in found.facts['warning']
    assert said in done('places', out, tmp_path / 'hut.csv', '--json', table)
    places = json.loads(table.read_text())
    assert places['spacing_error'] == error and said in places['note']
    with rasterio.open(out / 'inundation_probability.tif') as file:
        assert file.tags()['is_usable'] == 'false' and said in file.tags()['spacing_error']
    assert 0.0 < error['usable_spacing_m'] < 40.0
