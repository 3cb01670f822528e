# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Coordinate systems without a complete EPSG code, in every output."""

from dataclasses import replace
import json
from pathlib import Path
import sys
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.crs import CRS
from rasterio.transform import from_origin
from rasterio.warp import transform

from eruption import write_grid
from geodata import feature, write_raster
from lava_ros.errors import LavaError
from lava_ros.products.export import export_bag
from lava_ros.scene import Scene, scene_to_dict
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.features import read_features
from lava_ros.scene.on_terrain import read_raster_on
from lava_ros.scene.projection import coordinate_system, projected, system_name, system_words
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.simulation.output.checkpoint import from_bytes
from recording import record, TERRAIN
from small_checkpoint import small_checkpoint

GROUND = (1000.0 + np.add.outer(np.arange(40.0), np.arange(40.0))).astype(np.float32)

#: A national grid without a code: transverse Mercator with its own origin.
NATIONAL = CRS.from_proj4(
    '+proj=tmerc +lat_0=37 +lon_0=15.2 +k=0.9999 +x_0=500000 +y_0=4100000 +ellps=GRS80 +units=m'
)

#: UTM zone 33 with a shift of the datum for Sicily, 196 m from that of the code that GDAL finds.
SHIFTED = CRS.from_proj4(
    '+proj=utm +zone=33 +ellps=intl +towgs84=-104.1,-49.1,-9.9,0.971,-2.917,0.714,-11.68 +units=m'
)

COMPOUND = CRS.from_user_input('EPSG:32633+5773')

#: A local grid without a position on Earth.
SITE = CRS.from_wkt('LOCAL_CS["quarry grid",UNIT["metre",1]]')

#: Foot and US survey foot [m].
FOOT, SURVEY_FOOT = 0.3048, 1200.0 / 3937.0


def write(path: Path, crs: Any, data: np.ndarray = GROUND, **options: Any) -> Path:
    return write_raster(path, data, crs=crs, **options)


@pytest.mark.parametrize(('crs', 'code', 'name'), [
    (COMPOUND, 32633, 'EPSG:32633'),
    (NATIONAL, None, 'unknown, no EPSG code'),
    (SITE, None, 'quarry grid, no EPSG code'),
    (SHIFTED, None, 'unknown, no EPSG code'),
    (CRS.from_epsg(32633), 32633, 'EPSG:32633'),
])
def test_keeps_the_system_of_a_file(tmp_path, crs, code, name):
    terrain = load_terrain(write(tmp_path / 'a.tif', crs))
    np.testing.assert_array_equal(terrain.elevation, GROUND[::-1])
    assert (terrain.epsg, terrain.offset) == (code, (500_000.0, 4_179_600.0))
    assert system_name(terrain.epsg, terrain.wkt) == name
    if crs == CRS.from_epsg(32633):
        assert terrain.wkt is None
    else:
        assert terrain.wkt is not None and CRS.from_wkt(terrain.wkt) == crs
    expected = CRS.from_epsg(code) if code else crs
    assert coordinate_system(terrain.epsg, terrain.wkt) == expected


def test_compound_system_without_codes_has_a_horizontal_part(tmp_path):
    _, name, heights = COMPOUND.to_wkt().partition('VERT_CS')
    wkt = f'COMPD_CS["local heights",{NATIONAL.to_wkt()},{name}{heights}'
    terrain = load_terrain(write(tmp_path / 'a.tif', CRS.from_wkt(wkt)))
    assert terrain.epsg is None and terrain.wkt is not None and 'EGM96' in terrain.wkt
    found = coordinate_system(terrain.epsg, terrain.wkt)
    assert 'EGM96' not in found.to_wkt()
    (x,), (y,) = transform('EPSG:4326', NATIONAL, [15.2], [37.7])
    assert projected(terrain, 15.2, 37.7) == pytest.approx((x, y), abs=1e-3)


@pytest.mark.parametrize(
    'crs', [COMPOUND, NATIONAL, SHIFTED], ids=['compound', 'national', 'own shift of the datum']
)
def test_transforms_places_in_degrees(tmp_path, crs):
    terrain = load_terrain(write(tmp_path / 'a.tif', crs))
    middle = (500_200.0, 4_179_800.0)
    flat = CRS.from_epsg(32633) if crs == COMPOUND else crs
    (longitude,), (latitude,) = transform(flat, 'EPSG:4326', *([value] for value in middle))
    assert projected(terrain, longitude, latitude) == pytest.approx(middle, abs=1e-3)
    file = tmp_path / 'a.geojson'
    file.write_text(json.dumps(feature('Point', [longitude, latitude])))
    (found,) = read_features('--vents', file, terrain)
    np.testing.assert_allclose(found.rings[0], [middle], atol=1e-3)
    values = read_raster_on(terrain, write(tmp_path / 'b.tif', crs), field='x')
    np.testing.assert_array_equal(values, GROUND[::-1])


def test_raster_on_a_terrain_has_the_scale_of_its_band(tmp_path):
    terrain = load_terrain(write(tmp_path / 'a.tif', CRS.from_epsg(32633)))
    percent = np.full(GROUND.shape, 250, np.int16)
    percent[0, 0] = -1
    path = write_raster(tmp_path / 'b.tif', percent, nodata=-1, scale=(0.1, 5.0))
    values = read_raster_on(terrain, path, field='x')
    assert np.isnan(values[-1, 0]) and np.nanmin(values) == np.nanmax(values) == 30.0


def test_error_names_a_local_system_without_longitudes(tmp_path):
    terrain = load_terrain(write(tmp_path / 'a.tif', SITE))
    with pytest.raises(LavaError, match='the domain of quarry grid, no EPSG code'):
        projected(terrain, 15.0, 37.0)


@pytest.mark.parametrize('crs', [COMPOUND, NATIONAL, SITE, CRS.from_epsg(32634)])
def test_epsg_code_replaces_the_system_of_a_file(tmp_path, crs, caplog):
    terrain = load_terrain(write(tmp_path / 'a.tif', crs), epsg=32633)
    assert terrain.epsg == 32633
    is_same = crs == COMPOUND
    assert ('EPSG:32633 as given, although the file states' in caplog.text) != is_same
    assert (terrain.wkt is not None) == is_same


def test_unknown_epsg_code_is_refused_without_a_warning(tmp_path, caplog):
    with pytest.raises(LavaError, match='epsg is 5000, expected a coordinate system that GDAL'):
        load_terrain(write(tmp_path / 'a.tif', NATIONAL), epsg=5000)
    assert not caplog.records


def test_rejects_a_metric_code_for_a_file_in_degrees(tmp_path):
    path = write(tmp_path / 'a.tif', 'EPSG:4326')
    assert load_terrain(path, epsg=32633).resolution == 10.0
    with rasterio.open(path, 'r+') as file:
        file.transform = from_origin(15.0, 37.0, 1e-4, 1e-4)
    with pytest.raises(LavaError, match='a system in degrees: cells are 0.0001 wide'):
        load_terrain(path, epsg=32633)
    assert load_terrain(path, epsg=4258).epsg == 32633


def test_stored_terrains_keep_the_system(tmp_path, monkeypatch):
    """Files without a definition remain readable."""
    terrain = load_terrain(write(tmp_path / 'a.tif', NATIONAL))
    stored = scene_to_dict(Scene(terrain))['terrain']
    assert stored['wkt'] == terrain.wkt
    plain = small_checkpoint(1.0, 5)
    assert b'"wkt"' not in plain.to_bytes()
    assert from_bytes(plain.to_bytes()).scene.terrain.wkt is None
    placed = replace(plain, scene=replace(plain.scene, terrain=replace(
        plain.scene.terrain, epsg=None, wkt=terrain.wkt
    )))
    assert from_bytes(placed.to_bytes()).scene.terrain.wkt == terrain.wkt
    np.savez(tmp_path / 'a.npz', elevation=GROUND, resolution=10.0, wkt=str(terrain.wkt))
    # neither needs GDAL
    monkeypatch.setitem(sys.modules, 'rasterio', None)
    assert load_terrain(tmp_path / 'a.npz').wkt == terrain.wkt
    assert system_words(None, terrain.wkt) == 'unknown, no EPSG code'


def test_new_ground_in_another_system_without_a_code_is_refused():
    ground = replace(TERRAIN, epsg=None, wkt=NATIONAL.to_wkt())
    event = TerrainEvent(10.0, 'new ground', ground)
    assert Scene(ground, events=(event,)).events
    other = replace(event, terrain=replace(ground, wkt=SITE.to_wkt()))
    with pytest.raises(LavaError, match=r'events\[0\]\.terrain is .* the previous ground'):
        Scene(ground, events=(other,))


def test_maps_of_a_bag_have_its_system(tmp_path, caplog):
    bag = record(
        tmp_path / 'bag', times=(200.0,),
        terrain=replace(TERRAIN, epsg=None, wkt=NATIONAL.to_wkt()),
    )
    exported = export_bag(bag, tmp_path / 'own', maps=['thickness'])
    with rasterio.open(exported.files[0]) as file:
        assert file.crs == NATIONAL
        assert file.bounds.left == 499_950.0
    assert not caplog.records
    exported = export_bag(bag, tmp_path / 'other', maps=['thickness'], epsg=32633)
    assert 'EPSG:32633 as given, although the bag states unknown' in caplog.text
    with rasterio.open(exported.files[0]) as file:
        assert file.crs.to_epsg() == 32633
        assert file.bounds.left == 499_950.0


@pytest.mark.parametrize('suffix', ['FEET', 'feet', 'METERS', 'NO'])
def test_reads_the_unit_of_an_old_prj_file(tmp_path, suffix):
    write_grid(tmp_path / 'a.asc', GROUND, cell=10.0)
    (tmp_path / 'a.prj').write_text(
        'Projection UTM\nZone 33\nDatum WGS84\nUnits METERS\nParameters\nZunits ' + suffix
    )
    factor = FOOT if suffix.lower() == 'feet' else 1.0
    elevation = load_terrain(tmp_path / 'a.asc').elevation
    np.testing.assert_allclose(elevation, factor * GROUND, rtol=1e-6)


@pytest.mark.parametrize(('crs', 'unit', 'factor'), [
    ('EPSG:32633', 'ft', FOOT),
    ('EPSG:32633', 'US survey foot', SURVEY_FOOT),
    ('EPSG:32633', 'm', 1.0),
    ('EPSG:32633', 'cm', 0.01),
    # heights in feet, and in US survey feet
    ('EPSG:32633+8228', None, FOOT),
    ('EPSG:32633+6360', None, SURVEY_FOOT),
    ('EPSG:32633+8228', 'foot', FOOT),
])
def test_converts_heights_to_metres(tmp_path, crs, unit, factor, caplog):
    caplog.set_level('INFO')
    stored = GROUND.copy()
    stored[0, 0] = -9999.0
    terrain = load_terrain(write(tmp_path / 'a.tif', crs, stored, unit=unit, nodata=-9999.0))
    expected = np.where(stored == -9999.0, np.nan, factor * GROUND)
    np.testing.assert_allclose(terrain.elevation, expected[::-1], rtol=1e-6)
    assert ('become metres' in caplog.text) == (factor != 1.0)
    assert (terrain.epsg, terrain.wkt) == (32633, None)


@pytest.mark.parametrize(('crs', 'unit', 'value'), [
    ('EPSG:32633', 'fathom', 'fathom'),
    ('EPSG:32633+8228', 'm', 'foot and m'),
    # mean sea level, depths
    ('EPSG:32633+5715', None, 'metre of depth'),
])
def test_rejects_unknown_and_contradictory_units(tmp_path, crs, unit, value):
    with pytest.raises(LavaError, match=f'unit of the elevations of a.tif is .{value}.'):
        load_terrain(write(tmp_path / 'a.tif', crs, unit=unit))
