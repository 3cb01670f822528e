# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava places`: arrival times at places, compared with the GeoTIFFs of the same run."""

import csv
from datetime import datetime, timezone
from itertools import product
import json
from pathlib import Path
import shutil
from typing import Any

import numpy as np
import pytest
import rasterio

from cli.conftest import ensemble_words, write_ensemble_scene, write_outline
from command_line import done, refused
from geodata import feature, write_features
from lava_ros.scene.features import load_files
from recording import growing, record, TERRAIN

#: Points along the flow of the ensemble [m, map frame].
POINTS = {f'post {x}': (float(x), 97.0) for x in range(-48, 150, 5)}

QUANTILES = ('p10', 'p50', 'p90')


def write_places(path: Path) -> Path:
    """Write points, a road across the flow, a farm on its axis, and a town off the map."""
    ring = [[(-20.0, 97.0), (30.0, 97.0), (30.0, 118.0), (-20.0, 118.0), (-20.0, 97.0)]]
    places = [
        *(('Point', place, name) for name, place in POINTS.items()),
        ('LineString', [(-12.5, 25.0), (-12.5, 165.0)], 'road'),
        ('Polygon', ring, 'farm'),
        ('Point', (9000.0, 95.0), 'town'),
    ]
    return write_features(path, *(
        feature(kind, np.add(where, TERRAIN.offset), name=name) for kind, where, name in places
    ))


def table(*words: object, folder: Path) -> dict[str, dict[str, Any]]:
    """Return the JSON rows of `lava places` by name, after a comparison with its CSV."""
    out = folder / 'table.csv', folder / 'table.json'
    done('places', *words, '-o', out[0], '--json', out[1])
    data = {item['name']: item for item in json.loads(out[1].read_text())['places']}
    with out[0].open(newline='') as file:
        for row in csv.DictReader(file):
            known = data[row['name']]
            assert {key: text for key, text in row.items() if text} == {
                key: str(value) for key, value in known.items() if value is not None
            }
    return data


def values_at(path: Path, places: dict[str, tuple[float, float]]) -> dict[str, float]:
    """Return values of a GeoTIFF at map positions, NaN without data."""
    with rasterio.open(path) as file:
        where = [np.add(place, TERRAIN.offset) for place in places.values()]
        found = [float(value[0]) for value in file.sample(where, masked=False)]
        return {
            name: np.nan if value == file.nodata else value
            for name, value in zip(places, found, strict=True)
        }


def raster(path: Path) -> np.ndarray:
    """Read a GeoTIFF, row 0 in the south, NaN without data."""
    with rasterio.open(path) as file:
        return np.flipud(file.read(1, masked=True).astype(float).filled(np.nan))


def same(time: float | None, value: float) -> bool:
    return time == value if time is not None else bool(np.isnan(value))


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a flow of 800 s with arrival times."""

    def arrived(time: float) -> np.ndarray:
        # each cell 37.5 s before the first map that shows it
        columns = np.arange(TERRAIN.shape[1], dtype=np.float64)
        return np.where(growing(time) > 0.0, 100.0 * (columns + 1.0) - 37.5, np.nan)

    return record(tmp_path_factory.mktemp('places') / 'flow', arrived=arrived)


def test_table_of_a_run_equals_its_geotiff(bag: Path, tmp_path: Path) -> None:
    done('export', bag, '-o', tmp_path / 'maps', '--maps', 'arrival')
    found = table(bag, write_places(tmp_path / 'a.geojson'), folder=tmp_path)
    values = values_at(tmp_path / 'maps/arrival.tif', POINTS)
    reached = [name for name in POINTS if not np.isnan(values[name])]
    assert 3 < len(reached) < len(POINTS)
    for name in POINTS:
        item = found[name]
        assert all(same(item[f'arrival_{quantile}_s'], values[name]) for quantile in QUANTILES)
        assert item['probability_percent'] == (100.0 if name in reached else 0.0)
        assert (item['front_distance_m'] == 0.0) is (name in reached)
    arrival = raster(tmp_path / 'maps/arrival.tif')
    # the road is in the cells of -15 to -10 m, the south-west corner of the farm at (-20, 97) m
    assert found['road']['arrival_p50_s'] == np.nanmin(arrival[1:29, 7])
    wet = np.isfinite(arrival[:, 7])
    assert found['road']['inundated_length_p90_m'] == pytest.approx(5.0 * wet.sum())
    assert found['farm']['arrival_p50_s'] == np.nanmin(arrival[15:20, 6:16])
    overlap = np.array([3.0, 5.0, 5.0, 5.0, 3.0])[:, None] * 5.0
    area = (np.isfinite(arrival[15:20, 6:16]) * overlap).sum()
    assert found['farm']['inundated_area_p10_m2'] == pytest.approx(area)
    assert found['farm']['area_m2'] == pytest.approx(50.0 * 21.0)
    assert found['town']['off_map_percent'] == 100.0
    assert found['town']['probability_percent'] is None


@pytest.mark.parametrize('given', ['recording', 'option'])
def test_arrivals_have_dates_if_the_start_is_known(given: str, tmp_path: Path) -> None:
    stated = {'onset': '2006-07-14T22:00:00Z'} if given == 'recording' else {}
    bag = record(tmp_path / 'flow', custom_data=stated)
    words = () if stated else ('--start', '2006-07-15T00:00+02:00')
    zone = ('--timezone', 'Pacific/Auckland')
    words = ('places', bag, write_places(tmp_path / 'a.geojson'), *words, *zone)
    text = done(*words, '--json', tmp_path / 'a.json', '-o', tmp_path / 'a.csv')
    plain = json.loads((tmp_path / 'a.json').read_text())
    assert plain['onset_utc'] == '2006-07-14T22:00:00Z'
    rows = {item['name']: item for item in plain['places']}
    start = datetime(2006, 7, 14, 22, tzinfo=timezone.utc).timestamp()
    for item, which in product(rows.values(), ('earliest', 'p50')):
        time, date = item[f'arrival_{which}_s'], item[f'arrival_{which}_utc']
        assert (date is None) is (time is None)
        if time is not None:
            seconds = datetime.fromisoformat(date.replace('Z', '+00:00')).timestamp()
            # to the second
            assert 0.0 <= start + time - seconds < 1.0
    assert rows['road']['arrival_p50_s'] == 800.0
    assert ', 2006-07-14 22:13 UTC (2006-07-15 10:13 NZST)' in text
    assert 'the start is 2006-07-14 22:00 UTC' in text
    assert ',2006-07-14T22:13:20Z,' in (tmp_path / 'a.csv').read_text()
    error = refused('places', bag, tmp_path / 'a.geojson', '--start', 'yesterday')
    assert '--start is' in error


def test_table_up_to_a_time_leaves_out_later_arrivals(bag: Path, tmp_path: Path) -> None:
    places = write_places(tmp_path / 'a.geojson')
    late, early = (table(bag, places, *more, folder=tmp_path) for more in ((), ('--at', 450)))
    for name in POINTS:
        time = late[name]['arrival_p50_s']
        has_come = time is not None and time <= 450.0
        assert early[name]['arrival_p50_s'] == (time if has_come else None)
        assert (early[name]['front_distance_m'] == 0.0) is has_come
    assert early['post -33']['arrival_p50_s'] is not None
    assert early['post -18']['arrival_p50_s'] is None
    error = refused('places', bag, places, '--at', 900)
    assert "--at is '900', expected 200 to 800 s" in error


@pytest.fixture(scope='module')
def ensemble(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run six members, of which few flow far."""
    folder = tmp_path_factory.mktemp('ensemble')
    rates = {'distribution': 'loguniform', 'low': 0.3, 'high': 3.0}
    write_ensemble_scene(folder, 4.0, {'position': {'deviation': 10.0}, 'discharge': rates})
    done(*ensemble_words(folder, 6))
    return folder / 'members'


def test_table_of_an_ensemble_equals_its_geotiffs(ensemble: Path, tmp_path: Path) -> None:
    found = table(ensemble, write_places(tmp_path / 'a.geojson'), folder=tmp_path)
    likely = values_at(ensemble / 'inundation_probability.tif', POINTS)
    assert len({round(value) for value in likely.values()}) > 3
    for quantile in QUANTILES:
        values = values_at(ensemble / f'arrival_time_{quantile}.tif', POINTS)
        for name in POINTS:
            assert same(found[name][f'arrival_{quantile}_s'], values[name]), (name, quantile)
            assert found[name]['probability_percent'] == likely[name]
        arrival = raster(ensemble / f'arrival_time_{quantile}.tif')
        length = 5.0 * np.isfinite(arrival[1:29, 7]).sum()
        assert found['road'][f'inundated_length_{quantile}_m'] == pytest.approx(length)
        # one member may be at the road in the west, another in the east
        first = found['road'][f'arrival_{quantile}_s']
        cell = np.nanmin(arrival[1:29, 7], initial=1e9)
        assert cell == 1e9 if first is None else first <= cell
    assert found['town']['probability_percent'] is None


def test_table_uses_the_weights_of_members(ensemble: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ensemble.parent, tmp_path / 'ensemble'))
    corners = np.array([(20, 75), (60, 115)]) + TERRAIN.offset
    outline = write_outline(tmp_path / 'outline.geojson', *corners)
    done(*ensemble_words(folder, 6), '--observed', outline, '--observed-at', '2min')
    ensemble = folder / 'members/weighted'
    found = table(ensemble, write_places(tmp_path / 'a.geojson'), folder=tmp_path)
    likely = values_at(ensemble / 'inundation_probability.tif', POINTS)
    assert any(value % (100.0 / 6) > 0.1 for value in likely.values())
    for name in POINTS:
        assert found[name]['probability_percent'] == likely[name]
    for text, words in (
        ('[1, 1]', 'are of 6 members'), ('{', 'the weights'),
        ('[1, 1, 1, 1, 1, 1]', 'do not have the weights of its members'),
    ):
        (ensemble / 'weights.json').write_text(text)
        assert words in refused('places', ensemble, tmp_path / 'a.geojson')


def test_ensemble_prints_the_table_of_its_maps(ensemble: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ensemble.parent, tmp_path / 'ensemble'))
    places, report = write_places(tmp_path / 'a.geojson'), tmp_path / 'report.json'
    outline = write_outline(
        tmp_path / 'outline.geojson', *np.array([(20, 75), (60, 115)]) + TERRAIN.offset
    )
    observed = ['--observed', outline, '--observed-at', '2min']
    for more, maps in (([], folder / 'members'), (observed, folder / 'members/weighted')):
        words = [*ensemble_words(folder, 6), '--places', places, '--json', report, *more]
        printed = done(*words)
        written = json.loads(report.read_text())
        expected = table(maps, places, folder=tmp_path)
        assert {item['name']: item for item in written['places']} == expected
        assert printed.endswith(done('places', maps, places))


def test_reports_contain_the_table(ensemble: Path, tmp_path: Path, undrawn: None) -> None:
    places, page = write_places(tmp_path / 'a.geojson'), tmp_path / 'page.html'
    bag = record(tmp_path / 'flow', times=(200.0, 400.0))
    for runs in ([bag], [bag, ensemble]):
        done('map', *runs, '-o', page, '--places', places)
        text = page.read_text()
        assert text.count('Arrival at places') == 1
        assert text.count('>farm<') == len(runs)
        assert text.count('off the map: nothing is known') == len(runs)


@pytest.mark.parametrize('command', [
    ['places', 'missing.mcap', 'wrong.csv'],
    ['map', 'missing.mcap', '-o', 'a.pdf', '--places', 'wrong.csv'],
    ['map', 'missing.mcap', '-o', 'a.html', '--places', 'wrong.csv'],
])
def test_files_of_places_are_read_before_the_run(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path('wrong.csv').write_text('name,x,y\nhut,a,1\n')
    assert "wrong.csv, line 2 (hut), x is 'a', expected a finite number" in refused(*command)


def test_each_file_of_places_has_its_own_name(tmp_path: Path) -> None:
    names = 'huts.csv', 'huts.geojson', 'old/huts.csv'
    (tmp_path / 'old').mkdir()
    files = [write_features(tmp_path / name, feature('Point', (1.0, 2.0), name='hut'))
             if name.endswith('json') else tmp_path / name for name in names]
    for path in (files[0], files[2]):
        path.write_text('name,x,y\nhut,1,2\n')
    found = load_files('--places', files)
    assert list(found) == ['huts', f'{tmp_path.name}/huts', 'old/huts']
    assert all(len(items) == 1 for items in found.values())
