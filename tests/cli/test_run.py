# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava run`, and the commands that read its folder."""

import csv
from datetime import datetime
import html
import json
import os
from pathlib import Path
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
import rasterio
from rasterio.warp import transform

from command_line import done, lava, refused
from geodata import write_scene
from lava_ros.bag import BagReader
from lava_ros.bag.decoding import Decoder
from lava_ros.bag.recorded_node import last_moments
from lava_ros.cli.options import device_named
from lava_ros.layers.numbers import area_words, duration
from lava_ros.layers.recording import Recording
from lava_ros.simulation.carriers import across_key, count_key, COUNTED, max_count_key, METHODS
from lava_ros.simulation.output.budget import VOLUMES
from lava_ros.watch.frames import BagFrames

ROOT = Path(__file__).parents[2]

#: Elevation of a slope to the east, which ends in the sea [m], row 0 in the south.
SLOPE = np.tile(np.linspace(30.0, -10.0, 30), (20, 1)).astype(np.float32)

#: Corner of the slope in UTM zone 1 south; the antimeridian is 148 m east of it.
CORNER = (180_400.0, 8_117_900.0)

SCENE = """terrain: {file: ground.npz, sea_level: 0}
vents: [{projected: [180538.0, 8118000.0], radius: 8, effusion_rate: {file: rates.csv}}]
lava: {viscosity: 500}
"""
RATES = (
    'start,end,effusion_rate\n2021-03-01T04:30Z,2021-03-01T04:32Z,10\n'
    '2021-03-01T04:32Z,2021-03-01T05:30Z,16\n'
)
#: The huts are on both sides of the antimeridian.
PLACES = (
    'name,lon,lat\nwest hut,179.9999679,-16.9999832\neast hut,-179.9998437,-16.9999408\n'
    'far,179.9987361,-17.0007325\noff the map,179.9,-17.1\n'
)
DAM = 'x,y,x_end,y_end,height,width\n180570,8118000,180600,8118040,6,8\n'
SETTINGS = '--spacing', 8, '--device', 'cpu', '--maps', 4


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return the folder of an observatory with its files, and two runs of five minutes."""
    path = tmp_path_factory.mktemp('observatory')
    for name, text in (('rates', RATES), ('places', PLACES), ('dam', DAM)):
        (path / f'{name}.csv').write_text(text)
    np.savez(path / 'ground.npz', elevation=SLOPE, resolution=10.0, epsg=32701, offset=CORNER)
    (path / 'scene.yaml').write_text(SCENE)
    said = done(
        'run', path / 'scene.yaml', '--until', '5min', *SETTINGS, '--at', '100s',
        '--places', path / 'places.csv', '--barriers', path / 'dam.csv', '-o', path / 'run',
        '--json', path / 'run.json',
    )
    (path / 'said.txt').write_text(said)
    return path


@pytest.fixture
def result(folder):
    return json.loads((folder / 'run.json').read_text())


def test_json_is_the_file_of_the_run_with_its_places(folder, result):
    record = json.loads((folder / 'run/run.json').read_text())
    assert {name: result[name] for name in record} == record
    assert result.keys() - record.keys() == {'folder', 'places'}
    assert [item['path'] for item in result['inputs']] == [
        str(folder / 'scene.yaml'), 'ground.npz', 'rates.csv'
    ]
    assert result['simulated_time_s'] == 300.0
    assert result['volume_emitted_m3'] == pytest.approx(120.0 * 10.0 + 180.0 * 16.0)
    assert result['numerical_error']['spacing_m'] == 8.0
    assert result['settings']['map_times_s'] == [75.0, 100.0, 150.0, 225.0, 300.0]


def test_readers_show_the_map_that_a_run_made_for_a_time(folder, result, tmp_path):
    made = [item.time for item in Recording(folder / 'run').timeline.moments]
    asked = result['settings']['map_times_s']
    # at the first end of a step at or after the time
    assert len(made) == len(asked) and made[:-1] != asked[:-1]
    # no map of a later time is shown
    for time, expected in zip([*asked, asked[2] - 1.0], [*made, made[1]], strict=True):
        assert Recording(folder / 'run').frame_at(time).time == expected
        out, words = tmp_path / f'{time:g}', ('--at', f'{time}s')
        done('export', folder / 'run', '-o', out, '--maps', 'thickness', *words)
        table = tmp_path / f'{time:g}.json'
        done('places', folder / 'run', folder / 'places.csv', *words, '--json', table)
        assert json.loads(table.read_text())['time_s'] == expected
        with rasterio.open(out / 'thickness.tif') as file:
            assert float(file.tags()['simulated_time_s']) == expected
    for words in (('export', '-o', tmp_path / 'late'), ('places', folder / 'places.csv')):
        error = refused(words[0], folder / 'run', *words[1:], '--at', '301s')
        assert f"--at is '301s', expected {made[0]:.10g} to 300 s" in error


@pytest.fixture(scope='module')
def maps(folder):
    """Return the folder with the maps of the run as files for a GIS."""
    done('export', folder / 'run', '-o', folder / 'maps', '--formats', 'tif', 'geojson')
    return folder / 'maps'


def is_label(label, key):
    """Return True if a label has the words of a key, without its unit, in the same order."""
    words = iter(re.split('[ -]', label))
    return all(word in words for word in re.sub('_m[23]$', '', key).split('_'))


def test_every_output_has_the_same_area_and_volumes(folder, result, maps, tmp_path):
    run, area = folder / 'run', result['inundated_area_m2']
    said = (folder / 'said.txt').read_text()
    with rasterio.open(maps / 'inundated.tif') as file:
        inundated, tags = np.nan_to_num(file.read(1, masked=True).filled(0.0)), file.tags()
    assert float(inundated.sum()) * 100.0 == pytest.approx(area, rel=1e-6)
    assert float(tags['inundated_area_m2']) == pytest.approx(area, rel=1e-6)
    assert tags['preset'] == result['preset']
    (outline,) = json.loads((maps / 'outline.geojson').read_text())['features']
    assert outline['properties']['inundated_area_m2'] == pytest.approx(area, rel=1e-6)
    cells = np.count_nonzero(inundated >= 0.5)
    assert outline['properties']['cells_area_m2'] == 100.0 * cells != pytest.approx(area)
    values = Recording(run).timeline.moments[-1].values
    names = [name for name in result if name.startswith('volume_')]
    for name in ('inundated_area_m2', 'standing_area_m2', *names):
        assert float(values[name]) == result[name]
    assert values['numerical_error'] == result['numerical_error_text']
    assert values['flow_kind'] == result['flow_kind']
    done('map', run, '-o', tmp_path / 'page.html')
    page = html.unescape((tmp_path / 'page.html').read_text())
    in_sea = f'{result["volume_lost_in_sea_m3"]:,.1f} m'
    assert result['volume_lost_in_sea_m3'] > 100.0
    assert result['volume_lost_over_border_m3'] == result['volume_lost_in_no_data_m3'] == 0.0
    # each label has the words of a key
    labels = [
        line[:32].strip() for line in said.splitlines()
        if line.startswith(('volume ', 'inundated area ', 'standing area '))
    ]
    assert len(labels) == len(VOLUMES) + 2
    for label in labels:
        assert any(is_label(label, key) for key in ('inundated_area_m2', *values)), label
    assert tags['inundation_threshold_m'] == values['inundation_threshold_m']
    for text in (said, page):
        assert area_words(area) in text and in_sea in text
        assert result['numerical_error_text'].partition(' (')[0] in text


def test_every_output_has_the_same_arrivals_on_both_sides_of_180_degrees(
    folder, result, maps, tmp_path
):
    words = 'places', folder / 'run', folder / 'places.csv'
    said = done(*words, '-o', tmp_path / 'places.csv', '--json', tmp_path / 'places.json')
    assert json.loads((tmp_path / 'places.json').read_text())['places'] == result['places']
    with (tmp_path / 'places.csv').open() as file:
        rows = list(csv.DictReader(file))
    with rasterio.open(maps / 'arrival.tif') as file:
        lines = PLACES.splitlines()[1:3]
        for line, row, known in zip(lines, rows[:2], result['places'][:2], strict=True):
            place = [[float(number)] for number in line.split(',')[1:]]
            x, y = transform('EPSG:4326', file.crs, *place)
            (time,) = next(file.sample([(x[0], y[0])]))
            assert float(row['arrival_p50_s']) == known['arrival_p50_s'] == time
            assert duration(float(time)) in said
            passed = datetime.fromisoformat(known['arrival_p50_utc'].rstrip('Z'))
            passed -= datetime(2021, 3, 1, 4, 30)
            assert passed.total_seconds() == pytest.approx(float(time), abs=1.0)
        assert file.tags()['onset'] == result['onset'] == '2021-03-01T04:30:00Z'
    assert '04:30 UTC' in said
    far, outside = result['places'][2:]
    assert far['arrival_p50_s'] is None and far['off_map_percent'] == 0.0
    assert outside['off_map_percent'] == 100.0


def test_dam_is_compared_with_a_second_run(folder, result):
    run, compared = folder / 'run', result['barriers']
    other = json.loads((run / 'with_barriers/run.json').read_text())
    assert compared['area_m2'] == {'inundated': {
        'without': result['inundated_area_m2'], 'with': other['inundated_area_m2'],
    }}
    assert other['resolution']['spacing_m'] == result['resolution']['spacing_m']
    before, after = (Recording(item).frame_at() for item in (run, run / 'with_barriers'))
    with rasterio.open(run / 'comparison/probability_change.tif') as file:
        change = file.read(1)[::-1]
    came = [np.isfinite(frame.arrived) for frame in (before, after)]
    np.testing.assert_array_equal(change > 0, came[1] & ~came[0])
    np.testing.assert_array_equal(change == -100, came[0] & ~came[1])
    assert (change == -100).any() and (change > 0).any()
    _, east, *_ = compared['places']
    assert east['arrival_p50_s_without'] == result['places'][1]['arrival_p50_s']
    assert east['arrival_p50_s_with'] > east['arrival_p50_s_without']
    assert (run / 'comparison/barriers.png').stat().st_size > 10_000


@pytest.mark.parametrize(('words', 'name'), [
    ((), 'map.png'), ((), 'page.html'), (('--seconds', '1s'), 'film.gif'),
])
def test_maps_of_the_folder_are_drawn_by_the_suffix(words, name, folder, tmp_path):
    done('map', folder / 'run', '-o', tmp_path / name, *words)
    assert (tmp_path / name).stat().st_size > 1000


def test_live_view_shows_every_map_of_the_folder(folder):
    frames = BagFrames(folder / 'run')
    frames.poll()
    assert len(frames.times) == 5
    assert frames.times[-1] == 300.0


def test_finished_run_is_never_changed(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = 'run', folder / 'scene.yaml', '--until', '1min', *SETTINGS
    before = (folder / 'run/run.json').read_bytes()
    assert '--output' in lava(*words, '-o', folder / 'run')[2]
    assert (folder / 'run/run.json').read_bytes() == before
    for name in ('scene', 'scene_2'):
        done(*words)
        assert json.loads((tmp_path / 'runs' / name / 'run.json').read_text())['maps'] == 'maps'


@pytest.mark.parametrize(('words', 'error'), [
    (('--until', '0'), "--until is '0'"),
    (('--at', '2h'), "--at is '2h', expected a time at or before --until, 1h"),
    (('--maps', '0'), '--maps is 0'),
    (('--within', '1min', '--spacing', '5'), '--spacing and --within exclude each other'),
    (('--method', 'cells', '--on', 'inertia'), 'effects.inertia is True, expected false with'),
    (('--start', 'yesterday'), "start is 'yesterday'"),
    (('--threshold', '0'), '--threshold is 0'),
    # the simulation refuses these, after the folder has been made
    (('--spacing', '-1'), 'spacing is -1'),
    (('--on', 'tides'), "--on is 'tides', expected one of steep, "),
    (('--off', 'tides'), "--off is 'tides', expected one of steep, "),
])
def test_run_names_the_argument_that_is_wrong(words, error, folder, tmp_path):
    *_, said = lava('run', folder / 'scene.yaml', '--until', '1h', *words, '-o', tmp_path / 'run')
    assert error in said
    assert not (tmp_path / 'run').exists()


def test_start_dates_a_run_with_a_constant_rate(tmp_path):
    np.savez(tmp_path / 'slope.npz', elevation=SLOPE, resolution=10.0)
    done(
        'run', '--terrain', tmp_path / 'slope.npz', '--vent', '50,100', '--start',
        '2021-03-01T04:30Z', '--until', '1min', *SETTINGS, '-o', tmp_path / 'run',
    )
    assert json.loads((tmp_path / 'run/run.json').read_text())['onset'] == '2021-03-01T04:30:00Z'


@pytest.mark.parametrize('method', METHODS)
def test_outputs_name_the_carriers_of_the_method(method, tmp_path):
    write_scene(tmp_path, SLOPE, 10.0, {
        'vents': [{'position': [100.0, 100.0], 'discharge': 10.0}], 'lava': {'viscosity': 500.0},
    })
    run, counted = tmp_path / 'run', COUNTED[method]
    lines = done(
        'run', tmp_path / 'scene.yaml', '--until', '20s', *SETTINGS, '--method', method, '-o', run,
    )
    record = json.loads((run / 'run.json').read_text())
    (status,) = last_moments(bag := BagReader(run / record['maps']), Decoder(bag))
    for key in (count_key(method), max_count_key(method)):
        assert record[key] > 0, key
    assert str(record[count_key(method)]) == status.values[count_key(method)]
    assert record['resolution'][across_key(method)] == pytest.approx(
        status.number(across_key(method)), rel=0.01
    )
    others = {count_key(name) for name in METHODS} - {count_key(method)}
    assert not others & {*record, *status.values}
    assert f'\n{counted}  ' in lines
    frames = BagFrames(run / record['maps'])
    frames.poll()
    assert frames.method == method


@pytest.mark.parametrize('method', METHODS)
def test_run_without_vents_has_no_flow(method, tmp_path):
    write_scene(tmp_path, SLOPE, 10.0, {'vents': []})
    run = tmp_path / 'run'
    done(
        'run', tmp_path / 'scene.yaml', '--until', '1min', *SETTINGS, '--method', method, '-o', run
    )
    record = json.loads((run / 'run.json').read_text(), parse_constant=pytest.fail)
    assert record['inundated_area_m2'] == record['volume_emitted_m3'] == 0.0
    assert record['resolution'][across_key(method)] is None
    assert (record['numerical_error'], record['numerical_error_text']) == (
        None, 'not yet measured'
    )
    done('map', run, '-o', tmp_path / 'map.png', '--json', tmp_path / 'map.json')
    carriers = {'particles': 'as particles', 'cells': 'on cells of'}[method]
    assert carriers in (tmp_path / 'map.json').read_text(encoding='utf-8')


#: Runs `lava` without ROS and the extras: neither packages nor message definitions.
WITHOUT_ROS = """
import importlib.abc, sys
BLOCKED = {'rclpy', 'nav_msgs', 'std_msgs', 'sensor_msgs', 'diagnostic_msgs', 'geometry_msgs',
           'rasterio', 'pyogrio', 'viser', 'websockets', 'dask', 'distributed', 'tf2_msgs'}
class Block(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in BLOCKED:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Block())
from lava_ros.bag import schemas
schemas._prefixes = tuple
from lava_ros.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def test_run_needs_neither_ros_nor_extras(tmp_path):
    np.savez(tmp_path / 'slope.npz', elevation=SLOPE, resolution=10.0)
    words = ['run', '--terrain', 'slope.npz', '--vent', '50,100', '--until', '1min', '-o', 'run']
    (tmp_path / 'places.csv').write_text('name,x,y\nMill,60,100\n')
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    for line in (
        [*words, *map(str, SETTINGS)], ['map', 'run', '-o', 'map.png'],
        ['map', 'run', '-o', 'run.html'], ['places', 'run', 'places.csv'],
    ):
        ended = subprocess.run(
            [sys.executable, '-c', WITHOUT_ROS, *line], cwd=tmp_path, env=environment,
            capture_output=True, text=True, check=False,
        )
        assert ended.returncode == 0, ended.stderr
    assert 'Mill' in ended.stdout
    frames = list(Recording(tmp_path / 'run').frames())
    assert [round(frame.time) for frame in frames][-1] == 60
    assert refused('run', '--terrain', tmp_path / 'slope.npz', '--device', 'cuda:9')


def test_observatory_tutorial_runs_as_written(tmp_path, monkeypatch):
    page = (ROOT / 'docs/tutorials/own_dem.md').read_text(encoding='utf-8')
    example = [sys.executable, ROOT / 'examples/observatory_files.py']
    subprocess.run(example, cwd=tmp_path, check=True)
    monkeypatch.chdir(tmp_path)
    (flow,) = re.findall(r'^lava (run .* rates.csv .*)$', page, re.MULTILINE)
    status, out, err = lava(*shlex.split(flow), '--preset', 'draft', '--device', 'cpu')
    assert status == 0, err
    assert 'are ignored' not in out + err
    result = json.loads((tmp_path / 'runs/lidar/run.json').read_text())
    # 20 minutes of 12 m3/s and 40 of 5.5
    assert result['volume_emitted_m3'] == pytest.approx(27_600.0, rel=1e-6)
    assert result['onset'] == '2021-09-19T14:10:00Z'
    (drawing,) = re.findall(r'^lava (map runs/lidar .*?) +#', page, re.MULTILINE)
    for words in (drawing, 'export runs/lidar -o maps --formats tif geojson'):
        done(*shlex.split(words))
    assert (tmp_path / 'map.pdf').read_bytes().startswith(b'%PDF')
    with rasterio.open(tmp_path / 'maps/thickness.tif') as file:
        assert file.crs.to_epsg() == 32633
        row, column = file.index(500_600.0, 4_179_680.0)
        assert file.read(1, masked=True)[row, column] > 0.1
    found = json.loads((tmp_path / 'maps/fissures.geojson').read_text(encoding='utf-8'))
    (fissure,) = found['features']
    assert fissure['properties']['name'] == 'upper fissure'
    assert fissure['properties']['peak_effusion_rate'] == pytest.approx(12.0)


@pytest.mark.parametrize(('given', 'method', 'expected'), [
    (None, 'particles', 'cuda:0'), (None, 'cells', 'cpu'), ('cpu', 'particles', 'cpu'),
    ('cuda:0', 'cells', 'cuda:0'),
])
def test_device_without_an_option_is_that_of_the_method(
    monkeypatch: pytest.MonkeyPatch, given: str | None, method: str, expected: str
) -> None:
    import warp as wp

    monkeypatch.setattr(wp, 'get_preferred_device', lambda: 'cuda:0')
    monkeypatch.setattr(wp, 'get_devices', lambda: ['cpu', 'cuda:0'])
    assert device_named(given, method) == expected
