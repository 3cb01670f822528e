# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava run`, and the commands that read its folder."""

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

from command_line import done, lava, refused
from geodata import feature, write_features, write_scene
from lava_ros.layers.recording import Recording
from lava_ros.watch.frames import BagFrames

ROOT = Path(__file__).parents[2]

#: Elevation of a slope to the east [m], row 0 in the south.
SLOPE = np.tile(np.linspace(540.0, 500.0, 30), (20, 1)).astype(np.float32)

SCENE = {
    'vents': [{
        'projected': [500_050.0, 4_180_100.0],
        'effusion_rate': {'file': 'rates.csv'},
    }],
}
RATES = 'start,end,effusion_rate\n2021-03-01T04:30Z,2021-03-01T05:30Z,5\n'
SETTINGS = '--spacing', 8, '--device', 'cpu', '--maps', 4


def place(name: str, x: float, y: float) -> dict:
    return feature('Point', [500_000.0 + x, 4_180_000.0 + y], name=name)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder with a scene, places and a run of five minutes."""
    path = tmp_path_factory.mktemp('observatory')
    (path / 'rates.csv').write_text(RATES)
    write_scene(path, SLOPE, 10.0, SCENE, epsg=32633, offset=(500_000.0, 4_180_000.0))
    write_features(
        path / 'places.geojson', place('hut', 85.0, 105.0), place('far', 285.0, 15.0),
        place('off the map', 900.0, 900.0),
    )
    done(
        'run', path / 'scene.yaml', '--until', '5min', *SETTINGS, '--at', '100s',
        '--places', path / 'places.geojson', '-o', path / 'run', '--json', path / 'run.json',
    )
    return path


@pytest.fixture
def result(folder):
    return json.loads((folder / 'run.json').read_text())


def test_json_is_the_file_of_the_run_with_its_places(folder, result):
    record = json.loads((folder / 'run/run.json').read_text())
    assert {name: result[name] for name in record} == record
    assert result.keys() - record.keys() == {'kind', 'folder', 'places'}
    assert [item['path'] for item in result['inputs']] == [
        str(folder / 'scene.yaml'), 'ground.npz', 'rates.csv'
    ]
    assert result['simulated_time_s'] == 300.0
    assert result['volume_emitted_m3'] == pytest.approx(1500.0)
    assert result['numerical_error']['spacing_m'] == 8.0
    assert result['settings']['map_times_s'] == [75.0, 100.0, 150.0, 225.0, 300.0]


def test_every_output_has_the_same_numbers(folder, result, tmp_path):
    run = folder / 'run'
    done('export', run, '-o', tmp_path / 'maps', '--formats', 'tif')
    done('places', run, folder / 'places.geojson', '--json', tmp_path / 'places.json')
    with rasterio.open(tmp_path / 'maps/inundated.tif') as file:
        inundated, tags = np.nan_to_num(file.read(1, masked=True).filled(0.0)), file.tags()
    assert float(inundated.sum()) * 100.0 == pytest.approx(result['inundated_area_m2'], rel=1e-6)
    assert tags['onset'] == result['onset'] == '2021-03-01T04:30:00Z'
    assert tags['preset'] == result['preset']
    table = json.loads((tmp_path / 'places.json').read_text())
    assert table['places'] == result['places']
    assert [item['name'] for item in table['places']] == ['hut', 'far', 'off the map']
    values = Recording(run).timeline.moments[-1].values
    for name in ('inundated_area_m2', 'standing_area_m2', 'volume_emitted_m3', 'volume_thin_m3'):
        assert float(values[name]) == result[name]
    assert values['numerical_error'] == result['numerical_error_text']
    assert values['flow_kind'] == result['flow_kind']


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
    (('--method', 'cells', '--within', '1min'), '--within and --method exclude each other'),
    (('--method', 'cells', '--on', 'inertia'), 'effects.inertia is True, expected false with'),
    (('--on', 'crust', '--off', 'crust'), '--on crust and --off crust exclude each other'),
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


@pytest.mark.parametrize('method', ['particles', 'cells'])
def test_run_without_vents_has_no_flow(method, tmp_path):
    write_scene(tmp_path, SLOPE, 10.0, {'vents': []})
    run = tmp_path / 'run'
    done(
        'run', tmp_path / 'scene.yaml', '--until', '1min', *SETTINGS, '--method', method, '-o', run
    )
    record = json.loads((run / 'run.json').read_text(), parse_constant=pytest.fail)
    assert record['inundated_area_m2'] == record['volume_emitted_m3'] == 0.0
    assert record['resolution']['particles_across'] is None
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
