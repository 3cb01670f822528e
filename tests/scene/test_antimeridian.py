# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Longitudes beyond 180 degrees mean the same place in every input."""

import json

import numpy as np
import pytest

from geodata import feature, write_raster
from lava_ros.errors import LavaError
from lava_ros.files.columns import angle
from lava_ros.products.pictures import _window
from lava_ros.products.run_page import Run
from lava_ros.scene import Terrain
from lava_ros.scene.features import read_features
from lava_ros.scene.on_terrain import read_raster_on
from lava_ros.scene.projection import projected, transformed
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.scene.typed_places import place_as_typed
from lava_ros.scene.vent_files import read_vents

#: A terrain of 20 km in UTM zone 1 south, across the antimeridian.
CENTRE = (180_000.0, 8_120_000.0)
TERRAIN = Terrain(
    np.full((200, 200), 100.0), 100.0, epsg=32701,
    offset=(CENTRE[0] - 10_000.0, CENTRE[1] - 10_000.0),
)
#: Two names of one meridian.
LONGITUDES = (-179.98, 180.02)
LATITUDE = -16.98
PLACE = projected(TERRAIN, LONGITUDES[0], LATITUDE)


def from_option(folder, longitude):
    return place_as_typed('--vent', f'{longitude},{LATITUDE}', TERRAIN, must_be_covered=True)


def from_letters(folder, longitude):
    text = f'{abs(longitude):.2f}{"W" if longitude < 0.0 else "E"},16.98S'
    return place_as_typed('--vent', text, TERRAIN)


def from_table(folder, longitude):
    (folder / 'a.csv').write_text(f'lon,lat,name\n{longitude},{LATITUDE},a\n')
    (row,) = read_vents('--vents', folder / 'a.csv', TERRAIN)
    return row.place


def from_places(folder, longitude):
    (folder / 'a.csv').write_text(f'lon,lat,name\n{longitude},{LATITUDE},a\n')
    (item,) = read_features('places', folder / 'a.csv', TERRAIN)
    return item.rings[0][0]


def from_geojson(folder, longitude):
    point = feature('Point', (longitude, LATITUDE))
    # without a stated system, GeoJSON has longitudes and latitudes
    text = json.dumps({'type': 'FeatureCollection', 'features': [point]})
    (folder / 'a.geojson').write_text(text)
    (item,) = read_features('places', folder / 'a.geojson', TERRAIN)
    return item.rings[0][0]


def from_raster(folder, longitude):
    values = np.zeros((41, 41), dtype=np.float32)
    values[20, 20] = 1.0
    corner = (longitude - 20.5 * 0.002, LATITUDE + 20.5 * 0.002)
    path = write_raster(folder / 'a.tif', values, cell=0.002, north_west=corner, crs='EPSG:4326')
    found = np.nan_to_num(read_raster_on(TERRAIN, path, field='--susceptibility'))
    row, column = np.unravel_index(found.argmax(), found.shape)
    assert found.max() == 1.0
    return np.add(TERRAIN.offset, (np.array([column, row]) + 0.5) * 100.0)


def from_elevation(folder, longitude):
    values = np.full((41, 41), 10.0, dtype=np.float32)
    values[20, 20] = 500.0
    corner = (longitude - 20.5 * 0.002, LATITUDE + 20.5 * 0.002)
    path = write_raster(folder / 'a.tif', values, cell=0.002, north_west=corner, crs='EPSG:4326')
    terrain = load_terrain(path, insist=True)
    assert terrain.epsg in (32701, 32760)
    ground = np.nan_to_num(terrain.elevation)
    row, column = np.unravel_index(ground.argmax(), ground.shape)
    place = np.add(terrain.corner, (np.array([column, row]) + 0.5) * terrain.resolution)
    if terrain.epsg == 32760:
        # the zone west of the antimeridian
        place = transformed('EPSG:32760', 'EPSG:32701', [place[0]], [place[1]])[:, 0]
    return place


@pytest.mark.parametrize('longitude', LONGITUDES)
@pytest.mark.parametrize('read', [
    from_option, from_letters, from_table, from_places, from_geojson, from_raster, from_elevation,
])
def test_longitudes_beyond_180_are_the_same_place(read, longitude, tmp_path):
    error = np.hypot(*np.subtract(read(tmp_path, longitude), PLACE))
    # half the diagonal of a cell of a raster
    assert error < (220.0 if read in (from_raster, from_elevation) else 1e-3)


@pytest.mark.parametrize('ends', [(179.95, 180.05), (179.95, -179.95), (-180.05, -179.95)])
def test_extent_across_the_antimeridian(ends):
    run = Run('run', '', '', {}, {}, TERRAIN, None, None)
    west, south, east, north = _window((ends[0], -17.0, ends[1], -16.9), [run])
    assert 10_000.0 < east - west < 12_000.0 and 10_000.0 < north - south < 12_000.0


@pytest.mark.parametrize('value', [361.0, -360.5, '361E', '1000'])
def test_angles_beyond_a_turn_are_refused(value):
    with pytest.raises(LavaError, match='a longitude from -360 to 360 degrees'):
        angle('lon', value, 'longitude')
