# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What shows bags and ensembles to people: `lava plot`, `report`, `export`, `animate`, `info`."""

import json
from pathlib import Path
import re
import shutil
import sys
from typing import Any

from matplotlib.image import imread
import numpy as np
import pyogrio
import pytest
import rasterio
from rasterio.warp import transform
import yaml

from cli.calls import done, refused
from command_line import lava
from lava_ros.maps.export import MAPS
from lava_ros.scene import Terrain
from recording import GRIDS, record, TERRAIN


def plot(folder: Path, *words: object) -> dict[str, Any]:
    """Draw something, and return what the page says."""
    done('plot', *words, '-o', folder / 'map.png', '--json', folder / 'said.json')
    assert imread(folder / 'map.png').shape[2] == 4
    return json.loads((folder / 'said.json').read_text())


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Frames at 200, 400, 600 and 800 s."""
    return record(tmp_path_factory.mktemp('plot') / 'flow')


@pytest.fixture(scope='module')
def ensemble(tmp_path_factory):
    """Four members on the ground of the bag."""
    folder = tmp_path_factory.mktemp('ensemble')
    np.savez(
        folder / 'ground.npz', elevation=TERRAIN.elevation, resolution=5.0, epsg=32633,
        origin=TERRAIN.origin, offset=TERRAIN.offset, source='a slope of tests',
    )
    (folder / 'scene.yaml').write_text(yaml.safe_dump({
        'terrain': {'file': 'ground.npz'},
        'vents': [{'position': [50.0, 95.0], 'discharge': 3.0, 'radius': 8.0}],
        'uncertainty': {'position': {'deviation': 5.0}},
    }))
    done(*ensemble_words(folder))
    return folder / 'members'


def ensemble_words(folder: Path) -> list[object]:
    """The command of the ensemble of a folder."""
    words = ['ensemble', folder / 'scene.yaml', '-o', folder / 'members', '--members']
    return [*words, '4', '--horizon', '3min', '--workers', '1', '--device', 'cpu']


@pytest.fixture
def seen(tmp_path):
    """Where lava was seen: a part of the bag's flow and of the ensemble's."""
    crs = {'properties': {'name': 'EPSG:32633'}}
    ring = [[499_950, 4_180_070], [500_060, 4_180_070], [500_060, 4_180_120],
            [499_950, 4_180_120], [499_950, 4_180_070]]
    area = {'type': 'Polygon', 'coordinates': [ring], 'crs': crs}
    (tmp_path / 'seen.geojson').write_text(json.dumps(area))
    return str(tmp_path / 'seen.geojson')


def test_a_bag(bag, tmp_path):
    """The page says what the bag knows, and what it is told."""
    said = plot(tmp_path, bag)
    assert said['title'] == 'Lava flow after 13 min'
    assert said['maps'] == ['Lava thickness', 'Temperature', 'Hazard']
    notes = said['notes']
    assert 'expected error of the footprint 15 %' in notes.pop('model')
    assert notes.items() >= {
        'computed': '2026-09-21', 'effusion rate': '10 m³/s', 'elevation': 'maps in cells of 5 m',
        'coordinates': 'WGS 84 / UTM zone 33N (EPSG:32633)',
    }.items()
    said = plot(
        tmp_path, bag, '--layers', 'arrival', '--time', '400', '--volcano', 'Etna',
        '--source', 'INGV 2014', '--date', '2026-11-23',
    )
    assert said['title'] == 'Etna: Lava flow after 7 min'
    assert 'time' not in said['notes']
    assert said['maps'] == ['Time of arrival of the lava, 0.1 m thick']
    assert said['notes']['elevation'] == 'INGV 2014, maps in cells of 5 m'
    assert said['notes']['date'] == '2026-11-23'


def test_an_ensemble(ensemble, tmp_path, seen):
    """Probability and arrivals; with what was seen also how reliable they were."""
    said = plot(tmp_path, ensemble)
    assert len(said['maps']) == 4 and said['title'] == 'Lava within 3 min, 4 runs'
    assert said['notes']['elevation'] == 'a slope of tests, maps in cells of 5 m'
    assert said['notes']['uncertain'] == 'position' and said['scores'] == {}
    said = plot(tmp_path, ensemble, '--layers', 'probability', '--observed', seen)
    assert 0.0 < said['scores']['members']['brier_score'] < 1.0


def test_shapes_of_an_ensemble(ensemble):
    """Isochrones lie beside the contours of probability: each holds all that came before."""
    for share in (10, 50, 90):
        path = ensemble / f'arrival_time_p{share}.geojson'
        times = [item['properties'] for item in json.loads(path.read_text())['features']]
        assert [item['time_s'] for item in times] == [60.0, 120.0, 180.0][: len(times)]
        areas = [item['area_m2'] for item in times]
        assert areas == sorted(areas) and (areas or share == 90)


def test_formats_of_an_ensemble(ensemble, monkeypatch):
    """The command given again writes what was not asked for before; what cannot be is refused."""
    words = [*ensemble_words(ensemble.parent), '--formats', 'gpkg']
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, 'pyogrio', None)
        assert "pip install 'lava_ros[terrain]'" in refused(*words)
    done(*words)
    layers = [name for name, _ in pyogrio.list_layers(ensemble / 'lava.gpkg')]
    assert {'inundation_probability', 'arrival_time_p50'} <= set(layers)
    found = pyogrio.read_info(ensemble / 'lava.gpkg', layer='arrival_time_p50')
    assert found['crs'] == 'EPSG:32633' and 'time_s' in found['fields']


def test_several_runs(bag, ensemble, tmp_path):
    """They are told apart by their folders; what they have in common is said once."""
    other = record(tmp_path / 'other' / 'flow', times=(200.0, 400.0))
    said = plot(tmp_path, bag, other)
    assert said['maps'] == [
        f'{path.parent.name}/flow: Lava thickness' for path in (bag, other)
    ]
    assert said['notes']['effusion rate'] == '10 m³/s'
    assert said['notes']['result'].count('standing lava') == 2
    said = plot(tmp_path, bag, ensemble)
    assert said['maps'][1] == 'members: Expected peak thickness of the lava'
    nowhere = record(tmp_path / 'nowhere', terrain=Terrain(TERRAIN.elevation, 5.0, TERRAIN.origin))
    picture = tmp_path / 'no.png'
    assert 'the same for all' in refused('plot', bag, nowhere, '-o', picture)
    assert 'different names' in refused('plot', bag, bag, '-o', picture)
    assert not picture.exists()


def test_overlays(bag, tmp_path, caplog, seen):
    """Points, lines and outlines of others are drawn; those beyond the map are counted."""
    plain = plot(tmp_path, bag, '--layers', 'hazard')
    before = imread(tmp_path / 'map.png')
    (tmp_path / 'stations.csv').write_text('x,y,name\n499980,4180090,a\n1,2,b\n')
    words = ('--overlay', tmp_path / 'stations.csv', '--observed', seen)
    assert plot(tmp_path, bag, '--layers', 'hazard', *words) == plain
    assert 'stations: 1 of 2 features lie outside' in caplog.text
    blue = [
        int(((image[..., 2] > 0.4) & (image[..., 0] < 0.15)).sum())
        for image in (before, imread(tmp_path / 'map.png'))
    ]
    assert blue[1] > blue[0] + 300


@pytest.mark.parametrize(
    ('words', 'named'),
    [
        (('--layers', 'probability'), 'one of thickness, temperature, hazard'),
        (('--overlay', 'none.csv'), '--overlay is .none.csv., expected a file that exists'),
        (('--observed', 'none.geojson'), '--observed is'),
        (('--time', '9h'), 'time is'),
        (('--extent', '5', '1', '4', '2'), '--extent is .5 1 4 2., expected WEST SOUTH EAST'),
        (('--extent', '1', '2', '3', '4'), '--extent is .1 2 3 4., expected an extent with'),
        (('--extent', 'nan', '2', '3', '4'), '--extent is nan'),
        (('--scale', '1:0'), '--scale is .0., expected'),
        (('--scale', '1:20'), '--scale is .1:20., expected 1:[0-9]+ or smaller'),
        (('--scale', 'large'), '--scale is'),
        (('--onset', '2006-07-14T22:00'), '--onset is .*offset from UTC'),
        (('--onset', 'yesterday'), '--onset is'),
        (('--onset', '2006-07-14T22:00Z', '--timezone', 'Europe/Etna'), '--timezone is'),
        (('--timezone', 'Europe/Rome'), '--timezone is .*together with --onset'),
        (('--logo', 'none.png'), '--logo is .none.png., expected a PNG or JPEG'),
    ],
)
def test_what_cannot_be_drawn(bag, tmp_path, words, named):
    """One sentence, and no picture."""
    assert re.search(named, refused('plot', bag, '-o', tmp_path / 'a.png', *words))
    assert not (tmp_path / 'a.png').exists()


def test_maps_older_than_asked_for_say_so(bag, tmp_path, caplog):
    """The page and the log name both times; an export does too."""
    said = plot(tmp_path, bag, '--time', '550s')
    assert said['title'] == 'Lava flow after 7 min'
    note = 'maps at 7 min (400 s), the newest of the recording at or before 9 min (550 s)'
    assert said['notes']['time'] == note and note in caplog.text
    caplog.clear()
    done('export', bag, '-o', tmp_path / 'maps', '--at', '550s')
    assert note in caplog.text
    caplog.clear()
    assert 'time' not in plot(tmp_path, bag)['notes'] and 'the newest' not in caplog.text


def test_dates_and_times(ensemble, tmp_path):
    """The onset gives the times of maps, isochrones and horizon, in UTC and local."""
    onset = ('--onset', '2006-07-14T22:00Z', '--timezone', 'Europe/Rome')
    bag = record(tmp_path / 'flow', config=GRIDS)
    notes = plot(tmp_path, bag, '--layers', 'arrival', '--time', '600', *onset)['notes']
    assert notes['start of the eruption'] == '2006-07-14 22:00 UTC (2006-07-15 00:00 CEST)'
    assert notes['maps show'] == '2006-07-14 22:10 UTC (2006-07-15 00:10 CEST)'
    assert notes['isochrones'].startswith('5 min: 2006-07-14 22:05 UTC (2006-07-15 00:05 CEST)')
    notes = plot(tmp_path, ensemble, '--onset', '2026-01-01T13:00+01:00', *onset[2:])['notes']
    assert notes['forecast until'] == '2026-01-01 12:03 UTC (13:03 CET)'


@pytest.mark.parametrize('command', ['plot', 'report'])
def test_observed_lava_off_the_map_is_refused(command, bag, ensemble, tmp_path):
    """An outline elsewhere gives neither a page nor a score."""
    crs = {'properties': {'name': 'EPSG:32633'}}
    ring = [[0, 0], [100, 0], [100, 100], [0, 100], [0, 0]]
    area = {'type': 'Polygon', 'coordinates': [ring], 'crs': crs}
    (tmp_path / 'far.geojson').write_text(json.dumps(area))
    page = tmp_path / {'plot': 'a.png', 'report': 'a.html'}[command]
    for run in (ensemble, bag) if command == 'plot' else (ensemble,):
        said = refused(command, run, '-o', page, '--observed', tmp_path / 'far.geojson')
        assert re.search('--observed is .*far.geojson.*observed lava on the terrain', said)
    assert not page.exists()


def test_words_are_plain(ensemble, tmp_path):
    """No name of an effect or of a quantile stands on a page."""
    said = plot(tmp_path, ensemble)
    assert said['maps'][1:] == [
        'Early arrival (1 run in 10)', 'Median arrival (1 run in 2)', 'Late arrival (9 runs in 10)'
    ]
    assert 'physics' not in said['notes']
    assert 'radiation' in said['notes']['processes included']
    assert said['notes']['runs'].startswith('4; a probability of 50 % is known to 25 percentage')


def test_extent_in_degrees(bag, tmp_path):
    """It is that of the same corners in metres."""
    pictures = []
    metres = (499_980.0, 4_180_050.0, 500_050.0, 4_180_100.0)
    x, y = transform('EPSG:32633', 'EPSG:4326', metres[::2], metres[1::2])
    for extent in (metres, (x[0], y[0], x[1], y[1])):
        plot(tmp_path, bag, '--layers', 'hazard', '--extent', *extent)
        pictures.append(imread(tmp_path / 'map.png')[200:-200])
    assert float((pictures[0] != pictures[1]).any(axis=-1).mean()) < 0.02


@pytest.mark.parametrize(
    'words',
    [('--overlay', 'a.csv'), ('--scale', '1:2000'), ('--author', 'A'), ('--logo', 'a.png')],
)
def test_page_options_are_refused_for_the_report_of_a_bag(bag, tmp_path, words):
    """The report of a single bag has no page to print: the error names the option."""
    assert f'{words[0]} is' in refused('report', bag, '-o', tmp_path / 'a.html', *words)
    assert not (tmp_path / 'a.html').exists()


def test_an_ensemble_without_maps(ensemble, tmp_path):
    """A folder that is not finished is named, and so is a time it has not."""
    (tmp_path / 'ensemble.json').write_text((ensemble / 'ensemble.json').read_text())
    refused('plot', tmp_path, '-o', tmp_path / 'a.png')
    refused('plot', ensemble, '--time', '1h', '-o', tmp_path / 'a.png')
    (tmp_path / 'ensemble.json').write_text('[]')
    refused('report', tmp_path, '-o', tmp_path / 'a.html')


@pytest.mark.parametrize(
    ('name', 'value', 'limits'),
    [
        ('inundation_probability', 700.0, '0 to 100'), ('arrival_time_p50', -3.0, '0 to 180'),
        ('arrival_time_p10', np.inf, '0 to 180'),
        ('expected_peak_thickness', 4.3e6, '0 to 100000'),
        ('elevation', 4.3e6, '-100000 to 100000'),
    ],
)
def test_impossible_values_of_an_ensemble_are_refused(ensemble, tmp_path, name, value, limits):
    """Pages name the map, its value, and the values it can have."""
    folder = shutil.copytree(ensemble, tmp_path / 'members')
    with rasterio.open(folder / f'{name}.tif', 'r+', IGNORE_COG_LAYOUT_BREAK='YES') as file:
        values = file.read(1)
        values[0, 0] = value
        file.write(values, 1)
    for words in (('plot', '-o', 'a.png'), ('report', '-o', 'a.html')):
        said = refused(words[0], folder, words[1], tmp_path / words[2])
        assert f'{name}.tif has {value:g}, expected {limits}' in said


def test_reports(bag, ensemble, tmp_path, seen):
    """A page of an ensemble or of several runs has the maps as a picture, and the facts."""
    page = tmp_path / 'a.html'
    done('report', ensemble, '-o', page, '--observed', seen)
    text = page.read_text()
    assert 'data:image/png;base64,' in text and 'brier score of members' in text
    assert 'Simulation, not verified.' in text
    done('report', bag, ensemble, '-o', page)
    assert 'members: Expected peak thickness of the lava' in page.read_text()
    refused('report', bag, '-o', page, '--observed', seen)


def test_export(bag, tmp_path):
    """The files are named, or counted where they are many; there is nothing to warn of."""
    out = tmp_path / 'out'
    names = ''.join(f'written to {out / f"{name}.tif"}\n' for name in MAPS)
    assert lava('export', bag, '-o', out, '--at', '600') == (0, names, '')
    assert done('export', bag, '-o', tmp_path / 'all', '--every') == (
        f'14 files written to {tmp_path / "all"}\n'
    )
    assert len(list((tmp_path / 'all').glob('*.tif'))) == 14


def test_export_without_coordinate_system(tmp_path):
    """It is done, and said with the way out."""
    bag = record(tmp_path / 'bag', terrain=Terrain(TERRAIN.elevation, 5.0, TERRAIN.origin))
    words = ['--epsg', '32633', '--offset', '500000', '4180000']
    status, _, said = lava('export', bag, '-o', tmp_path / 'a')
    assert status == 0 and '--epsg and --offset set one' in said
    status, _, said = lava('export', bag, '-o', tmp_path / 'b', *words)
    assert (status, said) == (0, '')


def test_info_has_the_simulated_time_and_volumes(bag):
    """What the node said last: eight columns of ten cells, 5 m wide."""
    volume = 250.0 * (8 * 3.26 - 0.05 * 28)
    lines = done('info', bag).splitlines()
    assert 'simulated  800.000 s' in lines
    place = lines.index('volumes') + 1
    told = dict(line.strip().split('  ', 1) for line in lines[place : place + 8])
    assert {name: value.strip() for name, value in told.items()} == {
        'emitted': f'{volume:,.1f} m3',
        'flowing': f'{volume:,.1f} m3',
        'frozen': '0 m3',
        'left over the border': '0 m3',
        'left into cells without data': '0 m3',
        'waiting in the vents': '0 m3',
        'of that late': '0 m3',
        'unaccounted for': 'below 1e-15',
    }
    said = json.loads(done('info', bag, '--json', '-'))['simulation']
    assert said['time'] == 800.0
    assert said['volume_held_m3'] == pytest.approx(volume, rel=1e-6)
