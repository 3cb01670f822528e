# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""One eruption in every output: the same cells, volumes, thicknesses and times in all of them.

The files are read by libraries of others: rasterio, rosbags and json.
"""

from importlib.util import find_spec
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rasterio
from rosbags.highlevel import AnyReader

from cli.calls import done
from eruption import CELL, SHAPE, write_case
from lava_ros.hindcast.page import FALSE_ALARM, HIT
from lava_ros.maps.plot import area_words

#: Runny lava that drains, and cools so fast that a part of it freezes within the hour.
LAVA = (
    'epsg: 32633\nlava: {viscosity: 6.0e+2, yield_strength: 0, solidus: 1250.0, '
    'convection: 200.0}\nvent_temperature: 1360.0\n'
)

#: Start, end and discharge of the eruption, which pauses [s, s, m3/s].
DISCHARGE = ((0, 600, 25), (600, 1500, 0), (1500, 2100, 25), (2100, 3600, 0))

#: Formats of an export, by the package that writes each.
FORMATS = {'tif': 'rasterio', 'geojson': 'rasterio', 'gpkg': 'pyogrio', 'nc': 'xarray'}


def write_eruption(folder: Path) -> Path:
    """Write the case of the eruption."""
    case = write_case(folder, yaml=LAVA)
    rows = '\n'.join(f'{start},{end},{flux}' for start, end, flux in DISCHARGE)
    (case / 'effusion_rate.csv').write_text(f'start_s,end_s,discharge_m3_per_s\n{rows}\n')
    return case


def words(case: Path, out: Path) -> list[object]:
    """The command of its hindcast."""
    options = ['--preset', 'draft', '--spacing', '10', '--device', 'cpu', '--maps', '4']
    return ['hindcast', case, *options, '-o', out]


def read_tif(path: Path) -> np.ndarray:
    """Values of a GeoTIFF, float64, NaN without data, row 0 in the south."""
    with rasterio.open(path) as file:
        return file.read(1, masked=True).astype(np.float64).filled(np.nan)[::-1]


def read_bag(path: Path) -> SimpleNamespace:
    """The newest maps and diagnostics of a bag."""
    last: dict[str, Any] = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            last[connection.topic] = reader.deserialize(data, connection.msgtype)
    images = {
        name: np.frombuffer(last[f'/{name}'].data.tobytes(), np.float32).reshape(SHAPE)
        for name in ('arrived', 'height_raw')
    }
    grids = {
        name: np.array(last[f'/{name}'].data, np.int8).reshape(SHAPE)
        for name in ('height', 'hazard')
    }
    status = next(item for item in last['/diagnostics'].status if item.name.endswith('simulation'))
    said = {item.key: item.value for item in status.values}
    return SimpleNamespace(**images, **grids, said=said)


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """A hindcast, what it printed, and everything that is made of its bag."""
    folder = tmp_path_factory.mktemp('agreement')
    case, out = write_eruption(folder / 'pulses'), folder / 'out'
    printed = done(*words(case, out))
    formats = [name for name, package in FORMATS.items() if find_spec(package)]
    done('export', out / 'bag', '-o', folder / 'maps', '--formats', *formats)
    done('plot', out / 'bag', '-o', folder / 'map.png', '--json', folder / 'plot.json')
    done('report', out / 'bag', '-o', folder / 'report.html')
    return SimpleNamespace(
        folder=folder, case=case, out=out, printed=printed, maps=folder / 'maps',
        score=json.loads((out / 'hindcast.json').read_text())['score'],
        volume=json.loads((out / 'hindcast.json').read_text())['volume'],
        plot=json.loads((folder / 'plot.json').read_text()),
        report=(folder / 'report.html').read_text(),
        page=(out / 'hindcast.html').read_text(),
        arrival=read_tif(out / 'arrival.tif'),
        thickness=np.nan_to_num(read_tif(out / 'thickness.tif')),
        bag=read_bag(out / 'bag'),
    )


def test_the_eruption_has_what_tells_outputs_apart(run):
    """Lava freezes, drains away between two pulses, and flows still at the end."""
    inundated, standing = np.isfinite(run.arrival), run.thickness >= 0.1
    assert run.volume['frozen'] > 0.05 * run.volume['emitted']
    assert (inundated & ~standing).sum() >= 5
    assert not (standing & ~inundated).any()
    assert ((run.arrival > 0.0) & (run.arrival < 600.0)).any() and np.nanmax(run.arrival) > 1500.0


def test_the_inundated_area_is_one(run):
    """Times are equal to the digit in all maps, and all areas are those of their cells."""
    inundated, cell = np.isfinite(run.arrival), CELL**2
    np.testing.assert_array_equal(read_tif(run.maps / 'arrival.tif'), run.arrival)
    np.testing.assert_array_equal(run.bag.arrived, run.arrival.astype(np.float32))
    # first, middle and last of the times
    times = np.sort(run.arrival[inundated])
    for time in (times[0], times[len(times) // 2], times[-1]):
        where = run.arrival == time
        assert (run.bag.arrived[where] == np.float32(time)).all()
    codes = read_tif(run.out / 'comparison.tif')
    np.testing.assert_array_equal((codes == HIT) | (codes == FALSE_ALARM), inundated)
    area = inundated.sum() * cell
    assert run.score['area'] == area
    assert float(run.bag.said['inundated_area_m2']) == area
    for name, kind in (('outline', 'area_m2'), ('isochrones', 'area_m2')):
        features = json.loads((run.maps / f'{name}.geojson').read_text())['features']
        assert features[-1]['properties'][kind] == area
    assert f'{area / 1e6:.3f} of ' in run.page and f'{area / 1e6:.3f} of ' in run.printed
    assert f'{area_words(area)} inundated' in run.plot['summary']
    assert f'<dt>inundated area, 0.1 m or more</dt><dd>{area_words(area)}</dd>' in run.report
    for path in (run.out / 'peak_thickness.tif', run.maps / 'peak_height.tif'):
        assert (read_tif(path)[inundated] >= np.float32(0.1)).all()
    # ground that lava has reached is never safe again
    assert (run.bag.hazard[inundated] > 0).all()
    others = (run.bag.hazard > 0) & ~inundated
    assert not (run.thickness[others] >= 0.1).any()
    np.testing.assert_array_equal(run.bag.hazard == 50, inundated & (run.thickness < 0.01))


def test_the_standing_lava_is_one(run):
    """Its cells, its volume and its largest thickness."""
    standing, cell = run.thickness >= 0.1, CELL**2
    shown = np.nan_to_num(read_tif(run.maps / 'height.tif'))
    np.testing.assert_array_equal(shown, run.thickness)
    np.testing.assert_array_equal(run.bag.height_raw, run.thickness.astype(np.float32))
    np.testing.assert_array_equal(run.bag.height > 0, standing)
    area = standing.sum() * cell
    assert run.score['standing_area'] == area
    assert float(run.bag.said['standing_area_m2']) == area
    assert f'{area_words(area)} standing lava' in run.plot['summary']
    assert f'<dt>standing lava, 0.1 m or more</dt><dd>{area_words(area)}</dd>' in run.report
    assert f'{area / 1e6:.3f} km² at the end' in run.page
    thickest = run.thickness.max()
    assert run.score['thickest'] == run.bag.height_raw.max() == thickest
    assert f'up to {thickest:.3g} m thick' in run.plot['summary']
    volume = run.thickness.sum() * cell
    assert run.score['volume'] == pytest.approx(volume, rel=1e-6)
    flowing = run.volume['held'] - run.volume['pending']
    assert flowing + run.volume['frozen'] == pytest.approx(volume, rel=1e-5)
    assert float(run.bag.said['volume_frozen_m3']) == run.volume['frozen']


def test_the_outline_is_the_footprint_of_its_own_run(run):
    """Fed back as what was mapped it agrees in every cell."""
    case = write_eruption(run.folder / 'again')
    (case / 'footprint.asc').unlink()
    (run.maps / 'outline.geojson').rename(case / 'footprint.geojson')
    done(*words(case, run.folder / 'out2'))
    score = json.loads((run.folder / 'out2' / 'hindcast.json').read_text())['score']
    assert score['area'] == run.score['area'] and score['jaccard'] >= 0.98
