# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava places`: arrival times at places, compared with the GeoTIFFs of the same run."""

import csv
import json
from pathlib import Path
import re
import shutil
from typing import Any

import numpy as np
import pytest
import rasterio

from cli.calls import done, refused
from cli.inputs import ensemble_words, write_outline, write_scene
from recording import growing, record, TERRAIN

#: Points along the flow of the ensemble [m, map frame].
POINTS = {f'post {x}': (float(x), 97.0) for x in range(-48, 150, 5)}

QUANTILES = {'p10': 0.1, 'p50': 0.5, 'p90': 0.9}


def write_places(path: Path) -> Path:
    """Write points, a road across the flow, a farm on its axis, and a town off the map."""
    east, north = TERRAIN.offset

    def feature(name: str, kind: str, places: Any) -> dict[str, Any]:
        moved = np.add(places, (east, north)).tolist()
        geometry = {'type': kind, 'coordinates': moved}
        return {'type': 'Feature', 'properties': {'name': name}, 'geometry': geometry}

    ring = [[(-20.0, 97.0), (30.0, 97.0), (30.0, 118.0), (-20.0, 118.0), (-20.0, 97.0)]]
    features = [
        *(feature(name, 'Point', place) for name, place in POINTS.items()),
        feature('road', 'LineString', [(-12.5, 25.0), (-12.5, 165.0)]),
        feature('farm', 'Polygon', ring),
        feature('town', 'Point', (9000.0, 95.0)),
    ]
    crs = {'type': 'name', 'properties': {'name': 'EPSG:32633'}}
    path.write_text(json.dumps({'type': 'FeatureCollection', 'crs': crs, 'features': features}))
    return path


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


@pytest.fixture(scope='module', params=['noted', 'maps'])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a flow of 800 s with arrival times, or with maps alone."""

    def arrived(time: float) -> np.ndarray:
        # each cell 37.5 s before the first map that shows it
        columns = np.arange(TERRAIN.shape[1], dtype=np.float64)
        return np.where(growing(time) > 0.0, 100.0 * (columns + 1.0) - 37.5, np.nan)

    path = tmp_path_factory.mktemp('places') / 'flow'
    return record(path, arrived=arrived if request.param == 'noted' else None)


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


def test_table_up_to_a_time_leaves_out_later_arrivals(bag: Path, tmp_path: Path) -> None:
    places = write_places(tmp_path / 'a.geojson')
    late, early = (table(bag, places, *more, folder=tmp_path) for more in ((), ('--time', 450)))
    for name in POINTS:
        time = late[name]['arrival_p50_s']
        has_come = time is not None and time <= 450.0
        assert early[name]['arrival_p50_s'] == (time if has_come else None)
        assert (early[name]['front_distance_m'] == 0.0) is has_come
    assert early['post -33']['arrival_p50_s'] is not None
    assert early['post -18']['arrival_p50_s'] is None
    error = refused('places', bag, places, '--time', 900)
    assert '--time is 900.0, expected a finite number at most 800 s' in error


@pytest.fixture(scope='module')
def ensemble(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run six members, of which few flow far."""
    folder = tmp_path_factory.mktemp('ensemble')
    rates = {'distribution': 'loguniform', 'low': 0.3, 'high': 3.0}
    write_scene(folder, 4.0, {'position': {'deviation': 10.0}, 'discharge': rates})
    done(*ensemble_words(folder, 6))
    return folder / 'members'


def first_looks(folder: Path, rows: slice, columns: slice) -> list[int | None]:
    """Return the first look with lava in a part of the map, from the file of each member."""
    found: list[int | None] = []
    for path in sorted((folder / 'members').glob('*.npz')):
        member = np.load(path)
        looks = np.full(TERRAIN.shape, 65535, dtype=np.int64)
        (row, column), (height, width) = member['corner'], member['look'].shape
        looks[row : row + height, column : column + width] = member['look']
        first = int(looks[rows, columns].min())
        found.append(None if first == 65535 else first)
    return found


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
    plan = json.loads((ensemble / 'ensemble.json').read_text())['plan']
    for name, part in (('road', np.s_[1:29, 7:8]), ('farm', np.s_[15:20, 6:16])):
        looks = first_looks(ensemble, *part)
        times = sorted((look + 0.5) * plan['horizon_s'] / plan['looks'] for look in looks
                       if look is not None)
        assert found[name]['probability_percent'] == pytest.approx(100.0 * len(times) / 6)
        for quantile, fraction in QUANTILES.items():
            needed = int(np.ceil(6 * fraction))
            expected = times[needed - 1] if needed <= len(times) else None
            assert found[name][f'arrival_{quantile}_s'] == (
                None if expected is None else pytest.approx(expected, rel=1e-6)
            )
    assert found['town']['probability_percent'] is None


def test_table_uses_the_weights_of_members(ensemble: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ensemble.parent, tmp_path / 'ensemble'))
    ring = np.array([(20, 75), (60, 75), (60, 115), (20, 115), (20, 75)]) + TERRAIN.offset
    outline = write_outline(tmp_path / 'outline.geojson', ring)
    done(*ensemble_words(folder, 6), '--observed', outline, '--observed-at', '2min')
    ensemble = folder / 'members/weighted'
    found = table(ensemble, write_places(tmp_path / 'a.geojson'), folder=tmp_path)
    likely = values_at(ensemble / 'inundation_probability.tif', POINTS)
    assert any(value % (100.0 / 6) > 0.1 for value in likely.values())
    for name in POINTS:
        assert found[name]['probability_percent'] == likely[name]
    for text, words in (
        ('[1, 1]', 'a folder with 6 members'), ('[1, -1]', 'a whole number'), ('{', 'the weights'),
        ('[1, 1, 1, 1, 1, 1]', 'maps with the weights of its members'),
    ):
        (ensemble / 'weights.json').write_text(text)
        error = refused('places', ensemble, tmp_path / 'a.geojson')
        assert words in error, error


@pytest.mark.parametrize(('text', 'words'), [
    ('name,x,y\nhut,here,5\n', r"line 2 \(hut\), x is 'here'"),
    ('name,x,y,x_end,y_end\nroad,500000,4180090,500000,4180090\n', r'\(road\) is .a line'),
    ('name,east\nhut,5\n', 'the columns x,y'),
])
def test_refuses_unusable_features_by_name(
    bag: Path, tmp_path: Path, text: str, words: str
) -> None:
    (tmp_path / 'a.csv').write_text(text)
    error = refused('places', bag, tmp_path / 'a.csv')
    assert re.search(words, error), error


def test_reports_contain_the_table(bag: Path, ensemble: Path, tmp_path: Path) -> None:
    places, page = write_places(tmp_path / 'a.geojson'), tmp_path / 'page.html'
    for runs in ([bag], [ensemble], [bag, ensemble]):
        done('report', *runs, '-o', page, '--overlay', places)
        text = page.read_text()
        assert text.count('Arrival at places') == 1
        assert text.count('>farm<') == len(runs)
        assert text.count('off the map: nothing is known') == len(runs)
