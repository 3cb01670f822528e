# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What GIS programs read beside GeoTIFF."""

import json
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

from lava_ros.cli.main import main
from lava_ros.errors import LavaError
from lava_ros.maps import gis
from lava_ros.maps.export import export_bag
from lava_ros.maps.gis import coordinate_system
from lava_ros.scene import Terrain
from recording import record, TERRAIN


@pytest.fixture
def bag(tmp_path):
    """Frames at 200, 400, 600 and 800 s."""
    return record(tmp_path / 'bag')


def test_outline_and_isochrones(bag, tmp_path):
    """Polygons of whole cells, in longitude and latitude, each time with all before it."""
    words = ['export', str(bag), '-o', str(tmp_path / 'out'), '--formats', 'geojson']
    assert main(words) == 0
    outline, isochrones = (
        json.loads((tmp_path / f'out/{name}.geojson').read_text())['features']
        for name in ('outline', 'isochrones')
    )
    assert [item['properties'] for item in outline] == [{'from_m': 0.1, 'area_m2': 80 * 25.0}]
    (ring,) = outline[0]['geometry']['coordinates'][0]
    # 15 degrees east is 500 km east in zone 33; the flow is there from -50 m to -10 m
    assert all(14.999 < x < 15.0 and 37.7 < y < 37.8 for x, y in ring)
    assert ring[0] == ring[-1] and len(ring) == 5
    found = [(item['properties']['time_s'], item['properties']['area_m2']) for item in isochrones]
    assert found[0] == (300.0, 20 * 25.0) and found[-1] == (900.0, 80 * 25.0)
    assert [item['properties']['time'] for item in isochrones] == ['5 min', '10 min', '15 min']


def test_a_hole_stays_a_hole():
    """Ground that lava flows around is not in its outline."""
    cells = np.zeros((6, 6), dtype=bool)
    cells[1:5, 1:5] = True
    cells[2, 2] = False
    (feature,) = gis.area(cells, gis.Place((100.0, 200.0), 10.0, None))
    assert feature['properties']['area_m2'] == 1500.0
    ((outer, inner),) = feature['geometry']['coordinates']
    assert {tuple(item) for item in outer} == {(110, 210), (150, 210), (150, 250), (110, 250)}
    assert {tuple(item) for item in inner} == {(120, 220), (130, 220), (130, 230), (120, 230)}
    assert gis.area(~cells & cells, gis.Place((0.0, 0.0), 1.0, None)) == []


def test_isochrones_are_few_and_round():
    """However long an eruption lasts."""
    place = gis.Place((0.0, 0.0), 1.0, None)
    for last in (40.0, 3000.0, 86_400.0, 86_400.0 * 1000):
        times = np.linspace(0.0, last, 100).reshape(10, 10)
        ends = [item['properties']['time_s'] for item in gis.isochrones(times, place)]
        assert 1 <= len(ends) <= gis.MOST_ISOCHRONES and ends[-1] >= last
    assert gis.isochrones(np.full((3, 3), np.nan), place) == []


def test_contours_of_probability():
    """Where lava is at least as likely as so much; unknown is not likely."""
    percent = np.array([[np.nan, 5.0, 10.0], [49.0, 50.0, 95.0]])
    found = [item['properties'] for item in gis.probabilities(percent, gis.Place((0, 0), 1, None))]
    assert found == [
        {'probability_percent': least, 'area_m2': cells}
        for least, cells in ((10.0, 4.0), (50.0, 2.0), (90.0, 1.0))
    ]


def test_a_map_that_is_nowhere(tmp_path):
    """GeoJSON has longitudes: nothing is written where nobody knows them."""
    bag = record(tmp_path / 'bag', terrain=Terrain(TERRAIN.elevation, 5.0, TERRAIN.origin))
    with pytest.raises(LavaError, match='epsg is None, expected the EPSG code'):
        export_bag(bag, tmp_path / 'out', formats=['geojson'])
    assert not (tmp_path / 'out').exists()


def test_styles_of_qgis(bag, tmp_path):
    """Each GeoTIFF has one, from the colour of the least to that of the most."""
    export_bag(bag, tmp_path / 'out')
    names = {path.stem for path in (tmp_path / 'out').glob('*.qml')}
    assert names == {path.stem for path in (tmp_path / 'out').glob('*.tif')}
    root = ElementTree.parse(tmp_path / 'out/height.qml').getroot()
    drawn = root.find('pipe/rasterrenderer')
    assert drawn is not None and drawn.get('type') == 'singlebandpseudocolor'
    values = [float(item.get('value', '')) for item in drawn.iter('item')]
    assert (values[0], values[-1]) == (0.0, pytest.approx(3.26))


@pytest.mark.parametrize(
    ('format_name', 'module', 'words'),
    [('gpkg', 'fiona', 'GeoPackage is .*fiona'), ('nc', 'xarray', 'NetCDF is .*xarray')],
)
def test_without_the_library(format_name, module, words, bag, tmp_path, monkeypatch):
    """The error says how to get it, before anything is written."""
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(LavaError, match=words + r".*'lava_ros\[gis\]'"):
        export_bag(bag, tmp_path / 'out', formats=[format_name])
    assert not (tmp_path / 'out').exists()


def test_a_geopackage(bag, tmp_path):
    """Outline and isochrones are layers of it, in the coordinates of the map."""
    fiona = pytest.importorskip('fiona')
    export_bag(bag, tmp_path / 'out', formats=['gpkg'])
    path = tmp_path / 'out/lava.gpkg'
    assert fiona.listlayers(path) == ['outline', 'isochrones']
    with fiona.open(path, layer='outline') as layer:
        assert layer.crs.to_epsg() == 32633
        assert layer.bounds == (499_950.0, 4_180_070.0, 499_990.0, 4_180_120.0)
        assert [item['properties']['area_m2'] for item in layer] == [2000.0]


def test_a_netcdf(bag, tmp_path):
    """All maps in one file, each with unit, coordinates and coordinate system."""
    xarray = pytest.importorskip('xarray')
    export_bag(bag, tmp_path / 'out', formats=['nc'])
    with xarray.open_dataset(tmp_path / 'out/maps.nc', engine='scipy') as data:
        assert data.attrs['Conventions'].startswith('CF-')
        assert set(data.data_vars) >= {'height', 'temperature', 'hazard', 'arrival', 'crs'}
        assert data.height.attrs['units'] == 'm' and data.height.attrs['grid_mapping'] == 'crs'
        assert data.height.sel(x=499_952.5, y=4_180_072.5).item() == pytest.approx(3.26)
        assert np.isnan(data.height.sel(x=500_100.0, y=4_180_072.5, method='nearest'))
    crs = coordinate_system(32633)
    assert data.crs.attrs['crs_wkt'] == crs.to_wkt()
