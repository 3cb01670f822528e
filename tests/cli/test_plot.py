# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Output for people: `lava map`, `report`, `export` and `info`."""

from dataclasses import replace
import json
from pathlib import Path
import re
import shutil
import sys
from typing import Any
from unittest.mock import Mock

from matplotlib.image import imread
import numpy as np
import pyogrio
import pytest
import rasterio
from rasterio.crs import CRS
from rasterio.errors import NotGeoreferencedWarning
from rasterio.warp import transform

from cli.conftest import ensemble_words, write_ensemble_scene, write_outline
from command_line import done, lava, refused
from lava_ros.products.export import MAPS
from lava_ros.scene import Terrain
from lava_ros.simulation.numerical_error import AreaError, NumericalError
from recording import GRIDS, record, TERRAIN


def plot(folder: Path, *words: object) -> dict[str, Any]:
    """Draw a page, and return its JSON description."""
    done('map', *words, '-o', folder / 'map.png', '--json', folder / 'output.json')
    return json.loads((folder / 'output.json').read_text())


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Record frames at 200, 400, 600 and 800 s."""
    return record(tmp_path_factory.mktemp('plot') / 'flow')


@pytest.fixture
def outline(tmp_path):
    """Write an observed outline that overlaps both flows."""
    corners = (499_950, 4_180_070), (500_060, 4_180_120)
    return write_outline(tmp_path / 'outline.geojson', *corners)


def test_plot_describes_a_bag(bag, tmp_path, undrawn):
    output = plot(tmp_path, bag)
    assert output['title'] == 'Lava flow after 13 min'
    assert output['maps'] == ['Lava thickness', 'Temperature', 'Hazard index']
    notes = output['notes']
    error = 'numerical error 15 % of the inundated area, 12 % of the standing area'
    assert error in notes.pop('model')
    assert notes.items() >= {
        'computed': '2026-09-21', 'effusion rate': '10 m³/s', 'elevation': 'maps in cells of 5 m',
        'coordinates': 'WGS 84 / UTM zone 33N (EPSG:32633)', 'volume emitted': '6,170 m³',
    }.items()
    output = plot(
        tmp_path, bag, '--layers', 'arrival', '--at', '400', '--volcano', 'Etna',
        '--source', 'INGV 2014', '--date', '2026-11-23',
    )
    assert output['title'] == 'Etna: Lava flow after 7 min'
    assert 'time' not in output['notes']
    assert output['maps'] == ['Time of arrival of the lava, 0.1 m thick']
    assert output['notes']['elevation'] == 'INGV 2014, maps in cells of 5 m'
    assert output['notes']['date'] == '2026-11-23'


def test_plot_describes_and_scores_an_ensemble(ensemble, tmp_path, outline, undrawn):
    output = plot(tmp_path, ensemble)
    assert output['title'] == 'Lava within 3 min, 4 runs'
    assert output['maps'][1:] == [
        f'{name} arrival (lava comes earlier in {percent} % of cases)'
        for name, percent in (('Early', 20), ('Median', 40), ('Late', 80))
    ]
    assert output['maps'][0] == 'Inundation probability (no colour: below 20 %)'
    assert 'latent heat' in output['notes']['processes included']
    assert output['notes']['runs'].startswith('4; a probability of 50 % is known to 25 percentage')
    assert output['notes']['elevation'] == 'a slope of tests, maps in cells of 5 m'
    drawn = output['notes']['uncertain'].split('; ')
    assert drawn[0] == 'effusion rate times 0.5 to 1.5 (uniform), Harris 2007'
    assert any(text.startswith('position ') for text in drawn) and output['scores'] == {}
    assert output['notes']['taken as exact'].startswith('specific heat, ')
    assert output['notes']['what decides (1 - J)'].startswith('not known from 4 members, needs ')
    output = plot(tmp_path, ensemble, '--layers', 'inundation_probability', '--observed', outline)
    assert 0.0 < output['scores']['members']['brier_score'] < 1.0


def pages_of(run: Path, folder: Path) -> dict[str, tuple[dict[str, Any], str]]:
    """Return lava, error and warnings in JSON, and the text for people, of all commands."""
    hut = folder / 'hut.csv'
    hut.write_text('x,y,name\n500050,4180100,hut\n')
    drawn = plot(folder, run)
    done('map', run, '-o', folder / 'page.html')
    page = (folder / 'page.html').read_text()
    done('places', run, hut, '--json', folder / 'places.json')
    return {
        'plot': (drawn['runs'][run.name], ' '.join(drawn['notes'].values())),
        'report': (drawn['runs'][run.name], page),
        'places': (json.loads((folder / 'places.json').read_text()), page),
    }


@pytest.mark.parametrize('kind', ['bag', 'ensemble'])
def test_all_pages_state_lava_error_and_under_resolution(kind, tmp_path, undrawn):
    if kind == 'bag':
        run, lava = record(tmp_path / 'coarse', times=[200.0, 400.0]), 'kedadry2023'
    else:
        # a spacing of 30 m on a flow of about 30 m
        write_ensemble_scene(tmp_path, 3.0, {'position': {'deviation': 5.0}})
        run, lava = tmp_path / 'members', 'etna_basalt'
        words = [*ensemble_words(tmp_path, 2), '--spacing', 30, '--json', tmp_path / 'run.json']
        words = done(*words)
        assert 'lava: etna_basalt; at the vent' in words
        error = NumericalError(AreaError(0.1, 0.05), AreaError(0.2, 0.1), 30.0, 5.0, 180.0)
        known = json.loads((run / 'run.json').read_text())
        (run / 'run.json').write_text(json.dumps({**known, 'numerical_error': error.as_dict()}))
    for name, (plain, text) in pages_of(run, tmp_path).items():
        assert plain['erupting_lava']['material'] == lava, name
        assert plain['erupting_lava']['vents'][0]['viscosity_pa_s'] > 0.0, name
        assert f'{lava}; at the vent' in text, name
        if kind == 'ensemble':
            assert plain['numerical_error'] == error.as_dict()
            assert 'The flow is under-resolved' in plain['warnings'][0], name
            assert 'The flow is under-resolved' in text, name
        else:
            assert plain['numerical_error']['inundated']['total'] == 0.15, name
            assert '15 % of the inundated area' in text, name
    if kind == 'ensemble':
        report = json.loads((tmp_path / 'run.json').read_text())
        assert report['warnings'] == plain['warnings']
        assert report['erupting_lava'] == plain['erupting_lava']


def test_isochrones_of_an_ensemble_are_nested(ensemble):
    for share in (10, 50, 90):
        path = ensemble / f'arrival_time_p{share}.geojson'
        times = [item['properties'] for item in json.loads(path.read_text())['features']]
        steps = [60.0, 120.0, 180.0]
        # the correction for the particle spacing moves the first arrivals
        first = steps.index(times[0]['time_s']) if times else 0
        assert [item['time_s'] for item in times] == steps[first : first + len(times)]
        areas = [item['cells_area_m2'] for item in times]
        assert areas == sorted(areas) and (areas or share == 90)


def test_ensemble_adds_a_format_when_run_again(ensemble, monkeypatch):
    words = [*ensemble_words(ensemble.parent, 4), '--formats', 'gpkg']
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, 'pyogrio', None)
        assert 'pip install pyogrio' in refused(*words)
    done(*words)
    layers = [name for name, _ in pyogrio.list_layers(ensemble / 'lava.gpkg')]
    assert {'inundation_probability', 'arrival_time_p50'} <= set(layers)
    found = pyogrio.read_info(ensemble / 'lava.gpkg', layer='arrival_time_p50')
    assert found['crs'] == 'EPSG:32633' and 'time_s' in found['fields']


def test_plot_compares_runs_by_folder(bag, ensemble, tmp_path, undrawn):
    other = record(tmp_path / 'other' / 'flow', times=(200.0, 400.0))
    output = plot(tmp_path, bag, other)
    assert output['maps'] == [f'{path.parent.name}/flow: Lava thickness' for path in (bag, other)]
    assert output['notes']['effusion rate'] == '10 m³/s'
    assert output['notes']['result'].count('standing lava') == 2
    output = plot(tmp_path, bag, ensemble)
    assert output['maps'][1] == 'members: Expected peak thickness of the lava'
    nowhere = record(tmp_path / 'nowhere', terrain=Terrain(TERRAIN.elevation, 5.0, TERRAIN.origin))
    # maps use the horizontal part of a coordinate system
    compound = replace(TERRAIN, wkt=CRS.from_user_input('EPSG:32633+5773').to_wkt())
    plot(tmp_path, bag, record(tmp_path / 'compound', terrain=compound))
    picture = tmp_path / 'no.png'
    assert 'different coordinate systems' in refused('map', bag, nowhere, '-o', picture)
    assert 'have the same name' in refused('map', bag, bag, '-o', picture)
    assert not picture.exists()


def test_plot_draws_overlays_and_counts_those_off_the_map(bag, tmp_path, caplog, outline):
    plain = plot(tmp_path, bag, '--layers', 'hazard')
    before = imread(tmp_path / 'map.png')
    (tmp_path / 'stations.csv').write_text('x,y,name\n499980,4180090,a\n1,2,b\n')
    words = ('--places', tmp_path / 'stations.csv', '--observed', outline)
    assert plot(tmp_path, bag, '--layers', 'hazard', *words) == plain
    assert 'stations: 1 of 2 features lie outside' in caplog.text
    blue = [
        int(((image[..., 2] > 0.4) & (image[..., 0] < 0.15)).sum())
        for image in (before, imread(tmp_path / 'map.png'))
    ]
    assert blue[1] > blue[0] + 300


@pytest.mark.parametrize(('words', 'named'), [
    (('--layers', 'inundation_probability'), 'one of thickness, temperature, hazard'),
    (('--places', 'none.csv'), '--places is .none.csv., expected a file that exists'),
    (('-o', 'a.html', '--places', 'none.csv'), '--places is .none.csv., expected a file that'),
    (('--extent', '5', '1', '4', '2'), '--extent is .5, 1, 4, 2., expected WEST SOUTH EAST'),
    (('--extent', '1', '2', '3', '4'), '--extent is .1, 2, 3, 4., expected an extent that over'),
    (('--scale', '1:0'), '--scale is .1:0., expected'),
    (('--scale', '1:20'), '--scale is 1:20, expected 1:[0-9]+ or smaller'),
    (('--start', '14 July'), '--start is .14 July., expected a date such as .* in UTC unless'),
    (('--start', '2006-07-14T22:00Z', '--timezone', 'Europe/Etna'), '--timezone is'),
    (('--timezone', 'Europe/Rome'), '--timezone has no effect without --start'),
    (('--logo', 'none.png'), '--logo is .none.png., expected a PNG or JPEG'),
    (('-o', 'a.html', '--logo', 'none.png'), '--logo is .none.png., expected a PNG or JPEG'),
    (('-o', 'a.html', '--scale', '1:2000'), '--scale does not apply to .html, a page for a scr'),
])
def test_map_refuses_unusable_options(bag, tmp_path, monkeypatch, words, named):
    monkeypatch.chdir(tmp_path)
    assert re.search(named, refused('map', bag, '-o', 'a.png', *words))
    assert not list(tmp_path.iterdir())


def test_maps_older_than_the_requested_time_are_noted(bag, tmp_path, caplog, undrawn):
    output = plot(tmp_path, bag, '--at', '550s')
    assert output['title'] == 'Lava flow after 7 min'
    note = 'maps at 7 min (400 s), the newest of the recording at or before 9 min (550 s)'
    assert output['notes']['time'] == note and note in caplog.text
    caplog.clear()
    done('export', bag, '-o', tmp_path / 'maps', '--at', '550s')
    assert note in caplog.text
    caplog.clear()
    assert 'time' not in plot(tmp_path, bag)['notes'] and 'the newest' not in caplog.text


def test_onset_gives_dates_in_utc_and_local_time(ensemble, tmp_path, caplog, undrawn):
    stated = {'onset': '2006-07-14T22:00:00Z'}
    bag = record(tmp_path / 'flow', config=GRIDS, custom_data=stated)
    zone = ('--timezone', 'Europe/Rome')
    notes = plot(tmp_path, bag, '--layers', 'arrival', '--at', '600', *zone)['notes']
    assert notes['start of the eruption'] == '2006-07-14 22:00 UTC (2006-07-15 00:00 CEST)'
    assert notes['maps show'] == '2006-07-14 22:10 UTC (2006-07-15 00:10 CEST)'
    assert notes['isochrones'].startswith('5 min: 2006-07-14 22:05 UTC (2006-07-15 00:05 CEST)')
    notes = plot(tmp_path, ensemble, '--start', '2026-01-01T13:00+01:00', *zone)['notes']
    assert notes['forecast until'] == '2026-01-01 12:03 UTC (13:03 CET)'
    notes = plot(tmp_path, bag, '--start', '2026-01-01T12:00Z', *zone)['notes']
    assert notes['maps show'].startswith('2026-01-01 12:13 UTC')
    done('map', bag, '-o', tmp_path / 'a.html')
    page = (tmp_path / 'a.html').read_text()
    assert '<dt>maps show</dt><dd>2006-07-14 22:13 UTC' in page
    done('export', bag, '-o', tmp_path / 'maps', '--formats', 'tif', 'geojson', 'nc')
    with rasterio.open(tmp_path / 'maps/thickness.tif') as file:
        tags = file.tags()
    assert (tags['onset'], tags['date_utc']) == ('2006-07-14T22:00:00Z', '2006-07-14T22:13:20Z')
    areas = json.loads((tmp_path / 'maps/isochrones.geojson').read_text())['features']
    assert areas[0]['properties']['date_utc'].rstrip('Z') == '2006-07-14T22:05:00'
    netcdf = f'netcdf:{tmp_path / "maps/maps.nc"}'
    with pytest.warns(NotGeoreferencedWarning), rasterio.open(netcdf) as file:
        assert file.tags()['NC_GLOBAL#onset'] == '2006-07-14T22:00:00Z'
    bag = record(tmp_path / 'odd', config=GRIDS, custom_data={'onset': 'in summer'})
    assert 'maps show' not in plot(tmp_path, bag)['notes']
    assert "onset of the bag is 'in summer', expected a date" in caplog.text


def test_observed_lava_off_the_map_is_refused(bag, ensemble, tmp_path):
    far = write_outline(tmp_path / 'far.geojson', (0, 0), (100, 100))
    for run, page in ((ensemble, 'a.png'), (bag, 'a.png'), (ensemble, 'a.html')):
        output = refused('map', run, '-o', tmp_path / page, '--observed', far)
        assert re.search('--observed is .*far.geojson.*observed lava on the terrain', output)
        assert not (tmp_path / page).exists()


def test_extents_in_degrees_and_metres_agree(bag, tmp_path, monkeypatch):
    drawn = Mock()
    monkeypatch.setattr('lava_ros.products.pictures.draw_sheet', drawn)
    metres = (499_980.0, 4_180_050.0, 500_050.0, 4_180_100.0)
    x, y = transform('EPSG:32633', 'EPSG:4326', metres[::2], metres[1::2])
    for extent in (metres, (x[0], y[0], x[1], y[1])):
        plot(tmp_path, bag, '--layers', 'hazard', '--extent', *extent)
    first, second = (call.kwargs['extent'] for call in drawn.mock_calls)
    assert first == metres
    np.testing.assert_allclose(second, metres, rtol=0.0, atol=0.5)


def test_refuses_an_unfinished_ensemble(ensemble, tmp_path):
    (tmp_path / 'run.json').write_text((ensemble / 'run.json').read_text())
    refused('map', tmp_path, '-o', tmp_path / 'a.png')
    refused('map', ensemble, '--at', '1h', '-o', tmp_path / 'a.png')
    (tmp_path / 'run.json').write_text('[]')
    refused('map', tmp_path, '-o', tmp_path / 'a.html')


@pytest.mark.parametrize(('name', 'value', 'limits'), [
    ('inundation_probability', 700.0, '0 to 100'), ('arrival_time_p10', np.inf, '0 to 180'),
    ('elevation', 4.3e6, '-100000 to 100000'),
])
def test_impossible_values_of_an_ensemble_are_refused(ensemble, tmp_path, name, value, limits):
    folder = shutil.copytree(ensemble, tmp_path / 'members')
    with rasterio.open(folder / f'{name}.tif', 'r+', IGNORE_COG_LAYOUT_BREAK='YES') as file:
        values = file.read(1)
        values[0, 0] = value
        file.write(values, 1)
    for page in ('a.png', 'a.html'):
        output = refused('map', folder, '-o', tmp_path / page)
        assert f'{name}.tif has {value:g}, expected {limits}' in output


def test_reports_contain_maps_and_facts(bag, ensemble, tmp_path, outline, undrawn):
    page = tmp_path / 'a.html'
    done('map', ensemble, '-o', page, '--observed', outline)
    text = page.read_text()
    assert 'data:image/png;base64,' in text and 'brier score of members' in text
    assert 'Simulation, not verified.' in text
    done('map', bag, ensemble, '-o', page)
    assert 'members: Expected peak thickness of the lava' in page.read_text()
    page.unlink()
    done('map', bag, '-o', page, '--observed', outline, '--author', 'A. Nonymous')
    assert '<dt>author</dt><dd>A. Nonymous</dd>' in page.read_text()


def test_export_lists_or_counts_its_files(bag, tmp_path):
    out = tmp_path / 'out'
    # the bag has no inundated fractions
    maps = [name for name in MAPS if name != 'inundated']
    names = ''.join(f'written to {out / f"{name}.tif"}\n' for name in maps)
    assert lava('export', bag, '-o', out, '--at', '600') == (0, names, '')
    assert done('export', bag, '-o', tmp_path / 'all', '--every') == (
        f'14 files written to {tmp_path / "all"}\n'
    )
    assert len(list((tmp_path / 'all').glob('*.tif'))) == 14


def test_info_has_the_simulated_time_and_volumes(bag):
    volume = 250.0 * (8 * 3.26 - 0.05 * 28)
    lines = done('bag', 'info', bag).splitlines()
    assert 'simulated  800.000 s' in lines
    place = lines.index('volumes') + 1
    stated = dict(line.strip().split('  ', 1) for line in lines[place : place + 8])
    assert {name: value.strip() for name, value in stated.items()} == {
        'emitted': f'{volume:,.1f} m3', 'flowing': f'{volume:,.1f} m3', 'solidified': '0 m3',
        'lost over the border': '0 m3', 'lost in no-data cells': '0 m3',
        'waiting in the vents': '0 m3', 'overdue in the vents': '0 m3',
        'error': 'below 1e-15 of the emitted volume',
    }
    output = json.loads(done('bag', 'info', bag, '--json', '-'))['simulation']
    assert output['simulated_time_s'] == 800.0
    assert output['volume_flowing_m3'] == pytest.approx(volume, rel=1e-6)
