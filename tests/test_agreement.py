# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""One eruption in every output: the same cells, volumes, thicknesses and times.

Other libraries read the files: rasterio, rosbags and json. An ensemble and a forecast of the
eruption equal the hindcast: only the temperature is uncertain, by less than a float32 resolves.
"""

from dataclasses import replace
from datetime import datetime
from importlib.util import find_spec
import json
import math
from pathlib import Path
import shutil
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.errors import NotGeoreferencedWarning
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores

from command_line import done
from eruption import CELL, CORNER, SHAPE, VENT, write_case
from lava_ros.cli.console import with_units
from lava_ros.files.resources import share_path
from lava_ros.forecast.forecast_run import ForecastRun
from lava_ros.forecast.probability import EnsembleAccumulator, footprint_by
from lava_ros.forecast.store import stored_members
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.page import FALSE_ALARM, HIT
from lava_ros.hindcast.run import FORCED, Settings
from lava_ros.layers.forecast import occupancy
from lava_ros.layers.layer_files import load_layers
from lava_ros.layers.numbers import area_words
from lava_ros.layers.place_arrivals import live_arrivals
from lava_ros.layers.places import places_on
from lava_ros.layers.recording import Recording
from lava_ros.products.run_page import read_run
from lava_ros.ros import codec, outputs
from lava_ros.scene.features import read_features
from lava_ros.simulation import Simulation

#: Runny lava that drains, and solidifies in part within the hour. No effect is switched on during
#: the flow, because ensemble members would have it from the start.
LAVA = (
    'epsg: 32633\nlava: {viscosity: 6.0e+2, yield_strength: 0, crust_strength: 0, '
    'solidus: 1250.0, convection: 260.0, arrhenius: 0.01}\nvent_temperature: 1360.0\n'
    'effusion_rate: {start: 2021-09-19T14:10:00Z}\n'
    'uncertainty: {temperature: {distribution: uniform, low: 0.0, high: 1.0e-9}, exact: all}\n'
)

#: Options of every run.
OPTIONS = ('--preset', 'draft', '--spacing', '10', '--device', 'cpu')

#: Start, end and discharge of the pulses [s, s, m3/s].
DISCHARGE = ((0, 600, 15), (600, 1500, 0), (1500, 2100, 60), (2100, 3600, 0))

#: Formats of an export, by the package that writes each.
FORMATS = {'tif': 'rasterio', 'geojson': 'rasterio', 'gpkg': 'pyogrio', 'nc': 'scipy'}


def write_eruption(folder: Path) -> Path:
    case = write_case(folder, yaml=LAVA)
    rows = '\n'.join(f'{start},{end},{flux}' for start, end, flux in DISCHARGE)
    (case / 'effusion_rate.csv').write_text(f'start_s,end_s,discharge_m3_per_s\n{rows}\n')
    return case


def read_tif(path: Path | str) -> np.ndarray:
    """Read a raster as float64, NaN without data, row 0 in the south."""
    with rasterio.open(path) as file:
        return file.read(1, masked=True).astype(np.float64).filled(np.nan)[::-1]


def newest_messages(path: Path) -> dict[str, Any]:
    """Return the newest message of each topic of a bag."""
    last: dict[str, Any] = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            last[connection.topic] = reader.deserialize(data, connection.msgtype)
    return last


def image_of(message: Any) -> np.ndarray:
    """Return the pixels of a float32 image, row 0 in the south."""
    return np.frombuffer(message.data.tobytes(), np.float32).reshape(SHAPE)


def grid_of(message: Any) -> np.ndarray:
    return np.array(message.data, np.int8).reshape(SHAPE)


def read_bag(path: Path) -> SimpleNamespace:
    """Return the newest maps and diagnostics of a bag."""
    last = newest_messages(path)
    images = {
        name: image_of(last[f'/{name}']) for name in ('arrived', 'inundated', 'height_raw')
    }
    grids = {name: grid_of(last[f'/{name}']) for name in ('height', 'hazard')}
    status = next(item for item in last['/diagnostics'].status if item.name.endswith('simulation'))
    diagnostics = {item.key: item.value for item in status.values}
    return SimpleNamespace(**images, **grids, diagnostics=diagnostics)


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Return a hindcast, its printed text, and everything made from its bag."""
    folder = tmp_path_factory.mktemp('agreement')
    case, out = write_eruption(folder / 'pulses'), folder / 'out'
    printed = done('run', case, *OPTIONS, '-o', out)
    formats = [name for name, package in FORMATS.items() if find_spec(package)]
    done('export', out, '-o', folder / 'maps', '--formats', *formats)
    done('map', out, '-o', folder / 'map.png', '--json', folder / 'plot.json')
    done('map', out, '-o', folder / 'report.html')
    return SimpleNamespace(
        folder=folder, case=case, out=out, printed=printed, maps=folder / 'maps',
        score=json.loads((out / 'run.json').read_text())['score'],
        volume=json.loads((out / 'run.json').read_text()),
        decisions=json.loads((out / 'run.json').read_text())['decisions'],
        plot=json.loads((folder / 'plot.json').read_text()),
        report=(folder / 'report.html').read_text(), page=(out / 'hindcast.html').read_text(),
        arrival=read_tif(out / 'arrival.tif'), inundated=read_tif(out / 'inundated.tif'),
        thickness=np.nan_to_num(read_tif(out / 'thickness.tif')), bag=read_bag(out / 'maps'),
    )


def test_eruption_solidifies_drains_and_still_flows(run):
    assert not any(item['on_since_s'] for item in run.decisions)
    reached, standing = np.isfinite(run.arrival), run.thickness >= 0.1
    assert run.volume['volume_solidified_m3'] > 0.05 * run.volume['volume_emitted_m3']
    assert (reached & ~standing).sum() >= 5
    assert not (standing & ~reached).any()
    assert ((run.arrival > 0.0) & (run.arrival < 600.0)).any() and np.nanmax(run.arrival) > 1500.0


def area_of_features(path: Path, name: str) -> float:
    """Return the area of a name that the last feature of a GeoJSON file states [m2]."""
    return json.loads(path.read_text())['features'][-1]['properties'][name]


def tag_of(path: Path, name: str) -> float:
    with rasterio.open(path) as file:
        return float(file.tags()[name])


def place_areas(run) -> list[float]:
    """Return the inundated area of a place that is the whole map, in a bag and a table."""
    east, north = CORNER
    rows, columns = SHAPE
    ring = [[east, north], [east + columns * CELL, north]]
    ring += [[x, y + rows * CELL] for x, y in reversed(ring)]
    feature = {
        'type': 'Feature', 'properties': {'name': 'map'},
        'geometry': {'type': 'Polygon', 'coordinates': [[*ring, ring[0]]]},
    }
    path = run.folder / 'map.geojson'
    path.write_text(json.dumps({
        'type': 'FeatureCollection', 'features': [feature],
        'crs': {'type': 'name', 'properties': {'name': 'EPSG:32633'}},
    }))
    table = run.folder / 'places.json'
    done('places', run.out, path, '--json', table)
    (row,) = json.loads(table.read_text())['places']
    return [row[f'inundated_area_p{percent}_m2'] for percent in (10, 50, 90)]


#: The inundated area [m2] by output.
AREAS = {
    'inundated.tif': lambda run: run.inundated[run.inundated > 0].sum() * CELL**2,
    'exported inundated.tif': lambda run: (
        np.nansum(read_tif(run.maps / 'inundated.tif')) * CELL**2
    ),
    'tag of the exported map': lambda run: tag_of(run.maps / 'inundated.tif', 'inundated_area_m2'),
    'layer of the bag': lambda run: run.bag.inundated.sum(dtype=float) * CELL**2,
    'diagnostics': lambda run: float(run.bag.diagnostics['inundated_area_m2']),
    'outline': lambda run: area_of_features(run.maps / 'outline.geojson', 'inundated_area_m2'),
    'frame': lambda run: (lambda frame: frame.area(frame.inundated))(frame_of(run)),
    'places': lambda run: place_areas(run)[1],
}


def frame_of(run) -> Any:
    return Recording(run.out).frame_at()


@pytest.mark.parametrize('output', AREAS)
def test_inundated_area_is_the_same_in_each_output(run, output):
    assert AREAS[output](run) == pytest.approx(run.score['inundated_area_m2'], rel=1e-6)


def test_inundated_area_is_the_same_in_all_texts(run):
    area = run.score['inundated_area_m2']
    assert f'{area / 1e6:.3f} of ' in run.page and f'{area / 1e6:.3f} of ' in run.printed
    assert f'{area_words(area)} inundated' in run.plot['summary']
    assert f'<dt>inundated area, 0.1 m or more</dt><dd>{area_words(area)}</dd>' in run.report


def test_cells_and_times_are_the_same_in_all_outputs(run):
    reached, footprint, cell = np.isfinite(run.arrival), run.inundated >= 0.5, CELL**2
    assert 5 < footprint.sum() < reached.sum() - 5
    np.testing.assert_array_equal(run.inundated > 0.0, reached)
    np.testing.assert_array_equal(read_tif(run.maps / 'inundated.tif'), run.inundated)
    np.testing.assert_array_equal(run.bag.inundated, run.inundated.astype(np.float32))
    np.testing.assert_array_equal(read_tif(run.maps / 'arrival.tif'), run.arrival)
    np.testing.assert_array_equal(run.bag.arrived, run.arrival.astype(np.float32))
    times = np.sort(run.arrival[reached])
    for time in (times[0], times[len(times) // 2], times[-1]):
        where = run.arrival == time
        assert (run.bag.arrived[where] == np.float32(time)).all()
    codes = read_tif(run.out / 'comparison.tif')
    np.testing.assert_array_equal((codes == HIT) | (codes == FALSE_ALARM), footprint)
    assert run.score['hits'] + run.score['false_alarms'] == footprint.sum()
    isochrones = run.maps / 'isochrones.geojson'
    assert area_of_features(isochrones, 'cells_area_m2') == reached.sum() * cell
    peaks = [read_tif(folder / 'peak_thickness.tif') for folder in (run.out, run.maps)]
    np.testing.assert_array_equal(*peaks)
    np.testing.assert_array_equal(peaks[0] >= np.float32(0.1), reached)
    # ground that lava has reached is never safe again
    assert (run.bag.hazard[reached] > 0).all()
    others = (run.bag.hazard > 0) & ~reached
    assert not (run.thickness[others] >= 0.1).any()
    np.testing.assert_array_equal(run.bag.hazard == 50, reached & (run.thickness < 0.01))


def test_standing_lava_is_the_same_in_all_outputs(run):
    standing, cell = run.thickness >= 0.1, CELL**2
    shown = np.nan_to_num(read_tif(run.maps / 'thickness.tif'))
    np.testing.assert_array_equal(shown, run.thickness)
    np.testing.assert_array_equal(run.bag.height_raw, run.thickness.astype(np.float32))
    np.testing.assert_array_equal(run.bag.height > 0, standing)
    area = float(run.bag.diagnostics['standing_area_m2'])
    assert area == pytest.approx(run.inundated[standing].sum() * cell, rel=1e-6)
    assert run.score['standing_area_m2'] == area < run.score['inundated_area_m2']
    assert f'{area_words(area)} standing lava' in run.plot['summary']
    assert f'<dt>standing area, 0.1 m or more</dt><dd>{area_words(area)}</dd>' in run.report
    assert f'{area / 1e6:.3f} km² at the end' in run.page
    thickest = run.thickness.max()
    assert run.score['largest_thickness_m'] == run.bag.height_raw.max() == thickest
    assert f'up to {thickest:.3g} m thick' in run.plot['summary']
    volume = run.thickness.sum() * cell
    assert run.score['volume_on_map_m3'] == pytest.approx(volume, rel=1e-6)
    flowing = run.volume['volume_flowing_m3']
    assert flowing + run.volume['volume_solidified_m3'] == pytest.approx(volume, rel=1e-5)
    assert float(run.bag.diagnostics['volume_solidified_m3']) == run.volume['volume_solidified_m3']


@pytest.mark.parametrize('name', ['thickness', 'arrival', 'inundated'])
def test_exported_maps_have_the_tags_of_the_hindcast(run, name):
    with (
        rasterio.open(run.out / f'{name}.tif') as file,
        rasterio.open(run.maps / f'{name}.tif') as exported,
    ):
        assert file.nodata == exported.nodata and file.units == exported.units
        tags = ('scene', 'effects', 'preset', 'lava_ros', 'observation')
        assert [file.tags()[tag] for tag in tags] == [exported.tags()[tag] for tag in tags]


def test_pages_show_vents_that_have_closed(run):
    assert not len(Recording(run.out).frame_at().vents)
    vents = read_run(run.out).panels['thickness'].frame.vents
    np.testing.assert_allclose(vents + CORNER, [VENT])


def test_exported_outline_is_read_as_the_same_cells(run):
    case = write_eruption(run.folder / 'again')
    (case / 'footprint.asc').unlink()
    shutil.copy(run.maps / 'outline.geojson', case / 'footprint.geojson')
    np.testing.assert_array_equal(load_case(case).footprint, run.inundated >= 0.5)


def check_netcdf(folder: Path) -> None:
    """Compare each map of a NetCDF with the GeoTIFF of its name."""
    path, tifs = f'netcdf:{folder / "maps.nc"}', {item.stem: item for item in folder.glob('*.tif')}
    with pytest.warns(NotGeoreferencedWarning), rasterio.open(path) as file:
        assert {name.rpartition(':')[2] for name in file.subdatasets} == set(tifs)
    for name, tif in tifs.items():
        with rasterio.open(f'{path}:{name}') as file, rasterio.open(tif) as other:
            assert (file.transform, file.crs) == (other.transform, other.crs)
        np.testing.assert_array_equal(read_tif(f'{path}:{name}'), read_tif(tif))


def test_netcdf_equals_the_geotiffs(run):
    check_netcdf(run.maps)


def test_dates_are_those_of_the_case(run, ensemble):
    assert run.plot['notes']['start of the eruption'].startswith('2021-09-19 14:10 UTC')
    assert run.plot['notes']['maps show'].startswith('2021-09-19 15:10 UTC')
    assert '2021-09-19 15:10 UTC' in run.report
    for folder in (run.out, run.maps, ensemble.out):
        for path in folder.glob('*.tif'):
            with rasterio.open(path) as file:
                assert file.tags()['onset'] == '2021-09-19T14:10:00Z'
    for path in (run.maps / 'isochrones.geojson', ensemble.out / 'arrival_time_p50.geojson'):
        for item in json.loads(path.read_text())['features']:
            passed = datetime.fromisoformat(item['properties']['date_utc'].rstrip('Z'))
            passed -= datetime(2021, 9, 19, 14, 10)
            assert passed.total_seconds() == item['properties']['time_s']


@pytest.fixture(scope='module')
def ensemble(run):
    """Run an ensemble of identical members."""
    out, report = run.folder / 'ensemble', run.folder / 'ensemble.json'
    formats = [name for name, package in FORMATS.items() if find_spec(package)]
    done(
        'run', run.case, *OPTIONS, '-o', out, '--members', '2', '--workers', '1',
        '--json', report, '--formats', *formats,
    )
    members = read_run(out).ensemble
    assert members is not None
    return SimpleNamespace(out=out, report=json.loads(report.read_text()), plan=members.plan)


def maps_of(members, plan):
    """Return the maps of members of equal weight."""
    tally = EnsembleAccumulator(plan)
    for member in members:
        tally.add(member)
    return tally.maps()


def test_ensemble_of_identical_members_equals_the_run(run, ensemble):
    members = list(stored_members(ensemble.out, 2, ensemble.plan, on_refused=print))
    # without the correction for the particle spacing
    maps = maps_of([replace(member, pair=None) for member in members], ensemble.plan)
    reached = np.isfinite(run.arrival)
    np.testing.assert_array_equal(maps.probability, np.where(reached, 100.0, 0.0))
    peak = read_tif(ensemble.out / 'expected_peak_thickness.tif')
    np.testing.assert_array_equal(np.isfinite(peak), reached)
    np.testing.assert_array_equal(read_tif(ensemble.out / 'largest_peak_thickness.tif'), peak)
    # members are kept in whole millimetres
    np.testing.assert_allclose(
        np.nan_to_num(peak), np.nan_to_num(read_tif(run.out / 'peak_thickness.tif')), atol=5.1e-4
    )
    for times in (*maps.arrival.values(), maps.worst.arrival):
        np.testing.assert_array_equal(np.isfinite(times), reached)
        late = np.abs(times - run.arrival)[reached]
        assert late.max() <= maps.arrival_error + 1e-3
    assert {*maps.areas(CELL).values(), maps.worst_area(CELL)} == {run.score['inundated_area_m2']}
    np.testing.assert_array_equal(
        footprint_by(members[0], ensemble.plan, ensemble.plan.horizon), run.inundated >= 0.5
    )


def test_ensemble_differs_from_the_run_by_the_error_of_the_spacing(run, ensemble):
    members = list(stored_members(ensemble.out, 2, ensemble.plan, on_refused=print))
    maps = maps_of(members, ensemble.plan)
    expected = with_units(maps.spacing_error.as_dict(), m='spacing usable_spacing')
    assert expected == ensemble.report['spacing_error']
    probability = read_tif(ensemble.out / 'inundation_probability.tif')
    np.testing.assert_array_equal(probability, maps.probability)
    np.testing.assert_array_equal(probability > 0.0, np.isfinite(run.arrival))
    for fraction, times in maps.arrival.items():
        path = ensemble.out / f'arrival_time_p{100 * fraction:.0f}.tif'
        np.testing.assert_array_equal(read_tif(path), times)
    worst, *areas = ensemble.report['area_m2'].values()
    assert areas == list(maps.areas(CELL).values()) and worst == maps.worst_area(CELL)
    growth = math.exp(-maps.spacing_error.growth)
    assert areas[1] == pytest.approx(run.score['inundated_area_m2'] * growth)
    for percent, area in zip((10, 50, 90), areas, strict=True):
        path = ensemble.out / 'inundation_probability.tif'
        assert tag_of(path, f'inundated_area_p{percent}_m2') == area


def test_ensemble_is_the_same_in_all_outputs(run, ensemble):
    tifs = {path.stem: read_tif(path) for path in ensemble.out.glob('*.tif')}
    messages = newest_messages(ensemble.out / 'atlas')
    probability = tifs['inundation_probability']
    np.testing.assert_array_equal(
        grid_of(messages['/lava/inundation_probability']), occupancy(probability)
    )
    for name in ('arrival_time_p10', 'arrival_time_p50', 'arrival_time_p90'):
        np.testing.assert_array_equal(image_of(messages[f'/lava/{name}']), tifs[name])
    np.testing.assert_array_equal(
        image_of(messages['/lava/expected_peak_thickness']),
        np.nan_to_num(tifs['expected_peak_thickness']),
    )
    features = json.loads((ensemble.out / 'inundation_probability.geojson').read_text())
    for item in features['features']:
        at_least = item['properties']['probability_percent']
        assert item['properties']['cells_area_m2'] == (probability >= at_least).sum() * CELL**2
    features = json.loads((ensemble.out / 'arrival_time_p50.geojson').read_text())['features']
    for item in features:
        by_then = tifs['arrival_time_p50'] <= item['properties']['time_s']
        assert item['properties']['cells_area_m2'] == by_then.sum() * CELL**2
    done('map', ensemble.out, '-o', run.folder / 'e.png', '--json', run.folder / 'e.json')
    shown = json.loads((run.folder / 'e.json').read_text())
    for name, area in ensemble.report['area_m2'].items():
        words = name.replace('at least', 'at') + (' or more' if '%' in name else '')
        assert f'{area_words(area)} {words.replace("member", "run")}' in shown['summary']
    check_netcdf(ensemble.out)


def test_forecast_equals_the_later_run(run):
    case = load_case(run.case)
    simulation = Simulation(
        case.scene, effects=FORCED, accuracy=Settings('draft', 10.0, 'cpu').accuracy(case),
        device='cpu', horizon=case.duration,
    )
    start = simulation.advance(900.0, limit=case.duration)
    now = simulation.snapshot()
    forecast = ForecastRun(
        simulation.checkpoint(), horizon=case.duration - start, threshold=0.1, device='cpu'
    ).run()
    types = get_typestore(Stores.ROS2_JAZZY)
    read = {}
    for layer in load_layers(share_path('msg_configs/forecast.yaml')):
        if not layer.is_ensemble:
            message = outputs.layer_message(layer, forecast, codec.header('map', 0))
            name = codec.type_name(type(message))
            read[layer.topic] = types.deserialize_cdr(codec.serialise(message), name)
    # arrivals are float32
    reached, before = np.isfinite(run.arrival), run.arrival <= np.float32(start)
    assert 5 < before.sum() < reached.sum() - 5
    np.testing.assert_array_equal(now.inundated > 0.0, before)
    np.testing.assert_array_equal(forecast.inundated, run.inundated.astype(np.float32))
    np.testing.assert_array_equal(now.arrived[before], run.arrival[before])
    ahead = image_of(read['arrival_time']).astype(np.float64)
    np.testing.assert_array_equal(np.isfinite(ahead), reached)
    assert ahead[before].max() < np.spacing(np.float32(start))
    later = reached & ~before
    # a float32 of the time after the start
    np.testing.assert_allclose(start + ahead[later], run.arrival[later], rtol=0.0, atol=1e-3)
    np.testing.assert_array_equal(grid_of(read['peak_height'])[later] > 0, True)
    assert not grid_of(read['peak_height'])[~reached].any()
    # a place in the first, a middle and the last cell that lava reached
    cells = np.argwhere(reached)[np.argsort(run.arrival[reached], kind='stable')]
    cells = [tuple(cells[index]) for index in (0, len(cells) // 2, -1)]
    positions = [(np.array(cell)[::-1] + 0.5) * CELL + CORNER for cell in cells]
    path = run.folder / 'places.csv'
    path.write_text('x,y\n' + ''.join(f'{x},{y}\n' for x, y in positions))
    places = places_on(read_features('places', path, case.scene.terrain), case.scene.terrain)
    live = live_arrivals(places, now, forecast)
    for row, cell in zip(live.rows, cells, strict=True):
        assert row.probability == 100.0
        assert row.arrival[0.5] == pytest.approx(run.arrival[cell], rel=0.0, abs=1e-3)
