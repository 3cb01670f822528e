# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Export of bags to GeoTIFF, NetCDF and vector files."""

import json
from pathlib import Path
import re
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import rasterio
from rasterio.errors import NotGeoreferencedWarning
from rasterio.warp import transform
from std_msgs.msg import String

from command_line import lava
from lava_ros.bag import BagReader, BagWriter, LATCHED
from lava_ros.cli.main import main
from lava_ros.errors import LavaError
from lava_ros.files.vectors import SHAPEFILE_NAMES, WRITTEN
from lava_ros.layers.layer import HAZARD_CLASSES
from lava_ros.layers.recording import Recording
from lava_ros.products import gis
from lava_ros.products.colours import STYLES
from lava_ros.products.export import export_bag, MAPS
from lava_ros.products.gis import coordinate_system
from lava_ros.products.plot import MAX_ISOCHRONES
from lava_ros.products.raster_layers import NODATA, RASTER_LAYERS, write_style
from lava_ros.ros import codec, outputs
from lava_ros.scene import Terrain
from lava_ros.scene.features import load_features
from recording import (
    changed,
    GRIDS,
    growing,
    RAW_CONFIG,
    record,
    SECOND,
    silenced,
    START,
    TERRAIN,
    VENT,
)

#: Maps of bags without inundated fractions.
OWN_MAPS = [name for name in MAPS if name != 'inundated']


@pytest.fixture(scope='module')
def out(grids):
    """Return the folder of its GeoTIFF files with a threshold of 0.5 m."""
    exported = export_bag(grids, grids.parent / 'out', threshold=0.5)
    assert [item.stem for item in exported.files] == OWN_MAPS
    return grids.parent / 'out'


def band(path):
    """Return the cells of a GeoTIFF, row 0 in the south."""
    with rasterio.open(path) as file:
        return file.read(1)[::-1]


def test_rasters_have_the_values_of_the_frame(grids, out):
    frame = Recording(grids).frame_at()
    outside = ~TERRAIN.has_data
    for name, source, dry in (
        ('thickness', 'thickness', NODATA),
        ('temperature', 'temperature', NODATA),
        ('hazard', 'hazard', 0.0),
    ):
        values = frame.layers[source].values
        with rasterio.open(out / f'{name}.tif') as file:
            cells = file.read(1)[::-1]
            assert file.nodata == NODATA
            expected = np.where(np.isfinite(values), values, dry)
            np.testing.assert_allclose(cells, np.where(outside, NODATA, expected), rtol=1e-6)
            np.testing.assert_array_equal(file.read_masks(1)[::-1] == 0, cells == NODATA)


def test_rasters_are_georeferenced(out):
    with rasterio.open(out / 'thickness.tif') as file:
        assert file.crs.to_epsg() == 32633
        assert file.bounds == (499_950.0, 4_180_020.0, 500_150.0, 4_180_170.0)
        # row 10, column 7 of the terrain: the south-eastern corner of the flow
        easting = 500_000.0 - 50.0 + 7.5 * 5.0
        northing = 4_180_000.0 + 20.0 + 10.5 * 5.0
        assert file.xy(*file.index(easting, northing)) == (easting, northing)
        around = [(0.0, 0.0), (5.0, 0.0), (0.0, -5.0), (-5.0, 0.0), (0.0, 5.0)]
        places = [(easting + x, northing + y) for x, y in around]
        values = [value[0] for value in file.sample(places)]
        np.testing.assert_allclose(values, [2.9, NODATA, NODATA, 3.0, 2.9], atol=1e-5)
        longitude, latitude = transform(file.crs, 'EPSG:4326', [easting], [northing])
    # an easting of 500 km is 15 degrees east, the central meridian
    assert longitude[0] == pytest.approx(15.0, abs=1e-3)
    assert 37.0 < latitude[0] < 38.0


def test_arrival_and_peak_thickness_are_accumulated(out):
    times = band(out / 'arrival.tif')
    with rasterio.open(out / 'arrival.tif') as file:
        tags = file.tags()
        assert file.units == ('s',)
    expected = [200, 200, 400, 400, 600, 600, 800, 800, NODATA, NODATA]
    np.testing.assert_array_equal(times[12, :10], expected)
    assert (times[:10] == NODATA).all()
    assert tags['inundation_threshold_m'] == '0.5'
    assert tags['longest_time_between_maps_s'] == '200.0'
    peak = band(out / 'peak_thickness.tif')
    np.testing.assert_allclose(peak[12, [0, 7, 8]], [3.3, 2.9, NODATA], atol=1e-5)
    assert peak[0, 0] == NODATA


@pytest.mark.parametrize(('times', 'is_late'), [
    ((200.0, 400.0), False), ((300.0, 500.0, 700.0), False), ((400.0, 500.0), True),
    ((400.0,), True),
])
@pytest.mark.parametrize('has_times', [False, True])
def test_maps_that_begin_late_are_named(tmp_path, caplog, times, is_late, has_times):
    """A resumed node and a late recording have no maps of the beginning."""
    arrived = (lambda time: np.where(growing(time) > 0.0, 50.0, np.nan)) if has_times else None
    export_bag(record(tmp_path / 'bag', times, arrived=arrived), tmp_path / 'out')
    names = 'peak_thickness' if has_times else 'arrival and peak_thickness'
    text = f'the maps begin at 7 min: lava before that is not in {names}'
    assert (text in caplog.messages) is is_late
    with rasterio.open(tmp_path / 'out/peak_thickness.tif') as file:
        assert float(file.tags()['maps_from_s']) == times[0]
    with rasterio.open(tmp_path / 'out/arrival.tif') as file:
        late = file.tags().get('longest_time_between_maps_s')
        assert late == (None if has_times else repr(max(times[0], *np.diff(times), 0.0)))


def test_tags_state_unit_time_and_rounding(out):
    with rasterio.open(out / 'thickness.tif') as file:
        tags = file.tags()
        assert (file.units, file.descriptions) == (('m',), ('thickness',))
    assert tags['simulated_time_s'] == '800.0'
    assert tags['quantisation'].startswith('recorded in steps of 0.1 from 0 to 10, true to 0.05')
    assert tags['thinnest_lava_shown_m'] == '0.1'
    assert tags['saturated'] == 'no'
    assert tags['bag'] == 'bag'
    with rasterio.open(out / 'temperature.tif') as file:
        assert file.units == ('degC',)
        assert 'steps of 12 from 0 to 1200' in file.tags()['quantisation']


def test_unrounded_thickness_has_no_limits(tmp_path):
    flow = np.zeros(TERRAIN.shape, dtype=np.float32)
    flow[12, 5:8] = 41.37, 0.004, 12.5
    bag = record(tmp_path / 'bag', flow=lambda _: flow)
    export_bag(bag, tmp_path / 'out', maps=['thickness', 'peak_thickness'])
    for name in ('thickness', 'peak_thickness'):
        cells = band(tmp_path / f'out/{name}.tif')
        np.testing.assert_array_equal(cells, np.where(flow > 0.0, flow, np.float32(NODATA)))


def test_exports_one_time_or_all_frames(grids, tmp_path):
    export_bag(grids, tmp_path / 'out', time=450.0)
    assert (band(tmp_path / 'out/thickness.tif')[12] > 0.0).sum() == 4
    with rasterio.open(tmp_path / 'out/thickness.tif') as file:
        assert file.tags()['simulated_time_s'] == '400.0'
    assert band(tmp_path / 'out/arrival.tif').max() == 400.0
    exported = export_bag(grids, tmp_path / 'every', every=True, maps=['thickness', 'arrival'])
    *maps, arrival = exported.files
    names = [f'thickness_000{number}_{200 * (number + 1)}s.tif' for number in range(4)]
    assert [item.name for item in maps] == names
    assert arrival.name == 'arrival.tif'
    for number, path in enumerate(maps, 1):
        assert (band(path)[12] > 0.0).sum() == 2 * number


def test_bag_without_coordinate_system_is_in_the_map_frame(tmp_path):
    terrain = Terrain(TERRAIN.elevation, 5.0, origin=TERRAIN.origin)
    bag = record(tmp_path / 'bag', terrain=terrain)
    # GDAL's error names the code, and GeoJSON requires longitudes
    with pytest.raises(LavaError, match='epsg is 999999'):
        export_bag(bag, tmp_path / 'out', epsg=999_999)
    with pytest.raises(LavaError, match='epsg is missing, expected the EPSG code'):
        export_bag(bag, tmp_path / 'out', formats=['geojson'])
    assert not (tmp_path / 'out').exists()
    exported = export_bag(bag, tmp_path / 'plain', maps=['hazard'])
    assert exported.georeference.epsg is None
    with rasterio.open(tmp_path / 'plain/hazard.tif') as file:
        assert file.crs is None
        assert file.bounds[:2] == (-50.0, 20.0)
    export_bag(bag, tmp_path / 'placed', maps=['hazard'], epsg=32633, offset=(1000.0, 2000.0))
    with rasterio.open(tmp_path / 'placed/hazard.tif') as file:
        assert file.crs.to_epsg() == 32633
        assert file.bounds[:2] == (950.0, 2020.0)


@pytest.mark.parametrize(('options', 'words'), [
    ({'offset': (1.0, 2.0)}, 'offset is .*as the bag states'),
    ({'time': 100.0}, 'time is 100.0, expected 200 to 800 s'),
    ({'threshold': 0.01}, 'threshold is 0.01'),
    ({'threshold': float('nan')}, 'threshold is nan'),
    ({'maps': ['depth']}, 'maps'),
    ({'every': True, 'formats': ['nc', 'kml']}, "Only GeoTIFF files can contain every frame"),
])
def test_rejects_invalid_arguments(grids, tmp_path, options, words):
    with pytest.raises(LavaError, match=words):
        export_bag(grids, tmp_path / 'out', **options)  # type: ignore[arg-type]
    assert not (tmp_path / 'out').exists()


def test_failed_export_leaves_no_folder(grids, tmp_path):
    (tmp_path / 'thickness.tif').touch()
    with pytest.raises(LavaError, match='a folder that is new or empty'):
        export_bag(grids, tmp_path)
    without = silenced(grids, tmp_path / 'without.mcap', '/terrain')
    with pytest.raises(LavaError, match='messages on the topic /terrain '):
        export_bag(without, tmp_path / 'maps')
    assert not (tmp_path / 'maps').exists()
    late = silenced(grids, tmp_path / 'late.mcap', '/terrain', late=True)
    with pytest.raises(LavaError, match='bag is .*late.mcap.*a terrain and a map'):
        export_bag(late, tmp_path / 'maps')
    assert not (tmp_path / 'maps').exists()


def test_outline_and_isochrones_are_polygons_of_cells(bag, tmp_path):
    words = ['export', str(bag), '-o', str(tmp_path / 'out'), '--formats', 'geojson']
    assert main(words) == 0
    outline, isochrones = (
        json.loads((tmp_path / f'out/{name}.geojson').read_text())['features']
        for name in ('outline', 'isochrones')
    )
    assert [item['properties'] for item in outline] == [
        # the bag has no covered fractions
        {'shows': 'inundated area', 'inundation_threshold_m': 0.1, 'cells_area_m2': 80 * 25.0}
    ]
    (ring,) = outline[0]['geometry']['coordinates'][0]
    # 15 degrees east is an easting of 500 km in zone 33; the flow is at -50 m to -10 m
    assert all(14.999 < x < 15.0 and 37.7 < y < 37.8 for x, y in ring)
    assert ring[0] == ring[-1] and len(ring) == 5
    known = [item['properties'] for item in isochrones]
    found = [(item['time_s'], item['cells_area_m2']) for item in known]
    assert found[0] == (300.0, 20 * 25.0) and found[-1] == (900.0, 80 * 25.0)
    assert [item['time'] for item in known] == ['5 min', '10 min', '15 min']


def test_another_threshold_applies_to_every_map_of_an_export(tmp_path, caplog):
    def arrived(time):
        columns = np.arange(1.0, TERRAIN.shape[1] + 1.0) * 100.0
        return np.where(growing(time) > 0.0, columns, np.nan)

    path = record(tmp_path / 'bag', arrived=arrived)
    done = export_bag(path, tmp_path / 'out', threshold=3.1, formats=('tif', 'geojson'))
    # 3.26 m to 3.11 m thick
    area = 4 * 10 * 25.0
    for name in ('outline', 'isochrones'):
        features = json.loads((tmp_path / f'out/{name}.geojson').read_text())['features']
        last = features[-1]['properties']
        assert (last['inundation_threshold_m'], last['cells_area_m2']) == (3.1, area)
        assert 'inundated_area_m2' not in last
    assert 'inundated' not in {item.stem for item in done.files}
    assert 'inundated is left out: the bag has it for lava of 0.1 m or more' in caplog.text


def test_rejects_coordinates_outside_the_projection(tmp_path):
    terrain = Terrain(np.zeros((2, 2)), 10.0, epsg=32633, offset=(1e8, 4e6))
    features = gis.area(np.ones((2, 2), dtype=bool), terrain)
    layers, origin = {'outline': features}, gis.Provenance('a')
    with pytest.raises(LavaError, match='corner of the map') as caught:
        gis.write_formats(tmp_path, ['geojson'], layers, {}, terrain, '', origin)
    assert caught.value.value == terrain.corner


def test_areas_of_cells_times_and_probabilities():
    cells = np.zeros((6, 6), dtype=bool)
    cells[1:5, 1:5] = True
    cells[2, 2] = False
    (feature,) = gis.area(cells, Terrain(np.zeros((6, 6)), 10.0, offset=(100.0, 200.0)))
    assert feature['properties']['cells_area_m2'] == 1500.0
    ((outer, inner),) = feature['geometry']['coordinates']
    assert {tuple(item) for item in outer} == {(110, 210), (150, 210), (150, 250), (110, 250)}
    assert {tuple(item) for item in inner} == {(120, 220), (130, 220), (130, 230), (120, 230)}
    terrain = Terrain(np.zeros((2, 2)), 1.0)
    assert gis.area(~cells & cells, terrain) == []
    for last in (40.0, 3000.0, 86_400.0, 86_400.0 * 1000):
        times = np.linspace(0.0, last, 100).reshape(10, 10)
        ends = [item['properties']['time_s'] for item in gis.isochrones(times, terrain)]
        assert 1 <= len(ends) <= MAX_ISOCHRONES and ends[-1] >= last
    assert gis.isochrones(np.full((3, 3), np.nan), terrain) == []
    percent = np.array([[np.nan, 5.0, 10.0], [49.0, 50.0, 95.0]])
    found = [item['properties'] for item in gis.probabilities(percent, terrain)]
    assert found == [
        {'probability_percent': least, 'cells_area_m2': cells}
        for least, cells in ((10.0, 4.0), (50.0, 2.0), (90.0, 1.0))
    ]


def painted(style: Path, value: float) -> tuple[float, str]:
    """Return the opacity (0 to 1) and the colour of a value in a QGIS style."""
    drawn = ElementTree.parse(style).find('pipe/rasterrenderer')
    assert drawn is not None
    items = list(drawn.iter('item'))
    stops = [float(item.get('value', 'nan')) for item in items]
    assert stops == sorted(stops) and len(set(stops)) == len(stops)
    if drawn.find('.//colorrampshader').get('colorRampType') == 'DISCRETE':
        # an item covers values up to its own; QGIS draws none above the last item
        found = [item for item, stop in zip(items, stops, strict=True) if value <= stop]
        return float(found[0].get('alpha')) / 255.0, str(found[0].get('color'))
    alpha = np.interp(value, stops, [float(item.get('alpha', 'nan')) for item in items])
    nearest = min(items, key=lambda item: abs(float(item.get('value', 'nan')) - value))
    return float(alpha) / 255.0, str(nearest.get('color'))


def test_every_file_of_a_bag_has_a_style(bag, tmp_path):
    export_bag(bag, tmp_path / 'out')
    names = {path.stem for path in (tmp_path / 'out').glob('*.qml')}
    assert names == {path.stem for path in (tmp_path / 'out').glob('*.tif')}
    style = tmp_path / 'out/thickness.qml'
    assert painted(style, 0.0)[0] == 0.0
    assert painted(style, 4.0) == (1.0, STYLES['thickness'].colours[-1])


@pytest.mark.parametrize('name', RASTER_LAYERS)
def test_style_leaves_cells_without_lava_transparent(name, tmp_path):
    layer = RASTER_LAYERS[name]
    values = np.array([[0.0, 1.0, 2.0, np.nan]])
    values *= {'arrival': 36_000.0, 'inundated': 0.5}.get(layer.drawn, 1.0)
    style = write_style(tmp_path / 'map.tif', name, values)
    for value in values[0, 1:3]:
        assert painted(style, float(value))[0] == 1.0
    if layer.drawn in ('arrival', 'temperature', 'elevation', 'change'):
        # files have no data in cells without lava, ground or change
        assert painted(style, 0.0)[0] == 1.0
    else:
        assert painted(style, 0.0)[0] == 0.0
    labels = [item.get('label') for item in ElementTree.parse(style).iter('item')]
    if layer.unit == 's':
        assert (labels[0], labels[-1]) == ('0 h', '20 h')


def test_style_of_the_hazard_has_its_classes(tmp_path):
    style = write_style(tmp_path / 'hazard.tif', 'hazard', np.array([[0.0, 50.0, 100.0]]))
    harmful, lethal = STYLES['hazard'].colours
    assert [painted(style, value) for value in (1.0, 50.0, 99.0)] == [(1.0, harmful)] * 3
    assert painted(style, 100.0) == (1.0, lethal)
    labels = [item.get('label') for item in ElementTree.parse(style).iter('item')]
    assert labels == ['no lava', *HAZARD_CLASSES.values()]


@pytest.mark.parametrize('name', RASTER_LAYERS)
def test_every_raster_describes_itself(name, tmp_path):
    values = np.array([[0.0, 3.0], [np.nan, 2.0]])
    origin = gis.Provenance('etna.yaml', ('steep', 'cooling'), 'draft', '9.9', 'seen.geojson')
    terrain = Terrain(np.zeros((2, 2)), 1.0)
    path, _ = gis.write_grid(tmp_path / 'map.tif', name, values, terrain, origin, {'members': '4'})
    with rasterio.open(path) as file:
        assert file.nodata == NODATA and file.descriptions == (name,)
        assert file.units == (RASTER_LAYERS[name].unit,)
        tags = file.tags()
        cells = file.read(1, masked=True)[::-1]
    assert RASTER_LAYERS[name].meaning in tags['TIFFTAG_IMAGEDESCRIPTION']
    expected = {'scene': 'etna.yaml', 'effects': 'steep cooling', 'preset': 'draft',
                'lava_ros': '9.9', 'observation': 'seen.geojson', 'members': '4'}
    assert tags.items() >= expected.items()
    dry = RASTER_LAYERS[name].drawn in ('thickness', 'change')
    np.testing.assert_array_equal(np.ma.getmaskarray(cells), [[dry, False], [True, False]])
    np.testing.assert_array_equal(cells[~cells.mask], values[~cells.mask])


def test_rejects_a_raster_that_is_not_in_the_table(tmp_path):
    terrain = Terrain(np.zeros((2, 2)), 1.0)
    with pytest.raises(LavaError, match='name is .depth., expected .*thickness'):
        gis.write_grid(tmp_path / 'a.tif', 'depth', np.ones((2, 2)), terrain, gis.Provenance('a'))


@pytest.mark.parametrize('ending', WRITTEN)
def test_vector_formats_keep_features_and_positions(ending, bag, tmp_path):
    out = tmp_path / 'out'
    exported = export_bag(bag, out, formats=[ending])
    assert sorted(exported.files) == sorted(out.iterdir())
    paths = [path for path in exported.files if path.suffix == f'.{ending}']
    found = [item for path in paths for item in load_features('--places', path)]
    areas = [item for item in found if item.kind == 'Polygon']
    (outline,) = (item for item in areas if 'time_s' not in item.properties)
    times = {float(item.properties['time_s']) for item in areas if item is not outline}
    assert times == {300.0, 600.0, 900.0}
    # a Shapefile holds names of 10 letters
    names = SHAPEFILE_NAMES if ending in ('shp', 'zip') else {}
    name = names.get('inundation_threshold_m', 'inundation_threshold_m')
    assert {float(item.properties[name]) for item in areas} == {0.1}
    name = names.get('cells_area_m2', 'cells_area_m2')
    assert float(outline.properties[name]) == 2000.0
    (ring,) = outline.on(TERRAIN).rings
    ends = [(499_950.0, 4_180_070.0), (499_990.0, 4_180_120.0)]
    np.testing.assert_allclose([ring.min(axis=0), ring.max(axis=0)], ends, atol=0.02)
    (vent,) = (item for item in found if item.kind == 'Point')
    place = np.add(VENT.position, TERRAIN.offset)
    np.testing.assert_allclose(vent.on(TERRAIN).rings[0], [place], atol=0.02)
    name = 'effusion_rate' if ending not in ('shp', 'zip') else 'effusion_r'
    assert float(vent.properties[name]) == VENT.discharge


def test_netcdf_has_all_maps(bag, tmp_path):
    export_bag(bag, tmp_path / 'out', formats=['nc', 'tif'])
    path = f'netcdf:{tmp_path / "out/maps.nc"}'
    with pytest.warns(NotGeoreferencedWarning), rasterio.open(path) as file:
        assert file.tags()['NC_GLOBAL#Conventions'].startswith('CF-')
        names = {name.rpartition(':')[2] for name in file.subdatasets}
    assert names == {*OWN_MAPS}
    with rasterio.open(f'{path}:thickness') as file:
        assert file.crs == coordinate_system(32633) and file.units == ('m',)
        assert file.tags()['crs#grid_mapping_name'] == 'transverse_mercator'
        assert float(file.tags()['crs#longitude_of_central_meridian']) == 15.0
        # not rounded to single precision
        assert float(file.tags()['crs#scale_factor_at_central_meridian']) == 0.9996
        assert float(file.tags()['crs#inverse_flattening']) == 298.257223563
        (inside,), (outside,) = file.sample([(499_952.5, 4_180_072.5), (500_100.0, 4_180_072.5)])
    assert inside == np.float32(3.26) and np.isnan(outside)
    # its variables and the file have the tags of the GeoTIFFs
    for name in OWN_MAPS:
        with (
            rasterio.open(f'{path}:{name}') as file,
            rasterio.open(tmp_path / f'out/{name}.tif') as tif,
        ):
            own = file.tags(1)
            shared = {key: value for key, value in file.tags().items() if 'NC_GLOBAL#' in key}
            tags = {key: value for key, value in tif.tags().items() if key.islower()}
        shared = {key.partition('#')[2]: value for key, value in shared.items()}
        assert {key: {**shared, **own}[key] for key in tags} == tags
        assert 'inundation_threshold_m' in own or name != 'arrival'


def test_all_maps_of_one_time_have_its_date(tmp_path):
    bag = record(
        tmp_path / 'bag', arrived=lambda time: np.where(growing(time) > 0.1, 60.0, np.nan),
        custom_data={'onset': '2021-09-19T16:00:00+02:00'},
    )
    dates = {}
    for path in export_bag(bag, tmp_path / 'out', formats=['tif']).files:
        with rasterio.open(path) as file:
            if 'simulated_time_s' in file.tags():
                dates[path.stem] = file.tags().get('date_utc')
    assert set(dates) == {'thickness', 'temperature', 'hazard', 'inundated'}
    assert set(dates.values()) == {'2021-09-19T14:13:20Z'}


def test_attributes_with_a_unit_keep_it_in_a_shapefile():
    """Two names that are cut to the same letters would also be one column."""
    terrain, cells = Terrain(np.zeros((2, 2)), 1.0), np.ones((2, 2), bool)
    known = {'inundation_threshold_m': 0.1, 'inundated_area_m2': 4.0}
    features = gis.probabilities(100.0 * cells, terrain, **known)
    features += gis.isochrones(900.0 * cells, terrain, **known)
    names = {name for item in features for name in item['properties']}
    long = {name for name in names if len(name) > 10}
    assert long == set(SHAPEFILE_NAMES)
    assert max(map(len, SHAPEFILE_NAMES.values())) <= 10
    assert len({*names - long, *SHAPEFILE_NAMES.values()}) == len(names)


@pytest.mark.parametrize('ending', WRITTEN)
def test_dates_of_isochrones_keep_their_zone(ending, tmp_path):
    bag = record(tmp_path / 'bag', custom_data={'onset': '2021-09-19T16:00:00+02:00'})
    paths = export_bag(bag, tmp_path / 'out', formats=[ending]).files
    found = [
        item.properties['date_utc'] for path in paths if path.suffix == f'.{ending}'
        for item in load_features('--places', path) if item.properties.get('time_s')
    ]
    if ending == 'geojson':
        # its reader parses dates
        text = (tmp_path / 'out/isochrones.geojson').read_text()
        found = re.findall('"date_utc": "(.*?)"', text)
    assert found == [f'2021-09-19T14:{minutes:02}:00Z' for minutes in (5, 10, 15)]


def with_hazard_text(topic: str, message: Any) -> Any:
    return String(data='lava') if topic == '/hazard' else message


def with_fewer_rows(topic: str, message: Any) -> Any:
    if topic == '/hazard':
        message.info.height -= 1
        message.data = message.data[: message.info.width * message.info.height]
    return message


def with_other_corner(topic: str, message: Any) -> Any:
    if topic == '/hazard':
        message.info.origin.position.x += 5.0
    return message


def with_infinite_values(topic: str, message: Any) -> Any:
    if topic == '/height':
        pixels = np.frombuffer(message.data, np.float32).copy()
        pixels[700] = np.inf
        message.data = pixels.tobytes()
    return message


@pytest.mark.parametrize(('change', 'topic', 'words'), [
    (with_hazard_text, '/hazard', 'the bag has std_msgs/msg/String, the layer is a nav_msgs/msg/'),
    (with_fewer_rows, '/hazard', 'a map of 40 x 29 cells fits no terrain'),
    (with_other_corner, '/hazard', r'a map at (-45, 20) in cells of 5 m fits no terrain'),
    (with_infinite_values, '/height', 'a map has infinite values'),
])
def test_layer_that_cannot_be_used_is_named(tmp_path, change, topic, words):
    source = record(tmp_path / 'source', config=RAW_CONFIG)
    sound = {item.name for item in export_bag(source, tmp_path / 'sound').files}
    path = changed(source, tmp_path / 'bag', change)
    for options, expected in (((), 1), (('--incomplete',), 0)):
        out = tmp_path / f'out{expected}'
        status, _, error = lava('export', path, '-o', out, *options)
        assert status == expected
        assert error.count(f'maps on {topic} are left out: {words}') == 1
        # the others are exported
        left = {item.name for item in out.glob('*.tif')}
        gone = {'/hazard': {'hazard.tif'}, '/height': {'thickness.tif'}}[topic]
        assert gone == (sound - left) & {'hazard.tif', 'thickness.tif'}
        assert 'temperature.tif' in left


def test_layer_of_an_earlier_terrain_is_left_out_without_damage(tmp_path):
    """The terrain changes; until the next maps, those in the bag are of the earlier terrain."""
    before = record(tmp_path / 'before', (200.0,), config=RAW_CONFIG)
    terrain = Terrain(TERRAIN.elevation[:20], 5.0, (0.0, 0.0))
    header = codec.header('map', START + SECOND // 4)
    source = BagReader(before)
    with BagWriter(tmp_path / 'bag', custom_data=source.custom_data) as writer:
        for item in source.messages():
            kind = source.topics[item.topic]
            writer.write(
                item.topic, kind.message_type, item.data, item.stamp_ns, qos=kind.qos
            )
        for name, message in outputs.terrain_messages(terrain, header).items():
            writer.write(
                f'/{name}', codec.type_name(type(message)), codec.serialise(message),
                START + SECOND // 4, qos=LATCHED,
            )
    recording = Recording(tmp_path / 'bag')
    frame = recording.frame_at()
    assert frame.elevation.shape == (20, 40) and not frame.layers
    assert not recording.bag.damage


def test_cells_around_the_terrain_are_cut_off(tmp_path):
    config = GRIDS.replace('range: [0.0, 10.0]', 'range: [0.0, 10.0], min_cells: 45')
    wide = Recording(record(tmp_path / 'wide', config=config))
    plain = Recording(record(tmp_path / 'plain', config=GRIDS))
    for frame, expected in zip(wide.frames(), plain.frames(), strict=True):
        thickness, known = (item.layers['thickness'].values for item in (frame, expected))
        np.testing.assert_array_equal(thickness, known)
    assert not wide.bag.damage
