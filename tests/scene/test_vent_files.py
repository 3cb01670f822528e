# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Vector files and tables: one file of each format for each use."""

import json
from pathlib import Path
from typing import Any
import warnings
import zipfile

import numpy as np
from pyogrio import raw
import pytest
from rasterio.warp import transform

from geodata import feature
from lava_ros.errors import LavaError
from lava_ros.files import vectors
from lava_ros.files.columns import angle, COLUMNS, understood
from lava_ros.forecast.observations import observed_in_file
from lava_ros.scene import SceneSource, Terrain
from lava_ros.scene.features import read_features
from lava_ros.scene.given_vents import GivenVents
from lava_ros.scene.reshaping import read_barriers
from lava_ros.scene.vent_files import check_places, read_vents

TERRAIN = Terrain(np.zeros((50, 50)), 20.0, epsg=32633, offset=(500_000.0, 4_180_000.0))

#: Places on it, easting and northing [m].
FISSURE = [[(500_200.0, 4_180_200.0), (500_200.0, 4_180_300.0)],
           [(500_300.0, 4_180_300.0), (500_600.0, 4_180_300.0)]]
POINTS = [(500_100.0, 4_180_100.0), (500_700.0, 4_180_100.0)]
SQUARE = [[(500_100.0, 4_180_100.0), (500_300.0, 4_180_100.0), (500_300.0, 4_180_300.0),
           (500_100.0, 4_180_300.0), (500_100.0, 4_180_100.0)]]

#: Attributes of a vent, with synonyms of the names.
KNOWN = {'Name': 'Fessura', 'Q': 30.0, 'radius': 25.0, 'Temp': 1350.0, 'remark': 'of 1971'}

#: GDAL driver of each format.
DRIVERS = {
    'geojson': 'GeoJSON', 'json': 'GeoJSON', 'gpkg': 'GPKG', 'shp': 'ESRI Shapefile',
    'zip': 'ESRI Shapefile', 'shz': 'ESRI Shapefile', 'kml': 'LIBKML', 'kmz': 'LIBKML',
}


def geographic(places: Any) -> Any:
    """Convert nested lists of places to longitudes and latitudes."""
    if isinstance(places, tuple):
        (x,), (y,) = transform('EPSG:32633', 'EPSG:4326', [places[0]], [places[1]])
        return [x, y]
    return [geographic(item) for item in places]


def write(path: Path, kind: str, places: Any, known: dict[str, Any]) -> Path:
    """Write a feature with GDAL; zip a Shapefile with Python, in a folder."""
    ending = path.suffix[1:]
    data = json.dumps(feature(kind, geographic(places), **known)).encode()
    target = path.with_suffix('.shp') if ending == 'zip' else path
    with warnings.catch_warnings():
        # GDAL limits integers to 64 bits, and cuts long names in a Shapefile
        warnings.simplefilter('ignore')
        meta, _, geometry, values = raw.read(data)
        raw.write(
            target, geometry, values, meta['fields'], driver=DRIVERS[ending], geometry_type=kind,
            crs='EPSG:4326',
        )
    if ending == 'zip':
        with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
            for part in path.parent.glob(f'{path.stem}.*'):
                if part != path:
                    archive.write(part, f'a folder/{part.name}')
                    part.unlink()
    return path


def vents_of(path: Path, discharge: Any = None) -> list[Any]:
    """Return the vents that a command reads from a file."""
    return list(GivenVents((), path, discharge, {}, str).rows(TERRAIN))


def test_each_format_has_a_driver():
    assert {f'.{ending}' for ending in DRIVERS} == set(vectors.ENDINGS)


@pytest.mark.parametrize('ending', DRIVERS)
def test_reads_vents_barriers_and_areas_of_every_format(ending, tmp_path, caplog):
    path = write(tmp_path / f'a.{ending}', 'MultiLineString', FISSURE, KNOWN)
    first, second = vents_of(path)
    np.testing.assert_allclose([first.place, first.other_end], FISSURE[0], atol=0.02)
    np.testing.assert_allclose([second.place, second.other_end], FISSURE[1], atol=0.02)
    assert (first.discharge, second.discharge) == pytest.approx((7.5, 22.5), rel=1e-4)
    assert (first.name, first.radius, first.temperature) == ('Fessura', 25.0, 1350.0)
    assert 'are ignored: remark (' in caplog.text
    found = read_features('--places', path, TERRAIN)
    assert [item.name for item in found] == ['Fessura', 'Fessura']
    assert len({item.where for item in found}) == 1
    path = write(tmp_path / f'b.{ending}', 'MultiPoint', POINTS, KNOWN)
    assert [vent.discharge for vent in vents_of(path)] == [15.0, 15.0]
    with pytest.raises(LavaError, match='exclude each other'):
        vents_of(path, 5.0)
    known, usual = {'barrier_height': 12.0, 'owner': 'a'}, {'height': None, 'width': 10.0}
    path = write(tmp_path / f'c.{ending}', 'MultiLineString', FISSURE, known)
    one, other = read_barriers('--lines', path, TERRAIN, usual)
    np.testing.assert_allclose(one.line, FISSURE[0], atol=0.02)
    assert (one.height, one.width, one.slope, other.height) == (12.0, 10.0, 1.0, 12.0)
    assert 'are ignored: owner (' in caplog.text
    path = write(tmp_path / f'd.{ending}', 'MultiPolygon', [SQUARE], {})
    lava, known_cells = observed_in_file(path, TERRAIN)
    assert known_cells.all() and lava.sum() == 100 and lava[5:15, 5:15].all()


def test_rejects_invalid_barriers(tmp_path):
    path = write(tmp_path / 'a.gpkg', 'MultiLineString', FISSURE, {'height': -2.0})
    with pytest.raises(LavaError, match='height is -2.0, expected a finite number at least 0.1'):
        read_barriers('--lines', path, TERRAIN, {'height': None, 'width': 10.0})
    path = write(tmp_path / 'b.gpkg', 'MultiPolygon', [SQUARE], {'height': 2.0})
    with pytest.raises(LavaError, match="is 'a Polygon', expected a line"):
        read_barriers('--lines', path, TERRAIN, {'height': None, 'width': 10.0})
    # the error has the places of the file
    path.with_name('far.csv').write_text('lon,lat,lon_end,lat_end,height,width\n9,50,9.5,50,5,8\n')
    with pytest.raises(LavaError, match=r'far.csv.*, line is .*9.5, 50.*expected a line on the'):
        read_barriers('--barriers', path.with_name('far.csv'), TERRAIN)


@pytest.mark.parametrize(('header', 'row'), [
    ('x,y,name', '{x},{y},a'),
    ('X;Y;flow_id', '{x};{y};a'),
    ('Easting\tNorthing\tName', '{x}\t{y}\ta'),
    ('POINT_X,POINT_Y,Label', '{x},{y},a'),
    ('UTM_E (km),utmN (km),Vent', '{kx},{ky},a'),
    ('x y name', '{x}   {y} a'),
    ('lon,lat,name', '{lon},{lat},a'),
    ('Latitude,Longitude,Site', '{lat},{lon},a'),
    ('lat,long,name', '37 46 8.4 N,15°0\'3.6"E,a'),
    ('lat;lon;name', '37:46:8,4;15 0 3,6;a'),
    ('WKT,name', '"POINT ({x} {y})",a'),
])
def test_reads_coordinates_with_any_header(header, row, tmp_path):
    lon, lat = 15.001, 37.769
    (x,), (y,) = transform('EPSG:4326', 'EPSG:32633', [lon], [lat])
    text = row.format(x=x, y=y, kx=x / 1000, ky=y / 1000, lon=lon, lat=lat)
    (tmp_path / 'a.csv').write_text(f'# a comment\n{header}\n{text}\n', encoding='utf-8-sig')
    (vent,) = read_vents('--vents', tmp_path / 'a.csv', TERRAIN)
    np.testing.assert_allclose(vent.place, (x, y), atol=0.02)
    assert vent.name == 'a'


def test_error_names_a_feature_of_kml_without_folders(tmp_path):
    path = tmp_path / 'a.kml'
    path.write_text(
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>crater</name>'
        '<TimeSpan><begin>2021-09-19</begin></TimeSpan><Point><coordinates>15,37.7</coordinates>'
        '</Point></Placemark></Document></kml>'
    )
    with pytest.raises(LavaError, match=r"a\.kml, feature 0 \(crater\), begin is '2021-09-19"):
        read_vents('--vents', path, TERRAIN)


def test_names_may_have_a_number_sign(tmp_path):
    rows = 'camp #1,500100,4180100 # by GPS\n#camp,0,0\ncamp #2,500200,4180100\n'
    (tmp_path / 'a.csv').write_text(f'name,x,y\n{rows}')
    vents = read_vents('--vents', tmp_path / 'a.csv', TERRAIN)
    assert [(vent.name, vent.place[0]) for vent in vents] == [
        ('camp #1', 500_100.0), ('camp #2', 500_200.0),
    ]


@pytest.mark.parametrize(('header', 'field', 'cell', 'value'), [
    *((name, 'discharge', '12', 12.0) for name in
      ('discharge', 'Discharge', 'RATE', 'q', 'Effusion_Rate', 'EffusionRate', 'TADR',
       'discharge_m3_per_s', 'Effusion rate [m3/s]', 'Q (m³ s⁻¹)', 'rate (m^3/s)')),
    ('rate (m3/h)', 'discharge', '3600', 1.0),
    ('radius', 'radius', '50', 50.0),
    ('Radius_m', 'radius', '50', 50.0),
    ('width', 'radius', '50', 25.0),
    ('width (cm)', 'radius', '500', 2.5),
    ('radius_ft', 'radius', '100', 30.48),
    ('temperature', 'temperature', '1300', 1300.0),
    ('Temp (°C)', 'temperature', '1100', 1373.15),
    ('temp_c', 'temperature', '1100', 1373.15),
    ('start_h', 'start', '2', 7200.0),
])
def test_converts_columns_of_vents_to_si(header, field, cell, value, tmp_path):
    (tmp_path / 'a.csv').write_text(f'x,y,{header}\n500100,4180100,{cell}\n')
    (vent,) = read_vents('--vents', tmp_path / 'a.csv', TERRAIN)
    assert getattr(vent, field) == pytest.approx(value)


def test_reads_a_vent_table_of_lava2d(tmp_path):
    (tmp_path / 'vent_01.txt').write_text(
        'time\tx0\ty0\tx1\ty1\twidth\tdischarge\n'
        + ''.join(f'{time}\t500100\t4180100\t500260\t4180220\t20\t{rate}\n'
                  for time, rate in ((0, 10), (43200, 10), (54000, 5), (86400, 5)))
    )
    (vent,) = vents_of(tmp_path / 'vent_01.txt')
    assert vent.places == ((500_100.0, 4_180_100.0), (500_260.0, 4_180_220.0))
    assert vent.radius == 10.0
    assert vent.discharge == ((0.0, 10.0), (43200.0, 7.5), (54000.0, 5.0), (86400.0, 0.0))


@pytest.mark.parametrize(('text', 'words'), [
    ('x,y,q\n500100,4180100,much\n', "line 2, q is 'much', expected a finite number"),
    ('x,y,q\n500100,4180100,-1\n', 'line 2, q is -1, expected a finite number at least 0'),
    ('x,y,q,rate\n500100,4180100,1,2\n', "is 'q and rate', expected one column for"),
    ('x,y,radius,width\n500100,4180100,1,2\n', 'width and .*, radius exclude each other'),
    ('x,y,start,end\n500100,4180100,5,2\n', 'line 2.*, end is 2, expected a time after'),
    ('x,y,rate_dre\n500100,4180100,5\n', 'rate_dre is 5, expected a bulk effusion rate'),
    ('x,y,time\n500100,4180100,5\n', 'an effusion rate, and a point'),
    ('x,y,start_date\n500100,4180100,44458\n', 'is .44458., expected a header without the word'),
    ('x,y\n510100,4180100\n', 'a.csv is .*a place on the terrain, which covers'),
    ('x,y,x_end,y_end\n500100,4180100,500100,4180100\n', 'a line of length 0'),
])
def test_rejects_invalid_vents(text, words, tmp_path):
    (tmp_path / 'a.csv').write_text(text)
    with pytest.raises(LavaError, match=words):
        vents_of(tmp_path / 'a.csv')


def test_column_names_have_one_meaning():
    names = [name for known, _ in COLUMNS.values() for name in known]
    assert {name for name in names if names.count(name) > 1} == {'x1', 'y1'}
    found, _ = understood('a', ['x1', 'y1', 'x2', 'y2'], COLUMNS)
    assert {name: column.header for name, column in found.items()} == {
        'x': 'x1', 'y': 'y1', 'x_end': 'x2', 'y_end': 'y2',
    }
    for header, name in (('effusion_r', 'effusion_rate'), ('temperatur', 'temperature'),
                         ('Name (en)', 'name')):
        assert list(understood('a', [header], COLUMNS)[0]) == [name]
    found, others = understood('a', ['x0', 'y0', 'x1', 'y1', 'fid', 'colour'], COLUMNS)
    assert found['x_end'].header == 'x1' and others == ['colour']


@pytest.mark.parametrize(
    'text', ['15 61', '15 30.5 20', '15,006', '-15 W', 'W 15 W', '15 0 0 N', '361', '']
)
def test_rejects_invalid_angles(text):
    with pytest.raises(LavaError, match='a longitude from -360 to 360 degrees'):
        angle('lon', text, 'longitude')


def test_rejects_incomplete_or_ambiguous_archives(tmp_path):
    path = write(tmp_path / 'a.shp', 'Point', POINTS[0], {'name': 'a'})
    path.with_suffix('.dbf').unlink()
    with pytest.raises(LavaError, match=r'its other parts in the same folder \(.dbf\)'):
        read_features('--vents', path, TERRAIN)
    write(tmp_path / 'b.geojson', 'Point', POINTS[0], {})
    with zipfile.ZipFile(tmp_path / 'two.zip', 'w') as archive:
        for name in ('b.geojson', 'c.geojson'):
            archive.write(tmp_path / 'b.geojson', name)
    with pytest.raises(LavaError, match='two.zip is .b.geojson, c.geojson., expected an archive'):
        read_features('--vents', tmp_path / 'two.zip', TERRAIN)
    write(tmp_path / 'd.gpkg', 'Point', POINTS[0], {})
    (tmp_path / 'd.gpkg-wal').write_bytes(b'changes')
    with pytest.raises(LavaError, match='a GeoPackage closed by other programs'):
        read_features('--vents', tmp_path / 'd.gpkg', TERRAIN)


def test_limits_the_unpacked_size(tmp_path, monkeypatch):
    monkeypatch.setattr(vectors, 'MAX_BYTES', 1000)
    with zipfile.ZipFile(tmp_path / 'a.zip', 'w', zipfile.ZIP_DEFLATED) as archive:
        archive.writestr('a.geojson', '{' + ' ' * 10_000 + '}')
    with pytest.raises(LavaError, match='MiB when unpacked'):
        read_features('--vents', tmp_path / 'a.zip', TERRAIN)
    (tmp_path / 'a.json').write_text('{' + ' ' * 10_000 + '}')
    with pytest.raises(LavaError, match='a file of at most'):
        read_features('--vents', tmp_path / 'a.json', TERRAIN)


def test_warns_of_a_missing_system(tmp_path, caplog):
    path = write(tmp_path / 'a.shp', 'Point', POINTS[0], {'name': 'a'})
    path.with_suffix('.prj').unlink()
    (vent,) = vents_of(path)
    np.testing.assert_allclose(vent.place, POINTS[0], atol=0.02)
    assert 'names no coordinate system' in caplog.text


@pytest.mark.parametrize(('old', 'new', 'words'), [
    ('"properties"', '"propertys"', 'unknown members are ignored: propertys'),
    ('"crs"', '"srs"', 'unknown members are ignored: srs'),
    ('"Point"', '"Point", "q": 5', 'unknown members are ignored: q'),
    ('{"name": "a"}', '12', 'properties is 12, expected an object, or null'),
    ('"a"', 'Infinity', 'name is inf, expected a finite number'),
    ('"name": "a"', '"q": 1, "q": 2', "contains an object with two members 'q'"),
])
def test_reports_members_that_gdal_ignores(old, new, words, tmp_path, caplog):
    text = json.dumps({
        'type': 'FeatureCollection', 'crs': {'properties': {'name': 'EPSG:32633'}},
        'features': [feature('Point', POINTS[0], name='a')],
    })
    assert old in text
    (tmp_path / 'a.json').write_text(text.replace(old, new))
    try:
        read_vents('--vents', tmp_path / 'a.json', TERRAIN)
        message = caplog.text
    except LavaError as error:
        message = f'{caplog.text}{error}'
    assert words in message


def test_warns_of_duplicate_vents(tmp_path, caplog):
    row = '500100,4180100,5,{},{}\n'
    for times, is_warned in (((0, 60), False), ((0, 60), True), ((60, 90), False)):
        rows = row.format(0, 60) + (row.format(*times) if is_warned or times != (0, 60) else '')
        (tmp_path / 'a.csv').write_text('x,y,q,start,end\n' + rows)
        caplog.clear()
        SceneSource(terrain=TERRAIN, vents=tmp_path / 'a.csv').load()
        assert ('2 vents at' in caplog.text) == is_warned


@pytest.mark.parametrize('ending', ['csv', 'shp'])
def test_places_are_degrees_if_they_are_then_on_the_terrain(ending, tmp_path):
    path = tmp_path / f'a.{ending}'
    (lon, lat), (x, y) = geographic([POINTS[0]])[0], POINTS[0]
    if ending == 'csv':
        path.write_text(f'x,y,name\n{lon},{lat},a\n')
    else:
        write(path, 'Point', POINTS[0], {'name': 'a'})
        path.with_suffix('.prj').unlink()
    (vent,) = vents_of(path)
    (point,) = read_features('--places', path, TERRAIN)
    np.testing.assert_allclose([vent.place, point.rings[0][0]], [(x, y)] * 2, atol=0.02)
    # eastings and northings near the origin of the system
    local = Terrain(np.zeros((50, 50)), 2.0, epsg=32633)
    (tmp_path / 'b.csv').write_text('x,y\n15.0,37.7\n')
    (point,) = read_features('--places', tmp_path / 'b.csv', local)
    assert point.rings[0].tolist() == [[15.0, 37.7]]
    (vent,) = GivenVents(['15.0,37.7'], None, 1.0, {}, str).rows(local)
    assert vent.place == (15.0, 37.7)


IN_ZONE_34 = {'crs': {'type': 'name', 'properties': {'name': 'EPSG:32634'}}}
SWAPPED = 'longitude and latitude are swapped'
EAST, NORTH = POINTS[0]


@pytest.mark.parametrize(('content', 'shown', 'words'), [
    ('lon,lat\n37.7687,15.0023\n', '(37.7687, 15.0023)', SWAPPED),
    ('lon,lat,lon_end,lat_end\n15.0023,37.7687,37.7690,15.0030\n', '(37.7690, 15.0030)', SWAPPED),
    (f'x,y\n{NORTH},{EAST}\n', f'({NORTH}, {EAST})', 'easting and northing are swapped'),
    (feature('Point', [37.7687, 15.0023]), '(37.7687, 15.0023)', SWAPPED),
    (feature('LineString', [[15.0023, 37.7687], [37.769, 15.003]]), '(37.769, 15.003)', SWAPPED),
    (feature('Point', [EAST, NORTH]), '', 'in EPSG:32633, not in EPSG:4326, that of the file'),
    (feature('Point', [EAST, NORTH]) | IN_ZONE_34, f'({EAST}, {NORTH})',
     'in EPSG:32633, not in EPSG:32634, that of the file'),
])
def test_error_shows_a_place_as_in_the_file_and_its_slip(content, shown, words, tmp_path):
    path = tmp_path / ('a.csv' if isinstance(content, str) else 'a.geojson')
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(LavaError) as caught:
        check_places(read_vents('--vents', path, TERRAIN), TERRAIN, path.name)
    assert shown in str(caught.value) and words in str(caught.value)
